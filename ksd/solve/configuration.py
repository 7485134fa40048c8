"""The result of a solve: model and state, the steps taken, and how it knows it is right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.errors import SceneError
from ksd.model.arrays import Motion
from ksd.model.compile import Model
from ksd.solve.reading import Reading
from ksd.solve.steps import ErrorEstimate, FiveStepRecord, Step
from ksd.solve.stops import Stop

if TYPE_CHECKING:
    from ksd.properties.strength import Strength


@dataclass(frozen=True, repr=False, init=False)
class Configuration:
    """A deformed configuration: the model, its state, and the record of the solve that found it.

    motion: state of the full model (positions m, rotation matrices, inner states, multipliers). method: kinematic,
    reduced, full, conventional or modal. targets: drive values by name [m or rad]. motions: intended motion of every
    joint by name [rad or m], unintended: per joint (6,) displacement [m] and rotation [rad] of interface B off its
    intended pose, in joint axes. method_error: estimate of what the fast methods add to the error of the mesh, made with
    the solve; None where the method is exact (see `error`). negatives:
    negative pivots at the end, expected: those the constraint rows explain. doubts: what speaks against the branch and
    was not cleared up by smaller steps. notes: what the solve itself warns of, part of `warnings`. near: every joint was
    seen near its intended motion, so the verdict need not look again.
    """

    model: Model
    motion: Motion
    method: str
    targets: Mapping[str, float]
    steps: Sequence[Step]
    negatives: int
    expected: int
    motions: Mapping[str, float]
    unintended: Mapping[str, np.ndarray]
    method_error: ErrorEstimate | None
    notes: tuple[str, ...]
    load_factor: float
    doubts: tuple[str, ...]
    chosen: bool
    near: bool

    def __init__(
        self,
        model: Model,
        motion: Motion,
        method: str,
        targets: Mapping[str, float],
        steps: Sequence[Step],
        *,
        negatives: int,
        expected: int,
        motions: Mapping[str, float] | None = None,
        unintended: Mapping[str, np.ndarray] | None = None,
        reading: Reading | None = None,
        method_error: ErrorEstimate | None = None,
        notes: tuple[str, ...] = (),
        load_factor: float = 1.0,
        doubts: tuple[str, ...] = (),
        chosen: bool = False,
        near: bool = False,
    ) -> None:
        # at once: a frozen dataclass of its own takes 5 us for so many fields, a tenth of a planar solve
        self.__dict__.update(
            model=model, motion=motion, method=method, targets=targets, steps=steps, negatives=negatives,
            expected=expected, method_error=method_error, notes=notes, load_factor=load_factor,
            doubts=doubts, chosen=chosen, near=near,
        )  # fmt: skip
        if reading is not None:
            self.__dict__["_reading"] = reading
        else:
            self.__dict__.update(motions=motions or {}, unintended=unintended or {})

    def __getattr__(self, name: str) -> Any:
        # of an answer just found the motions of its joints are not yet under their names
        reading = self.__dict__.get("_reading")
        if reading is None or name not in ("motions", "unintended"):
            raise AttributeError(f"a configuration has no '{name}'")
        found = reading.by_motion() if name == "motions" else reading.by_joint()
        self.__dict__[name] = found
        return found

    def __repr__(self) -> str:
        forces = ", ".join(f"{n} {v:.6g}" for n, v in self.forces.items())
        return (
            f"<Configuration of '{self.model.scene.name}' by {self.method}: {self.targets}, forces {forces}>"
        )

    @property
    def converged(self) -> bool:
        """Whether the last step reached equilibrium (or, for kinematic, closed all loops)."""
        steps = self.steps
        return (steps.last if isinstance(steps, FiveStepRecord) else steps[-1].stop) is Stop.CONVERGED

    @property
    def stable(self) -> bool:
        """No negative pivots beyond those of the constraint rows: a minimum of energy under the held drives; where loads
        are not conservative, no divergence and no flutter."""
        if self.negatives != self.expected:
            return False
        return not len(self.model.arrays.loads.skew) or self.still is None or self.still[0]

    @cached_property
    def still(self) -> tuple[bool, str] | None:
        """Whether it flutters, in words, where loads follow their links or are moments; else None."""
        if not self.model.arrays.loads.skew.any() or not self.converged:
            return None
        from ksd.solve.following import keeps_still

        return keeps_still(*self.insides, self.load_factor)

    @property
    def trust(self) -> Any:
        """Verdicts `stable`, `branch`, `trusted`, each with a sentence: `ksd.solve.trust.Trust`."""
        from ksd.solve.trust import judge

        return judge(self)

    @cached_property
    def error(self) -> ErrorEstimate | None:
        """What it is off the truth, the error of its mesh included, found when asked for: `ksd.solve.error.error_of`."""
        from ksd.solve.error import error_of

        return error_of(self)

    @cached_property
    def left_out(self) -> dict[str, dict[str, float]]:
        """What plate stiffening and restrained warping, where they are not in the model, would change here: relative change
        of "force", "displacement" and "support_stiffness" by effect, measured when asked for: `ksd.solve.left_out`."""
        from ksd.solve.left_out import left_out

        return left_out(self)

    @property
    def branch(self) -> str:
        """Why this is, or is not, the branch meant, in one sentence."""
        return str(self.trust.branch)

    @property
    def trusted(self) -> bool:
        """Whether it converged, is stable, and lies on the branch meant; `trust.trusted` says why."""
        return bool(self.trust.trusted)

    @cached_property
    def strength(self) -> Strength | None:
        """Largest strain and stress of all leafs, and the share of their limits; None where leafs are reduced solids."""
        from ksd.properties.strength import strength

        if getattr(self.model, "solids", None):
            return None
        return strength(*self.insides, load_factor=self.load_factor)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know: of the solve, of the scene (`ksd.scene.plausible`), and of strain and stress."""
        from ksd.properties.strength import unusual

        strain = () if self.strength is None else self.strength.warnings
        return (*self.notes, *filter(None, [self.minimum]), *unusual(self.model), *strain)

    @cached_property
    def minimum(self) -> str:
        """Which of several minima this is, where preload makes the undeformed configuration unstable; else nothing."""
        from ksd.solve.rest import minimum_taken

        return minimum_taken(self.model, self.motion, self.stable) if self.model.spring_names else ""

    @property
    def iterations(self) -> int:
        """Matrix solves of all steps together."""
        return sum(s.iterations for s in self.steps)

    @property
    def time(self) -> float:
        """Thread time [s] of all steps together."""
        return sum(s.time for s in self.steps)

    @property
    def forces(self) -> dict[str, float]:
        """Drive force [N] or moment [Nm] by drive name: what the drive exerts on its link, positive along the drive."""
        count = len(self.model.drive_names)
        return {
            n: -float(m) for n, m in zip(self.model.drive_names, self.motion.multiplier[:count], strict=True)
        }

    @property
    def reactions(self) -> dict[str, float]:
        """What every support exerts [N or Nm], by support name."""
        count = len(self.model.drive_names)
        return {
            n: -float(m)
            for n, m in zip(self.model.support_names, self.motion.multiplier[count:], strict=True)
        }

    @property
    def links(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Displacement (3,) [m] of the reference point and rotation matrix (3, 3) of every link, by name."""
        rest = self.model.rest
        return {
            link: (self.motion.x[i] - rest.x[i], self.motion.R[i].copy())
            for i, link in enumerate(self.model.scene.links)
        }

    def rotation(self, link: str) -> np.ndarray:
        """Rotation vector (3,) [rad] of a link from rest, global axes. Raises SceneError for an unknown name."""
        from ksd.numerics.rotations import rotation_log

        found = np.empty(3)
        rotation_log(self.motion.R[self._node(link)], found)
        return found

    def displacement(self, link: str, at: Any) -> np.ndarray:
        """Displacement (3,) [m] of the point of a link that is at `at` (3,) [m] at rest. Raises SceneError for an unknown
        name."""
        i = self._node(link)
        arm = np.asarray(at, float) - self.model.rest.x[i]
        return self.motion.x[i] + self.motion.R[i] @ arm - np.asarray(at, float)

    def _node(self, link: str) -> int:
        """Number of a link or internal block."""
        known = self.model.node_names
        if link not in known:
            raise SceneError(f"link '{link}' is not part of this mechanism; there are {', '.join(known)}")
        return known.index(link)

    @cached_property
    def answering(self) -> Motion:
        """The state that questions beyond forces and poses are asked of: its own, or, where `solve` chose a fast method
        itself, the equilibrium next to it. Raises ConvergenceError where that is not found."""
        from ksd.solve.corrected import FAST, settled

        return settled(self) if self.chosen and self.method in FAST else self.motion

    @property
    def insides(self) -> tuple[Model, Motion]:
        """Model and state with every leaf's own insides: those of the configuration, or, of modal bodies, the chains they
        reduce at the nodes they have."""
        return _opened(self.model, self.motion)

    @property
    def questioned(self) -> tuple[Model, Motion]:
        """Model and state that questions are asked of: the state `answering`, the model with the effects that only
        questions call for (`ksd.properties.later`)."""
        from ksd.properties.later import for_questions

        return for_questions(self.model), self.answering

    @property
    def unreduced(self) -> tuple[Model, Motion]:
        """As `questioned`, with every leaf's own insides (see `insides`). Stress, energy, mass and buckling are asked of
        these."""
        model, motion = self.questioned
        return _opened(model, motion)

    def _of_leafs(self, question: str) -> None:
        """Raises SceneError where the leafs that a question is asked of are reduced solids."""
        solids = getattr(self.model, "solids", None)
        if solids:
            raise SceneError(
                f"{question} is not known of reduced solids ({', '.join(solids)}); ask it of the leafs in their place, "
                "or of the meshed solid itself"
            )

    def validity(self, **options: Any) -> Any:
        """Stroke and local rotation up to which the modal basis of a leaf is good: `ksd.solve.validity.validity`."""
        from ksd.solve.validity import validity

        return validity(self.model, **options)  # type: ignore[arg-type]

    def stiffness(self, link: Any, **options: Any) -> Any:
        """Compliance and stiffness of a point of a link: `ksd.properties.stiffness.point_stiffness`."""
        from ksd.properties.stiffness import point_stiffness

        return point_stiffness(*self.questioned, link, load_factor=self.load_factor, **options)

    def drive_stiffness(self, **options: Any) -> Any:
        """dF/dd [N/m, Nm/rad] of all held drives: `ksd.properties.stiffness.drive_stiffness`."""
        from ksd.properties.stiffness import drive_stiffness

        return drive_stiffness(*self.questioned, load_factor=self.load_factor, **options)

    def frequencies(self, **options: Any) -> Any:
        """Eigenfrequencies [Hz] and modes about this state: `ksd.properties.frequencies.frequencies`."""
        from ksd.properties.frequencies import frequencies

        self._of_leafs("frequencies")
        return frequencies(*self.unreduced, load_factor=self.load_factor, **options)

    def buckling(self, link: Any = None, **options: Any) -> Any:
        """Critical load factors of an added load, or of the state's own stresses: `ksd.properties.buckling.buckling`."""
        from ksd.properties.buckling import buckling

        self._of_leafs("buckling")
        return buckling(*self.unreduced, link, load_factor=self.load_factor, **options)

    def stress(self, *, points: int = 25) -> Any:
        """Stress [Pa] along every leaf, where and how much: `ksd.properties.stress.stress`."""
        from ksd.properties.stress import stress

        self._of_leafs("stress")
        return stress(*self.unreduced, points=points, load_factor=self.load_factor)

    def strain_energy(self) -> dict[str, float]:
        """Strain energy [J] of every leaf by name."""
        from ksd.properties.stress import strain_energy

        return strain_energy(*self.unreduced, load_factor=self.load_factor)

    def with_error(self, question: Any) -> tuple[Any, Any]:
        """Answer and error figure of ``question(pose)`` (number, array, mapping): `ksd.solve.corrected.with_error`."""
        from ksd.solve.corrected import with_error

        return with_error(self, question)

    def sensitivity(self, question: Any, link: Any, **load: Any) -> Any:
        """Change of ``question(pose)`` per load on a link: `ksd.solve.sensitivity.sensitivity`."""
        from ksd.solve.sensitivity import sensitivity

        return sensitivity(self, question, link, **load)

    def internal_stress(self, **options: Any) -> Any:
        """Stress [Pa] when leafs are clamped beside their place: `ksd.properties.internal_stress.internal_stress`."""
        from ksd.properties.internal_stress import internal_stress

        self._of_leafs("internal stress")
        return internal_stress(*self.unreduced, load_factor=self.load_factor, **options)

    def interface_forces(self) -> Any:
        """What joints, free leafs and springs exert on the links and on ground: `ksd.properties.interface_forces`."""
        from ksd.properties.interface_forces import interface_forces

        return interface_forces(*self.unreduced, load_factor=self.load_factor)

    def parasitic(self, link: Any = None, *, at: Any = None) -> Any:
        """Motion of a point that no drive prescribes: `ksd.properties.parasitic.parasitic`."""
        from ksd.properties.parasitic import parasitic

        return parasitic(self.model, self.motion, link, at=at)

    def pivot_shift(self, joint: Any, *, at: Any = None) -> Any:
        """How far the pivot of a joint has moved: `ksd.properties.parasitic.pivot_shift`."""
        from ksd.properties.parasitic import pivot_shift

        return pivot_shift(self.model, self.motion, joint, at=at)

    def section_forces(self, *, points: int = 25) -> dict[str, Any]:
        """Section forces along every leaf by name, see `ksd.properties.section_forces`."""
        from ksd.properties.section_forces import section_forces

        return section_forces(*self.unreduced, points=points, load_factor=self.load_factor)

    def shape(self, *, points: int = 25) -> Any:
        """Centrelines of all leafs and outlines of all links, see `ksd.properties.shape.Shape`."""
        from ksd.properties.shape import mechanism_shape

        return mechanism_shape(*self.insides, points=points)

    def as_dict(self) -> dict[str, Any]:
        """Every number of the tables and more, units in the keys; layout in `ksd.solve.answer.SCHEMA`."""
        from ksd.solve.answer import as_dict

        return as_dict(self)

    def plot(self, path: Any = None, **options: Any) -> Any:
        """Picture of the deformed over the undeformed mechanism, written to `path` if given; options of
        `ksd.view.plot_mechanism`. Returns the matplotlib figure. Raises SceneError for an unknown file type."""
        from ksd.view import plot_mechanism, save_figure

        figure = plot_mechanism(self, **options)
        return figure if path is None else save_figure(figure, path)

    def view(self, path: Any = None) -> Any:
        """The deformed mechanism in three dimensions: a window to turn it in, a .png rendered without one (both by the
        `view` extra), or a .vtu file for ParaView; returns the path. See `ksd.view`."""
        from ksd.view import show_mechanism, write_vtu

        picture = path is None or str(path).lower().endswith(".png")
        return show_mechanism(self, path) if picture else write_vtu(self, path)

    def tables(self) -> list[Any]:
        """Rich renderables of the result, see `ksd.solve.report`."""
        from ksd.solve.report import tables

        return tables(self)

    def __str__(self) -> str:
        from ksd.properties.words import printed

        return printed(*self.tables())


def note_turn(found: Configuration, turned: float) -> None:
    """Leave the largest turn of a strain-mode leaf per quadrature point [rad] with the answer, for the verdict."""
    found.__dict__["_turned"] = turned


def with_reading(
    found: Configuration, reading: Reading, notes: tuple[str, ...], *, near: bool
) -> Configuration:
    """The same with the motions of its joints, as read where their records are known, and what was not found."""
    told = object.__new__(Configuration)
    told.__dict__.update(found.__dict__, _reading=reading, notes=(*found.notes, *notes), near=near)
    for name in ("motions", "unintended", "warnings"):
        told.__dict__.pop(name, None)
    return told


def _opened(model: Model, motion: Motion) -> tuple[Model, Motion]:
    """The chains of modal bodies at the nodes they have; any other model and state as they are."""
    from ksd.modal.bodies import ModalModel, inside

    return (model.full, inside(model, motion)) if isinstance(model, ModalModel) else (model, motion)
