"""Effects that the motion of a planar scene does not call for and questions out of its plane do.

While a mechanism stays in its plane no leaf twists, so that restrained warping changes neither forces nor poses, however
large its factor. It is left out of such a model and taken up by what is asked afterwards: support stiffness, frequencies,
buckling. The state is the same with and without it.
"""

from __future__ import annotations

from dataclasses import replace

from ksd.model.compile import Model, compile_given, marked
from ksd.model.effects import Choice
from ksd.model.plane import plane_of
from ksd.properties.kept import per_model

_WHY = "no leaf twists while the scene stays in its plane; taken up by questions out of it"


def for_moving(model: Model) -> Model:
    """The model without the effects kept by estimate that only questions out of its plane call for."""
    choice = model.choice
    if choice is None or not choice["warping"].kept or isinstance(plane_of(model), str):
        return model
    effects = tuple(
        replace(e, present=False, later=True, reason=f"{_WHY}; {e.reason}") if e.name == "warping" else e
        for e in choice.effects
    )
    return _with(model, replace(choice, effects=effects))


@per_model
def for_questions(model: Model) -> Model:
    """The model with the effects that were left for questions; the same one where there are none."""
    choice = model.choice
    if choice is None or not any(e.later for e in choice.effects):
        return model
    effects = tuple(replace(e, present=True, later=False) if e.later else e for e in choice.effects)
    return _with(model, replace(choice, effects=effects))


def _with(model: Model, choice: Choice) -> Model:
    """The same scene as it stands, with the leaf effects of `choice`."""
    mesh = replace(model.mesh, warping=choice["warping"].present)
    return marked(compile_given(model.scene, mesh), model.said, choice)
