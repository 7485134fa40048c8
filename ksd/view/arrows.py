"""What acts on the mechanism: drives, forces, moments, masses and springs, at a length that can be read."""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.view.camera import Camera
from ksd.view.figure import BACKING, DRIVE, INK, LOAD, Array, spoken_amount, spoken_value

LEAST, USUAL = 0.1, 0.13
"""Shortest arrow of a drive, and length of the arrow of a load, over the size of the mechanism."""
COIL = 0.015
"""Half the width of a coil spring, and the length of one of its coils, over that size."""
ROUND = 0.05
"""Radius of the arrow of a rotation or moment over that size."""
HEAD = 0.8
"""Length of its head over that radius."""
EDGE_ON = 0.17
"""Cosine of the angle of an axis to the eye below which a rotation is an arrow with two heads along it, and tangent of that
of an arrow below which it is a point."""


def draw_arrows(
    axes: Any, configuration: Any, shape: Any, camera: Camera, *, size: float, labels: bool
) -> Array:
    """Draw drives and loads with what they are; returns points (n, 2) [mm] along them that no label should cover."""
    busy = [np.zeros((0, 2))]
    for driven in shape.driven:
        value, place = configuration.targets[driven.name], camera.flat(driven.place)
        if driven.kind == "translation":
            way = value * driven.direction
            start, end = driven.rest, driven.rest + way
            if abs(value) < LEAST * size:
                # too short to be seen: pushed from outside
                start, end = (
                    driven.place - np.sign(value or 1.0) * LEAST * size * driven.direction,
                    driven.place,
                )
            tip = camera.flat(end)
            _straight(axes, camera, start, end, DRIVE)
            if abs(value) >= LEAST * size:
                axes.plot(*np.stack([tip, place]).T, color=DRIVE, linewidth=0.8, linestyle=":", zorder=5)
            busy.append(np.linspace(camera.flat(start), tip, 25))
        else:
            ring = _turning(axes, camera, driven.place, np.sign(value or 1.0) * driven.direction, size, DRIVE)
            tip = ring[-1]
            busy.append(ring)
        axes.plot(*place, marker="o", markersize=5, color=DRIVE, markerfacecolor="white", zorder=6)
        busy.append(place[None])
        if labels:
            unit = "N" if driven.kind == "translation" else "Nm"
            force = spoken_amount(configuration.reported_forces[driven.name], unit)
            _label(axes, f"{driven.name}: {spoken_value(value, driven.kind)}, {force}", tip, DRIVE)
    busy += [_load(axes, load, camera, size, labels=labels) for load in shape.loads]
    return np.concatenate(busy)


def _load(axes: Any, load: Any, camera: Camera, size: float, *, labels: bool) -> Array:
    """A force ends where it acts, a moment goes round it, a mass is a dot."""
    amount, place = float(np.linalg.norm(load.value)), camera.flat(load.place)
    unit = {"force": "N", "moment": "Nm", "mass": "kg"}[load.kind]
    tip, busy = place, place[None]
    if load.kind == "force":
        start = load.place - USUAL * size * load.value / amount
        _straight(axes, camera, start, load.place, LOAD)
        tip = camera.flat(start)
        busy = np.linspace(tip, place, 25)
    elif load.kind == "moment":
        busy = _turning(axes, camera, load.place, load.value / amount, size, LOAD)
        tip = busy[-1]
    else:
        axes.plot(*place, marker="o", markersize=6, color=INK, zorder=6)
    if labels:
        said = spoken_amount(amount, unit)
        _label(
            axes,
            said if load.kind == "mass" else f"{load.name}: {said}",
            tip,
            INK if load.kind == "mass" else LOAD,
        )
    return busy


def draw_distances(axes: Any, shape: Any, camera: Camera, *, labels: bool) -> Array:
    """Distances asked for: both points, and a thin line along which the distance is measured, with its value; returns points
    (n, 2) [mm] that no label should cover."""
    busy = [np.zeros((0, 2))]
    for asked in shape.distances:
        start, end = asked.ends
        value = float((end - start) @ asked.direction)
        line = camera.flat(np.stack([start, start + value * asked.direction, end]))
        axes.plot(*line[:2].T, color=INK, linewidth=0.7, zorder=4.5, gid="distance")
        axes.plot(*line[1:].T, color=INK, linewidth=0.7, linestyle=":", zorder=4.5)
        axes.plot(*line[[0, 2]].T, "x", color=INK, markersize=5, zorder=6)
        busy += [line, np.linspace(line[0], line[1], 25)]
        if labels:
            said = f"{asked.name}: {spoken_value(value, 'translation')}"
            _label(axes, said, line[:2].mean(axis=0), INK)
    return np.concatenate(busy)


def _straight(axes: Any, camera: Camera, start: Array, end: Array, color: str) -> None:
    """An arrow in space [m]; where it points to the eye or away, a circle with its tip or its feathers."""
    way = (end - start) @ camera.toward
    if np.linalg.norm(camera.flat(end - start)) > 1e3 * EDGE_ON * abs(way):
        _arrow(axes, camera.flat(start), camera.flat(end), color)
        return
    look = {"color": color, "linestyle": "none", "zorder": 6.5}
    axes.plot(*camera.flat(end), "o", markersize=9, markerfacecolor="white", **look)
    axes.plot(*camera.flat(end), marker="." if way > 0.0 else "x", markersize=5, **look)


def _arrow(axes: Any, start: Array, end: Array, color: str) -> None:
    look = {"arrowstyle": "-|>", "color": color, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, zorder=5, arrowprops=look)
    # an annotation alone does not widen the axes
    axes.update_datalim([start, end])


def _turning(axes: Any, camera: Camera, place: Array, axis: Array, size: float, color: str) -> Array:
    """Three quarters of a circle about an axis (3,), right-handed, with a head; where that would be seen as a line an arrow
    with two heads along the axis; returns its points (n, 2) [mm]."""
    if abs(axis @ camera.toward) < EDGE_ON:
        flat = camera.flat(place + np.linspace(0.0, USUAL * size, 25)[:, None] * axis)
        for end in (flat[-5], flat[-1]):
            _arrow(axes, flat[0], end, color)
        return flat
    first = camera.right - (camera.right @ axis) * axis
    if np.linalg.norm(first) < 0.3:
        first = camera.up - (camera.up @ axis) * axis
    first = first / np.linalg.norm(first)
    second, radius = np.cross(axis, first), ROUND * size
    angles = np.linspace(-0.25 * np.pi, 1.15 * np.pi, 40)[:, None]
    rays = np.cos(angles) * first + np.sin(angles) * second
    # as large as the ring it belongs to, which in a small picture is shorter than matplotlib's arrow heads
    head = np.array([rays[-1] * 1.35, np.cross(axis, rays[-1]) * HEAD + rays[-1], rays[-1] * 0.65])
    flat = camera.flat(place + radius * np.concatenate([rays, head]))
    axes.plot(*flat[: len(rays)].T, color=color, linewidth=1.4, zorder=5, solid_capstyle="butt")
    axes.fill(*flat[len(rays) :].T, color=color, linewidth=0.0, zorder=5)
    return flat


def _label(axes: Any, said: str, tip: Array, color: str) -> None:
    axes.annotate(
        said, tip, (8, 6), textcoords="offset points", fontsize=8, color=color, zorder=7, bbox=BACKING
    )


def draw_springs(axes: Any, shape: Any, camera: Camera, size: float) -> None:
    """Coil springs as zigzags between their ends, torsion springs as spirals."""
    for spring in shape.springs:
        if len(spring.ends) == 1:
            turn = np.linspace(0.0, 5 * np.pi, 80)
            radius = 1e3 * 0.02 * size * turn / turn[-1]
            line = camera.flat(spring.ends[0]) + radius[:, None] * np.stack(
                [np.cos(turn), np.sin(turn)], axis=1
            )
        else:
            start, end = camera.flat(spring.ends)
            way = end - start
            across = np.array([-way[1], way[0]]) / max(float(np.linalg.norm(way)), 1e-12)
            # coils of one size, however long it is
            turns = int(np.clip(0.6 * np.linalg.norm(way) / (1e3 * COIL * size), 3, 40))
            share = np.concatenate([[0.0], np.linspace(0.2, 0.8, 2 * turns + 2), [1.0]])
            side = np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], turns), [0.0, 0.0]])
            line = start + share[:, None] * way + 1e3 * COIL * size * side[:, None] * across
        axes.plot(*line.T, color=INK, linewidth=1.0, zorder=4.5, gid="spring")
