"""Whether a result can be trusted: all checks of it, in this order.

1. `stability_verdict`: the state is a minimum of energy, judged by the inertia of the tangent and by how far leaf springs
   turn per quadrature point.
2. `branch_verdict`: load steps left no doubt (`ksd.solvers.load_steps`), and every joint is near the motion that its
   record describes.
3. `compare_with_load_steps`: where loads do much of the work, load steps end in the same state as the five steps.
4. `with_mesh_check`: the curvature modes of the mesh suffice for the state.
5. `check_trained_range`: every joint is within the range its record was trained on.
6. `solved_verdict`: the equations converged, 1 and 2 hold, and the error is smaller than the result.
7. `strength_verdict`: strain and stress are within what a linear elastic beam and its material allow.
8. `error_verdict`: the estimated error against the model, and what effects would change that the model leaves out, are
   within MAX_TRUSTED_ERROR.

`trust_verdicts` collects the verdicts (`Configuration.trust`). `refusal` is the sentence with which `ksd.solve` refuses
what is not solved (`require_solved` raises it); sweeps, batches, gradients and jobs refuse the same poses with the same
sentence.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ksd.answers.doctor import doctor
from ksd.answers.printing import format_number, format_signed_percent
from ksd.answers.strength import unusual_values
from ksd.errors import ConvergenceError, RangeError, TrustError
from ksd.model.arrays import carries_load
from ksd.model.mesh import MAX_ORDER
from ksd.scene.rules import plane_hint
from ksd.solvers.branch_check import loads_dominate
from ksd.solvers.estimated_result import Estimated, EstimatedResult
from ksd.solvers.joint_range import MAX_UNINTENDED_DISPLACEMENT, MAX_UNINTENDED_ROTATION
from ksd.solvers.load_steps import state_difference
from ksd.solvers.steps import EITHER_SIDE, ErrorEstimate, Stop, Verdict, equilibrium_iterations, percent

if TYPE_CHECKING:
    from ksd.solvers.five_steps import FiveStepsStorage

NOT_SOLVED, NOT_TRUSTED = "not solved: ", "not to be trusted: "
"""How the sentence of a verdict begins that says no."""
NEGLIGIBLE_DISPLACEMENT = 1e-3
"""Error of a link position, over the size of the mechanism, that is accepted however small the displacements are."""
MAX_TURN_PER_POINT = np.deg2rad(60.0)
"""Turn of a strain-mode leaf per quadrature point [rad] above which the inertia of the tangent is not reliable."""
EQUAL_STATE_TOLERANCE, REDUCED_STATE_TOLERANCE = 1e-5, 0.02
"""Largest difference of equal states (positions over the size, rotations [rad]): of exact ones, and with a reduced one."""
MAX_TRUSTED_ERROR = 0.1
"""Relative error, or change by an effect left out, above which nothing is trusted unless a coarser accuracy is asked for."""
EFFECT_NAMES = {"plate": "plate stiffening", "warping": "restrained warping"}
"""Effects that a model can leave out, as they are printed; others by their own name."""
NEGLIGIBLE_EFFECT = 1e-5
"""Relative change by an effect left out below which it is not told."""
ERROR_QUANTITIES = ("force", "displacement")
"""What the relative error of a result is of, among the quantities that effects change."""
MAX_HIGHEST_MODE_SHARE = 0.05
"""Energy share of a leaf in its highest mode above which its curvature is not resolved."""
NEGLIGIBLE_ENERGY_SHARE = 1e-3
"""Share of that mode in the energy of the whole mechanism up to which this does not matter."""


@dataclass(frozen=True)
class Trust:
    """The verdicts on a configuration.

    stable: it is a minimum of energy; branch: it is on the branch that leads from rest by the intended motions; strength: a
    linear elastic beam can be in this state; trusted: all three, converged, and with an error of 10 % at most (or
    the accuracy asked for), which the sentence states, as it does effects left out that change more than that accuracy.
    """

    stable: Verdict
    branch: Verdict
    strength: Verdict
    trusted: Verdict

    def __str__(self) -> str:
        sentences = ((f"{name}: ", verdict.sentence) for name, verdict in vars(self).items())
        return "\n".join(name + sentence.removeprefix(name) for name, sentence in sentences)


def stability_verdict(c: EstimatedResult) -> Verdict:
    """Whether the state is a minimum of energy under the held drives."""
    reason = _over_rolled_leaf(c)
    return Verdict(False, f"NOT CERTAIN: {reason}") if reason else Verdict(c.stable, stability_sentence(c))


def stability_sentence(c: EstimatedResult) -> str:
    """Whether the state is stable, and why, in one sentence."""
    if _is_moving(c):
        return "in motion, no equilibrium"
    surplus = c.negatives - c.expected_negatives
    flutter_check = c.nonconservative_stability
    if flutter_check is not None and (surplus == 0 or (surplus > 0 and not flutter_check)):
        return flutter_check.sentence
    if surplus == 0:
        return "stable: a minimum of energy under the held drives"
    hint = plane_hint(c.model.scene)
    hint = f"; {hint}" if hint else ""
    if surplus > 0:
        directions = "one direction" if surplus == 1 else f"{surplus} directions"
        return (
            f"UNSTABLE: the mechanism would leave this state by itself in {directions}{hint}; {EITHER_SIDE}"
        )
    return (
        f"NOT CERTAIN: {c.negatives} negative pivots where the drives and supports explain {c.expected_negatives}; "
        f"two of them may prescribe the same freedom{hint}"
    )


def _is_moving(c: EstimatedResult) -> bool:
    return c.steps[-1].stop is Stop.MOVING


def _over_rolled_leaf(c: EstimatedResult) -> str:
    """A sentence about the strain-mode leaf that turns too far for its quadrature points; empty where none does.

    At two full turns on 7 points a saddle, as finer leaf springs and chains of 40 elements show, counted as a minimum.
    """
    if c.mesh_adequacy.turn_per_point < MAX_TURN_PER_POINT:
        return ""
    members, inner, worst = c.model.arrays.members, c.motion.inner, ("", 0.0, 1)
    for i in c.model.strain_leaves:
        nx, ny, _, points = members.number[i, :4].tolist()
        constant = inner[members.inner_at[i] + np.array([0, nx, nx + ny])]
        turn = float(np.linalg.norm(constant) * members.length[i])
        if turn / points > worst[1] / worst[2]:
            worst = (c.model.member_names[i], turn, points)
    name, turn, points = worst
    return (
        f"leaf '{name}' turns {np.rad2deg(turn):.0f} degrees from end to end, too much for {points} quadrature points; "
        f"give a mesh with {int(np.ceil(turn / MAX_TURN_PER_POINT)) + 1} or more"
    )


def branch_verdict(c: EstimatedResult) -> Verdict:
    """Whether the state is on the branch that leads from rest by the intended motions of the joints."""
    if c.doubts:
        return Verdict(False, "another branch is possible: " + "; ".join(c.doubts))
    if _is_moving(c):
        return Verdict(True, "that of the motion")
    name, share, shift, turn = _joint_furthest_off(c)
    turned = format_number(float(np.rad2deg(turn)), 3, zero=1e-9)
    off = f"joint '{name}' is {1e3 * shift:.3g} mm and {turned} degrees off its intended motion"
    if share > 1.0 and c.method not in ("conventional", "constant"):
        return Verdict(False, f"{off}: too far to be the state its record describes")
    if name:
        return Verdict(True, f"the branch of the intended motions: at most, {off}")
    way = c.steps[-1].note.split(",")[0] or c.method
    return Verdict(True, f"reached from where it started ({way}), nothing speaks against it")


def _joint_furthest_off(c: EstimatedResult) -> tuple[str, float, float, float]:
    """The joint furthest off its intended motion: name, share of the limit, displacement [m], rotation [rad]; name "" where
    no joint is known."""
    worst = ("", 0.0, 0.0, 0.0)
    for placed in c.model.scene.joints:
        off = c.unintended.get(placed.name)
        if off is None:
            continue
        x, y, z, *turned = off.tolist()
        shift, turn = math.hypot(x, y, z), math.hypot(*turned)
        if not shift < placed.joint.length:
            # the nearest intended motion was not found, so the offset means nothing
            continue
        share = max(
            shift / (MAX_UNINTENDED_DISPLACEMENT * placed.joint.length), turn / MAX_UNINTENDED_ROTATION
        )
        if share > worst[1] or not worst[0]:
            worst = (placed.name, share, shift, turn)
    return worst


def needs_load_step_check(found: EstimatedResult) -> bool:
    """Whether a result of the five steps must be compared with load steps, because loads do much of the work."""
    if found.method not in ("reduced", "full") or not carries_load(found.model.arrays):
        return False
    target = found.model.targets(found.targets)
    return loads_dominate(found.model, found.motion, target, equilibrium_iterations(found.steps))


def compare_with_load_steps(
    found: Estimated, solve_by_load_steps: Callable[[], Estimated]
) -> tuple[str, Estimated | None]:
    """Compare a result with that of load steps.

    Returns the doubt in one sentence, empty where both end in the same state, and the result of the load steps, None where
    that is not solved.
    """
    try:
        other = solve_by_load_steps()
    except ConvergenceError as reason:
        return f"loads do much of the work, and load steps do not confirm it: {reason}", None
    verdict = solved_verdict(other)
    if not verdict:
        return f"loads do much of the work, and load steps do not confirm it: {verdict}", None
    difference = state_difference(found.model, found.motion, other.motion)
    error, size = found.method_error, found.model.arrays.size
    own = 0.0 if error is None else 3.0 * max(error.displacement / size, error.rotation)
    own = own if own < math.inf else 0.0
    if difference <= (EQUAL_STATE_TOLERANCE if error is None else max(REDUCED_STATE_TOLERANCE, own)):
        return "", other
    energy, theirs = (sum(c.strain_energy().values()) for c in (found, other))
    return (
        f"loads do much of the work, and load steps end in another minimum (strain energy {theirs:.4g} J, here "
        f"{energy:.4g} J)"
    ), other


def with_mesh_check(found: Estimated, wanted: float) -> Estimated:
    """The result with the accuracy that is `wanted`, a note where a leaf has more than that of its energy in its highest
    modes, and a doubt where its curvature is not resolved and the leaf matters."""
    share, where, axis, _ = found.mesh_adequacy
    if wanted != found.accuracy:
        found = replace(found, accuracy=wanted)
    if share <= wanted:
        return found
    more = "raise the orders of the mesh"
    if found.model.mesh.orders[axis] >= MAX_ORDER:
        more = "more are not possible; a chain is finer, ksd.Mesh(leaf='corotational', elements=80)"
    about = ("torsion", "strong bending", "weak bending")[axis]
    note = (
        f"leaf '{where}' has {100 * share:.2g} % of its energy in its highest {about} mode; "
        f"the curvature modes {found.model.mesh.orders} are few for this state: {more}"
    )
    found = replace(found, notes=(*found.notes, note))
    if share > MAX_HIGHEST_MODE_SHARE:
        energy = found.strain_energy()
        if share * energy[where] > NEGLIGIBLE_ENERGY_SHARE * sum(energy.values()):
            found = replace(found, doubts=(*found.doubts, note))
    return found


def check_trained_range(b: FiveStepsStorage, theta: np.ndarray, *, extrapolate: bool) -> list[str]:
    """Check motions theta (q,) against the trained ranges. Returns warnings where `extrapolate`, else raises RangeError."""
    warnings = []
    for k, (name, value, scale) in enumerate(
        zip(b.bodies.motion_names, theta, b.bodies.motion_scale, strict=True)
    ):
        if b.limits[k, 0] <= value <= b.limits[k, 1]:
            continue
        excess = _range_sentence(name, value, *b.bodies.motion_range[k], scale=scale)
        if not extrapolate:
            raise RangeError(
                f"{excess}; ask for less, or pass extrapolate=True (--extrapolate) to use the functions beyond it"
            )
        warnings.append(f"{excess}; extrapolated")
    return warnings


def _range_sentence(name: str, value: float, low: float, high: float, *, scale: float) -> str:
    """How far a motion exceeds its trained range from low to high; scale: from the motion to rad (1) or m."""
    if scale == 1.0:
        v, a, b = np.rad2deg([value, low, high])
        return f"joint '{name}' would turn {v:.6g} degrees, outside its trained range of {a:.4g} to {b:.4g} degrees"
    v, a, b = 1e3 * scale * np.array([value, low, high])
    return f"joint '{name}' would move {v:.6g} mm, outside its trained range of {a:.4g} to {b:.4g} mm"


def is_solved(c: EstimatedResult) -> bool:
    """Whether `solved_verdict` is yes; the verdict is formed only where that is not evident."""
    return _is_evidently_solved(c) or bool(solved_verdict(c))


def solved_verdict(c: EstimatedResult) -> Verdict:
    """Whether the equations are solved, at a minimum and on the intended branch; leaves aside strain, stress and the
    error of the mesh."""
    return _verdict_with_error(c, stability_verdict(c), branch_verdict(c), c.method_error)


def _verdict_with_error(
    c: EstimatedResult, minimum: Verdict, branch: Verdict, error: ErrorEstimate | None
) -> Verdict:
    """See `solved_verdict`. error: the total error, or that of the method alone."""
    if not c.converged:
        return Verdict(False, f"{NOT_SOLVED}{c.steps[-1].stop.sentence}")
    if not minimum:
        return Verdict(False, NOT_TRUSTED + "; ".join([str(minimum), *c.doubts]))
    if not branch:
        return Verdict(False, f"{NOT_TRUSTED}{branch}")
    if error is not None and error.mesh == math.inf:
        return Verdict(
            True,
            "trusted but for the error of its mesh: Newton steps find no equilibrium next to it on a finer one",
        )
    if error is not None and _exceeds_result(c, error):
        reason = (
            f"its estimated error is {percent(error.relative)} %"
            if math.isfinite(error.relative)
            else "corrector steps of the full model grow from one to the next or end at no state of its kind, so its error "
            "is not known"
        )
        return Verdict(False, f"{NOT_TRUSTED}{reason}")
    if error is None and c.model.solids:
        return Verdict(
            True, "trusted but for the bases of its solids, whose error was not estimated (ksd.solve does)"
        )
    if c.method_error is not None and error is not None:
        return Verdict(True, "trusted")
    return Verdict(True, f"trusted: {c.steps[-1].reason}, it is a minimum, and the branch is the one meant")


def _exceeds_result(c: EstimatedResult, e: ErrorEstimate) -> bool:
    """Whether the error is larger than the result, and not only because the displacements are negligible."""
    negligible = e.displacement <= NEGLIGIBLE_DISPLACEMENT * c.model.arrays.size and c.method != "constant"
    return not (e.relative <= 1.0 or negligible)


def strength_verdict(c: EstimatedResult) -> Verdict:
    """Whether a linear elastic beam can be in this state."""
    found = c.strength if c.converged or _is_moving(c) else None
    if found is None:
        return Verdict(True, "strain and stress are not known")
    return Verdict(not found.beyond, "; ".join(filter(None, [str(found), found.beyond])))


def trust_verdicts(c: EstimatedResult) -> Trust:
    """All verdicts on a configuration."""
    minimum, branch, beam = stability_verdict(c), branch_verdict(c), strength_verdict(c)
    trusted = _verdict_with_error(c, minimum, branch, c.error)
    if trusted:
        trusted = error_verdict(c, trusted)
    if trusted and not beam and c.strength is not None:
        trusted = Verdict(False, f"{NOT_TRUSTED}{c.strength.beyond}")
    return Trust(minimum, branch, beam, trusted)


class Uncertainty(NamedTuple):
    """Relative error of forces and poses: the larger of that against the model and of the largest change by an effect that
    the model leaves out.

    relative: inf where the error is not known, nan where none was estimated and no effect changes anything. effect,
    quantity: the effect, and what it changes most; "" where the error against the model is the larger one.
    """

    relative: float
    effect: str = ""
    quantity: str = ""


def uncertainty(c: EstimatedResult) -> Uncertainty:
    """The relative error of forces and poses, see `Uncertainty`."""
    own = math.nan if c.error is None else c.error.relative
    changes = (
        Uncertainty(abs(change), effect, quantity)
        for effect, row in c.left_out.items()
        for quantity, change in row.items()
        if quantity in ERROR_QUANTITIES and change != 0.0
    )
    largest = max(changes, key=lambda change: change.relative, default=Uncertainty(own))
    # negated, so that an effect counts where the error was not estimated
    return Uncertainty(own) if own >= largest.relative else largest


def error_verdict(c: EstimatedResult, verdict: Verdict) -> Verdict:
    """A verdict that is yes so far, with the error against the model and the effects left out that change more than the
    accuracy asked for; no where one of them is above MAX_TRUSTED_ERROR."""
    effects = []
    for name, row in c.left_out.items():
        # beside a change ten times as large, the list of effects left out tells it
        least = max(c.accuracy, 0.1 * max(map(abs, row.values()), default=0.0))
        shares = [
            f"{quantity.replace('_', ' ')} {format_signed_percent(100 * change)} %"
            for quantity, change in row.items()
            if abs(change) > least
        ]
        effects += (
            [f"{EFFECT_NAMES.get(name, name.replace('_', ' '))} ({', '.join(shares)})"] if shares else []
        )
    left_out = f"its model leaves out {' and '.join(effects)}" if effects else ""
    largest, error, bound = uncertainty(c), c.error, max(MAX_TRUSTED_ERROR, c.accuracy)
    own = "" if error is None else f"an estimated error of {percent(error.relative)} %"
    if error is not None and bound < error.relative < math.inf:
        also = f"; {left_out}" * bool(left_out)
        sentence = f"its estimated error is {percent(error.relative)} %, more than {percent(bound)} %{also}"
        return Verdict(False, NOT_TRUSTED + sentence)
    if largest.effect and largest.relative > bound:
        against = f"; {own} against it" * bool(own)
        return Verdict(False, f"{NOT_TRUSTED}{left_out}, more than {percent(bound)} %{against}")
    if error is None or error.mesh == math.inf:
        return replace(verdict, sentence=f"{verdict}{f'; {left_out}' * bool(left_out)}")
    comma = "," if ": " in verdict.sentence else ""
    within = f"within {own}"
    if largest.effect and largest.relative > c.accuracy:
        within = f"within {percent(largest.relative)} %: {left_out}; {own} against it"
    elif left_out or (largest.effect and largest.relative > NEGLIGIBLE_EFFECT):
        within = f"within {percent(largest.relative)} %, of which {own} against its model"
        within += f"; {left_out}" * bool(left_out)
    return Verdict(True, f"{verdict}{comma} {within}")


def refusal(c: EstimatedResult) -> str:
    """Why a configuration is refused unless strict=False, in one sentence; empty where it is solved.

    Strain and stress are not checked: that would take longer than the Newton steps of a prepared solve.
    """
    if _is_evidently_solved(c):
        return ""
    verdict = solved_verdict(c)
    if verdict:
        return ""
    minimum = f"; {c.minimum}" * bool(c.minimum)
    hint = "strict=False (in Python) returns the state all the same"
    if c.far_drives:
        # the likely cause, instead of what follows from it
        return f"{'; '.join(c.far_drives)} As it is, the pose is {verdict.sentence.partition(';')[0]}; {hint}"
    unusual = "" if c.stable else "".join(f"; {sentence}" for sentence in unusual_values(c.model))
    return f"{verdict}{minimum}{_conflicting_drives(c)}{unusual}; {hint}"


def require_solved(c: Estimated) -> Estimated:
    """The configuration itself if it is solved; else TrustError with its `refusal`, and the configuration as `result`."""
    reason = refusal(c)
    if reason:
        raise TrustError(reason, reached=1.0, result=c)
    return c


def _is_evidently_solved(c: EstimatedResult) -> bool:
    """Whether the configuration is solved without doubt, by what is known without further computation."""
    # the conventional solver does not depend on the records of the joints
    on_branch = c.joints_near_intended or c.method in ("conventional", "constant")
    solved = on_branch and c.stable and not c.doubts and c.converged
    return solved and (c.method_error is None or c.method_error.relative <= 1.0) and not _over_rolled_leaf(c)


def _conflicting_drives(c: EstimatedResult) -> str:
    """A clause about drives that conflict with each other, or in a singular position; empty where there are none."""
    if c.stable or not c.model.drive_names:
        return ""
    redundant = doctor(c.model.original_scene).redundant
    several = len(c.model.drive_names) > 1
    return "".join(
        f"; {r.sentence}" for r in redundant if r.what.startswith("drive ") and (several or r.free)
    )
