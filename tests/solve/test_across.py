"""Stability across the plane from the motions across it alone, against the spatial tangent."""

import numpy as np
import pytest
from scenes import STEEL, dense, fourbar, single_joint

import ksd
from ksd.model.compile import compile_scene
from ksd.model.planar_across import stable_across
from ksd.model.planar_system import assemble_planar
from ksd.model.system import assemble
from ksd.solve.conventional import conventional
from ksd.solve.planar import look_from_plane
from ksd.solve.storage import Storage
from ksd.units import mm


def loaded():
    """Fourbar with a dead load off its point, a drive of two terms seen from a moving link, and a rotation in it."""
    scene = fourbar()
    scene.load("top", force=(30.0, -80.0, 0.0), moment=(0, 0, 2.0), at=(0.05, 0.4, 0.0))
    seen = scene.displacement("right", (0.6, 0.8, 0), at=(0.2, 0.3, 0), relative_to="top")
    scene.actuate(terms=[seen, 0.3 * scene.rotation("left", "z")], name="mixed")
    return scene


def strip(*, heights=(0.0,), width=20 * mm, axis=(0, 0, 1), load=0.0):
    """Wide thin strips above each other, pushed at their ends in their own plane, which is across `axis`."""
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip")
    e3 = np.array(axis, float)
    e1 = np.eye(3)[int(np.argmin(np.abs(e3)))]
    e2 = np.cross(e3, e1)
    for h in heights:
        scene.leaf(
            scene.ground, tip, start=h * e3, end=0.3 * e1 + h * e3, section=ksd.rectangle(width, 0.5 * mm),
            material=STEEL, width_axis=e3,
        )  # fmt: skip
    scene.actuate(tip, along=e2, at=0.3 * e1, name="push")
    if load:
        scene.load("tip", force=-load * e1, at=0.3 * e1)
    return scene


# scenes, and the force [N] that their leafs carry in the random states
SCENES = {
    "fourbar": (fourbar, 3e5),
    "loaded": (loaded, 3e5),
    "joint": (single_joint, 3e5),
    "strip": (strip, 3e3),
    "two strips, other plane": (lambda: strip(heights=(-4 * mm, 4 * mm), axis=(1, 0, 0), load=3.0), 3e3),
}


def prepared(scene):
    """(storage, its planar one, planar arrays, motion and storage) of a scene at rest."""
    storage = Storage(compile_scene(scene))
    flat = storage.flat
    return storage, flat, flat.plane.arrays, flat.motion, flat.held.parts.work


def split(storage, across, plane):
    """The spatial matrix as assembled, seen as (in the plane, coupling, across) about points of the links in the mirror."""
    arrays, axes = storage.model.arrays, plane.lifting.axes
    S, k = dense(arrays, storage.work), axes[:, 2]
    T, inside = np.zeros((len(S), across.plan.unknowns)), []
    member = arrays.members
    mirror = np.mean(plane.lifting.height[member.node[:, 0]] + member.offset[:, 0] @ k)
    for node in range(1, len(arrays.start)):
        u, v = arrays.start[node], across.start[node]
        T[u : u + 3, v] = k
        for c in range(2):
            T[u + 3 : u + 6, v + 1 + c] = axes[:, c]
            T[u : u + 3, v + 1 + c] = np.cross(axes[:, c], (plane.lifting.height[node] - mirror) * k)
        for way in ((*axes[:, 0], 0, 0, 0), (*axes[:, 1], 0, 0, 0), (0, 0, 0, *k)):
            inside.append(np.zeros(len(S)))
            inside[-1][u : u + 6] = way
    for row in arrays.terms.start:
        inside.append(np.eye(len(S))[row])
    flat = np.array(inside).T
    return flat.T @ S @ flat, flat.T @ S @ T, T.T @ S @ T


@pytest.mark.parametrize("name", SCENES)
def test_a_minimum_across_is_one_in_space(name, rng):
    """On random planar states, which are no equilibria: the spatial tangent falls apart, and its part across the plane and
    the insides of the leafs have no negative pivots where a minimum is seen, and have some where none is seen."""
    make, force = SCENES[name]
    storage, flat, arrays, motion, work = prepared(make())
    across, space = flat.across.parts.across, storage.model.arrays
    assert len(across.times) == len(arrays.members.kind)
    target, seen = np.zeros(len(arrays.terms.start)), []
    for size in np.geomspace(0.001, 1.0, 40):
        motion.assign(flat.plane.rest)
        motion.pose[1:, 2] += size * rng.normal(size=len(motion.pose) - 1)
        motion.pose[1:, :2] += 0.05 * size * rng.normal(size=(len(motion.pose) - 1, 2))
        for i in range(len(across.times)):
            own = motion.inner[arrays.members.inner_at[i] : arrays.members.inner_at[i + 1]]
            own[:-3] += 5.0 * size * rng.normal(size=len(own) - 3)
            # pulled, for the thin leafs not to buckle in the plane
            own[-3:] += across.times[i] * size * force * rng.normal(size=3) * [0.1, 0.1, 0.01]
            own[-3] = abs(own[-3])
        motion.multiplier[:] = 0.1 * force * size * rng.normal(size=len(target))
        _, inside, status = assemble_planar(arrays, motion, target, 1.0, work, 1e-8, 10.0, 0)
        sound = stable_across(across, arrays, motion, work, 1.0)
        flat.lift()
        _, _, insides, failed = assemble(space, storage.motion, target, 1.0, storage.work, 1e-8, 0, 10.0)
        if inside or status or failed:
            continue
        own, coupling, other = split(storage, across, flat.plane)
        assert np.abs(coupling).max() < 1e-10 * np.abs(other).max()
        pivots = insides + int(np.sum(np.linalg.eigvalsh(other) < 0.0))
        assert sound == (pivots == 0)
        seen.append(sound)
    assert min(seen.count(True), seen.count(False)) >= 4


def test_what_is_no_mirror_image_is_asked_in_space():
    crossed = strip()
    crossed.load("tip", force=(1.0, 0, 0), at=(0.3, 0, 0.01))
    following = strip()
    following.load("tip", force=(1.0, 0, 0), at=(0.3, 0, 0), following=True)
    beside = strip(heights=(0.0,))
    beside.actuate("tip", along="x", at=(0.3, 0, 0.01), name="beside")
    for scene in (crossed, following, beside):
        assert not prepared(scene)[1].mirror
    chains = Storage(compile_scene(strip(), mesh=ksd.Mesh("corotational", elements=4)))
    assert not chains.flat.mirror


def test_tipping_over_is_seen_when_space_is_not_asked():
    """A strip pushed further and further: after the first look in space its mirror alone says when it tips."""
    model = compile_scene(strip())
    room = Storage(model)
    across = room.flat.across.parts.across
    verdicts = []
    for push in np.geomspace(1e-6, 2e-2, 12):
        across.seen[:] = 1e9
        alone = conventional(model, {"push": push}, planar=True, storage=room)
        space = conventional(model, {"push": push}, planar=False)
        assert alone.negatives == space.negatives
        verdicts.append(alone.stable)
    assert verdicts[0] and not verdicts[-1]


def test_space_is_asked_first_and_twice_as_far_out():
    room, flat, *_ = prepared(fourbar())
    across, last = flat.across.parts.across, 0.0
    for d, asked in ((0.01, True), (0.015, False), (0.005, False), (0.05, True), (0.09, False)):
        conventional(room.model, {"top": d}, planar=True, storage=room)
        assert (across.seen[0] != last) == asked
        last = across.seen[0]


def test_what_space_says_counts():
    """A state that the mirror takes for a minimum is what space says it is."""
    room, flat, *_ = prepared(fourbar())
    found = conventional(room.model, {"top": 0.1}, planar=True, storage=room)
    across = flat.across.parts.across
    across.seen[:] = -1.0
    args = flat.held, room.held, flat.across, np.array([0.1]), 1.0, 1e-8, found.steps[0].residual
    assert look_from_plane(*args, 1)[1:] == (1, 0) and across.seen[0] > 0
    # more pivots than rows in the plane: space counts them all
    across.seen[:] = -1.0
    assert look_from_plane(*args, 2)[1] == 1 and across.seen[0] == -1.0
