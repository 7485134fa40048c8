"""Changes that plate stiffening and restrained warping would make to a result whose model leaves them out.

Newton steps lead from the state to the equilibrium of the same mesh with the effect; forces, poses and support stiffness of
both are compared, as `ksd effects` does for all effects with a whole solve for each.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ksd.answers.derived import cached_per_model
from ksd.answers.printing import NamedAnswerTable, format_signed_percent
from ksd.answers.stiffness import point_stiffness
from ksd.answers.tangent import exact_tangent_arrays
from ksd.errors import KsdError
from ksd.model.arrays import TRANSLATION, State
from ksd.model.chosen_effects import with_conditions, with_twists
from ksd.model.compile import Model, compile_as_is
from ksd.model.plate_runs import is_wide, plate_conditions
from ksd.solvers.contact_state import Touched, contact_points
from ksd.solvers.error import find_equilibrium
from ksd.solvers.held_contacts import hold_contacts
from ksd.solvers.near_contact import equilibrium_in_contact
from ksd.solvers.result import Result

COMPARED = ("force", "displacement", "support_stiffness")
"""Quantities that are compared."""
ROUNDING_DISPLACEMENT, ROUNDING_FORCE = 1e-11, 1e-13
"""Displacement relative to the size of the mechanism, and force relative to EA of its stiffest leaf, that
count as rounding."""


class LeftOut(NamedAnswerTable[dict[str, float]]):
    """Relative changes by effect that is left out; prints as a table."""

    def __init__(self, changes: Mapping[str, dict[str, float]]) -> None:
        title = "Change if an effect that is not in the model were [%]"
        columns = ("effect", *(what.replace("_", " ") for what in COMPARED))
        super().__init__(changes, title, columns, _percents)

    def __repr__(self) -> str:
        effects = (
            f"{name} {{{', '.join(f'{k}: {format_signed_percent(100 * v)} %' for k, v in row.items())}}}"
            for name, row in self.items()
        )
        return f"<LeftOut: {', '.join(effects) or 'nothing'}>"


def _percents(changes: Mapping[str, float]) -> list[str]:
    """Table cells [%] of the changes of the COMPARED quantities."""
    return [format_signed_percent(100.0 * changes[what]) if what in changes else "-" for what in COMPARED]


def left_out(pose: Result) -> LeftOut:
    """Signed relative changes by effect that is left out and that some leaf could have.

    "force": largest change of a drive force, relative to the largest force; "displacement": of the largest link
    displacement; "support_stiffness": of the softest one of the first driven link. Of forces and displacements that are
    rounding, as those of an unloaded mechanism, the change is 0. Empty where nothing converged, and with solids.
    """
    model, motion = pose.unreduced_state
    if not pose.converged or model.solids:
        return LeftOut({})
    target, factor = model.targets(pose.targets), pose.load_factor

    def near(model: Model, state: State) -> tuple[Model, State, Touched | None] | None:
        if pose.found_in_contact:
            return equilibrium_in_contact(pose, model, state)
        found = find_equilibrium(exact_tangent_arrays(model), state, target, factor)
        return None if found is None else (model, found, None)

    own = (model, motion, pose.touched) if pose.found_in_contact else near(model, motion.copy())
    if own is None:
        return LeftOut({})
    changes = {}
    for name, other in (("plate", _with_plates(model)), ("warping", _with_warping(model))):
        there = None if other is model else near(other, own[1].copy())
        if there is not None:
            changes[name] = _changes(own, there, factor)
    return LeftOut(changes)


@cached_per_model
def _with_plates(model: Model) -> Model:
    """The model with plate stiffening; the model itself where it has that, or no leaf is wide."""
    if model.mesh.plate or not any(is_wide(leaf) for leaf in model.scene.leaf_names().values()):
        return model
    stiffened = with_conditions(model.scene, plate_conditions(model.scene))
    return compile_as_is(stiffened, model.mesh.with_effect("plate"), model.original_scene)


@cached_per_model
def _with_warping(model: Model) -> Model:
    """The model with restrained warping; the model itself where it has that, or no leaf warps."""
    warps = [leaf.section.Iw > 0.0 for _, leaf in model.scene.leaf_names().items()]
    if model.mesh.warping or not any(warps):
        return model
    return compile_as_is(with_twists(model.scene), model.mesh.with_effect("warping"), model.original_scene)


def _changes(
    without: tuple[Model, State, Touched | None],
    with_: tuple[Model, State, Touched | None],
    load_factor: float,
) -> dict[str, float]:
    """Relative changes from the state without an effect to that with it: model, state, and contacts that act."""
    (model, one, touched), (_, other, still) = without, with_
    drives, links = len(model.drive_names), model.links
    size, stiffness = model.arrays.size, float(model.arrays.members.stiffness_scale.max(initial=0.0))
    unit = np.where(model.arrays.terms.kind[model.arrays.terms.first[:drives]] == TRANSLATION, 1.0, size)
    found = {}
    if drives:
        # of the force that changes most, relative to the largest force
        first, second = (np.abs(m.multiplier[:drives]) / unit for m in (one, other))
        most = int(np.argmax(np.abs(second - first)))
        found["force"] = _ratio(second[most] - first[most], first.max(), ROUNDING_FORCE * stiffness * size)
    moved = [
        np.linalg.norm(m.x[1:links] - model.rest.x[1:links], axis=1).max(initial=0.0) for m in (one, other)
    ]
    found["displacement"] = _ratio(moved[1] - moved[0], moved[0], ROUNDING_DISPLACEMENT * size)
    states = [{name: c.state for name, c in contact_points(t).items()} for t in (touched, still)]
    if states[0] != states[1]:
        # one that slips in one of them only
        return found
    terms = [t for d in model.scene.drives for t in d.terms]
    link = terms[0].link if terms else model.scene.links[1]
    try:
        held = [
            hold_contacts(m, s, t) if t is not None and t.closed else (m, s) for m, s, t in (without, with_)
        ]
        soft = [point_stiffness(m, s, link, load_factor=load_factor).worst[0] for m, s in held]
    except KsdError:
        return found
    return found | {"support_stiffness": _ratio(soft[1] - soft[0], soft[0])}


def _ratio(change: float, whole: float, rounding: float = 0.0) -> float:
    """Relative change; 0 where the whole is rounding or infinite."""
    return float(change / whole) if whole > rounding and np.isfinite(whole) else 0.0
