"""The table of forces inside leaf springs and on links: equilibrium, other questions, print, file, errors."""

import csv

import numpy as np
import pytest
from planar_scenes import FINE, slider
from scenes import cross_flexure, fourbar

import ksd


@pytest.fixture(scope="module")
def pinned():
    scene = slider(1.0)
    scene.load("one", force=(1.5, -0.5, 0), at=(0.1, 0, 0))
    return ksd.solve(scene, d=5e-3, mesh=FINE)


def test_inside_a_leaf_one_force_runs_from_end_to_end(pinned):
    """The force is the same at both ends, the moments differ by its lever; at the pin there is none."""
    found = pinned.link_forces()
    for leaf in ("leaf", "leaf.2"):
        start, end = found.inside(leaf)
        assert start.force == pytest.approx(end.force, abs=1e-9)
        lever = np.cross(end.point - start.point, end.force)
        assert start.moment == pytest.approx(end.moment + lever, abs=1e-9)
        assert end.moment == pytest.approx(np.zeros(3), abs=1e-9)
        along = pinned.section_forces()[leaf]
        assert np.linalg.norm(along.start[:3]) == pytest.approx(np.linalg.norm(start.force), rel=1e-9)
        assert start.moment[2] == pytest.approx(along.start[5], rel=1e-9)


def test_on_links_everything_balances(pinned):
    """What is applied is the load, the drive and the supports."""
    rows = {(r.at, r.of): r for r in pinned.link_forces().rows if r.part == "link"}
    load, guide = rows["one", "applied"], rows["slider", "applied"]
    assert load.force == pytest.approx((1.5, -0.5, 0), abs=1e-9)
    lever = pinned.displacement("one", (0.1, 0, 0)) - load.point + np.array([0.1, 0, 0])
    assert load.moment == pytest.approx(np.cross(lever, (1.5, -0.5, 0)), abs=1e-9)
    assert guide.force[0] == pytest.approx(pinned.forces["d"], rel=1e-9)
    total = sum(r.force for (_, of), r in rows.items() if of == "applied")
    assert total == pytest.approx(np.zeros(3), abs=1e-9)
    assert rows["one", "C"].force == pytest.approx(-rows["two", "C"].force, abs=1e-12)


def test_print_and_file(pinned, tmp_path):
    found = pinned.link_forces()
    text = str(found)
    assert "in 'leaf'" in text and "start, at 'ground'" in text and "on 'one'" in text and "applied" in text
    head = next(line for line in text.splitlines() if "[N]" in line)
    assert "Fx [N]" in head and "Mz [Nm]" in head and "Fz" not in head and "Mx" not in head
    assert repr(found).startswith("<LinkForces: 2 leaf springs, at most") and repr(found).count("\n") == 0
    with open(found.to_csv(tmp_path / "forces.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found.rows)
    for row, kept in zip(rows, found.rows, strict=True):
        assert (row["part"], row["of"], row["at"]) == (kept.part, kept.of, kept.at)
        assert [float(row[f"F{a}_N"]) for a in "xyz"] == kept.force.tolist()
        assert [float(row[f"M{a}_Nm"]) for a in "xyz"] == kept.moment.tolist()
    with pytest.raises(ksd.SceneError, match=r"no leaf 'left'; there are leaf, leaf\.2"):
        found.inside("left")


def test_joints_in_space():
    """Leaf springs inside joints are rows of their own, their sum is what the joint exerts."""
    pose = ksd.solve(fourbar(), top=0.1)
    found = pose.link_forces()
    assert "Fz [N]" in str(found) and "Mx [Nm]" in str(found)
    inside = dict.fromkeys(r.of for r in found.rows if r.part == "inside")
    assert list(inside) == list(pose.section_forces())
    theirs = pose.interface_forces()
    for row in found.rows:
        if row.part == "link" and row.of != "applied":
            assert row.force == pytest.approx(theirs.of(row.of, row.at).force)
    joint = theirs.rows[0]
    own = [found.inside(n)[0] for n in inside if n.startswith(f"{joint.name}/")]
    ends = [r.force * (1 if joint.link in r.at else 0) for r in own]
    assert sum(ends) == pytest.approx(joint.force, abs=1e-9)
    # the drive alone holds the top link against both of its joints
    (held,) = (r for r in found.rows if (r.part, r.at, r.of) == ("link", "top", "applied"))
    at = (0.0, 0.3 + cross_flexure().length_AB, 0.0)
    lever = pose.displacement("top", at) - held.point + np.array(at)
    assert held.force == pytest.approx((pose.forces["top"], 0, 0), abs=1e-6)
    assert held.moment == pytest.approx(np.cross(lever, held.force), abs=1e-6)


def test_what_is_applied_has_the_moment_of_the_load_and_its_lever():
    scene, at = fourbar(), (0.05, 0.35, 0.02)
    force, moment = (3.0, -2.0, 1.0), (0.1, 0.2, 0.3)
    scene.load("left", force=force, moment=moment, at=at)
    pose = ksd.solve(scene, top=0.1, method="conventional")
    (found,) = (r for r in pose.link_forces().rows if (r.part, r.at, r.of) == ("link", "left", "applied"))
    lever = np.array(at) + pose.displacement("left", at) - found.point
    assert found.force == pytest.approx(force, abs=1e-6)
    assert found.moment == pytest.approx(moment + np.cross(lever, force), abs=1e-6)
    # about another point: the lever between the two
    forces, other = pose.interface_forces(), np.array([0.3, -0.2, 0.1])
    here, there = forces.on("left", about=found.point), forces.on("left", about=other)
    assert there[3:] == pytest.approx(here[3:] + np.cross(found.point - other, here[:3]), abs=1e-12)
    assert here[3:] == pytest.approx(-found.moment, abs=1e-12)
