"""Equilibria in contact next to one, for differences: each is solved anew, straight from rest, as `ksd.solve` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ksd.errors import ConvergenceError
from ksd.model.compile import Model, compile_with_effects
from ksd.scene.obstacle import without_contacts
from ksd.scene.scene import Scene
from ksd.solvers.configuration import Configuration
from ksd.solvers.perturbed import GradientParameter
from ksd.solvers.solver import Solver
from ksd.solvers.verdict import refusal

CONTACT_STEP = 1e-3
"""Relative step of differences of fourth order, large beside what equilibria in contact leave open."""


class ContactEquilibria:
    """Equilibria of a scene with contacts, with each parameter at value + step * scale for each of the relative `steps`."""

    def __init__(self, steps: Sequence[float]) -> None:
        self.steps = tuple(steps)

    def __call__(
        self, pose: Configuration, parameters: Sequence[GradientParameter]
    ) -> tuple[Configuration, list[list[Configuration]]]:
        """The pose itself, and the perturbed ones by parameter and step. Raises ConvergenceError where there is none, and
        where a contact opens, closes, sticks or slips between them, or where one is not to be trusted."""
        state, same = _contact_state(pose), Solver(_with_effects_of(pose.model, pose.model.original_scene))
        sides: list[list[Configuration]] = []
        for parameter in parameters:
            own, p = [], parameter.one_sided(self.steps)
            for step in self.steps:
                value = p.value + step * p.scale
                solver = same if p.scene is None else Solver(_with_effects_of(pose.model, p.scene(value)))
                values = p.targets_at(pose.targets, value)
                found = solver(values, strict=False, estimate=False)
                changed = {n for n, s in _contact_state(found).items() if state.get(n) != s}
                if changed:
                    raise ConvergenceError(
                        f"no gradient by '{p.name}': '{min(changed)}' opens, closes, sticks or slips between {p.value:.6g} "
                        f"and {value:.6g}; ask on one side of that"
                    )
                if (reason := refusal(found)) and not refusal(pose):
                    raise ConvergenceError(f"no gradient by '{p.name}': at {value:.6g} {reason}")
                own.append(found)
            sides.append(own)
        return pose, sides


def _with_effects_of(model: Model, scene: Scene) -> Model:
    """The model of a scene on the mesh, and with the effects, of a model."""
    assert model.choice is not None
    return replace(
        compile_with_effects(without_contacts(scene), model.mesh, model.choice), original_scene=scene
    )


def _contact_state(pose: Configuration) -> dict[str, str]:
    """The state of every stop, cable and contact by name."""
    one_sided = {**pose.stops, **pose.cables}
    return {n: "closed" if part.force else "open" for n, part in one_sided.items()} | {
        n: c.state for n, c in pose.contacts.items()
    }
