"""What a solve leaves: model, state and the record of the solve, and what follows from these alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.mesh_adequacy import ModeAdequacy, mode_adequacy
from ksd.answers.printing import NamedAnswers
from ksd.answers.shape import point_position
from ksd.checks import clear_argument_errors_of_methods, name_hint, show, vector
from ksd.errors import SceneError
from ksd.modal.leaf_bodies import full_model_state
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import ROUNDING_MULTIPLE
from ksd.model.turns import counted_rotation, node_rotations
from ksd.scene.link import Link
from ksd.solvers.contact_state import ContactPoint, OneSidedPart, Touched, contact_points, one_sided
from ksd.solvers.held_contacts import hold_contacts
from ksd.solvers.joint_motions import JointMotions
from ksd.solvers.nonconservative_stability import nonconservative_stability
from ksd.solvers.steps import DEFAULT_ACCURACY, ErrorEstimate, Step, Stop, Verdict


@clear_argument_errors_of_methods
@dataclass(frozen=True, repr=False)
class Result:
    """Model, state and the record of the solve that led to it; other fields: see `ksd.Configuration`.

    negatives: negative pivots of the tangent; expected_negatives: those explained by constraint rows. doubts: reasons for
    which the branch is in doubt, and that smaller load steps did not remove. joint_motions: motions of the joints, or a
    function that computes them from the state; None where the joints have no known records. method_was_chosen: `solve` chose
    the method for its estimated error. joints_near_intended: the solve has checked that every joint is near its intended
    motion. accuracy: the relative accuracy that was asked for. kernel_time [s]: thread time in which a first solve of this
    process loaded or compiled kernels, apart from the steps. touched: of stops and cables; None where the scene has none.
    """

    model: Model
    motion: State
    method: str
    targets: Mapping[str, float]
    steps: Sequence[Step]
    _: KW_ONLY
    negatives: int
    expected_negatives: int
    joint_motions: JointMotions | Callable[[State], JointMotions | None] | None = None
    method_error: ErrorEstimate | None = None
    notes: tuple[str, ...] = ()
    load_factor: float = 1.0
    doubts: tuple[str, ...] = ()
    method_was_chosen: bool = False
    joints_near_intended: bool = False
    accuracy: float = DEFAULT_ACCURACY
    kernel_time: float = 0.0
    touched: Touched | None = None

    def __repr__(self) -> str:
        forces = ", ".join(f"{n} {v:.6g}" for n, v in self.reported_forces.items())
        return (
            f"<Configuration of '{self.model.scene.name}' by {self.method}: {self.targets}, forces {forces}>"
        )

    @cached_property
    def motions(self) -> dict[str, float]:
        """Intended motion of every joint by name [rad or m]; empty where the joints have no records."""
        return NamedAnswers({} if self._joints is None else self._joints.by_motion(), "joint motion")

    @cached_property
    def unintended(self) -> dict[str, np.ndarray]:
        """Displacement [m] and rotation vector [rad] (6,) of interface B off its intended pose, in joint axes, by joint;
        empty where the joints have no records."""
        return NamedAnswers({} if self._joints is None else self._joints.by_joint(), "joint")

    @cached_property
    def _joints(self) -> JointMotions | None:
        """Motions of the joints, computed at first use where the solve deferred that."""
        motions = self.joint_motions
        return motions(self.motion) if callable(motions) else motions

    @property
    def converged(self) -> bool:
        """Whether the last step reached equilibrium (for method "kinematic": closed all loops)."""
        return self.steps[-1].stop is Stop.CONVERGED

    @property
    def stable(self) -> bool:
        """Whether the state is a minimum of energy under the held drives (no negative pivots beyond those of the constraint
        rows); where loads are not conservative, whether it neither diverges nor flutters."""
        if self.negatives != self.expected_negatives:
            return False
        if self.model.conservative:
            return True
        return self.nonconservative_stability is None or self.nonconservative_stability.yes

    @cached_property
    def nonconservative_stability(self) -> Verdict | None:
        """Flutter check where loads follow their links or are moments; None elsewhere, and where nothing converged."""
        if self.model.conservative or not self.converged:
            return None
        try:
            held = self.with_contacts_held
        except SceneError as reason:
            return Verdict(
                False, f"NOT CERTAIN: whether it is stable is not known: {str(reason).removesuffix('.')}"
            )
        return nonconservative_stability(*held.unreduced_state, self.load_factor)

    @cached_property
    def mesh_adequacy(self) -> ModeAdequacy:
        """Energy share that the curvature modes may miss, and turn of the leaf springs per quadrature point."""
        return mode_adequacy(self.model, self.motion)

    @property
    def stops(self) -> Mapping[str, OneSidedPart]:
        """Force [N] or moment [Nm] and gap of every end stop by name, "end.high"; prints as a table."""
        return one_sided(self.touched, "stop")

    @property
    def contacts(self) -> Mapping[str, ContactPoint]:
        """State, gap, place, forces and reserve of friction of every contact of surfaces by name; prints as a table."""
        return contact_points(self.touched)

    @property
    def cables(self) -> Mapping[str, OneSidedPart]:
        """Tension [N], slack and length [m] of every cable by name; prints as a table."""
        return one_sided(self.touched, "cable")

    @property
    def far_drives(self) -> tuple[str, ...]:
        """Drive values that were probably given in another unit, a sentence each.

        Not rotations: more than half a turn is refused unless the path has followed it.
        """
        angles = {d.name for d in self.model.scene.drives if d.dimension == "angle"}
        return self.model.far_drives({n: v for n, v in self.targets.items() if n not in angles})

    @property
    def iterations(self) -> int:
        """Factorisations of all steps together."""
        return sum(s.iterations for s in self.steps)

    @property
    def time(self) -> float:
        """Thread time [s] of all steps together."""
        return sum(s.time for s in self.steps)

    @property
    def forces(self) -> dict[str, float]:
        """Drive force [N] or moment [Nm] by drive name: what the drive exerts on its link, positive along the drive."""
        count = len(self.model.drive_names)
        efforts = zip(self.model.drive_names, self.motion.multiplier[:count], strict=True)
        return NamedAnswers({n: -float(m) for n, m in efforts}, "drive")

    @property
    def reported_forces(self) -> dict[str, float]:
        """`forces` for printing, with 0 for what is only rounding: up to ROUNDING_MULTIPLE times the rounding of EA/L at the
        farthest point. Larger forces are real, however small beside others."""
        arrays, drives = self.model.arrays, self.model.scene.drives
        farthest = max(float(arrays.size), float(np.abs(self.motion.x).max()))
        stiffness = float(arrays.members.stiffness_scale.max(initial=0.0))
        rounding = ROUNDING_MULTIPLE * np.finfo(float).eps * farthest * stiffness
        rotations = {d.name for d in drives if d.dimension != "length"}
        least = {n: rounding * (float(arrays.size) if n in rotations else 1.0) for n in self.forces}
        return {n: v if abs(v) > least[n] else 0.0 for n, v in self.forces.items()}

    @property
    def reactions(self) -> dict[str, float]:
        """Force [N] or moment [Nm] that every support exerts, by support name; not what holds a mechanism in its plane."""
        count, supports = len(self.model.drive_names), self.model.original_scene.supports
        efforts = zip(supports, self.motion.multiplier[count:], strict=False)
        return NamedAnswers({s.name: -float(m) for s, m in efforts}, "support")

    @property
    def links(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Displacement (3,) [m] of the reference point and rotation matrix (3, 3) of every link, by name."""
        rest, unlisted = self.model.rest, self.model.scene.unlisted
        moved = {
            link: (self.motion.x[i] - rest.x[i], self.motion.R[i].copy())
            for i, link in enumerate(self.model.scene.links)
            if link not in unlisted
        }
        return NamedAnswers(moved, "link")

    def rotation(self, link: Link | str) -> np.ndarray:
        """Rotation vector (3,) [rad] of a link from rest, global axes, with its whole turns as counted along the path of the
        solve. Raises SceneError for an unknown name."""
        node, rotation = self._node(link), np.empty(3)
        counted_rotation(self.motion.R[node], node_rotations(self.model.arrays, self.motion)[node], rotation)
        return rotation

    def displacement(self, link: Link | str, at: ArrayLike | None = None) -> np.ndarray:
        """Displacement (3,) [m] of the point of a link that is at `at` (3,) [m] at rest; of its reference point when None
        (of a point of a leaf: the point itself). Raises SceneError for an unknown name."""
        i = self._node(link)
        point = self.model.rest.x[i] if at is None else np.array(vector(at, "at", unit="m"))
        return point_position(self.model, self.motion, i, point) - point

    def distance(self, name: str) -> float:
        """The distance [m] of two points that the scene defines by this name (`Mechanism.distance`); along a direction, its
        signed component. Raises SceneError for an unknown name."""
        known = {d.name: d for d in self.model.scene.distances}
        if name not in known:
            raise SceneError(
                f"distance {show(name)} is not defined in this mechanism{name_hint(name, known)}"
            )
        defined = known[name]
        i, j = self._node(defined.a), self._node(defined.b)
        end = point_position(self.model, self.motion, j, defined.end)
        span = end - point_position(self.model, self.motion, i, defined.start)
        if defined.along is None:
            return float(np.linalg.norm(span))
        turned = np.eye(3) if defined.turns_with is None else self.motion.R[self._node(defined.turns_with)]
        return float(span @ turned @ np.asarray(defined.along))

    def _node(self, named: Link | str) -> int:
        """Node number of a link or internal block. Raises SceneError for an unknown name."""
        link = named.name if isinstance(named, Link) else named
        known = self.model.node_names
        if link not in known:
            raise SceneError(
                f"link '{link}' is not part of this mechanism; there are {', '.join(self.model.listed_names)}"
            )
        return known.index(link)

    @cached_property
    def unreduced_state(self) -> tuple[Model, State]:
        """Model and state with every modal body replaced by the chain of elements that it reduces; without modal bodies
        those of the configuration."""
        return full_model_state(self.model, self.motion)

    @cached_property
    def with_contacts_held(self) -> Self:
        """The pose for questions about small motions: itself, or where stops, cables or contacts act that with them held
        (`ksd.solvers.held_contacts`). Raises SceneError where one of them cannot be held."""
        touched = self.touched
        if touched is None or not touched.closed:
            return self
        model, motion = hold_contacts(self.model, self.motion, touched)
        return replace(self, model=model, motion=motion, touched=None, joint_motions=None)

    @property
    def acts(self) -> bool:
        """Whether a stop or cable acts here."""
        return self.touched is not None and self.touched.closed

    @property
    def found_in_contact(self) -> bool:
        """Whether load steps with contact found it; none of the contacts may act here."""
        return self.touched is not None and len(self.touched.before[0]) > 0

    def _refuse_contact(self, question: str) -> None:
        """Raise SceneError for a question that has no answer yet where a stop or cable acts."""
        touched = self.touched
        if touched is not None and touched.closed:
            name = next(p.name for p, f in zip(touched.what.parts, touched.forces, strict=True) if f[0])
            raise SceneError(
                f"{question}: '{name}' acts in this pose, and this question knows no stops, cables and contacts; prescribe "
                "what it holds by mechanism.actuate, which answers it for a stop that stays closed"
            )

    def _of_leaves(self, question: str) -> None:
        """Raise SceneError for a question that has no answer where leaf springs are reduced solids."""
        solids = self.model.solids
        if solids:
            raise SceneError(
                f"{question} is not available for reduced solids ({', '.join(solids)}); use leaf springs in their place, "
                "or the meshed solid itself"
            )


Solved = TypeVar("Solved", bound=Result)
"""A result, or what has more answers than one: functions that change a result return what they were given."""
