"""Whether an answer can be believed: a minimum of energy, on the branch the designer means, solved to its bound.

A residual of zero proves equilibrium and nothing more. What else is looked at: the inertia of the tangent, the doubts
that `ksd.solve.load_steps` could not clear up, and how far every joint is from its intended motion, where its record is
there. Each verdict is a truth value and a sentence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ksd.errors import TrustError
from ksd.model.arrays import STRAIN
from ksd.model.compile import Model
from ksd.properties.doctor import doctor
from ksd.properties.kept import per_model
from ksd.solve.near import FAR_SHIFT, FAR_TURN
from ksd.solve.steps import ErrorEstimate

if TYPE_CHECKING:
    from ksd.solve.configuration import Configuration

SLIGHT = 1e-3
"""Error of a link position, over the size of the mechanism, that is small however small the answer."""
MOST_GAP = np.deg2rad(60.0)
"""Turn of a strain-mode leaf per quadrature point [rad] beyond which its inertia is not to be relied on."""


@dataclass(frozen=True)
class Verdict:
    """Yes or no, and why in one sentence."""

    yes: bool
    sentence: str

    def __bool__(self) -> bool:
        return self.yes

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True)
class Trust:
    """stable: a minimum of energy; branch: the one that leads here from rest; strength: a linear elastic beam can be in
    this state; trusted: all three, and converged."""

    stable: Verdict
    branch: Verdict
    strength: Verdict
    trusted: Verdict

    def __str__(self) -> str:
        return "\n".join(f"{n}: {v.sentence}" for n, v in vars(self).items())


class _Turning(NamedTuple):
    """Strain-mode leafs: member, places (3, m) of the constant modes about x, y, z, length [m], quadrature points."""

    strain: np.ndarray
    at: np.ndarray
    length: np.ndarray
    points: np.ndarray


@per_model
def _turning(model: Model) -> _Turning:
    members = model.arrays.members
    strain = np.flatnonzero(members.kind == STRAIN)
    number, first = members.number[strain], members.inner_at[strain]
    at = first + np.cumsum([0 * number[:, 0], number[:, 0], number[:, 1]], axis=0)
    length, points = members.length[strain], number[:, 3]
    return _Turning(strain, at, length, points)


def stability(c: Configuration) -> str:
    """Whether the configuration stays where it is, in words."""
    surplus = c.negatives - c.expected
    if surplus == 0 and c.still is not None:
        return c.still[1]
    if surplus == 0:
        return "stable: a minimum of energy under the held drives"
    if surplus > 0:
        ways = "one direction" if surplus == 1 else f"{surplus} directions"
        return f"UNSTABLE: the mechanism would leave this state by itself in {ways}"
    return (
        f"NOT CERTAIN: {c.negatives} negative pivots where the drives and supports explain {c.expected}; "
        "two of them may prescribe the same freedom"
    )


def _rolled(c: Configuration) -> str:
    """The strain-mode leaf that is rolled up too far for its quadrature points, in words, or nothing.

    Two full turns on 7 points counted as a minimum what finer leafs and chains of 40 elements know to be a saddle.
    """
    if c.__dict__.get("_turned", MOST_GAP) < MOST_GAP:
        return ""
    leafs = _turning(c.model)
    if not len(leafs.strain):
        return ""
    turns = np.sqrt(np.square(c.motion.inner.take(leafs.at)).sum(axis=0)) * leafs.length
    worst = int((turns / leafs.points).argmax())
    turn, points = float(turns[worst]), int(leafs.points[worst])
    if turn > MOST_GAP * points:
        return (
            f"leaf '{c.model.member_names[leafs.strain[worst]]}' turns {np.rad2deg(turn):.0f} degrees from end to end, too "
            f"much for {points} quadrature points; give a mesh with {int(np.ceil(turn / MOST_GAP)) + 1} or more"
        )
    return ""


def _stable(c: Configuration) -> Verdict:
    said, rolled = stability(c), _rolled(c)
    if rolled:
        return Verdict(False, f"NOT CERTAIN: {rolled}")
    return Verdict(c.stable, said)


def _furthest(c: Configuration) -> tuple[str, float, float, float]:
    """The joint furthest off its intended motion: name, share of what is far, displacement [m], rotation [rad]."""
    worst = ("", 0.0, 0.0, 0.0)
    for placed in c.model.scene.joints:
        off = c.unintended.get(placed.name)
        if off is None:
            continue
        x, y, z, *turned = off.tolist()
        shift, turn = math.hypot(x, y, z), math.hypot(*turned)
        if not shift < placed.joint.length:
            # the nearest intended motion was not found: nothing is known of this joint
            continue
        share = max(shift / (FAR_SHIFT * placed.joint.length), turn / FAR_TURN)
        if share > worst[1] or not worst[0]:
            worst = (placed.name, share, shift, turn)
    return worst


def _branch(c: Configuration) -> Verdict:
    if c.doubts:
        return Verdict(False, "another branch is possible: " + "; ".join(c.doubts))
    name, share, shift, turn = _furthest(c)
    off = f"joint '{name}' is {1e3 * shift:.3g} mm and {np.rad2deg(turn):.3g} degrees off its intended motion"
    if share > 1.0 and c.method != "conventional":
        return Verdict(False, f"{off}: too far to be the state its record describes")
    if name:
        return Verdict(True, f"the branch of the intended motions: at most, {off}")
    return Verdict(
        True, f"reached from where it started ({c.steps[-1].note or c.method}), nothing speaks against it"
    )


def _worthless(c: Configuration, e: ErrorEstimate) -> bool:
    """Whether the error is larger than the answer, and not only because the answer is next to nothing."""
    return not (e.relative <= 1.0 or e.displacement <= SLIGHT * c.model.arrays.size)


def solved_well(c: Configuration) -> Verdict:
    """Whether the equations are solved, at a minimum and on the branch meant, whatever the leafs are strained by and the
    mesh is off."""
    return _solved_well(c, _stable(c), _branch(c), c.method_error)


def _solved_well(c: Configuration, stable: Verdict, branch: Verdict, error: ErrorEstimate | None) -> Verdict:
    """See `solved_well`; error: all of it, or what the method adds to that of the mesh."""
    if not c.converged:
        return Verdict(False, f"not solved: {c.steps[-1].stop.sentence}")
    if not stable:
        return Verdict(False, "not to be trusted: " + "; ".join([str(stable), *c.doubts]))
    if not branch:
        return Verdict(False, f"not to be trusted: {branch}")
    if error is not None and error.mesh == math.inf:
        return Verdict(
            True,
            "trusted but for the error of its mesh: Newton steps find no equilibrium next to it on a finer one",
        )
    if error is not None and _worthless(c, error):
        said = (
            f"its estimated error is {100 * error.relative:.2g} %"
            if math.isfinite(error.relative)
            else "corrector steps of the full model grow from one to the next, so its error is not known"
        )
        return Verdict(False, f"not to be trusted: {said}")
    if error is None and hasattr(c.model, "solids"):
        return Verdict(
            True, "trusted but for the bases of its solids, whose error was not estimated (ksd.solve does)"
        )
    if c.method_error is not None and error is not None:
        return Verdict(True, f"trusted within its estimated error of {100 * error.relative:.2g} %")
    off = "" if error is None else f", within an estimated error of {100 * error.relative:.2g} %"
    return Verdict(
        True, f"trusted: {c.steps[-1].reason}, it is a minimum, and the branch is the one meant{off}"
    )


def _strength(c: Configuration) -> Verdict:
    found = c.strength if c.converged else None
    if found is None:
        return Verdict(True, "strain and stress are not known")
    return Verdict(not found.beyond, "; ".join(filter(None, [str(found), found.beyond])))


def judge(c: Configuration) -> Trust:
    """Verdicts on a configuration."""
    stable, branch, strength = _stable(c), _branch(c), _strength(c)
    trusted = _solved_well(c, stable, branch, c.error)
    if trusted and not strength and c.strength is not None:
        trusted = Verdict(False, f"not to be trusted: {c.strength.beyond}")
    return Trust(stable, branch, strength, trusted)


def _evident(c: Configuration) -> bool:
    """Whether it is `solved_well`, as far as numbers at hand tell: verdicts are put in words when they are read."""
    settled = c.near and c.stable and not c.doubts and c.converged
    return settled and (c.method_error is None or c.method_error.relative <= 1.0) and not _rolled(c)


def insist(c: Configuration) -> Configuration:
    """The configuration itself if it is `solved_well`, else TrustError with the reason; its `result` is `c`.

    Strain and stress are not looked at: they would cost a prepared solve more than its Newton steps.
    """
    if _evident(c):
        return c
    trusted = solved_well(c)
    if not trusted:
        minima = f"; {c.minimum}" * bool(c.minimum)
        said = (
            f"{trusted}{minima}{_fighting_drives(c)}; strict=False (in Python) returns the state all the same"
        )
        raise TrustError(said, reached=1.0, result=c)
    return c


def _fighting_drives(c: Configuration) -> str:
    """What else is wrong where drives of one freedom tear at each other; nothing otherwise."""
    if c.stable or len(c.model.drive_names) < 2:
        return ""
    fights = [f.sentence for f in doctor(c.model.said or c.model.scene).fights if f.what.startswith("drive ")]
    return "".join(f"; {sentence}" for sentence in fights)
