"""The result of a solve: model and state, the record of the solve, verdicts, and everything that can be computed from it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.buckling import Buckling, buckling
from ksd.answers.extent import Clearance, clearance, extent
from ksd.answers.forces import InterfaceForces, SectionForces, interface_forces, section_forces
from ksd.answers.frequencies import Modes, frequencies
from ksd.answers.internal_stress import Misplaced, internal_stress
from ksd.answers.link_forces import LinkForces, link_forces
from ksd.answers.mesh_adequacy import ModeAdequacy, mode_adequacy
from ksd.answers.modal_stress import modal_stress
from ksd.answers.parasitic import Parasitic, PivotShift, parasitic, pivot_shift
from ksd.answers.plant import BASE_INPUTS, Damping, Plant, make_plant
from ksd.answers.printing import NamedAnswers, render_text
from ksd.answers.shape import Shape, mechanism_shape, point_position
from ksd.answers.stiffness import DriveStiffness, PointStiffness, drive_stiffness, point_stiffness
from ksd.answers.strength import Strength, strength, unusual_values
from ksd.answers.stress import Stress, strain_energy, stress
from ksd.answers.verify import Verification, verify
from ksd.checks import (
    Axis,
    checked_question,
    clear_argument_errors_of_methods,
    name_hint,
    names_of,
    show,
    vector,
    whole_number,
)
from ksd.errors import ConvergenceError, SceneError
from ksd.export.files import export
from ksd.html import NotebookTables
from ksd.modal.leaf_bodies import full_model_state
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import ROUNDING_MULTIPLE
from ksd.model.turns import counted_rotation, node_rotations
from ksd.numerics.threads import small_matrices
from ksd.scene.functions_of_time import HalfSine
from ksd.scene.link import Link
from ksd.scene.scene import PlacedJoint
from ksd.solvers.answer import as_dict
from ksd.solvers.contact_state import ContactPoint, OneSidedPart, Touched, contact_points, one_sided
from ksd.solvers.error import (
    equilibrium_near,
    error_estimate,
    refined_equilibrium,
    refinement_step_suffices,
    with_error,
)
from ksd.solvers.grasp import Grasp, contacts_on, grasp
from ksd.solvers.held_contacts import hold_contacts
from ksd.solvers.joint_motions import JointMotions
from ksd.solvers.left_out import left_out
from ksd.solvers.nonconservative_stability import nonconservative_stability
from ksd.solvers.perturbed import answer_derivatives, parameters_of
from ksd.solvers.random_vibration import RandomVibration, Spectrum, check_spectra, vibrate
from ksd.solvers.report import tables
from ksd.solvers.response import Response, frequency_grid, respond
from ksd.solvers.sensitivity import sensitivity
from ksd.solvers.shock import Shock, check_pulse, shake
from ksd.solvers.steps import DEFAULT_ACCURACY, FAST_METHODS, ErrorEstimate, Step, Stop, Verdict
from ksd.solvers.undeformed_stability import multiple_minima_note
from ksd.solvers.validity import Validity, validity
from ksd.solvers.verdict import Trust, Uncertainty, trust_verdicts, uncertainty
from ksd.view import plot_mechanism, save_figure, show_mechanism, write_page, write_vtu
from ksd.view.camera import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.console import RenderableType


Answer = TypeVar("Answer")
"""What a question returns: a number, an array, or a mapping of them."""


class _WithoutInside(type):
    """Type whose `dir` leaves out what is for other modules of the package, as `dir` of its instances does."""

    def __dir__(cls) -> list[str]:
        return sorted(set(super().__dir__()) - INSIDE)


@clear_argument_errors_of_methods
@dataclass(frozen=True, repr=False)
class Configuration(NotebookTables, metaclass=_WithoutInside):
    """A deformed configuration: the model, its state, and the record of the solve that led to it.

    motion: state of the full model (positions [m], rotation matrices, inner states, multipliers). method: "kinematic",
    "reduced", "full", "conventional", "modal" or "constant". targets: drive values by name [m or rad]. steps: steps of the
    solve, in order. method_error: estimated error that a fast method adds to that of the mesh; None where the method is
    exact or no estimate was made (see `error`). load_factor: fraction of the loads of the scene that acts. notes: warnings
    of the solve, part of `warnings`.

    negatives: negative pivots of the tangent; expected_negatives: those explained by constraint rows. doubts: reasons for
    which the branch is in doubt, and that smaller load steps did not remove. joint_motions: motions of the joints, or a
    function that computes them from the state; None where the joints have no known records. method_was_chosen: `solve` chose
    the method for its estimated error. joints_near_intended: the solve has checked that every joint is near its intended
    motion. accuracy: the relative accuracy that was asked for. kernel_time [s]: thread time in which a first solve of this
    process loaded or compiled kernels, apart from the steps. touched: of stops and cables; None where the scene has none.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> pose = ksd.solve(guide, stroke)
    >>> print(f"{pose.forces['table']:.3f} N, {pose.frequencies().frequency_Hz[0]:.2f} Hz")
    5.036 N, 60.83 Hz
    >>> print(f"{pose.stress().largest_Pa / 1e6:.1f} MPa")
    250.7 MPa
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

    def __dir__(self) -> list[str]:
        return sorted(set(super().__dir__()) - INSIDE)

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
        held = self.with_contacts_held
        return nonconservative_stability(*held.unreduced_state, self.load_factor)

    @cached_property
    def mesh_adequacy(self) -> ModeAdequacy:
        """Energy share that the curvature modes may miss, and turn of the leaf springs per quadrature point."""
        return mode_adequacy(self.model, self.motion)

    @property
    def trust(self) -> Trust:
        """Verdicts `stable`, `branch`, `strength` and `trusted`, each yes or no with a sentence."""
        return trust_verdicts(self)

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

    @cached_property
    def error(self) -> ErrorEstimate | None:
        """Estimated total error, that of the mesh included, computed when first read: `ksd.solvers.error.error_estimate`;
        where stops or cables act it is not estimated."""
        if self._acts:
            return None
        return error_estimate(self)

    @cached_property
    def left_out(self) -> dict[str, dict[str, float]]:
        """Relative changes of "force", "displacement" and "support_stiffness" that plate stiffening and restrained warping
        would make, by effect that is not in the model; computed when first read (`ksd.solvers.left_out`), empty where stops
        or cables act."""
        if self._acts:
            return {}
        return left_out(self)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """Relative error of forces and poses: the larger of `error`, against the model, and of the largest change of a force
        or displacement by an effect that the model leaves out, with the name of that effect."""
        return uncertainty(self)

    @property
    def branch(self) -> str:
        """Why this is, or is not, the intended branch, in one sentence."""
        return self.trust.branch.sentence

    @property
    def trusted(self) -> bool:
        """Whether the result can be relied on: converged, stable, on the intended branch, within what a beam and its
        material bear, and with an `uncertainty` of 10 % at most, or the accuracy asked for. `trust.trusted` has the reason
        in a sentence."""
        return self.trust.trusted.yes

    @cached_property
    def strength(self) -> Strength | None:
        """Largest strain and stress of all leaves, and their shares of the limits; None where leaves are reduced solids."""
        if self.model.solids:
            return None
        return strength(*self.unreduced_state, load_factor=self.load_factor)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the solve, about the scene (`ksd.scene.plausibility`), and about strain and stress."""
        strain = () if self.strength is None else self.strength.warnings
        joints = () if self._joints is None else self._joints.unknown
        own = (*self.far_drives, *unusual_values(self.model))
        return (*self.notes, *joints, *filter(None, [self.minimum]), *own, *strain)

    @property
    def far_drives(self) -> tuple[str, ...]:
        """Drive values that were probably given in another unit, a sentence each.

        Not rotations: more than half a turn is refused unless the path has followed it.
        """
        angles = {d.name for d in self.model.scene.drives if d.dimension == "angle"}
        return self.model.far_drives({n: v for n, v in self.targets.items() if n not in angles})

    @cached_property
    def minimum(self) -> str:
        """Which of several minima this is, in a sentence, where the undeformed configuration is unstable under preload,
        heat, assembly errors or loads; empty elsewhere."""
        return (
            ""
            if self.model.solids or self._acts
            else multiple_minima_note(*self.unreduced_state, self.stable)
        )

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
        rest = self.model.rest
        moved = {
            link: (self.motion.x[i] - rest.x[i], self.motion.R[i].copy())
            for i, link in enumerate(self.model.scene.links)
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
            raise SceneError(f"link '{link}' is not part of this mechanism; there are {', '.join(known)}")
        return known.index(link)

    @cached_property
    def equilibrium(self) -> State:
        """State at which questions beyond forces and poses are answered: `motion`, or, where `solve` itself chose a fast
        method, the equilibrium of the full model next to it. Raises ConvergenceError where that is not found."""
        if self.method_was_chosen and self.method in FAST_METHODS:
            return equilibrium_near(self)
        return self.motion

    def set_equilibrium(self, state: State) -> None:
        """Set `equilibrium` where it is known already."""
        self.__dict__["equilibrium"] = state

    @cached_property
    def unreduced_state(self) -> tuple[Model, State]:
        """Model and state with every modal body replaced by the chain of elements that it reduces; without modal bodies
        those of the configuration."""
        return full_model_state(self.model, self.motion)

    @property
    def refinement_start(self) -> State:
        """State from which questions on a finer mesh take their Newton step: `equilibrium`, or `motion` where that step
        alone suffices."""
        self._refuse_contact("a question about small motions")
        if self.method_was_chosen and self.method in FAST_METHODS and refinement_step_suffices(self):
            return self.motion
        return self.equilibrium

    @property
    def unreduced_equilibrium(self) -> tuple[Model, State]:
        """Model and `equilibrium` with modal bodies replaced as in `unreduced_state`: for stress, energy and forces."""
        return full_model_state(self.model, self.equilibrium)

    @cached_property
    def with_contacts_held(self) -> Configuration:
        """The pose for questions about small motions: itself, or where stops, cables or contacts act that with them held
        (`ksd.solvers.held_contacts`). Raises SceneError where one of them cannot be held."""
        touched = self.touched
        if touched is None or not touched.closed:
            return self
        model, motion = hold_contacts(self.model, self.motion, touched)
        return replace(self, model=model, motion=motion, touched=None, joint_motions=None)

    @property
    def _acts(self) -> bool:
        """Whether a stop or cable acts here."""
        return self.touched is not None and self.touched.closed

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

    def validity(self, *, leaf: str | None = None, error: float = 0.01) -> Validity:
        """Stroke (over its length) and rotation [rad] up to which the modal basis of a leaf, or a reduced solid, stays
        within a relative `error`; the first one where `leaf` is None.

        Raises SceneError for an unknown name, where no body is modal, and for bases expanded at a trained state.
        """
        return validity(self.model, leaf=leaf, error=error)

    def stiffness(
        self,
        link: Link | str,
        *,
        at: ArrayLike | None = None,
        axes: Literal["global", "link"] | ArrayLike = "global",
        freed: Iterable[str] = (),
    ) -> PointStiffness:
        """Compliance (6, 6) and every stiffness of the point of `link` that is at `at` (3,) [m, global] at rest.

        at: reference point of the link when None. axes: "global", "link" (fixed to it), or orthonormal columns (3,
        3). freed: drives and supports released, with their present force. Raises SceneError for unknown names,
        KinematicsError where nothing resists a motion.
        """
        held = self.with_contacts_held
        return point_stiffness(
            held.model,
            held.refinement_start,
            link,
            at=at,
            axes=axes,
            freed=freed,
            load_factor=self.load_factor,
        )

    def grasp(self, link: Link | str, *, at: ArrayLike | None = None) -> Grasp:
        """How contacts hold a link: stiffness of its point at `at` (3,) [m, global] at rest, forces, and friction needed.

        Raises SceneError where no closed contact is on it, KinematicsError where nothing resists a motion.
        """
        name = self.model.node_names[self._node(link)]
        scene, points = self.model.original_scene, self.contacts
        signs = contacts_on(name, scene, points)
        return grasp(name, scene, points, signs, self.stiffness(name, at=at))

    def drive_stiffness(self, *, freed: Iterable[str] = ()) -> DriveStiffness:
        """Stiffness dF/dd (d, d) [N/m, Nm/rad, N/rad] between all drives except those in `freed`, which keep their force.

        Raises SceneError for unknown names, KinematicsError where nothing resists a motion.
        """
        held = self.with_contacts_held
        return drive_stiffness(held.model, held.refinement_start, freed=freed, load_factor=self.load_factor)

    @small_matrices
    def frequencies(
        self,
        *,
        count: int = 6,
        freed: Iterable[str] = (),
        dense: bool | None = None,
    ) -> Modes:
        """The `count` lowest eigenfrequencies [Hz] and modes about this state; drives and supports are held, except those in
        `freed`, which keep their present force.

        dense: True or False forces dense or iterative eigenvalues. Raises SceneError when nothing has mass and for reduced
        solids, KinematicsError when nothing resists a motion.
        """
        self._of_leaves("frequencies")
        whole_number(count, "count")
        held = self.with_contacts_held
        return frequencies(
            *full_model_state(held.model, held.refinement_start),
            count=count,
            freed=freed,
            load_factor=self.load_factor,
            dense=dense,
        )

    @small_matrices
    def plant(
        self,
        *,
        inputs: str | Iterable[str] | None = None,
        outputs: str | Iterable[str] | None = None,
        damping: Damping | None = None,
        modes: int | None = None,
        freed: Iterable[str] | None = None,
        up_to_Hz: float | None = None,
    ) -> Plant:
        """The modal model between inputs and outputs on which `response` and the like stand.

        up_to_Hz: highest frequency of interest [Hz], by which the number of modes is chosen. Other arguments as in
        `response`.
        """
        self._of_leaves("response")
        for what, given in (("inputs", inputs), ("outputs", outputs)):
            if given is not None and not names_of(given, what):
                raise SceneError(f"{what} = {show(given)}: name one at least")
        held = self.with_contacts_held
        return make_plant(
            *full_model_state(held.model, held.refinement_start), inputs=inputs, outputs=outputs, damping=damping,
            modes=modes, freed=freed, up_to_Hz=up_to_Hz, load_factor=self.load_factor,
        )  # fmt: skip

    def response(
        self,
        frequency_Hz: ArrayLike | None = None,
        *,
        inputs: str | Iterable[str] | None = None,
        outputs: str | Iterable[str] | None = None,
        damping: Damping | None = None,
        modes: int | None = None,
        freed: Iterable[str] | None = None,
    ) -> Response:
        """Frequency response of sensors and drive motions to drive forces, loads and base acceleration, small about this
        state.

        frequency_Hz (n,): around the modes when None. inputs: drives, loads of the scene (1 is that load once more), or
        "base x" ... "base rz" [m/s^2, rad/s^2]; all drives when None. outputs: sensors and drives; all sensors when None, or
        all drives where there are none. damping: ratio of all modes, ratios, two pairs (frequency [Hz], ratio) of Rayleigh,
        or "materials"; when None the loss factors of the materials, .01 where there are none. Dampers come on top. modes:
        their number, chosen by the frequencies when None; what others would change is in `error`. freed: drives and supports
        released, those among inputs and outputs when None. Raises SceneError, KinematicsError where the state is unstable.
        """
        grid = None if frequency_Hz is None else frequency_grid(frequency_Hz)
        highest = None if grid is None else float(grid[-1])
        plant = self.plant(
            inputs=inputs, outputs=outputs, damping=damping, modes=modes, freed=freed, up_to_Hz=highest
        )
        return respond(plant, grid)

    def transmissibility(
        self,
        direction: str,
        frequency_Hz: ArrayLike | None = None,
        *,
        outputs: str | Iterable[str] | None = None,
        damping: Damping | None = None,
        modes: int | None = None,
        freed: Iterable[str] = (),
    ) -> Response:
        """Absolute motion of sensors per motion of a shaken base along or about a global axis: 1 at low frequencies.

        direction: "x" ... "rz"; outputs: sensors of displacements or accelerations, read in space whatever they are relative
        to ground; drives are held except those in `freed`. Other arguments as in `response`.
        """
        grid = None if frequency_Hz is None else frequency_grid(frequency_Hz)
        highest = None if grid is None else float(grid[-1])
        plant = self.plant(
            inputs=(f"base {direction}",),
            outputs=outputs,
            damping=damping,
            modes=modes,
            freed=freed,
            up_to_Hz=highest,
        )
        return respond(plant.per_base_motion(), grid)

    def random_vibration(
        self,
        psd: Mapping[str, Spectrum],
        *,
        outputs: str | Iterable[str] | None = None,
        damping: Damping | None = None,
        modes: int | None = None,
        freed: Iterable[str] | None = None,
    ) -> RandomVibration:
        """Root mean squares of sensors, and of stress, under stationary random inputs.

        psd: one-sided spectra by input, points (frequency [Hz], density [unit^2/Hz]), such as {"base y": [(1, 1e-3), (200,
        1e-3)]}, straight between points on logarithmic axes. Other arguments as in `response`.
        """
        known = (
            *self.model.drive_names, *(load.name for load in self.model.scene.loads), *BASE_INPUTS,
        )  # fmt: skip
        spectra = check_spectra(psd, known)
        highest = max(float(rows[-1, 0]) for rows in spectra.values())
        plant = self.plant(
            inputs=tuple(spectra),
            outputs=outputs,
            damping=damping,
            modes=modes,
            freed=freed,
            up_to_Hz=highest,
        )
        stress = modal_stress(plant.modes, len(plant.frequency_Hz), load_factor=self.load_factor)
        return vibrate(plant, spectra, stress)

    def shock(
        self,
        pulse: HalfSine | Sequence[tuple[float, float]],
        *,
        source: str = "base y",
        outputs: str | Iterable[str] | None = None,
        damping: Damping | None = None,
        modes: int | None = None,
        freed: Iterable[str] | None = None,
    ) -> Shock:
        """Response of sensors to a pulse of base acceleration, or of another input, and its response spectrum.

        pulse: `ksd.HalfSine(amplitude=, duration=)`, or points (t [s], value). source: input that follows it. Other
        arguments as in `response`. Sensors of a displacement or velocity must be relative to ground.
        """
        given = check_pulse(pulse)
        highest = 4.0 / given.duration
        plant = self.plant(
            inputs=(source,), outputs=outputs, damping=damping, modes=modes, freed=freed, up_to_Hz=highest
        )
        return shake(plant, given)

    @small_matrices
    def buckling(
        self,
        link: Link | str | None = None,
        *,
        at: ArrayLike | None = None,
        force: ArrayLike = (0.0, 0.0, 0.0),
        moment: ArrayLike = (0.0, 0.0, 0.0),
        following: bool = False,
        count: int = 4,
        freed: Iterable[str] = (),
    ) -> Buckling:
        """Signed critical load factors of a load on `link` that is added to this state, or, without a link, of the stresses
        of the state itself, at which it diverges (for flutter under non-conservative loads see `frequencies`).

        force (3,) [N] and moment (3,) [Nm], global, on the point of the link at `at` (3,) [m] at rest (its reference
        point when None), fixed in space, or turning with the link where `following`. count: number of factors; freed:
        drives and supports released, with their present force. Raises SceneError for unknown names, a load of zero, a state
        without stress and reduced solids, ConvergenceError where no factor is found.
        """
        self._of_leaves("buckling")
        whole_number(count, "count")
        held = self.with_contacts_held
        return buckling(
            *full_model_state(held.model, held.refinement_start), link, at=at, force=force, moment=moment,
            following=following, count=count, freed=freed, load_factor=self.load_factor,
        )  # fmt: skip

    def stress(self, *, points: int = 25) -> Stress:
        """Stress [Pa] of every leaf at `points` stations (of a chain: at its nodes; in a nodal mesh: at both ends of every
        element).

        Raises SceneError for reduced solids.
        """
        self._of_leaves("stress")
        return stress(
            *self.unreduced_equilibrium, points=whole_number(points, "points"), load_factor=self.load_factor
        )

    def strain_energy(self) -> dict[str, float]:
        """Strain energy [J] of every leaf by full name, and of springs; the sum is the energy that the mechanism stores."""
        return strain_energy(*self.unreduced_equilibrium, load_factor=self.load_factor)

    def with_error(self, question: Callable[[Configuration], Answer]) -> tuple[Answer, Any]:
        """Answer of ``question(pose)`` (number, array, or mapping of them) and its error, in the same shape.

        The error is that of method and mesh: the change to the answer at the equilibrium next to this state on a finer mesh.
        Raises ConvergenceError where that is not found.
        """
        self._refuse_contact("an error by a finer mesh")
        return with_error(self, question)

    @small_matrices
    def verify(self) -> Verification:
        """Independent check: every leaf is integrated from its start as an exact rod under the computed wrench.

        The gaps by which the rods miss their ends give corrected forces and poses, and the error of this result, that of
        method and mesh. Raises ConvergenceError where this is no equilibrium, SceneError for reduced solids, KinematicsError
        where nothing resists a motion.
        """
        self._of_leaves("verification")
        self._refuse_contact("verification")
        if not self.converged:
            raise ConvergenceError(
                f"only an equilibrium can be verified, and this is none: {self.trust.trusted.sentence}"
            )
        (model, motion), factor = self.unreduced_state, self.load_factor
        found = verify(model, motion, model.targets(self.targets), load_factor=factor)
        if not found.unclosed:
            return found
        # the rods do not close from this state: start from the equilibrium on a finer mesh
        finer, state, _ = refined_equilibrium(self)
        if state is None:
            return found
        again = verify(finer, state, finer.targets(self.targets), load_factor=factor, of=(model, motion))
        return found if again.unclosed else replace(again, gaps=found.gaps)

    def sensitivity(
        self,
        question: Callable[[Configuration], Any],
        link: Link | str,
        *,
        at: ArrayLike,
        force: ArrayLike = (0.0, 0.0, 0.0),
        moment: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Any:
        """Change of ``question(pose)`` (number, array, or mapping of numbers; in the same shape) by a dead load, to first
        order, with the drives held.

        The load is a force (3,) [N] and a moment (3,) [Nm], global, on the point of `link` at `at` (3,) [m] at rest.
        Raises SceneError for unknown names and a load of zero, ConvergenceError where no neighbouring equilibrium is
        found.
        """
        self._refuse_contact("sensitivity")
        return sensitivity(self, question, link, at=at, force=force, moment=moment)

    def gradient(
        self,
        question: Callable[[Configuration], Any],
        *,
        by: Iterable[str] | str | None = None,
        design: Callable[..., Any] | None = None,
        at_design: Mapping[str, Any] | None = None,
        sizes: Mapping[str, float] | None = None,
    ) -> dict[str, Any]:
        """Derivative of ``question(pose)`` (number, array, or mapping of them; in the same shape) at the equilibrium of this
        pose, per unit of every parameter [SI], by its name.

        by: drives, components of loads ("payload_force_z"), or parameters of `design`, a function that draws this mechanism
        from the parameters `at_design`; by default all numbers of the design except counts, without a design all drives.
        sizes: scales of the steps of parameters that are zero. Answers that jump or have kinks, such as the largest of
        several, are differenced as they are; for columns of sweeps, tracked by name, see `ksd.gradient`. Raises SceneError
        for unknown names and where a parameter changes more than numbers, ConvergenceError at the end of a branch. Method:
        `ksd.solvers.perturbed`.
        """
        checked_question(question)
        self._refuse_contact("gradient")
        scene = self.model.original_scene
        parameters = parameters_of(
            scene, self.targets, size=self.model.arrays.size, design=design, at_design=at_design, by=by, sizes=sizes
        )  # fmt: skip
        return answer_derivatives(self, question, parameters)

    @small_matrices
    def internal_stress(
        self, *, offset: float = 1e-5, rotation: float = 1e-4, leaves: Iterable[str] = (), points: int = 13
    ) -> Misplaced:
        """Largest von Mises stress [Pa] when the end of a leaf is clamped with an error of position or orientation, for one
        leaf and direction at a time.

        offset [m] and rotation [rad] of the end in the leaf's axes there, both positive; leaves: full names, all when empty;
        points: stations per leaf. Raises SceneError for unknown names, sizes that are not positive, and reduced solids.
        """
        self._of_leaves("internal stress")
        self._refuse_contact("internal stress")
        return internal_stress(
            *self.unreduced_equilibrium, offset=offset, rotation=rotation, leaves=names_of(leaves, "leaves"),
            load_factor=self.load_factor, points=whole_number(points, "points"),
        )  # fmt: skip

    def interface_forces(self) -> InterfaceForces:
        """Force [N] and moment [Nm], global, that joints, single leaf springs, springs, pins and sliders exert on links and
        ground, each at its own interface."""
        return interface_forces(*self.unreduced_equilibrium, load_factor=self.load_factor)

    def link_forces(self) -> LinkForces:
        """Force [N] and moment [Nm], global, in every leaf spring at both ends, and on every link with the loads applied
        there. The result prints as a table; its `to_csv` writes a file."""
        return link_forces(*self.unreduced_equilibrium, load_factor=self.load_factor)

    def parasitic(
        self, link: Link | str | None = None, *, at: ArrayLike | None = None, along: Axis | None = None
    ) -> Parasitic:
        """Displacement [m] and rotation [rad] from rest that no drive or support prescribes, of the point of `link` at `at`
        (3,) [m] at rest; link and point of the first drive when None.

        Drives that act on other links prescribe nothing of this one: removed is what they would cause if the link moved in
        proportion to them, as at rest. along: "x", "y", "z" or a vector (3,), the direction of the wanted displacement; then
        all but that component is parasitic.

        Rest is the undeformed configuration, without weight and loads. A driven joint prescribes a rotation about its pivot,
        where its leaf springs cross; where they do not cross, about the middle between its interfaces. Raises SceneError for
        an unknown link, and where no link is named and there is no drive.
        """
        return parasitic(self.model, self.motion, self.targets, link, at=at, along=along)

    def extent(self) -> np.ndarray:
        """Lowest and highest coordinates (2, 3) [m, global] of the leaf springs, width and thickness included."""
        return extent(*self.unreduced_state)

    def clearance(self) -> Clearance:
        """Smallest distance of two leaf springs that share no block. Raises SceneError where all share one."""
        return clearance(*self.unreduced_state)

    def pivot_shift(self, joint: PlacedJoint | str, *, at: ArrayLike | None = None) -> PivotShift:
        """Displacement [m, joint axes] of the pivot of a joint, seen from interface A: the point of interface B at `at` (3,)
        [m, global] at rest, where its leaf springs cross when None.

        Raises SceneError for an unknown joint or one without an intended rotation.
        """
        return pivot_shift(self.model, self.motion, joint, at=at)

    def section_forces(self, *, points: int = 25) -> dict[str, SectionForces]:
        """Normal and shear forces [N], torsion and bending moments [Nm] along every leaf by full name, at `points` stations
        (of a chain: at its nodes)."""
        return section_forces(
            *self.unreduced_equilibrium,
            points=whole_number(points, "points", least=2),
            load_factor=self.load_factor,
        )

    def shape(self, *, points: int = 25) -> Shape:
        """Centrelines [m] of all leaves at `points` stations or more, outlines of all links, and driven points, global."""
        return mechanism_shape(
            *self.unreduced_state,
            points=whole_number(points, "points", least=2),
            load_factor=self.load_factor,
        )

    def as_dict(self) -> dict[str, Any]:
        """All numbers of the tables and more, with units in the keys; layout: `ksd.solvers.answer.SCHEMA`."""
        return as_dict(self)

    def plot(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        axes: Axes | None = None,
        view: View | None = None,
        labels: bool = True,
        title: str | None = None,
        color: Literal["stress"] | None = None,
    ) -> Figure:
        """Matplotlib figure of the deformed over the undeformed mechanism, written to `path` (.png, .pdf, .svg ...) if
        given.

        axes: drawn into these, a new figure when None. view: "xy", "xz" or "yz" onto a coordinate plane, "3d" in space, or
        the azimuth and elevation of the eye [deg]; its plane for a planar mechanism, "3d" for others when None. labels:
        names of links, drives and loads, with values and forces. title: above the picture, names of scene and method when
        None. color: "stress" colours the leaves by von Mises stress. Raises SceneError for an unknown view, colour or file
        type.
        """
        figure = plot_mechanism(self, axes=axes, view=view, labels=labels, title=title, color=color)
        return figure if path is None else save_figure(figure, path)

    def view(self, path: str | os.PathLike[str] | None = None) -> Path | None:
        """The deformed mechanism in three dimensions: a window to turn it in, a .png rendered without one (both by the
        `view` extra), a .html page to turn it on (`live`), or a .vtu file for ParaView; returns the path. Raises SceneError
        for another file type."""
        if path is not None and str(path).lower().endswith((".html", ".htm")):
            return write_page(self, path)
        picture = path is None or str(path).lower().endswith(".png")
        return show_mechanism(self, path) if path is None or picture else write_vtu(self, path)

    def export(
        self,
        path: str | os.PathLike[str],
        *,
        deformed: bool | None = None,
        points: int | None = None,
        view: str | None = None,
        margin: float | None = None,
        hole: float | None = None,
        tolerance: float | None = None,
    ) -> Path:
        """Write a file for another program, in mm, by its ending; returns the path.

        .dxf: undeformed drawing with flat patterns of the sheets; view: plane of the drawing, margin, hole [m]: length of
        the clamped margins and diameter of the holes in them, tolerance [m]: of free curves (`ksd.export.write_dxf`).
        .stl, .3mf, .step: bodies; deformed: in this pose or at rest, points: stations along each leaf
        (`ksd.export.write_bodies`). .vtu: for ParaView, in m. .inp: for CalculiX
        (`ksd.export.write_deck`). None leaves the default. Raises SceneError, also where the
        extra `cad` is needed and not installed."""
        return export(
            self,
            path,
            deformed=deformed,
            points=points,
            view=view,
            margin=margin,
            hole=hole,
            tolerance=tolerance,
        )

    def tables(self) -> list[RenderableType]:
        """Tables and sentences of the result for rich's `Console.print`."""
        return tables(self)

    def __str__(self) -> str:
        return render_text(*self.tables())


INSIDE = frozenset(
    (
        "doubts", "equilibrium", "expected_negatives", "joint_motions", "joints_near_intended", "mesh_adequacy",
        "method_was_chosen", "negatives", "nonconservative_stability", "notes", "refinement_start", "reported_forces",
        "set_equilibrium",
        "unreduced_equilibrium", "unreduced_state",
        "with_contacts_held", "_acts", "_joints", "_node", "_of_leaves", "_refuse_contact", "touched",
    )
)  # fmt: skip
"""Attributes of a configuration for other modules of the package only; `dir` leaves them out."""
