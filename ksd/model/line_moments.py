"""Moments per length along leaf springs, as dead moments on points of the leaf: Gauss points between other points of it.

The work of the moment on rotations that are polynomials along the leaf is exact, so what is left is what the steps of the
inner moment at the points do to the shape in second order: it falls with the fourth power of the number of points. With
POINTS of them along a whole leaf the place of its end is 7e-7 of its displacement off where m L^2 / EI = 2, which bends it
by 1 rad, and 3e-6 at 8; so are points of the user, between which the rule is applied. The steps shorten the leaf, which
pulls one that is held at both ends; `without_shortening` has that for the error figure. The inner moment has no steps in
answers: `missing_moment` fills them (`ksd.answers.forces`).

Within the leaf itself the moment would need another leaf kernel: of fixed direction in space it has no potential, so that
the tangent of the amplitudes is not symmetric, which their elimination takes for granted (`ksd.elements.strain`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import as_vector
from ksd.errors import SceneError
from ksd.scene.leaf import LeafCondition
from ksd.scene.line_load import LineLoad
from ksd.scene.load import Load
from ksd.scene.scene import LeafPoint

POINTS, FEWEST_POINTS = 12, 4
"""Points of a moment along a whole leaf, and along a short part of it."""
SHORTENING_STATIONS = 41
"""Stations of a piece at which the rotation by the steps of the inner moment is integrated."""


def _span(line: LineLoad, length: float) -> tuple[float, float]:
    """Start and end [m] of the part that a load covers of a leaf of this length."""
    return line.start, length if line.end is None else min(line.end, length)


def moments_on_points(
    line: LineLoad, length: float, cuts: Iterable[float] = ()
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Arc lengths (n,) [m] and moments (n, 3) [Nm] on the leaf there, which stand for the moment of a line load.

    cuts [m]: arc lengths of other points of the leaf.
    """
    start, end = _span(line, length)
    places, moments = [], []
    for a, b in pairwise((start, *sorted(s for s in cuts if start < s < end), end)):
        # rounded off thirds and quarters, so that n does not change beside them
        count = max(FEWEST_POINTS, round(POINTS * (b - a) / length + 0.2))
        x, weight = np.polynomial.legendre.leggauss(count)
        s = a + (b - a) * 0.5 * (1.0 + x)
        share = ((s - start) / (end - start))[:, None]
        moment = (1.0 - share) * np.asarray(line.moment) + share * np.asarray(line.end_moment)
        places.append(s)
        moments.append(0.5 * (b - a) * weight[:, None] * moment)
    return np.concatenate(places), np.concatenate(moments)


def with_moment_points(scene: Any) -> Any:
    """The scene with points and loads in the place of moments along leaf springs, each load by the name of its line load."""
    lines = [line for line in scene.line_loads if line.has_moment]
    if not lines or any(load.link in scene.unlisted for load in scene.loads):
        return scene
    leaves, points, loads = {f.name: f.leaf for f in scene.leaves}, list(scene.points), list(scene.loads)
    for line in lines:
        leaf = leaves[line.leaf]
        state = leaf.condition
        if leaf.curve is not None and state is not None and (any(state.shift) or any(state.turn)):
            raise SceneError(
                f"line load '{line.name}': its moment acts on points of leaf '{line.leaf}', which may not be curved and "
                "have an assembly error (mechanism.fit) then; leave one of them out"
            )
        cuts = [p.s for p in scene.points if p.leaf == line.leaf]
        for k, (s, moment) in enumerate(zip(*moments_on_points(line, leaf.length, cuts), strict=True)):
            near = 1e-9 * leaf.length
            point = next((p for p in points if p.leaf == line.leaf and abs(p.s - s) <= near), None)
            if point is None:
                # numbered, not named by s, which a design may vary
                point = LeafPoint(f"{line.name} {k + 1}", line.leaf, float(s), unlisted=True)
                points.append(point)
            place = as_vector(leaf.section_at(s / leaf.length)[0])
            loads.append(Load(line.name, point.name, (0.0, 0.0, 0.0), as_vector(moment), place))
    links = (*scene.links, *(p.name for p in points[len(scene.points) :]))
    return replace(scene, links=links, points=tuple(points), loads=tuple(loads))


def without_moments(scene: Any) -> Any:
    """The scene without moments along leaf springs."""
    if not any(line.has_moment for line in scene.line_loads):
        return scene
    zero, kept = (0.0, 0.0, 0.0), (line for line in scene.line_loads if line.has_force)
    return replace(scene, line_loads=tuple(replace(x, moment=zero, to_moment=None) for x in kept))


def without_shortening(scene: Any, load_factor: float) -> Any:
    """The scene with leaf springs whose natural length is longer by what the steps of the inner moment at points of moments
    shorten them: by half the square of the rotation that these steps are; scene: that of `with_moment_points`.

    For the error figure: a leaf spring held at both ends is pulled by it, and as no mesh changes it, no mesh tells it.
    """
    leaves = {f.name: f.leaf for f in scene.leaves}
    for name in dict.fromkeys(line.leaf for line in scene.line_loads if line.has_moment):
        leaf = leaves[name]
        marks = [0.0, *sorted(p.s for p in scene.points if p.leaf == name), leaf.length]
        axes, turn, total = leaf.section_at(0.0)[1], np.zeros(2), 0.0
        stiff = leaf.material.E * np.array([leaf.section.Iy, leaf.section.Iz])
        for a, b in pairwise(marks):
            s, step = np.linspace(a, b, SHORTENING_STATIONS, retstep=True)
            missing = load_factor * missing_moment(scene, name, leaf.length, s, 0.5 * (a + b))
            bend = -missing @ axes[:, 1:] / stiff
            turns = turn + np.cumsum(0.5 * step * (bend + np.vstack([-bend[:1], bend[:-1]])), axis=0)
            square, turn = (turns**2).sum(axis=1), turns[-1]
            total += 0.5 * step * (square.sum() - 0.5 * (square[0] + square[-1]))
        own = leaf.condition or LeafCondition()
        longer = replace(own, stretch=own.stretch * (1.0 + total / leaf.length))
        leaves[name] = replace(leaf, condition=longer)
    return replace(scene, leaves=tuple(replace(f, leaf=leaves[f.name]) for f in scene.leaves))


def missing_moment(
    scene: Any, leaf: str, length: float, s: NDArray[np.float64], middle: float
) -> NDArray[np.float64]:
    """Inner moment (k, 3) [Nm], global, that moments along a leaf cause at arc lengths s (k,) [m], less that of their points
    on the piece of the leaf around `middle` [m]; scene: that of `with_moment_points`."""
    found = np.zeros((len(s), 3))
    beyond = {p.name for p in scene.points if p.leaf == leaf and p.s > middle}
    for line in (x for x in scene.line_loads if x.leaf == leaf and x.has_moment):
        start, end = _span(line, length)
        rest = (np.clip(end - s, 0.0, end - start) / (end - start))[:, None]
        first, last = np.asarray(line.moment), np.asarray(line.end_moment)
        found += (end - start) * (rest * last + 0.5 * rest**2 * (first - last))
        for load in scene.loads:
            if load.name == line.name and load.link in beyond:
                found -= load.moment
    return found
