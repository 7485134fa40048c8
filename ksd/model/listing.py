"""What a model simulates and what it leaves out, line by line, for print(model) and the report."""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.model.effects import WORDS
from ksd.model.plane import plane_of

_SILENT = "the scene says nothing of it"


def listing(model: Any) -> list[tuple[str, str]]:
    """(head, text) of every line: sizes, effects present, effects left out with the reason, what is made on demand."""
    scene, arrays = model.scene, model.arrays
    rows = len(model.drive_names) + len(model.support_names)
    inner = arrays.members.inner_at[-1]
    lines = [
        (
            scene.name,
            f"{len(scene.links) - 1} links, {len(scene.joints)} joints, {len(model.member_names)} leafs as {model.mesh}",
        ),
        (
            "unknowns",
            f"{arrays.plan.unknowns - rows} at nodes, {rows} multiplier{'s' * (rows != 1)}, "
            f"{inner} condensed inside the leafs",
        ),
        ("simulated", f"bending, torsion and stretch of the leafs{_drawn(model)}; {_rigid(model)}"),
    ]
    if len(arrays.loads.node):
        weights = ", gravity among them" if scene.gravity else ""
        lines.append(("loads", f"{len(arrays.loads.node)} on links{weights}"))
    lines += _present(model)
    if len(arrays.weight):
        mass, pull = arrays.weight[:, 0].sum(), np.linalg.norm(arrays.weight[0, 1:])
        lines.append(("weight of the leafs", f"{mass:.3g} kg along them, {mass * pull:.3g} N"))
    plane = plane_of(model)
    if isinstance(plane, str):
        lines.append(("with spatial", f"six unknowns per node, since {plane}"))
    else:
        lines.append(
            ("without spatial", "it lies in a plane: three unknowns per node, the answer checked in space")
        )
    lines += _absent(model)
    lines.append(
        ("made when asked for", "mass (frequencies, state space), spatial stiffness, stress, buckling")
    )
    return lines


def _drawn(model: Any) -> str:
    listed = model.choice.listed if model.choice is not None else ()
    return "".join(f"; {words}" for words in listed)


def _rigid(model: Any) -> str:
    elastic = "other " if "compliance" in _names(model, present=True) else ""
    return f"{elastic}links and blocks are rigid and eliminated"


def _names(model: Any, *, present: bool) -> tuple[str, ...]:
    if model.choice is None:
        return tuple(n for n in ("shear", "warping", "plate") if getattr(model.mesh, n) is present)
    return tuple(model.choice.present if present else model.choice.absent)


def _present(model: Any) -> list[tuple[str, str]]:
    if model.choice is None:
        return [(f"with {n}", "as the mesh says") for n in _names(model, present=True)]
    return [(f"with {e.name}", e.reason) for e in model.choice.effects if e.present and e.name != "spatial"]


def _absent(model: Any) -> list[tuple[str, str]]:
    if model.choice is None:
        return [(f"without {n}", "as the mesh says") for n in _names(model, present=False)]
    lines = [
        (f"without {e.name}", e.reason)
        for e in model.choice.effects
        if not e.present and e.name != "spatial" and e.reason != _SILENT
    ]
    silent = [WORDS[e.name] for e in model.choice.effects if not e.present and e.reason == _SILENT]
    if silent:
        lines.append(("left out", f"{', '.join(silent)}: the scene says nothing of them"))
    return lines
