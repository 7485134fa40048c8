"""The force that pulls a link out of the contacts that hold it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import Axis, clear_argument_errors, direction, vector
from ksd.errors import ConvergenceError
from ksd.model.compile import compile_as_is
from ksd.scene.link import Link
from ksd.scene.load import Load
from ksd.solvers.configuration import Configuration
from ksd.solvers.contact_solve import solve_with_contact
from ksd.solvers.grasp import contacts_on

ACCURACY = 1e-4
"""Relative accuracy of a force that pulls out."""
ENOUGH = 100.0
"""A force that does not pull a link out, in all normal forces on it: none does."""


@clear_argument_errors
def pull_out(pose: Configuration, link: Link | str, *, along: Axis, at: ArrayLike | None = None) -> float:
    """Dead force [N] along a direction that grows from this pose until all contacts of a link slip, or until no equilibrium
    is found beyond.

    along: "x", "-y", ... or a vector (3,); at (3,) [m, global]: its point at rest, the reference point of the link when
    None. inf where no force pulls the link out, as it hangs on springs as well. Raises SceneError where no closed contact is
    on the link.

    >>> grip = ksd.Mechanism("grip", plane="xy")
    >>> disc = grip.link("disc")
    >>> steel, blade = ksd.Material(E=200e9, nu=0.3), ksd.rectangle(3e-4, 0.01)
    >>> for name, side in (("lower", -1), ("upper", 1)):
    ...     base, jaw = grip.links(f"{name} base", name)
    ...     for y in (0.02, 0.04):
    ...         _ = grip.leaf(base, jaw, start=(0, side * y, 0), end=(0.06, side * y, 0), section=blade, material=steel)
    ...     _ = grip.actuate(base, along="y", at=(0, 0, 0), name=name)
    ...     _ = grip.support(base, along="x", at=(0, 0, 0))
    ...     _ = grip.support(base, about="z")
    ...     face = grip.surface(jaw, ksd.shapes.wall(), at=(0.07, side * 0.015, 0), axis=(0, -side, 0))
    ...     outline = grip.surface(disc, ksd.shapes.disc(0.015), at=(0.07, 0, 0), name=f"disc at {name}")
    ...     _ = grip.contact(face, outline, friction=0.3)
    >>> closed = ksd.walk(grip, [{"lower": 4e-3, "upper": -4e-3}])[-1]
    >>> print(f"{ksd.pull_out(closed, disc, along='x', at=(0.07, 0, 0)):.2f} N")
    1.23 N
    """
    node = pose._node(link)
    name, axis = pose.model.node_names[node], np.array(direction(along, "along"))
    point = tuple(pose.model.rest.x[node].tolist()) if at is None else vector(at, "at", unit="m")
    names = contacts_on(name, pose.model.original_scene, pose.contacts)
    total = sum(pose.contacts[contact].N for contact in names)
    base, touched = pose.model, pose.touched
    assert touched is not None
    reached, step, here = 0.0, 0.25 * total, pose
    while step > ACCURACY * max(reached, 1e-3 * total):
        load = Load("pull", name, tuple(((reached + step) * axis).tolist()), (0.0, 0.0, 0.0), point)
        scene = replace(base.scene, loads=(*base.scene.loads, load))
        original = replace(base.original_scene, loads=(*base.original_scene.loads, load))
        model = compile_as_is(scene, base.mesh, original, base.choice)
        try:
            moved = solve_with_contact(model, pose.targets, touched.values, start=here, smallest_step=0.3)
        except ConvergenceError:
            step *= 0.5
            continue
        if all(c.state in ("slip", "open") for n, c in moved.contacts.items() if n in names):
            step *= 0.5
            continue
        here, reached = moved, reached + step
        if reached > ENOUGH * total:
            return math.inf
        step *= 1.5
    return reached
