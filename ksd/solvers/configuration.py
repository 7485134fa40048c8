"""The result of a solve: model and state, the record of the solve, verdicts, and everything that can be computed from it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.buckling import Buckling, buckling
from ksd.answers.extent import Clearance, clearance, extent
from ksd.answers.forces import InterfaceForces, interface_forces
from ksd.answers.frequencies import Modes, frequencies
from ksd.answers.internal_stress import Misplaced, internal_stress
from ksd.answers.link_forces import LinkForces, link_forces
from ksd.answers.modal_stress import modal_stress
from ksd.answers.parasitic import Parasitic, PivotShift, parasitic, pivot_shift
from ksd.answers.plant import Damping, Plant, make_plant, vibration_inputs
from ksd.answers.printing import render_text
from ksd.answers.shape import Shape, mechanism_shape
from ksd.answers.stiffness import DriveStiffness, PointStiffness, drive_stiffness, point_stiffness
from ksd.answers.stress import Stress, stress
from ksd.answers.verify import Verification, verify
from ksd.checks import Axis, checked_question, clear_argument_errors_of_methods, names_of, show, whole_number
from ksd.errors import ConvergenceError, SceneError
from ksd.export.files import export
from ksd.html import NotebookTables
from ksd.modal.leaf_bodies import full_model_state
from ksd.numerics.threads import small_matrices
from ksd.scene.functions_of_time import HalfSine
from ksd.scene.link import Link
from ksd.scene.scene import PlacedJoint
from ksd.solvers.answer import as_dict
from ksd.solvers.error import refined_equilibrium, with_error
from ksd.solvers.estimated_result import EstimatedResult
from ksd.solvers.grasp import Grasp, contacts_on, grasp
from ksd.solvers.perturbed import answer_derivatives, parameters_of
from ksd.solvers.random_vibration import RandomVibration, Spectrum, check_spectra, vibrate
from ksd.solvers.report import tables
from ksd.solvers.response import Response, frequency_grid, respond
from ksd.solvers.sensitivity import sensitivity
from ksd.solvers.shock import Shock, check_pulse, shake
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
class Configuration(NotebookTables, EstimatedResult, metaclass=_WithoutInside):
    """A deformed configuration: the model, its state, and the record of the solve that led to it.

    motion: state of the full model (positions [m], rotation matrices, inner states, multipliers). method: "kinematic",
    "reduced", "full", "conventional", "modal" or "constant". targets: drive values by name [m or rad]. steps: steps of the
    solve, in order. method_error: estimated error that a fast method adds to that of the mesh; None where the method is
    exact or no estimate was made (see `error`). load_factor: fraction of the loads of the scene that acts. notes: warnings
    of the solve, part of `warnings`.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> pose = ksd.solve(guide, stroke)
    >>> print(f"{pose.forces['table']:.3f} N, {pose.frequencies().frequency_Hz[0]:.2f} Hz")
    5.036 N, 60.83 Hz
    >>> print(f"{pose.stress().largest_Pa / 1e6:.1f} MPa")
    250.7 MPa
    """

    def __dir__(self) -> list[str]:
        return sorted(set(super().__dir__()) - INSIDE)

    @property
    def trust(self) -> Trust:
        """Verdicts `stable`, `branch`, `strength` and `trusted`, each yes or no with a sentence."""
        return trust_verdicts(self)

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
        spectra = check_spectra(psd, vibration_inputs(self.model.scene))
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

    def with_error(self, question: Callable[[Configuration], Answer]) -> tuple[Answer, Any]:
        """Answer of ``question(pose)`` (number, array, or mapping of them) and its error, in the same shape.

        The error is that of method and mesh: the change to the answer at the equilibrium next to this state on a finer mesh.
        Raises ConvergenceError where that is not found.
        """
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
        "with_contacts_held", "acts", "found_in_contact", "_joints", "_node", "_of_leaves", "_refuse_contact", "touched",
    )
)  # fmt: skip
"""Attributes of a configuration for other modules of the package only; `dir` leaves them out."""
