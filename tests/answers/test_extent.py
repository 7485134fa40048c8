"""Size and clearance of leaf springs against closed forms and brute force, and the worst support stiffness."""

from itertools import combinations

import numpy as np
import pytest
from scenes import STEEL, single_joint
from scipy.spatial import cKDTree

import ksd
from ksd.answers import extent
from ksd.answers.shape import mechanism_shape
from ksd.units import deg, mm


def leaf(scene, a, b, start, end, width_axis, name, thickness=0.5 * mm, width=20 * mm):
    scene.leaf(a, b, start=start, end=end, section=ksd.rectangle(thickness, width), material=STEEL, width_axis=width_axis,
               name=name)  # fmt: skip


def chain(turned):
    """Two leaf springs one after the other, the second coming back above the first, and one aside: three blocks."""
    scene = ksd.Mechanism("chain")
    one, two, three = scene.links("one", "two", "three")
    leaf(scene, scene.ground, one, (0, 0, 0), (0.1, 0, 0), (0, 0, 1), "first")
    leaf(scene, one, two, (0.1, 0.02, 0), (0.0, 0.02, 0), (0, 0, 1), "second")
    leaf(scene, two, three, (0.0, 0.04, 0.03), (0.1, 0.04, 0.03), turned, "third", width=10 * mm)
    scene.actuate(three, along="x", at=(0.1, 0.04, 0.03), name="drive")
    return scene


def test_size_and_clearance_of_sheets_at_rest_are_those_of_rectangles():
    pose = ksd.solve(chain((0, 0, 1)), drive=0.0)
    low, high = pose.extent()
    assert low == pytest.approx((0, -0.25 * mm, -10 * mm), abs=1e-9)
    assert high == pytest.approx((0.1, 40.25 * mm, 35 * mm), abs=1e-9)
    # 'first' ends at z = 10 mm, 'third' begins at 25 mm, 40 mm above
    found = pose.clearance()
    assert found.leaves == ("first", "third")
    assert found.distance == pytest.approx(np.hypot(40 * mm, 15 * mm) - 0.5 * mm, rel=1e-9)
    # its width across: the edge of 'third' is at y = 35 mm, z = 30 mm
    found = ksd.solve(chain((0, 1, 0)), drive=0.0).clearance()
    assert found.distance == pytest.approx(np.hypot(35 * mm, 20 * mm) - 0.5 * mm, rel=1e-9)
    assert "first" in str(found) and "39.81 mm" in str(found)


def test_clearance_of_bent_sheets_is_that_of_many_points():
    hinge = ksd.CrossFlexure(
        STEEL, length=100 * mm, angle=45 * deg, thickness=1 * mm, widths=(40 * mm, 20 * mm)
    )
    scene = ksd.Mechanism("arm")
    one, two, three = scene.links("one", "two", "three")
    for a, b, at, axis, name in (
        (scene.ground, one, (0, 0, 0), "z", "base"),
        (one, two, (150 * mm, 0, 0), "y", "middle"),
        (two, three, (0.02, 0.05, 0.12), "z", "last"),
    ):
        scene.actuate_joint(scene.join(a, b, hinge, at=at, axis=axis, toward="x", name=name), name=name)
    pose = ksd.solve(scene, base=0.4, middle=0.3, last=-0.5, method="full")
    points, blocks = {}, {}
    for f in mechanism_shape(*pose.unreduced_state, points=201).leaves:
        v = np.linspace(-0.5, 0.5, 81)[None, :, None] * f.width[:, None, None]
        points[f.name] = (f.place[:, None] + v * f.axes[:, None, :, 2]).reshape(-1, 3)
        blocks[f.name] = f.name.split("/")[0]
    follow = {"base": {"base", "middle"}, "middle": {"base", "middle", "last"}, "last": {"middle", "last"}}
    found = pose.clearance()
    least = {
        (a, b): cKDTree(points[a]).query(points[b])[0].min() - 1 * mm
        for a, b in combinations(points, 2) if blocks[b] not in follow[blocks[a]]
    }  # fmt: skip
    pair = min(least, key=least.get)
    assert set(pair) == set(found.leaves)
    assert found.distance == pytest.approx(least[pair], abs=0.05 * mm) and 1 * mm < found.distance
    ends = np.concatenate(list(points.values()))
    assert pose.extent() == pytest.approx(np.array([ends.min(axis=0), ends.max(axis=0)]), abs=0.6 * mm)


def test_distance_of_flat_pieces_is_the_least_of_many_points():
    rng = np.random.default_rng(4)
    u = np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, 61)]), axis=-1).reshape(-1, 2)
    for k in range(60):
        one, two = rng.normal(size=(2, 3, 1, 3))
        two[0] += (0.0, 3.0, 1.0)[k % 3]
        if k % 5 == 0:
            two[1:] = one[1:]
        found = float(extent._flat_distance(one, two)[0])
        clouds = [p[0] + u @ p[1:, 0] for p in (one, two)]
        least = cKDTree(clouds[0]).query(clouds[1])[0].min()
        # two points of a grid are at most a step and a half off any two of the pieces
        step = sum(np.linalg.norm(p[e]) / 30 for p in (one, two) for e in (1, 2))
        assert found <= least + 1e-12 and least - found < (
            step if found < 0.2 else 0.15 * step + step**2 / found
        )


def test_distance_of_sheets_is_the_least_of_all_pairs_of_their_pieces():
    rng = np.random.default_rng(7)
    for k in range(40):
        # two curved, twisted sheets of nine pieces, far, near and through each other
        one, two = np.cumsum(rng.normal(size=(2, 3, 9, 3)), axis=2) * [[[1]], [[0.4]], [[0.7]]]
        two[0] += rng.normal(size=3) * (9.0, 2.0, 0.0)[k % 3]
        i, j = (a.ravel() for a in np.mgrid[:9, :9])
        least = extent._flat_distance(one[:, i], two[:, j]).min()
        assert extent._sheet_distance(one, two, np.inf) == pytest.approx(least, rel=1e-12, abs=1e-15)
        assert extent._sheet_distance(one, two, least + 0.1) == pytest.approx(least, rel=1e-12, abs=1e-15)


def test_leaf_springs_in_windows_of_one_joint_are_not_what_is_near():
    # the folded leaf springs of this hinge have windows for its bars: told as touching, whatever the pose
    scene, targets, _ = ksd.load_scene("ksd/scenes/arm_joints.toml")
    pose = ksd.solve(scene, targets, method="reduced")
    found = pose.clearance()
    places = {}
    for f in mechanism_shape(*pose.unreduced_state, points=41).leaves:
        v = np.linspace(-0.5, 0.5, 21)[None, :, None] * f.width[:, None, None]
        places[f.name] = (f.place[:, None] + v * f.axes[:, None, :, 2]).reshape(-1, 3)
    trees = {name: cKDTree(p) for name, p in places.items()}
    pairs = [(a, b) for a, b in scene.scene().leaves_apart() if a.split("/")[0] != b.split("/")[0]]
    assert len(pairs) > 100 and all(
        a.split("/")[0] != b.split("/")[0] for a, b in scene.scene().leaves_apart()
    )
    near = sorted(pairs, key=lambda p: np.linalg.norm(places[p[0]].mean(axis=0) - places[p[1]].mean(axis=0)))
    least = min(trees[a].query(places[b])[0].min() for a, b in near[:400])
    assert found.distance == pytest.approx(least - 0.45 * mm, abs=0.1 * mm) and found.distance > 5 * mm


def test_no_clearance_to_a_leaf_spring_on_whose_point_one_stands():
    """They meet there, as at a block."""
    scene = ksd.Mechanism("branch", plane="xy")
    words = {"section": ksd.rectangle(0.5 * mm, 10 * mm), "material": STEEL}
    a, b = scene.links("a", "b")
    scene.leaf("ground", a, start=(0, 0, 0), end=(0.1, 0, 0), name="under", **words)
    point = scene.point("under", 0.05)
    scene.leaf(point, b, start=(0.05, 0, 0), end=(0.05, 0.08, 0), name="up", **words)
    scene.leaf("ground", b, start=(0.15, 0.08, 0), end=(0.05, 0.08, 0), name="over", **words)
    scene.actuate(a, along="y", at=(0.1, 0, 0), name="d")
    assert scene.scene().leaves_apart() == []
    with pytest.raises(ksd.SceneError, match="share a block"):
        ksd.solve(scene, d=1 * mm).clearance()


def test_no_clearance_where_all_leaf_springs_share_a_block():
    with pytest.raises(ksd.SceneError, match="share a block"):
        ksd.solve(single_joint(), turn=0.1).clearance()
    table = ksd.sweep(single_joint(), turn=[0.1], questions=("size", "clearance"), progress=False)
    assert "clearance: every two" in table["status"][0] and table["size_z_mm"][0] > 60


def test_no_clearance_of_one_leaf_spring():
    scene = ksd.Mechanism("blade", plane="xy")
    tip = scene.link("tip")
    scene.leaf(
        "ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(1e-3, 0.01), material=STEEL
    )
    scene.actuate(tip, along="y", at=(0.1, 0, 0), name="d")
    with pytest.raises(
        ksd.SceneError, match=r"'blade' has no clearance: .* of two leaf springs, and it has one"
    ):
        ksd.solve(scene, d=1 * mm).clearance()


def test_worst_support_stiffness_is_the_least_of_all_directions():
    pose = ksd.solve(single_joint(), turn=0.3)
    found = pose.stiffness("tip", at=(0.03, 0.02, 0.05))
    rng = np.random.default_rng(1)
    v = rng.normal(size=(40_000, 3))
    v /= np.linalg.norm(v, axis=1)[:, None]
    for k, C in enumerate((found.compliance[:3, :3], found.compliance[3:, 3:])):
        least = 1.0 / np.einsum("ki,ij,kj->k", v, C, v).max()
        assert found.worst[k] == pytest.approx(least, rel=2e-3) and found.worst[k] <= least * (1 + 1e-12)
    row = next(ksd.sweep(single_joint(), turn=[0.3], questions="support_stiffness", link="tip", at=(0.03, 0.02, 0.05),
                         progress=False).rows())  # fmt: skip
    assert row["support_worst_N_per_m"] == pytest.approx(found.worst[0], rel=1e-6)
    assert row["support_worst_Nm_per_rad"] == pytest.approx(found.worst[1], rel=1e-6)


@pytest.mark.parametrize("width_axis", [(0, 0, 1), (0, 1, 0), (0, 1, 1)])
def test_size_and_clearance_of_wires_do_not_depend_on_their_width_axis(width_axis):
    """Two wires of 4 mm that cross at a distance of 10 mm, and a third one, as cylinders."""
    scene, section = ksd.Mechanism("wires"), ksd.circle(4 * mm)
    one, two, three = scene.links("one", "two", "three")
    for a, b, start, end, axis, name in (
        (scene.ground, one, (0, 0, 0), (0.1, 0, 0), width_axis, "first"),
        (one, two, (0.2, 0, 0), (0.2, 0.1, 0), "z", "second"),
        (two, three, (0.0, 0.01, 0.01), (0.1, 0.01, 0.01), width_axis, "third"),
    ):
        scene.leaf(a, b, start=start, end=end, width_axis=axis, section=section, material=STEEL, name=name)
    scene.actuate(three, along="x", at=(0.1, 0, 0), name="drive")
    pose = ksd.solve(scene, drive=0.0)
    assert pose.clearance().leaves == ("first", "third")
    assert pose.clearance().distance == pytest.approx(np.hypot(10 * mm, 10 * mm) - 4 * mm, rel=1e-5)
    low, high = pose.extent()
    assert low == pytest.approx((0, -2 * mm, -2 * mm), abs=1e-9)
    assert high == pytest.approx((202 * mm, 100 * mm, 12 * mm), abs=1e-9)
