"""The mechanism, deformed over undeformed, in millimetres: onto a coordinate plane, or in space without perspective."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ksd.answers.shape import Shape
from ksd.model.plane import Plane
from ksd.view.arrows import draw_arrows, draw_distances, draw_one_sided, draw_sensors, draw_springs
from ksd.view.bodies import (
    PAD_HALF_THICKNESS,
    Pad,
    Polygon,
    back_direction,
    block_colors,
    clamp_pads,
    convex_hull,
    convex_parts,
    facing_camera,
    ground_hatches,
    has_varying_thickness,
    hull_faces,
    leaf_faces,
    leaf_outlines,
    mechanism_size,
    with_fewer_stations,
)
from ksd.view.camera import Camera, View, camera_of
from ksd.view.depth_order import back_to_front
from ksd.view.drawable import Drawable
from ksd.view.figure import (
    FAINT_COLOR,
    GROUND_COLOR,
    LABEL_BACKGROUND,
    LEAF_COLOR,
    TEXT_COLOR,
    UNDEFORMED_COLOR,
    UNDEFORMED_FACE,
    Array,
    blended,
    label_axes,
    new_figure,
    write_title,
)
from ksd.view.labels import FIXED_LABEL, separate_labels
from ksd.view.stress_colors import StressColors, stress_colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MAX_AXES_WIDTH, MAX_AXES_HEIGHT = 6.2, 5.4
"""Largest size of the axes [inch]."""
MIN_AXES_WIDTH, MIN_AXES_HEIGHT = 3.4, 1.6
"""Smallest size of the axes [inch]."""
TITLE_LETTER_WIDTH = 0.082
"""Mean width of a letter of a title [inch]."""
LIGHT_DIRECTION = np.array([-0.35, 0.65, 0.68])
"""Direction to the light in the picture (right, up, toward the eye): from the upper left, in front."""
COPLANAR_TOLERANCE = 1e-4
"""Distance, relative to the size of the mechanism, up to which polygons count as coplanar."""
SHADED_SHARE = 0.62
"""Brightness of unlit faces relative to lit ones."""
MICROMETRE_SIZE = 0.5e-3
"""Size [m] below which axes are in micrometres."""
MAX_VISIBLE_TURN = np.deg2rad(6.0)
"""Largest turn between two stations of a leaf that does not show as a corner [rad]."""


def mechanism_plane(configuration: Drawable) -> str | None:
    """The coordinate plane of a planar mechanism, else None."""
    found = configuration.model.plane
    plane: str | None = configuration.model.scene.plane
    return plane or (("yz", "xz", "xy")[found.axis] if isinstance(found, Plane) else None)


def smooth_shape(configuration: Drawable) -> Any:
    """The shape of a configuration with stations close enough that no leaf shows corners."""
    shape = configuration.shape()
    along = [axes[:, :, 0] for leaf in shape.leaves for axes in (leaf.axes, leaf.rest_axes)]
    cosine = min((float((e[:-1] * e[1:]).sum(axis=1).min()) for e in along), default=1.0)
    slopes = [np.arctan(0.5 * np.gradient(leaf.thickness, leaf.s)) for leaf in shape.leaves]
    turns = [float(np.abs(np.diff(slope)).max()) for slope in slopes]
    sharp = max([float(np.arccos(np.clip(cosine, -1.0, 1.0))), *turns])
    return (
        shape
        if sharp <= MAX_VISIBLE_TURN
        else configuration.shape(points=min(20, int(sharp / MAX_VISIBLE_TURN) + 1) * len(along[0]))
    )


def plot_mechanism(
    configuration: Drawable,
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
    camera = camera_of(shape, view, plane=mechanism_plane(configuration))
    shape = replace(shape, leaves=tuple(facing_camera(leaf, camera) for leaf in shape.leaves))
    heat = stress_colors(configuration, shape, color)
    own = axes is None
    if axes is None:
        axes = new_figure(MAX_AXES_WIDTH, MAX_AXES_HEIGHT).add_subplot()
    size = mechanism_size(shape)
    _draw_undeformed(axes, shape, camera, size)
    drawn = _polygons(shape, camera, size, heat)
    draw_polygons(axes, drawn, camera)
    _draw_hinges(axes, shape, camera, size)
    draw_springs(axes, shape, camera, size)
    draw_one_sided(axes, shape, camera, size)
    axes.set_aspect("equal")
    axes.margins(0.08, 0.08)
    busy = np.concatenate(
        [
            draw_arrows(axes, configuration, shape, camera, size=size, labels=labels),
            draw_distances(axes, shape, camera, labels=labels),
            draw_sensors(axes, shape, camera, size=size, labels=labels),
        ]
    )
    if labels:
        _draw_names(axes, shape, camera)
    if not camera.plane and (own or labels):
        _draw_triad(axes, shape, camera, size, busy)
    caption = title if title is not None else _caption(configuration)
    if own:
        caption = _resize_figure(axes, caption, bar=0.0 if heat is None else 1.0)
    if heat is not None:
        heat.bar(axes, shrink=0.8, aspect=30, pad=0.02)
    _format_axes(axes, camera, size, caption)
    if own and labels:
        lines = [leaf.place for leaf in shape.leaves]
        # edges of bodies and hatching of ground, the polygons of two corners
        lines += [np.linspace(p.corners[0], p.corners[1], 12) for p in drawn if len(p.corners) == 2]
        separate_labels(axes, busy, camera.flat(np.concatenate([np.zeros((0, 3)), *lines])))
    figure: Figure = axes.figure  # type: ignore[assignment]
    return figure


def _caption(configuration: Drawable) -> str:
    """Default title of a picture."""
    return f"{configuration.model.scene.name}, {configuration.method}; undeformed in grey"


def _resize_figure(axes: Any, title: str, *, bar: float) -> str:
    """Resize the figure to its content at equal scales, with `bar` inches for a colour bar; returns the title wrapped to
    fit."""
    axes.autoscale_view()
    ends = np.array([axes.get_xlim(), axes.get_ylim()])
    spans = np.diff(ends)[:, 0]
    scale = min(np.array([MAX_AXES_WIDTH, MAX_AXES_HEIGHT]) / spans)
    # a slender picture still needs room for labels
    inches = np.maximum(scale * spans, (MIN_AXES_WIDTH, MIN_AXES_HEIGHT))
    more = 0.5 * (inches / scale - spans)
    axes.set_xlim(ends[0, 0] - more[0], ends[0, 1] + more[0])
    axes.set_ylim(ends[1, 0] - more[1], ends[1, 1] + more[1])
    lines = textwrap.wrap(title, int((inches[0] + bar) / TITLE_LETTER_WIDTH))
    axes.figure.set_size_inches(inches[0] + bar + 0.8, inches[1] + 0.65 + 0.17 * len(lines))
    return "\n".join(lines)


def _polygons(shape: Shape, camera: Camera, size: float, heat: StressColors | None) -> list[Polygon]:
    """Polygons of blocks, ground hatching and leaf springs, unordered."""
    polygons: list[Polygon] = []
    colors = block_colors(shape)
    for block in shape.blocks:
        clamped, color = clamp_pads(shape, block), colors[block.name]
        pale, edge = blended(color, 0.45), blended(color, 0.0)
        pieces = convex_parts(block, clamped, size)
        for k, points in enumerate(pieces):
            # the web, which is the last piece, is thinner, so that it ends within the pads
            half = PAD_HALF_THICKNESS * size * (0.8 if 0 < k == len(pieces) - 1 else 1.0)
            polygons += hull_faces(points, half, pale, edge=edge)
        if block.name == "ground":
            lines = (line for pad in clamped for line in ground_hatches(pad, size, camera))
            polygons += [Polygon(line, GROUND_COLOR, None, 0.9) for line in lines]
    for whole in shape.leaves:
        leaf = whole if heat or camera.plane or has_varying_thickness(whole) else with_fewer_stations(whole)
        # a face of varying thickness is pale, or its outline could not be seen
        plain = LEAF_COLOR if not has_varying_thickness(leaf) else blended(LEAF_COLOR, 0.45)
        drawn = plain if heat is None else heat.between(leaf.name)
        polygons += leaf_faces(
            leaf, drawn, line=1.8 if camera.plane and not has_varying_thickness(leaf) else 0.4
        )
        edge = LEAF_COLOR if camera.plane else blended(LEAF_COLOR, -0.35)
        for ring in leaf_outlines(leaf, camera):
            polygons += [
                Polygon(p, TEXT_COLOR if heat else edge, None, 0.6)
                for p in np.stack([ring[:-1], ring[1:]], axis=1)
            ]
    return polygons


def draw_polygons(axes: Any, polygons: list[Polygon], camera: Camera) -> None:
    """Draw polygons from back to front, only the front faces of bodies; in a planar view leaf springs come last."""
    from matplotlib.collections import PolyCollection

    shown = [p for p in polygons if not p.body or p.normal is None or p.normal @ camera.toward > -1e-9]
    size = float(np.ptp(np.concatenate([p.corners for p in shown]), axis=0).max())
    # in a planar view leaf springs are lines, drawn over the bodies
    first = [p for p in shown if p.body or not camera.plane]
    last = [p for p in shown if not p.body and camera.plane]
    last.sort(key=lambda p: float(p.corners.mean(axis=0) @ camera.toward))
    order = back_to_front(first, camera.toward, close=COPLANAR_TOLERANCE * size) + last
    colors = [_shaded_color(p, camera) for p in order]
    axes.add_collection(
        PolyCollection(
            [camera.flat(p.corners) for p in order], facecolors=colors, edgecolors=colors,
            linewidths=[p.line for p in order], capstyle="round", joinstyle="round", zorder=3, gid="bodies",
        )
    )  # fmt: skip
    axes.autoscale_view()


def _shaded_color(polygon: Polygon, camera: Camera) -> tuple[float, ...]:
    """The colour of a polygon shaded by the light; a sheet is lit from either side."""
    from matplotlib.colors import to_rgb

    color = np.array(to_rgb(polygon.color))
    if polygon.normal is None or camera.plane or len(polygon.corners) == 2:
        return tuple(color)
    seen = np.array([polygon.normal @ axis for axis in (camera.right, camera.up, camera.toward)])
    share = seen @ LIGHT_DIRECTION / np.linalg.norm(LIGHT_DIRECTION)
    share = max(0.0, float(share if polygon.body else share * np.sign(seen[2] or 1.0)))
    return tuple(color * (SHADED_SHARE + (1.0 - SHADED_SHARE) * share))


def _draw_undeformed(axes: Any, shape: Shape, camera: Camera, size: float) -> None:
    """Draw the undeformed leaf springs and links in grey, in the background."""
    for leaf in shape.leaves:
        for ring in leaf_outlines(leaf, camera, rest=True):
            axes.fill(
                *camera.flat(ring).T,
                facecolor=UNDEFORMED_FACE,
                edgecolor=UNDEFORMED_COLOR,
                linewidth=0.7,
                zorder=1,
            )
        if camera.plane and not has_varying_thickness(leaf):
            _draw_line(axes, camera.flat(leaf.rest), color=UNDEFORMED_COLOR, linewidth=1.2, zorder=1)
    for block in shape.blocks:
        if block.name != "ground" and ("/" not in block.name or camera.plane):
            corners = convex_hull(
                camera.flat(convex_parts(block, clamp_pads(shape, block, rest=True), size)[-1])
            )
            ring = np.vstack([corners, corners[:1]])
            _draw_line(axes, ring, color=UNDEFORMED_COLOR, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)


def _draw_line(axes: Any, points: Array, **style: Any) -> None:
    axes.plot(*points.T, solid_capstyle="round", **style)


def _draw_hinges(axes: Any, shape: Shape, camera: Camera, size: float) -> None:
    """Draw a circle for every pin, a ball for every ball joint, and a box or circle on a guide for what slides."""
    reach = 60.0 * size
    style = {"color": TEXT_COLOR, "zorder": 5.5}
    for hinge in shape.hinges:
        place = camera.flat(hinge.place)
        if hinge.kind in ("slider", "cylindrical"):
            along = 1e-3 * camera.flat(hinge.axis)
            side = 0.25 * reach * np.array([-along[1], along[0]])
            for edge in (side, -side):
                rail = np.stack([place + edge - 1.5 * reach * along, place + edge + 1.5 * reach * along])
                _draw_line(axes, rail, linewidth=0.9, **style)
        marker = "s" if hinge.kind == "slider" else "o"
        inside = TEXT_COLOR if hinge.kind == "ball" else "white"
        axes.plot(*place, marker=marker, markersize=6, markerfacecolor=inside, **style)


def _draw_names(axes: Any, shape: Shape, camera: Camera) -> None:
    """Write the names of the links onto them, that of ground at its first pad."""
    for block in shape.blocks:
        if "/" in block.name:
            continue
        clamped = clamp_pads(shape, block)
        if not clamped:
            continue
        if block.name == "ground":
            at, shift, side = _ground_name_position(clamped[0], camera)
        else:
            at, shift, side = np.mean([p.corners.mean(axis=0) for p in clamped], axis=0), 0, "center"
        axes.annotate(
            block.name, camera.flat(at), (0, shift), textcoords="offset points", ha="center", va=side, fontsize=8,
            color=TEXT_COLOR, zorder=6, bbox=LABEL_BACKGROUND,
        )  # fmt: skip


def _ground_name_position(pad: Pad, camera: Camera) -> tuple[Array, int, str]:
    """Position of the name of ground: point (3,), vertical offset [points] and vertical alignment. It is behind the pad, at
    the lower end of an upright one."""
    behind = back_direction(pad)
    if behind is None:
        behind = -pad.away.mean(axis=0) if len(pad.away) else -camera.up
    x, y = camera.flat(behind)
    if camera.plane and abs(x) > abs(y):
        return pad.corners[(pad.corners @ camera.up).argmin()], -9, "top"
    return pad.corners.mean(axis=0), (-14 if y < 0 or not camera.plane else 14), "center"


def _format_axes(axes: Any, camera: Camera, size: float, title: str) -> None:
    """Set the title and, in a planar view, axis labels in mm or, for a small mechanism, in µm; size [m]."""
    if camera.plane is None:
        write_title(axes, title)
        axes.set_axis_off()
        return
    small = size < MICROMETRE_SIZE
    x, y = (f"{name} [{'µm' if small else 'mm'}]" for name in camera.plane)
    label_axes(axes, title, x=x, y=y)
    if small:
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(lambda value, _: f"{1e3 * value:.6g}")


def _draw_triad(axes: Any, shape: Shape, camera: Camera, size: float, busy: Array) -> None:
    """Draw the coordinate axes, with their length, in an empty corner, else outside the mechanism."""
    digit = 10.0 ** np.floor(np.log10(0.16 * size))
    length = max(step * digit for step in (1, 2, 5) if step * digit <= 0.16 * size)
    tips = camera.flat(length * np.eye(3))
    low, high = (1.3 * end for end in (np.minimum(tips.min(axis=0), 0.0), np.maximum(tips.max(axis=0), 0.0)))
    # room for the axis names, and for the length below
    low -= 1e3 * length * np.array([0.15, 0.55])
    high += 1e2 * length
    axes.autoscale_view()
    ends = np.array([axes.get_xlim(), axes.get_ylim()])
    drawn = [line for leaf in shape.leaves for line in (leaf.rest, leaf.place)]
    # points between those of a block, since its body covers them too
    drawn += [
        (share * points[:, None] + (1.0 - share) * points).reshape(-1, 3)
        for block in shape.blocks for points in (block.rest, block.place) for share in np.linspace(0.0, 0.5, 6)
    ]  # fmt: skip
    taken = np.concatenate([camera.flat(np.concatenate(drawn)), busy])
    (left, right), (bottom, top) = ends - np.stack([low, high], axis=1)
    corners = np.array([(left, bottom), (right, bottom), (left, top), (right, top)])
    gap = 3e2 * length
    free = [not ((taken > c + low - gap) & (taken < c + high + gap)).all(axis=1).any() for c in corners]
    is_tall = np.ptp(ends[0]) / MAX_AXES_WIDTH < np.ptp(ends[1]) / MAX_AXES_HEIGHT
    outside = (right + (high - low)[0], bottom) if is_tall else (left, bottom - (high - low)[1])
    corner = corners[free.index(True)] if any(free) else np.array(outside)
    axes.update_datalim([corner + low, corner + high])
    style = {"color": FAINT_COLOR, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    for name, tip in zip("xyz", tips, strict=True):
        if np.linalg.norm(tip) > 0.1 * np.abs(tips).max():
            arrow = {"arrowstyle": "-|>,head_width=0.15,head_length=0.35", **style}
            axes.annotate("", corner + tip, corner, arrowprops=arrow, zorder=2)
            offset = 7.0 * tip / np.linalg.norm(tip)
            axes.annotate(
                name, corner + tip, offset, textcoords="offset points", ha="center", va="center", fontsize=8,
                color=FAINT_COLOR, gid=FIXED_LABEL,
            )  # fmt: skip
    ends = np.vstack([corner, corner + tips])
    words = {
        "textcoords": "offset points",
        "va": "top",
        "fontsize": 7,
        "color": FAINT_COLOR,
        "gid": FIXED_LABEL,
    }
    length_text = f"{1e6 * length:g} µm" if size < MICROMETRE_SIZE else f"{1e3 * length:g} mm"
    axes.annotate(f"axes: {length_text}", ends.min(axis=0), (-6, -12), **words)
