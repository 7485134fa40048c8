"""The mechanism, deformed over undeformed, in millimetres: onto a coordinate plane, or in space without perspective."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ksd.model.plane import Plane, plane_of
from ksd.view.arrows import draw_arrows, draw_distances, draw_springs
from ksd.view.bodies import (
    THICK,
    Pad,
    Polygon,
    back_of,
    block_colors,
    body,
    facing,
    hatches,
    hull,
    outlines,
    pads,
    parts,
    sheets,
    size_of,
    sparse,
    thick,
)
from ksd.view.camera import Camera, View, camera_of
from ksd.view.figure import (
    BACKING,
    FAINT,
    GROUND,
    INK,
    LEAF,
    PALE,
    REST,
    Array,
    mixed,
    new_figure,
    plain_axes,
)
from ksd.view.heat import Heat, heat_of
from ksd.view.labels import FIXED, part_labels
from ksd.view.order import back_to_front

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ksd.solve.configuration import Configuration

WIDE, HIGH = 6.2, 5.4
"""Most inches of axes."""
NARROW, LOW = 3.4, 1.6
"""Fewest inches of axes."""
LETTER = 0.082
"""Inches that a letter of a title takes."""
LIGHT = np.array([-0.35, 0.65, 0.68])
"""Where the light comes from, in the picture: left, above, before."""
CLOSE = 1e-4
"""Distance over the size of the mechanism up to which polygons lie in one plane."""
DIM = 0.62
"""What is left of a colour where the light does not fall."""
SMALL = 0.5e-3
"""Size [m] below which axes are in micrometres."""
CORNER = np.deg2rad(6.0)
"""Turn between two stations of a leaf beyond which its line would show a corner."""


def plane_seen(configuration: Any) -> str | None:
    """The coordinate plane a planar mechanism lives in."""
    found = plane_of(configuration.model)
    said: str | None = configuration.model.scene.plane
    return said or (("yz", "xz", "xy")[found.axis] if isinstance(found, Plane) else None)


def smooth_shape(configuration: Configuration) -> Any:
    """What there is to draw, with stations so close that no leaf shows corners."""
    shape = configuration.shape()
    along = [axes[:, :, 0] for leaf in shape.leaves for axes in (leaf.axes, leaf.rest_axes)]
    cosine = min((float((e[:-1] * e[1:]).sum(axis=1).min()) for e in along), default=1.0)
    slopes = [np.arctan(0.5 * np.gradient(leaf.thickness, leaf.s)) for leaf in shape.leaves]
    turns = [float(np.abs(np.diff(slope)).max()) for slope in slopes]
    sharp = max([float(np.arccos(np.clip(cosine, -1.0, 1.0))), *turns])
    return (
        shape
        if sharp <= CORNER
        else configuration.shape(points=min(20, int(sharp / CORNER) + 1) * len(along[0]))
    )


def plot_mechanism(
    configuration: Configuration,
    *,
    axes: Axes | None = None,
    view: View | Camera | None = None,
    labels: bool = True,
    title: str | None = None,
    color: Literal["stress"] | None = None,
) -> Figure:
    """Draw the deformed mechanism over the undeformed one (grey); returns the matplotlib figure.

    axes: matplotlib axes to draw into, a new figure when None. view: "xy", "xz" or "yz" onto a coordinate plane, "3d" in
    space, or the azimuth and elevation of the eye [deg]; its plane for a planar mechanism, "3d" for others when None.
    labels: names of links, drives and loads, with drive values and forces. title: above the picture, names of scene and
    method when None. color: "stress" colours the leaf springs by their von Mises stress, with a scale. Raises SceneError
    for another view or colour.
    """
    shape = smooth_shape(configuration)
    camera = camera_of(shape, view, plane=plane_seen(configuration))
    shape = replace(shape, leaves=tuple(facing(leaf, camera) for leaf in shape.leaves))
    heat = heat_of(configuration, shape, color)
    own = axes is None
    if axes is None:
        axes = new_figure(WIDE, HIGH).add_subplot()
    size = size_of(shape)
    _undeformed(axes, shape, camera, size)
    drawn = _polygons(shape, camera, size, heat)
    paint(axes, drawn, camera)
    _hinges(axes, shape, camera, size)
    draw_springs(axes, shape, camera, size)
    axes.set_aspect("equal")
    axes.margins(0.08, 0.08)
    busy = np.concatenate(
        [
            draw_arrows(axes, configuration, shape, camera, size=size, labels=labels),
            draw_distances(axes, shape, camera, labels=labels),
        ]
    )
    if labels:
        _names(axes, shape, camera)
    if not camera.plane and (own or labels):
        _triad(axes, shape, camera, size, busy)
    said = title if title is not None else _caption(configuration)
    if own:
        said = _fit(axes, said, bar=0.0 if heat is None else 1.0)
    if heat is not None:
        heat.bar(axes, shrink=0.8, aspect=30, pad=0.02)
    _frame(axes, camera, size, said)
    if own and labels:
        lines = [leaf.place for leaf in shape.leaves]
        # edges of bodies and strokes of ground
        lines += [np.linspace(p.corners[0], p.corners[1], 12) for p in drawn if len(p.corners) == 2]
        part_labels(axes, busy, camera.flat(np.concatenate([np.zeros((0, 3)), *lines])))
    figure: Figure = axes.figure  # type: ignore[assignment]
    return figure


def _caption(configuration: Any) -> str:
    return f"{configuration.model.scene.name}, {configuration.method}; undeformed in grey"


def _fit(axes: Any, title: str, *, bar: float) -> str:
    """Give the figure the size that what is drawn needs at equal scales, `bar` inches for a scale besides; returns the
    title in lines that fit."""
    axes.autoscale_view()
    ends = np.array([axes.get_xlim(), axes.get_ylim()])
    spans = np.diff(ends)[:, 0]
    scale = min(np.array([WIDE, HIGH]) / spans)
    # what is slender in the picture still needs room for words
    inches = np.maximum(scale * spans, (NARROW, LOW))
    more = 0.5 * (inches / scale - spans)
    axes.set_xlim(ends[0, 0] - more[0], ends[0, 1] + more[0])
    axes.set_ylim(ends[1, 0] - more[1], ends[1, 1] + more[1])
    lines = textwrap.wrap(title, int((inches[0] + bar) / LETTER))
    axes.figure.set_size_inches(inches[0] + bar + 0.8, inches[1] + 0.65 + 0.17 * len(lines))
    return "\n".join(lines)


def _polygons(shape: Any, camera: Camera, size: float, heat: Heat | None) -> list[Polygon]:
    """All that is solid, in no order."""
    found: list[Polygon] = []
    colors = block_colors(shape)
    for block in shape.blocks:
        clamped, color = pads(shape, block), colors[block.name]
        pale, edge = mixed(color, 0.45), mixed(color, 0.0)
        pieces = parts(block, clamped, size)
        for k, points in enumerate(pieces):
            # the web, the last, ends within the pads
            half = THICK * size * (0.8 if 0 < k == len(pieces) - 1 else 1.0)
            found += body(points, half, pale, edge=edge)
        if block.name == "ground":
            lines = (line for pad in clamped for line in hatches(pad, size, camera))
            found += [Polygon(line, GROUND, None, 0.9) for line in lines]
    for whole in shape.leaves:
        leaf = whole if heat or camera.plane or thick(whole) else sparse(whole)
        # a cut is seen whole: pale, or its outline is lost
        plain = LEAF if not thick(leaf) else mixed(LEAF, 0.45)
        drawn = plain if heat is None else heat.between(leaf.name)
        found += sheets(leaf, drawn, line=1.8 if camera.plane and not thick(leaf) else 0.4)
        edge = LEAF if camera.plane else mixed(LEAF, -0.35)
        for ring in outlines(leaf, camera):
            found += [
                Polygon(p, INK if heat else edge, None, 0.6) for p in np.stack([ring[:-1], ring[1:]], axis=1)
            ]
    return found


def paint(axes: Any, polygons: list[Polygon], camera: Camera) -> None:
    """The polygons from back to front, bodies by their front sides alone; onto a plane leaf springs come last."""
    from matplotlib.collections import PolyCollection

    shown = [p for p in polygons if not p.body or p.normal is None or p.normal @ camera.toward > -1e-9]
    size = float(np.ptp(np.concatenate([p.corners for p in shown]), axis=0).max())
    # onto a plane leaf springs are lines, and seen
    first = [p for p in shown if p.body or not camera.plane]
    last = [p for p in shown if not p.body and camera.plane]
    last.sort(key=lambda p: float(p.corners.mean(axis=0) @ camera.toward))
    order = back_to_front(first, camera.toward, close=CLOSE * size) + last
    colors = [_lit(p, camera) for p in order]
    axes.add_collection(
        PolyCollection(
            [camera.flat(p.corners) for p in order], facecolors=colors, edgecolors=colors,
            linewidths=[p.line for p in order], capstyle="round", joinstyle="round", zorder=3, gid="bodies",
        )
    )  # fmt: skip
    axes.autoscale_view()


def _lit(polygon: Polygon, camera: Camera) -> tuple[float, ...]:
    """The colour of a polygon in the light; a sheet has two sides."""
    from matplotlib.colors import to_rgb

    color = np.array(to_rgb(polygon.color))
    if polygon.normal is None or camera.plane or len(polygon.corners) == 2:
        return tuple(color)
    seen = np.array([polygon.normal @ axis for axis in (camera.right, camera.up, camera.toward)])
    share = seen @ LIGHT / np.linalg.norm(LIGHT)
    share = max(0.0, float(share if polygon.body else share * np.sign(seen[2] or 1.0)))
    return tuple(color * (DIM + (1.0 - DIM) * share))


def _undeformed(axes: Any, shape: Any, camera: Camera, size: float) -> None:
    """Leaf springs and links at rest, in grey, behind everything."""
    for leaf in shape.leaves:
        for ring in outlines(leaf, camera, rest=True):
            axes.fill(*camera.flat(ring).T, facecolor=PALE, edgecolor=REST, linewidth=0.7, zorder=1)
        if camera.plane and not thick(leaf):
            _line(axes, camera.flat(leaf.rest), color=REST, linewidth=1.2, zorder=1)
    for block in shape.blocks:
        if block.name != "ground" and ("/" not in block.name or camera.plane):
            corners = hull(camera.flat(parts(block, pads(shape, block, rest=True), size)[-1]))
            ring = np.vstack([corners, corners[:1]])
            _line(axes, ring, color=REST, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)


def _line(axes: Any, points: Array, **style: Any) -> None:
    axes.plot(*points.T, solid_capstyle="round", **style)


def _hinges(axes: Any, shape: Any, camera: Camera, size: float) -> None:
    """A circle for every pin, a box on a guide for every slider."""
    reach = 60.0 * size
    style = {"color": INK, "zorder": 5.5}
    for hinge in shape.hinges:
        place = camera.flat(hinge.place)
        if hinge.kind == "slider":
            along = 1e-3 * camera.flat(hinge.axis)
            side = 0.25 * reach * np.array([-along[1], along[0]])
            for edge in (side, -side):
                rail = np.stack([place + edge - 1.5 * reach * along, place + edge + 1.5 * reach * along])
                _line(axes, rail, linewidth=0.9, **style)
        marker = "o" if hinge.kind == "pin" else "s"
        axes.plot(*place, marker=marker, markersize=6, markerfacecolor="white", **style)


def _names(axes: Any, shape: Any, camera: Camera) -> None:
    """The names of the links on them; of ground at its first pad."""
    for block in shape.blocks:
        if "/" in block.name:
            continue
        clamped = pads(shape, block)
        if not clamped:
            continue
        if block.name == "ground":
            at, shift, side = _below(clamped[0], camera)
        else:
            at, shift, side = np.mean([p.corners.mean(axis=0) for p in clamped], axis=0), 0, "center"
        axes.annotate(
            block.name, camera.flat(at), (0, shift), textcoords="offset points", ha="center", va=side, fontsize=8,
            color=INK, zorder=6, bbox=BACKING,
        )  # fmt: skip


def _below(pad: Pad, camera: Camera) -> tuple[Array, int, str]:
    """Where the name of ground stands: point (3,), points above it, and which side of the word is there. Behind the pad, at
    the lower end of an upright one."""
    behind = back_of(pad)
    if behind is None:
        behind = -pad.away.mean(axis=0) if len(pad.away) else -camera.up
    x, y = camera.flat(behind)
    if camera.plane and abs(x) > abs(y):
        return pad.corners[(pad.corners @ camera.up).argmin()], -9, "top"
    return pad.corners.mean(axis=0), (-14 if y < 0 or not camera.plane else 14), "center"


def _frame(axes: Any, camera: Camera, size: float, title: str) -> None:
    axes.set_title(title, fontsize=10, color=INK, loc="left")
    if camera.plane is None:
        axes.set_axis_off()
        return
    small = size < SMALL
    for axis, name in zip((axes.xaxis, axes.yaxis), camera.plane, strict=True):
        axis.set_label_text(f"{name} [{'µm' if small else 'mm'}]", fontsize=9)
        if small:
            axis.set_major_formatter(lambda value, _: f"{1e3 * value:.6g}")
    axes.tick_params(labelsize=8)
    plain_axes(axes)


def _triad(axes: Any, shape: Any, camera: Camera, size: float, busy: Array) -> None:
    """The three axes in an empty corner, or beside or below what is drawn, of one length that is told."""
    digit = 10.0 ** np.floor(np.log10(0.16 * size))
    length = max(step * digit for step in (1, 2, 5) if step * digit <= 0.16 * size)
    tips = camera.flat(length * np.eye(3))
    low, high = (1.3 * end for end in (np.minimum(tips.min(axis=0), 0.0), np.maximum(tips.max(axis=0), 0.0)))
    # room for the letters, and for the words below
    low -= 1e3 * length * np.array([0.15, 0.55])
    high += 1e2 * length
    axes.autoscale_view()
    ends = np.array([axes.get_xlim(), axes.get_ylim()])
    drawn = [line for leaf in shape.leaves for line in (leaf.rest, leaf.place)]
    # bodies reach from point to point
    drawn += [
        (share * points[:, None] + (1.0 - share) * points).reshape(-1, 3)
        for block in shape.blocks for points in (block.rest, block.place) for share in np.linspace(0.0, 0.5, 6)
    ]  # fmt: skip
    taken = np.concatenate([camera.flat(np.concatenate(drawn)), busy])
    (left, right), (bottom, top) = ends - np.stack([low, high], axis=1)
    corners = np.array([(left, bottom), (right, bottom), (left, top), (right, top)])
    gap = 3e2 * length
    free = [not ((taken > c + low - gap) & (taken < c + high + gap)).all(axis=1).any() for c in corners]
    beside = np.ptp(ends[0]) / WIDE < np.ptp(ends[1]) / HIGH
    outside = (right + (high - low)[0], bottom) if beside else (left, bottom - (high - low)[1])
    corner = corners[free.index(True)] if any(free) else np.array(outside)
    axes.update_datalim([corner + low, corner + high])
    look = {"color": FAINT, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    for name, tip in zip("xyz", tips, strict=True):
        if np.linalg.norm(tip) > 0.1 * np.abs(tips).max():
            arrow = {"arrowstyle": "-|>,head_width=0.15,head_length=0.35", **look}
            axes.annotate("", corner + tip, corner, arrowprops=arrow, zorder=2)
            way = 7.0 * tip / np.linalg.norm(tip)
            axes.annotate(
                name, corner + tip, way, textcoords="offset points", ha="center", va="center", fontsize=8, color=FAINT,
                gid=FIXED,
            )  # fmt: skip
    ends = np.vstack([corner, corner + tips])
    words = {"textcoords": "offset points", "va": "top", "fontsize": 7, "color": FAINT, "gid": FIXED}
    said = f"{1e6 * length:g} µm" if size < SMALL else f"{1e3 * length:g} mm"
    axes.annotate(f"axes: {said}", ends.min(axis=0), (-6, -12), **words)
