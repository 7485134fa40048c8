"""The order of loads and drives, where it decides: one for all methods, the same as `ksd.follow` takes in that order."""

import json

import numpy as np
import pytest
from scenes import fourbar

import ksd
from ksd.cli import main
from ksd.solvers import loading_order
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.loading_order import compression, follow_in_order
from ksd.study.prepared_design import PreparedDesign

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
ORDERS = ("loads", "drives")


def guide(lengths, *, mass=0.3, gravity=(9.81, 0, 0), points=0, thickness=0.3e-3, apart=0.03):
    """A stage on upright leaf springs of unequal lengths, which the stroke compresses beyond what they carry straight."""
    m = ksd.Mechanism("guide")
    stage = m.link("stage", mass=mass, inertia=(1e-4,) * 3, at=(0, 0.1, 0))
    for k, length in enumerate(lengths):
        x = apart * (k - 1)
        name = f"leaf {k}"
        m.leaf("ground", stage, start=(x, 0.1 - length, 0), end=(x, 0.1, 0), section=ksd.rectangle(thickness, 0.02),
               material=STEEL, width_axis="z", name=name)  # fmt: skip
        for s in np.linspace(0, length, points + 2)[1:-1].tolist():
            m.point(name, s)
    if gravity:
        m.gravity = gravity
    m.actuate(stage, along="x", at=(0, 0.1, 0), name="push")
    return m


def followed(scene, mesh, **drives):
    """Drive forces at the ends of both orders by `ksd.follow`."""
    start = ksd.follow(scene, control="load", mesh=mesh).states[-1]
    one = ksd.follow(scene, control="drives", start=start, mesh=mesh, **drives)
    other = ksd.follow(scene, control="load", mesh=mesh, **drives)
    assert one.ended and other.ended and not one.turnings and not other.turnings
    return [path.states[-1].forces for path in (one, other)]


@pytest.mark.parametrize(
    "lengths, mass, gravity, push",
    [
        ((0.092, 0.067, 0.095), 0.3, (9.81, 0, 0), 18.8e-3),
        ((0.07, 0.094, 0.064), 0.1, (9.81, 0, 0), -13.4e-3),
    ],
)
def test_the_order_that_is_asked_for_is_the_one_that_is_taken(lengths, mass, gravity, push):
    """By `ksd.follow` in both orders; the loads come first where nothing is said, and the answer names the other end."""
    scene = guide(lengths, mass=mass, gravity=gravity)
    by_default = ksd.solve(scene, push=push)
    right = dict(zip(ORDERS, followed(scene, by_default.model.mesh, push=push), strict=True))
    assert abs(right["loads"]["push"] / right["drives"]["push"] - 1.0) > 1e-4
    for order, method in (("loads", "conventional"), ("drives", None)):
        pose = ksd.solve(scene, push=push, order=order, method=method, mesh=by_default.model.mesh)
        assert pose.trusted and pose.forces == pytest.approx(right[order], rel=1e-7)
        (said,) = (w for w in pose.warnings if "the loading order decides" in w)
        assert said.endswith(f" N at drive 'push' (order='{ORDERS[1 - ORDERS.index(order)]}')")
        other = ORDERS[1 - ORDERS.index(order)]
        assert f"order='{other}'" in said and f"{right[other]['push']:.6g} instead of" in said
    assert by_default.forces == pytest.approx(right["loads"], rel=1e-7)


def test_orders_that_end_alike_are_not_told_apart():
    """Steps too long for a leaf spring that buckles between its ends went over to its other side, at 11.55029 N."""
    scene = guide((0.095, 0.063, 0.087), mass=0.1, gravity=(0, -9.81, 0))
    poses = [ksd.solve(scene, push=10.7e-3, order=order) for order in ORDERS]
    short = ksd.follow(scene, push=10.7e-3, mesh=poses[0].model.mesh, first=1e-3).states[-1]
    for pose in poses:
        assert pose.trusted and pose.forces["push"] == pytest.approx(short.forces["push"], rel=1e-7)
        assert not any("order" in w for w in pose.warnings)


def test_a_sweep_and_the_command_line_take_the_order(tmp_path):
    scene = guide((0.07, 0.094, 0.064), mass=0.1)
    file = tmp_path / "guide.toml"
    ksd.save_scene(scene, file, targets={"push": -13.4e-3}, options={"order": "drives"})
    answers = {order: ksd.solve(scene, push=-13.4e-3, order=order).forces["push"] for order in ORDERS}
    for order, right in answers.items():
        table = ksd.sweep(scene, push=[-13.4e-3], questions="force", order=order, progress=False)
        assert table["push_force_N"] == pytest.approx([right], rel=1e-6)
        assert (
            main(
                [
                    "solve",
                    str(file),
                    "--json",
                    str(tmp_path / "a.json"),
                    *(["--order", order] * (order == "loads")),
                ]
            )
            == 0
        )
        assert json.loads((tmp_path / "a.json").read_text())["drives"]["push"]["force_N"] == pytest.approx(
            right, rel=1e-6
        )


def test_joints_with_records_take_the_same_order():
    """Load steps of both together, and the five steps, end 28 % apart from loads, then drives in this fourbar."""
    scene = fourbar(reading=2)
    scene.load("left", force=(-1023.65, -26.55, -549.35), moment=(12.365, -54.55, -42.12), at=(-0.2, 0.2, 0))
    pose = ksd.solve(scene, top=-0.144)
    right = dict(zip(ORDERS, followed(scene, pose.model.mesh, top=-0.144), strict=True))
    assert pose.forces == pytest.approx(right["loads"], rel=1e-7)
    other = ksd.solve(scene, top=-0.144, order="drives", mesh=pose.model.mesh)
    assert other.forces == pytest.approx(right["drives"], rel=1e-7)


def test_where_one_order_snaps_the_answer_says_so():
    scene = guide((0.073, 0.09, 0.068), mass=0.3, gravity=(0, -9.81, 0))
    free = guide((0.092, 0.067, 0.095), mass=0.01, gravity=(-9.81, 0, 0))
    poses = [ksd.solve(scene, push=16.2e-3), ksd.solve(free, push=-16.9e-3)]
    for pose in poses:
        for path in (
            follow_in_order(pose.model, pose.model.targets(pose.targets), order) for order in ORDERS
        ):
            told = any(path.obstacle in w and "snaps or buckles" in w for w in pose.warnings)
            assert told is bool(path.obstacle)


@pytest.mark.parametrize("points", [0, 1, 3])
@pytest.mark.parametrize("mesh", [None, ksd.Mesh(leaf="corotational", elements=12)])
def test_compression_does_not_hang_on_points_or_leaf_model(points, mesh):
    """A column under its own critical load, clamped at both ends, 4 pi^2 EI/L^2, and a quarter of it."""
    scene = guide((0.08,) * 3, gravity=None, points=points, apart=0.0)
    force = 3 * np.pi**2 * STEEL.E * 0.02 * 0.3e-3**3 / 12 / 0.08**2
    scene.load("stage", force=(0, -force * 0.9, 0), at=(0, 0.1, 0))
    model = ksd.compile_scene(scene, mesh=mesh)
    assert compression(model, solve_conventional(model, {"push": 0.0}).motion) == pytest.approx(0.9, rel=1e-3)


def test_an_order_that_cannot_matter_costs_nothing(monkeypatch):
    def never(*_, **__):
        raise AssertionError("followed without a reason")

    monkeypatch.setattr(loading_order, "follow_in_order", never)
    gentle = guide((0.09, 0.09, 0.09), gravity=(0, -9.81, 0))
    for scene in (gentle, guide((0.092, 0.067, 0.095), gravity=None)):
        pose = ksd.solve(scene, push=5e-3)
        assert pose.trusted and not pose.warnings
    with pytest.raises(ksd.SceneError, match=r"order = 'load': choose one of 'loads' \(loads, then drives\)"):
        ksd.solve(gentle, push=5e-3, order="load")


def test_a_batch_asks_a_whole_solve_where_loads_compress_a_leaf_spring(monkeypatch):
    """Above half of its critical load the order may decide; then, and only then, a pose of a batch is solved again."""
    scene, asked = fourbar(), []
    scene.load("left", force=(0, -5.0, 0), at=(-0.2, 0.2, 0))
    whole = PreparedDesign._full_refusal
    monkeypatch.setattr(PreparedDesign, "_full_refusal", lambda self, t: asked.append(t) or whole(self, t))
    assert ksd.batch(scene, top=[-0.1]).solved == 1 and not asked
    monkeypatch.setattr(loading_order, "MAX_COMPRESSION", 0.0)
    model = ksd.compile_scene(scene)
    assert compression(model, solve_conventional(model, {"top": -0.1}).motion) > 0.0
    assert ksd.batch(scene, top=[-0.1]).solved == 1 and len(asked) == 1
