"""Equilibrium in one compiled call: assembly, factorisation, solve and update, iterated to convergence.

The same function serves the full model, the reduced one (condensed joints), training and the conventional
solver. Convergence is scale-free (design section 5): at every node |R| <= rtol sum |f_e| + 10 eps (EA/L) max|x|,
for forces and moments apart, the same for the inner residual of every member, and constraint gaps to rounding.
In the stiff directions of thin leafs rounding may exceed that bound: a residual up to a thousand times larger is accepted
(`settled`) when the last Newton step moved nothing by more than 1e-7 of the size, turned nothing by more than 1e-6 rad, and
no longer lowered the residual. Without the last condition forces of taut leafs were off by 5e-5: nodes that stand still say
nothing of the insides of leafs, and what leaves positions right to 1e-14 is still a force in a stiff one.
"""

from __future__ import annotations

import math

from ksd.model.blank import System, blank_system
from ksd.model.system import assemble_apart, largest_move, largest_turn, solve_step, take_step
from ksd.model.turning import turn_step, turning
from ksd.numerics.held import Kind, address_of, found_at
from ksd.numerics.kernel import kernel, late
from ksd.numerics.local import local_vector

GRAIN = 10.0
"""Multiples of rounding in the residual bounds."""
LOOSE = 1000.0
"""How far the residual may exceed its bound when the last step was negligible."""
STALLED = 0.1
"""Residual over that before the step from which on steps no longer lower it."""

CONVERGED, TOO_MANY, LOCAL_ANGLE, SINGULAR, DIVERGED, NOT_FINITE = 0, 1, 2, 3, 4, 5


@kernel(inline="always")
def settled(worst, before, moved):
    """Whether Newton is done. worst, before: residual over its bound now and before the last step; moved: that step over
    what is negligible."""
    return worst <= 1.0 or (worst <= LOOSE and moved <= 1.0 and worst > STALLED * before)


@kernel
def _iterate(address, arrays, motion, factor, work, rtol, most, cap, blow_up):
    """See `iterate`; address: of the same arrays, for assembly, which is compiled apart too."""
    seen = local_vector(4)
    negatives, pivot = 0, 1.0
    worst, before, moved = math.inf, math.inf, math.inf
    # a variable, not the literal 0, for which numba would compile `assemble` a second time
    near = 0 * most
    turn = turning(arrays.loads, arrays.start) > 0
    for n in range(most + 1):
        # a load too small to rise above rounding still gets one step: at first the bounds have no grain
        assemble_apart(address, factor, rtol, near, GRAIN if n > 0 else 0.0, seen.ctypes)
        worst, inside, status = seen[0], int(seen[2]), int(seen[3])
        if not math.isfinite(worst):
            return NOT_FINITE, n, worst, negatives, pivot
        if worst <= 1.0 or (worst <= LOOSE and moved <= 1.0):
            # the inertia belongs to the converged state
            negatives, pivot = solve_step(arrays, work)
            if worst > 1.0 and pivot > 0.0:
                # its factors also lead the rest of the way, too short to count as a step
                if turn:
                    turn_step(address, factor)
                take_step(arrays, motion, work.rhs, work, 1.0)
                before = worst
                assemble_apart(address, factor, rtol, near, GRAIN, seen.ctypes)
                worst, inside, status = seen[0], int(seen[2]), int(seen[3])
                if not settled(worst, before, moved):
                    continue
            # a leaf with a replaced tiny pivot or a folded angle is no answer, however small the residual
            reason = LOCAL_ANGLE if status == 1 else (SINGULAR if status == 2 else CONVERGED)
            return reason, n, worst, negatives + inside, pivot
        if n == most:
            break
        if n > 0 and math.isfinite(blow_up):
            s = 0.0
            for i in range(len(work.rhs)):
                s += work.rhs[i] * work.rhs[i]
            if math.sqrt(s) > blow_up:
                return DIVERGED, n, worst, negatives, pivot
        negatives, pivot = solve_step(arrays, work)
        negatives += inside
        if not pivot > 0.0:
            return SINGULAR, n, worst, negatives, pivot
        if turn:
            turn_step(address, factor)
        before, scale = worst, 1.0
        if n > 0:
            largest = largest_turn(arrays, work.rhs)
            if largest > cap:
                scale = cap / largest
        moved = max(
            largest_turn(arrays, work.rhs) / 1e-6, largest_move(arrays, work.rhs) / (1e-7 * arrays.size)
        )
        take_step(arrays, motion, work.rhs, work, scale)
    return TOO_MANY, most, worst, negatives, pivot


_KIND = Kind(blank_system())


@late("void(int64, float64, float64, int64, float64, float64, CPointer(float64))")
def iterate_apart(address, factor, rtol, most, cap, blow_up, out):
    """`iterate` on the `System` at `address`; out (5,) is what it returns."""
    s = found_at(address, _KIND)
    out[0], out[1], out[2], out[3], out[4] = _iterate(
        address, s.arrays, s.motion, factor, s.work, rtol, most, cap, blow_up
    )


@kernel(needs=("iterate_apart",))
def iterate(arrays, motion, target, factor, work, rtol, most, cap, blow_up):
    """Newton to equilibrium at the drive values `target` (c,) and load `factor`, in place.

    The first step (the predictor) is taken whole; later ones are scaled so that no node turns more than `cap` rad.
    `blow_up`: stop when the residual norm exceeds it (the eps_max of Appendix B); inf switches it off.
    Local angles beyond 60 degrees may pass on the way; a converged state that has one is refused.
    Returns (reason, steps taken, residual over its bound, negative pivots, smallest relative pivot).
    """
    out = local_vector(5)
    at = address_of(System(arrays, motion, target, work), _KIND)
    iterate_apart(at, factor, rtol, most, cap, blow_up, out.ctypes)
    return int(out[0]), int(out[1]), out[2], int(out[3]), out[4]
