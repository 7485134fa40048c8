"""The mechanism in three dimensions: leaf springs as ribbons, deformed over undeformed, in millimetres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ksd.view.figure import FAINT, GROUND, INK, LEAF, LINKS, REST, Array, new_figure
from ksd.view.flat import _BACKING, _caption
from ksd.view.heat import heat_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from ksd.solve.configuration import Configuration


def ribbon(place: Array, axes: Array, width: Array) -> tuple[Array, Array]:
    """The two edges (k, 3) of a leaf: centreline plus and minus half its width along e3."""
    half = 0.5 * width[:, None] * axes[:, :, 2]
    return place - half, place + half


def plot_mechanism_3d(
    configuration: Configuration,
    *,
    axes: Axes3D | None = None,
    elevation: float = 30.0,
    azimuth: float = -60.0,
    title: str | None = None,
    color: Literal["stress"] | None = None,
) -> Figure:
    """Draw ribbons and links in perspective; returns the matplotlib figure.

    axes: 3D matplotlib axes, a new figure when None. elevation, azimuth [deg]: where it is seen from. color: as in
    `plot_mechanism`.
    """
    shape = configuration.shape()
    heat = heat_of(configuration, shape, color)
    if axes is None:
        axes = new_figure(7.0, 5.4).add_subplot(projection="3d")
    for leaf in shape.leaves:
        _outline(axes, ribbon(leaf.rest, leaf.rest_axes, leaf.width), REST)
        _ribbon(
            axes, ribbon(leaf.place, leaf.axes, leaf.width), None if heat is None else heat.between(leaf.name)
        )
    _links(axes, shape)
    for hinge in shape.hinges:
        marker = "o" if hinge.kind == "pin" else "s"
        axes.plot(*(1e3 * hinge.place[:, None]), marker=marker, color=INK, markerfacecolor="white")
    edges = [
        ribbon(*f, leaf.width)
        for leaf in shape.leaves
        for f in ((leaf.rest, leaf.rest_axes), (leaf.place, leaf.axes))
    ]
    points = 1e3 * np.concatenate([e for pair in edges for e in pair])
    middle, reach = 0.5 * (points.min(axis=0) + points.max(axis=0)), np.ptp(points, axis=0)
    reach = np.maximum(reach, 0.25 * reach.max())
    for name, m, r in zip("xyz", middle, reach, strict=True):
        getattr(axes, f"set_{name}lim")(m - 0.5 * r, m + 0.5 * r)
        getattr(axes, f"set_{name}label")(f"{name} [mm]", labelpad=4 + 10 * r / reach.max())
        getattr(axes, f"{name}axis").set_major_locator(_few_ticks(r / reach.max()))
    axes.set_box_aspect(reach, zoom=0.95)
    if heat is not None:
        heat.bar(axes, shrink=0.6, aspect=25, pad=0.1)
    axes.view_init(elev=elevation, azim=azimuth)
    axes.set_title(title if title is not None else _caption(configuration), fontsize=10, color=INK)
    return axes.figure


def _few_ticks(share: float) -> Any:
    """Fewer ticks on shorter axes, so that their labels do not touch."""
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=max(2, round(5 * share)))


def _ribbon(axes: Any, edges: tuple[Array, Array], colors: Array | None) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    low, high = (1e3 * e for e in edges)
    quads = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
    # shading would change what a colour says
    plain = LEAF if colors is None else colors
    axes.add_collection3d(
        Poly3DCollection(quads, facecolors=plain, edgecolors=plain, linewidths=0.2, shade=colors is None)
    )
    _outline(axes, edges, LEAF if colors is None else INK)


def _outline(axes: Any, edges: tuple[Array, Array], color: str) -> None:
    low, high = (1e3 * e for e in edges)
    axes.plot(*np.vstack([low, high[::-1], low[:1]]).T, color=color, linewidth=0.8)


def _links(axes: Any, shape: Any) -> None:
    """Every block as lines from its middle to its attachment points; ground as points."""
    links = 0
    for block in shape.blocks:
        if block.name == "ground":
            axes.plot(*(1e3 * block.place.T), linestyle="none", marker="s", markersize=3, color=GROUND)
            continue
        inner = "/" in block.name
        color = FAINT if inner else LINKS[links % len(LINKS)]
        links += not inner
        middle = block.place.mean(axis=0)
        for point in block.place:
            axes.plot(*(1e3 * np.stack([middle, point]).T), color=color, linewidth=1.6)
        if not inner:
            axes.text(*(1e3 * middle), block.name, fontsize=8, color=INK, zorder=20, bbox=_BACKING)
