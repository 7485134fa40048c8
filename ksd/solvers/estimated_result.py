"""A result with what is known of its errors and limits: the questions that its verdicts read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from ksd.answers.forces import SectionForces, section_forces
from ksd.answers.strength import Strength, strength, unusual_values
from ksd.answers.stress import strain_energy
from ksd.checks import clear_argument_errors_of_methods, whole_number
from ksd.modal.leaf_bodies import full_model_state
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.solvers.error import equilibrium_near, error_estimate, refinement_step_suffices
from ksd.solvers.left_out import left_out
from ksd.solvers.result import Result
from ksd.solvers.steps import FAST_METHODS, ErrorEstimate
from ksd.solvers.undeformed_stability import multiple_minima_note


@clear_argument_errors_of_methods
@dataclass(frozen=True, repr=False)
class EstimatedResult(Result):
    """A `Result` with its estimated error, the effects that its model leaves out, its strength and its warnings, each
    computed when first read, and the equilibrium of the full model next to it."""

    @cached_property
    def error(self) -> ErrorEstimate | None:
        """Estimated total error, that of the mesh included, computed when first read: `ksd.solvers.error.error_estimate`."""
        return error_estimate(self)

    @cached_property
    def left_out(self) -> dict[str, dict[str, float]]:
        """Relative changes of "force", "displacement" and "support_stiffness" that plate stiffening and restrained warping
        would make, by effect that is not in the model; computed when first read (`ksd.solvers.left_out`)."""
        return left_out(self)

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

    @cached_property
    def minimum(self) -> str:
        """Which of several minima this is, in a sentence, where the undeformed configuration is unstable under preload,
        heat, assembly errors or loads; empty elsewhere."""
        return (
            "" if self.model.solids or self.acts else multiple_minima_note(*self.unreduced_state, self.stable)
        )

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

    def strain_energy(self) -> dict[str, float]:
        """Strain energy [J] of every leaf by full name, and of springs; the sum is the energy that the mechanism stores."""
        return strain_energy(*self.unreduced_equilibrium, load_factor=self.load_factor)

    def section_forces(self, *, points: int = 25) -> dict[str, SectionForces]:
        """Normal and shear forces [N], torsion and bending moments [Nm] along every leaf by full name, at `points` stations
        (of a chain: at its nodes)."""
        return section_forces(
            *self.unreduced_equilibrium,
            points=whole_number(points, "points", least=2),
            load_factor=self.load_factor,
        )


Estimated = TypeVar("Estimated", bound=EstimatedResult)
"""An estimated result, or a `Configuration`."""
