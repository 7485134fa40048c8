"""The mechanism in two dimensions: deformed over undeformed, with its drives, in millimetres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ksd.errors import SceneError
from ksd.view.figure import (
    DRIVE,
    FAINT,
    GROUND,
    INK,
    LEAF,
    LINKS,
    REST,
    Array,
    hull,
    new_figure,
    spoken_force,
    spoken_value,
)
from ksd.view.heat import Heat, heat_of
from ksd.view.labels import part_labels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ksd.solve.configuration import Configuration

_AXES = "xyz"
_BACKING = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75}


def best_plane(shape: Any) -> Literal["xy", "xz", "yz"]:
    """The coordinate plane in which the mechanism is widest: "xy", "xz" or "yz"."""
    points = np.concatenate([np.concatenate([leaf.rest, leaf.place]) for leaf in shape.leaves])
    normal = int(np.argmin(np.ptp(points, axis=0)[::-1]))
    planes: tuple[Literal["xy", "xz", "yz"], ...] = ("xy", "xz", "yz")
    return planes[normal]


def plot_mechanism(
    configuration: Configuration,
    *,
    axes: Axes | None = None,
    plane: Literal["xy", "xz", "yz"] | None = None,
    labels: bool = True,
    title: str | None = None,
    color: Literal["stress"] | None = None,
) -> Figure:
    """Draw the deformed mechanism over the undeformed one (grey); returns the matplotlib figure.

    axes: matplotlib axes to draw into, a new figure when None. plane: "xy", "xz" or "yz", the widest when
    None. labels: names of links and drives, with drive values and forces. color: "stress" colours the leaf springs by their
    von Mises stress, with a scale. Raises SceneError for another plane or colour.
    """
    shape = configuration.shape()
    plane = plane or configuration.model.scene.plane or best_plane(shape)
    if plane not in ("xy", "xz", "yz"):
        raise SceneError(f'plane = {plane!r}: choose "xy", "xz" or "yz"')
    pick = [_AXES.index(a) for a in plane]
    own = axes is None
    if axes is None:
        axes = _fitting_figure(shape, pick, wide=7.0 if color is None else 8.0).add_subplot()
    _rest(axes, shape, pick)
    _links(axes, shape, pick, labels)
    _hinges(axes, shape, pick)
    _leaves(axes, shape, pick, heat_of(configuration, shape, color))
    axes.set_aspect("equal")
    axes.margins(0.16, 0.12)
    _drives(axes, configuration, shape, pick, labels)
    _frame(axes, plane, title if title is not None else _caption(configuration))
    if own and labels:
        leaves = 1e3 * np.concatenate([leaf.place for leaf in shape.leaves])[:, pick]
        part_labels(axes, _arrows(configuration, shape, pick), leaves)
    figure: Figure = axes.figure  # type: ignore[assignment]
    return figure


def _leaves(axes: Any, shape: Any, pick: list[int], heat: Heat | None) -> None:
    """The deformed leaf springs, in one colour or in those of their stress."""
    for leaf in shape.leaves:
        if heat is None:
            _line(axes, leaf.place[:, pick], color=LEAF, linewidth=1.8, zorder=4)
        else:
            _hot(axes, 1e3 * leaf.place[:, pick], heat.between(leaf.name))
    if heat is not None:
        heat.bar(axes, shrink=0.8, aspect=30, pad=0.02)


def _hinges(axes: Any, shape: Any, pick: list[int]) -> None:
    """A circle for every pin, a box on a guide for every slider."""
    points = np.concatenate([leaf.place for leaf in shape.leaves])[:, pick]
    reach = 0.06 * float(np.ptp(points, axis=0).max())
    style = {"color": INK, "zorder": 5.5}
    for hinge in shape.hinges:
        place = hinge.place[pick]
        if hinge.kind == "slider":
            along = hinge.axis[pick]
            side = 0.25 * reach * np.array([-along[1], along[0]])
            for edge in (side, -side):
                rail = np.stack([place + edge - 1.5 * reach * along, place + edge + 1.5 * reach * along])
                _line(axes, rail, linewidth=0.9, **style)
        marker = "o" if hinge.kind == "pin" else "s"
        axes.plot(*(1e3 * place), marker=marker, markersize=6, markerfacecolor="white", **style)


def _frame(axes: Any, plane: str, title: str) -> None:
    axes.set_xlabel(f"{plane[0]} [mm]")
    axes.set_ylabel(f"{plane[1]} [mm]")
    axes.set_title(title, fontsize=10, color=INK, loc="left")
    axes.grid(True, color="#eceff4", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _arrows(configuration: Any, shape: Any, pick: list[int]) -> Array:
    """Points (n, 2) [mm] along the arrows of the drives and at the driven points."""
    along, found = np.linspace(0.0, 1.0, 25)[:, None], []
    for driven in shape.driven:
        found.append(1e3 * driven.place[None, pick])
        if driven.kind == "translation":
            way = configuration.targets[driven.name] * driven.direction[pick]
            found.append(1e3 * (driven.rest[pick] + along * way))
    return np.concatenate(found) if found else np.zeros((0, 2))


def _fitting_figure(shape: Any, pick: list[int], *, wide: float) -> Any:
    """A figure `wide` inches wide, as high as the mechanism needs at equal scales."""
    points = np.concatenate([np.concatenate([leaf.rest, leaf.place]) for leaf in shape.leaves])[:, pick]
    across, high = np.maximum(np.ptp(points, axis=0), 1e-9)
    return new_figure(wide, float(np.clip(6.2 * high / across + 0.9, 2.8, 7.0)))


def _caption(configuration: Any) -> str:
    return f"{configuration.model.scene.name}, {configuration.method}; undeformed in grey"


def _line(axes: Any, points: Array, **style: Any) -> None:
    axes.plot(1e3 * points[:, 0], 1e3 * points[:, 1], solid_capstyle="round", **style)


def _hot(axes: Any, points: Array, colors: Array) -> None:
    """A leaf as pieces between its stations, each in its colour."""
    from matplotlib.collections import LineCollection

    pieces = np.stack([points[:-1], points[1:]], axis=1)
    axes.add_collection(
        LineCollection(list(pieces), colors=colors, linewidths=2.4, capstyle="round", zorder=4)
    )


def _outline(axes: Any, points: Array, color: str, alpha: float, zorder: float) -> None:
    """The convex hull of a block's attachment points: filled, or a thick line where they lie on one."""
    corners = 1e3 * hull(points)
    if len(corners) > 2:
        axes.fill(*corners.T, facecolor=color, edgecolor="none", alpha=alpha, zorder=zorder)
        axes.plot(*np.vstack([corners, corners[:1]]).T, color=color, linewidth=1.0, zorder=zorder)
    else:
        axes.plot(*corners.T, color=color, linewidth=3.0, solid_capstyle="round", zorder=zorder)


def _pieces(block: Any, points: Array) -> list[Array]:
    """Ground in one piece per joint, as it has no body of its own; other blocks and ground of leaf springs whole."""
    owners = np.array(block.owner)
    pieces = [points[owners == name] for name in dict.fromkeys(block.owner)]
    single = all(np.ptp(piece, axis=0).max() < 1e-9 for piece in pieces)
    return [points] if block.name != "ground" or single else pieces


def _rest(axes: Any, shape: Any, pick: list[int]) -> None:
    for leaf in shape.leaves:
        _line(axes, leaf.rest[:, pick], color=REST, linewidth=1.2, zorder=1)
    for block in shape.blocks:
        if block.name != "ground":
            corners = 1e3 * hull(block.rest[:, pick])
            axes.plot(
                *np.vstack([corners, corners[:1]]).T,
                color=REST,
                linewidth=0.8,
                linestyle=(0, (4, 3)),
                zorder=1,
            )


def _links(axes: Any, shape: Any, pick: list[int], labels: bool) -> None:
    middle = np.concatenate([leaf.place for leaf in shape.leaves])[:, pick].mean(axis=0)
    links = 0
    for block in shape.blocks:
        ground = block.name == "ground"
        inner = "/" in block.name
        color = GROUND if ground else FAINT if inner else LINKS[links % len(LINKS)]
        links += not (ground or inner)
        pieces = _pieces(block, block.place[:, pick])
        for piece in pieces:
            _outline(axes, piece, color, 0.22, 2)
        if labels and not inner:
            _name(axes, block.name, pieces[0], middle)


def _name(axes: Any, name: str, points: Array, middle: Array) -> None:
    """The name of a block: inside it; where it is a line in this view beside it, away from the mechanism."""
    corners = hull(points)
    at, offset = corners.mean(axis=0), np.zeros(2)
    if len(corners) < 3:
        along = corners[-1] - corners[0]
        across = np.array([-along[1], along[0]]) if np.linalg.norm(along) > 1e-9 else at - middle
        offset = across / max(float(np.linalg.norm(across)), 1e-12)
        # a quarter along, as drives often act in the middle
        at = 0.75 * corners[0] + 0.25 * corners[-1]
        offset = (offset if offset @ (at - middle) >= 0 else -offset) * [24.0, 10.0]
    axes.annotate(
        name,
        1e3 * at,
        offset,
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8,
        color=INK,
        zorder=6,
        bbox=_BACKING,
    )


def _drives(axes: Any, configuration: Any, shape: Any, pick: list[int], labels: bool) -> None:
    """An arrow along every driven displacement, from rest; a ring at every driven point; value and force."""
    for driven in shape.driven:
        rest, place = 1e3 * driven.rest[pick], 1e3 * driven.place[pick]
        value, tip = configuration.targets[driven.name], place
        if driven.kind == "translation":
            tip = rest + 1e3 * value * driven.direction[pick]
            axes.annotate(
                "",
                tip,
                rest,
                zorder=5,
                arrowprops={
                    "arrowstyle": "-|>",
                    "color": DRIVE,
                    "linewidth": 1.4,
                    "shrinkA": 0,
                    "shrinkB": 0,
                },
            )
            axes.plot(*np.stack([tip, place]).T, color=DRIVE, linewidth=0.8, linestyle=":", zorder=5)
        axes.plot(*place, marker="o", markersize=5, color=DRIVE, markerfacecolor="white", zorder=6)
        if labels:
            said = f"{driven.name}: {spoken_value(value, driven.kind)}, "
            said += spoken_force(configuration.forces[driven.name], driven.kind)
            axes.annotate(
                said,
                tip,
                (8, 6),
                textcoords="offset points",
                fontsize=8,
                color=DRIVE,
                zorder=7,
                bbox=_BACKING,
            )
