"""Drives, forces, moments, masses, springs, cables, stops, sensors and distances, drawn at a legible size."""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.answers.shape import Shape
from ksd.view.camera import Camera
from ksd.view.drawable import Drawable
from ksd.view.figure import (
    DRIVE_COLOR,
    GROUND_COLOR,
    LABEL_BACKGROUND,
    LOAD_COLOR,
    SENSOR_COLOR,
    TEXT_COLOR,
    Array,
    amount_with_unit,
    value_with_unit,
)

MIN_DRIVE_ARROW, LOAD_ARROW, SENSOR_ARROW = 0.1, 0.13, 0.07
LINE_LOAD_ARROW, MIN_LINE_LOAD_ARROW = 0.07, 0.05
"""Length of the longest arrow of a load along a leaf, relative to the size of the mechanism, and of the shortest, relative
to the longest."""
"""Shortest arrow of a drive, and lengths of the arrows of a load and of a sensor, relative to the size of the mechanism."""
COIL_SIZE = 0.015
"""Half the width of a coil spring, and the length of one coil, relative to that size."""
ROTATION_RADIUS = 0.05
"""Radius of the arrow of a rotation or moment, relative to that size."""
HEAD_RATIO = 0.8
"""Length of its head relative to that radius."""
EDGE_ON_COSINE = 0.17
"""Cosine of the angle between axis and viewing direction below which a rotation is drawn as an arrow with two heads along
its axis, and tangent of that angle below which an arrow is drawn as a point."""


def draw_arrows(
    axes: Any, configuration: Drawable, shape: Shape, camera: Camera, *, size: float, labels: bool
) -> Array:
    """Draw drives and loads with their names and values; returns points (n, 2) [mm] along them that no label may cover."""
    busy = [np.zeros((0, 2))]
    for driven in shape.driven:
        value, place = configuration.targets[driven.name], camera.flat(driven.place)
        if driven.kind == "translation":
            start, end = driven.rest, driven.rest + value * driven.direction
            if abs(value) < MIN_DRIVE_ARROW * size:
                # too short to be seen: an arrow of the smallest length that ends at the point
                start, end = (
                    driven.place - np.sign(value or 1.0) * MIN_DRIVE_ARROW * size * driven.direction,
                    driven.place,
                )
            tip = camera.flat(end)
            _draw_arrow_in_space(axes, camera, start, end, DRIVE_COLOR)
            if abs(value) >= MIN_DRIVE_ARROW * size:
                axes.plot(
                    *np.stack([tip, place]).T, color=DRIVE_COLOR, linewidth=0.8, linestyle=":", zorder=5
                )
            busy.append(np.linspace(camera.flat(start), tip, 25))
        else:
            ring = _draw_rotation(
                axes, camera, driven.place, np.sign(value or 1.0) * driven.direction, size, DRIVE_COLOR
            )
            tip = ring[-1]
            busy.append(ring)
        axes.plot(*place, marker="o", markersize=5, color=DRIVE_COLOR, markerfacecolor="white", zorder=6)
        busy.append(place[None])
        if labels:
            force = configuration.reported_forces[driven.name]
            amount = amount_with_unit(force, "N" if driven.kind == "translation" else "Nm")
            # the arrow shows the motion; force and value both count along the direction of the drive
            against = " against the arrow" if force * np.sign(value or 1.0) < 0.0 else ""
            text = f"{driven.name}: {value_with_unit(value, driven.kind)}, {amount}{against}"
            _label(axes, text, tip, DRIVE_COLOR)
    busy += [_draw_load(axes, load, camera, size, labels=labels) for load in shape.loads]
    busy += [_draw_line_load(axes, load, camera, size, labels=labels) for load in shape.line_loads]
    return np.concatenate(busy)


def _draw_line_load(axes: Any, load: Any, camera: Camera, size: float, *, labels: bool) -> Array:
    """Draw a load along a leaf as a row of arrows that end on it, with a line along their tails, or a row of turning arrows
    about it; returns points no label should cover."""
    largest = float(np.linalg.norm(load.value, axis=1).max()) or 1.0
    if load.kind == "moment":
        amounts = np.linalg.norm(load.value, axis=1)
        rings = [
            _draw_rotation(axes, camera, place, value / amount, 0.5 * size * amount / largest, LOAD_COLOR)
            for place, value, amount in zip(load.place, load.value, amounts, strict=True)
            if amount > MIN_LINE_LOAD_ARROW * largest
        ]
        line = np.concatenate([*rings, np.array([camera.flat(load.place[0])])])
        if labels:
            _label(axes, f"{load.name}: {load.text}", line[len(line) // 2], LOAD_COLOR)
        return line
    tails = load.place - LINE_LOAD_ARROW * size * load.value / largest
    for tail, tip, value in zip(tails, load.place, load.value, strict=True):
        if np.linalg.norm(value) > MIN_LINE_LOAD_ARROW * largest:
            _draw_arrow_in_space(axes, camera, tail, tip, LOAD_COLOR)
    line = np.array([camera.flat(tail) for tail in tails])
    axes.plot(*line.T, color=LOAD_COLOR, linewidth=0.8, zorder=5)
    if labels:
        _label(axes, f"{load.name}: {load.text}", line[len(line) // 2], LOAD_COLOR)
    return line


def _draw_load(axes: Any, load: Any, camera: Camera, size: float, *, labels: bool) -> Array:
    """Draw a force ending at its point, a moment around it or a mass as a dot; returns points no label should cover."""
    amount, place = float(np.linalg.norm(load.value)), camera.flat(load.place)
    unit = {"force": "N", "moment": "Nm", "mass": "kg"}[load.kind]
    tip, busy = place, place[None]
    if load.kind == "force":
        start = load.place - LOAD_ARROW * size * load.value / amount
        _draw_arrow_in_space(axes, camera, start, load.place, LOAD_COLOR)
        tip = camera.flat(start)
        busy = np.linspace(tip, place, 25)
    elif load.kind == "moment":
        busy = _draw_rotation(axes, camera, load.place, load.value / amount, size, LOAD_COLOR)
        tip = busy[-1]
    else:
        axes.plot(*place, marker="o", markersize=6, color=TEXT_COLOR, zorder=6)
    if labels:
        text = amount_with_unit(amount, unit)
        _label(
            axes,
            text if load.kind == "mass" else f"{load.name}: {text}",
            tip,
            TEXT_COLOR if load.kind == "mass" else LOAD_COLOR,
        )
    return busy


def draw_distances(axes: Any, shape: Shape, camera: Camera, *, labels: bool) -> Array:
    """Draw distances of the scene: both points, and a thin line along the direction of measurement, with its value; returns
    points (n, 2) [mm] that no label should cover."""
    busy = [np.zeros((0, 2))]
    for distance in shape.distances:
        start, end = distance.ends
        value = float((end - start) @ distance.direction)
        line = camera.flat(np.stack([start, start + value * distance.direction, end]))
        axes.plot(*line[:2].T, color=TEXT_COLOR, linewidth=0.7, zorder=4.5, gid="distance")
        axes.plot(*line[1:].T, color=TEXT_COLOR, linewidth=0.7, linestyle=":", zorder=4.5)
        axes.plot(*line[[0, 2]].T, "x", color=TEXT_COLOR, markersize=5, zorder=6)
        busy += [line, np.linspace(line[0], line[1], 25)]
        if labels:
            text = f"{distance.name}: {value_with_unit(value, 'translation')}"
            _label(axes, text, line[:2].mean(axis=0), TEXT_COLOR)
    return np.concatenate(busy)


def draw_sensors(axes: Any, shape: Shape, camera: Camera, *, size: float, labels: bool) -> Array:
    """Draw sensors as open triangles and dampers as open squares, with a thin arrow along or a ring about their direction;
    returns points (n, 2) [mm] that no label should cover."""
    busy = [np.zeros((0, 2))]
    for sensor in shape.sensors:
        place = camera.flat(sensor.place)
        if sensor.turns:
            points = _draw_rotation(axes, camera, sensor.place, sensor.direction, 0.7 * size, SENSOR_COLOR)
        else:
            end = sensor.place + SENSOR_ARROW * size * sensor.direction
            _draw_arrow_in_space(axes, camera, sensor.place, end, SENSOR_COLOR)
            points = np.linspace(place, camera.flat(end), 15)
        marker = "s" if sensor.damps else "^"
        axes.plot(*place, marker=marker, markersize=6, color=SENSOR_COLOR, markerfacecolor="white", zorder=6)
        busy += [place[None], points]
        if labels:
            _label(axes, sensor.name, points[-1], SENSOR_COLOR)
    return np.concatenate(busy)


def _draw_arrow_in_space(axes: Any, camera: Camera, start: Array, end: Array, color: str) -> None:
    """Draw an arrow in space [m]; along the viewing direction, a circle with a dot (toward the eye) or cross (away)."""
    depth = (end - start) @ camera.toward
    if np.linalg.norm(camera.flat(end - start)) > 1e3 * EDGE_ON_COSINE * abs(depth):
        _draw_arrow(axes, camera.flat(start), camera.flat(end), color)
        return
    style = {"color": color, "linestyle": "none", "zorder": 6.5}
    axes.plot(*camera.flat(end), "o", markersize=9, markerfacecolor="white", **style)
    axes.plot(*camera.flat(end), marker="." if depth > 0.0 else "x", markersize=5, **style)


def _draw_arrow(axes: Any, start: Array, end: Array, color: str) -> None:
    """Draw an arrow between two points (2,) [mm] of the picture."""
    style = {"arrowstyle": "-|>", "color": color, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, zorder=5, arrowprops=style)
    # an annotation alone does not widen the axes
    axes.update_datalim([start, end])


def _draw_rotation(axes: Any, camera: Camera, place: Array, axis: Array, size: float, color: str) -> Array:
    """Draw three quarters of a right-handed circle with a head about an axis (3,); seen edge-on, an arrow with two heads
    along the axis instead. Returns its points (n, 2) [mm]."""
    if abs(axis @ camera.toward) < EDGE_ON_COSINE:
        flat = camera.flat(place + np.linspace(0.0, LOAD_ARROW * size, 25)[:, None] * axis)
        for end in (flat[-5], flat[-1]):
            _draw_arrow(axes, flat[0], end, color)
        return flat
    first = camera.right - (camera.right @ axis) * axis
    if np.linalg.norm(first) < 0.3:
        first = camera.up - (camera.up @ axis) * axis
    first = first / np.linalg.norm(first)
    second, radius = np.cross(axis, first), ROTATION_RADIUS * size
    angles = np.linspace(-0.25 * np.pi, 1.15 * np.pi, 40)[:, None]
    rays = np.cos(angles) * first + np.sin(angles) * second
    # sized relative to the ring, which in a small picture is smaller than matplotlib's arrow heads
    head = np.array([rays[-1] * 1.35, np.cross(axis, rays[-1]) * HEAD_RATIO + rays[-1], rays[-1] * 0.65])
    flat = camera.flat(place + radius * np.concatenate([rays, head]))
    axes.plot(*flat[: len(rays)].T, color=color, linewidth=1.4, zorder=5, solid_capstyle="butt")
    axes.fill(*flat[len(rays) :].T, color=color, linewidth=0.0, zorder=5)
    return flat


def _label(axes: Any, text: str, tip: Array, color: str) -> None:
    """Write a label beside the point `tip` (2,) [mm]."""
    axes.annotate(
        text,
        tip,
        (8, 6),
        textcoords="offset points",
        fontsize=8,
        color=color,
        zorder=7,
        bbox=LABEL_BACKGROUND,
    )


def draw_one_sided(axes: Any, shape: Shape, camera: Camera, size: float) -> None:
    """Draw cables as lines through their points, surfaces by their outlines, and stops as bars across their direction."""
    for cable in shape.cables:
        line = camera.flat(cable.points)
        axes.plot(*line.T, color=TEXT_COLOR, linewidth=0.9, marker=".", markersize=4, zorder=4.5, gid="cable")
    for surface in shape.surfaces:
        axes.plot(
            *camera.flat(surface.outline).T, color=GROUND_COLOR, linewidth=1.3, zorder=4.4, gid="surface"
        )
    for stop in shape.stops:
        toward = camera.flat(stop.direction)
        across = np.array([-toward[1], toward[0]]) / max(float(np.linalg.norm(toward)), 1e-12)
        place, half = camera.flat(stop.place), 1e3 * 2.0 * COIL_SIZE * size
        line = place + half * np.array([-1.0, 1.0])[:, None] * across
        axes.plot(*line.T, color=GROUND_COLOR, linewidth=2.5, zorder=4.5, gid="stop")


def draw_springs(axes: Any, shape: Shape, camera: Camera, size: float) -> None:
    """Draw coil springs as zigzags between their ends, torsion springs as spirals."""
    for spring in shape.springs:
        if len(spring.ends) == 1:
            turn = np.linspace(0.0, 5 * np.pi, 80)
            radius = 1e3 * 0.02 * size * turn / turn[-1]
            line = camera.flat(spring.ends[0]) + radius[:, None] * np.stack(
                [np.cos(turn), np.sin(turn)], axis=1
            )
        else:
            start, end = camera.flat(spring.ends)
            span = end - start
            across = np.array([-span[1], span[0]]) / max(float(np.linalg.norm(span)), 1e-12)
            # coils of the same size in springs of any length
            turns = int(np.clip(0.6 * np.linalg.norm(span) / (1e3 * COIL_SIZE * size), 3, 40))
            share = np.concatenate([[0.0], np.linspace(0.2, 0.8, 2 * turns + 2), [1.0]])
            side = np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], turns), [0.0, 0.0]])
            line = start + share[:, None] * span + 1e3 * COIL_SIZE * size * side[:, None] * across
        axes.plot(*line.T, color=TEXT_COLOR, linewidth=1.0, zorder=4.5, gid="spring")
