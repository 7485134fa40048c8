"""Poses in one HTML file: what it holds, and that nothing ends its scripts early. In a browser: tests/interactive."""

import json
import re

import numpy as np
import pytest

import ksd
from ksd.errors import SceneError
from ksd.scene.toml_file import shipped_scenes
from ksd.units import mm
from ksd.view.sheets import sheet_corners, station_stress

pytest.importorskip("nicegui", reason="the extra `live` is not installed")


@pytest.fixture(scope="module")
def poses():
    mechanism, *_ = ksd.load_scene(shipped_scenes()["guide"])
    return [ksd.solve(mechanism, table=d * mm) for d in (0.0, 2.5, 5.0)]


def test_a_path_is_one_file_with_every_pose_on_one_scale(poses, tmp_path):
    text = ksd.view.write_page(poses, tmp_path / "guide.html").read_text()
    assert not re.search(r'(src|href)="(?!data:,")', text)
    parts = dict(re.findall(r'<script type="text/plain" id="(\w+)">(.*?)</script>', text, re.S))
    assert set(parts) == {"three", "sheets", "poses"}
    shown = json.loads(parts["poses"])
    assert shown["names"] == ["table = 0", "table = 0.0025", "table = 0.005"]
    assert {p["most"] for p in shown["poses"]} == {f"{poses[-1].strength.stress_Pa / 1e6:.4g}"}
    assert poses[-1].view(tmp_path / "one.html").exists()


def test_corners_are_those_of_the_sheets_and_stress_the_largest_of_the_section(poses):
    shape = poses[-1].shape(points=17)
    corners = sheet_corners(shape).reshape(2, -1, 4, 3)
    for leaf, own in zip(shape.leaves, corners, strict=True):
        assert own.mean(axis=1) == pytest.approx(leaf.place)
        assert np.linalg.norm(own[:, 0] - own[:, 1], axis=1) == pytest.approx(leaf.thickness)
        assert np.linalg.norm(own[:, 1] - own[:, 2], axis=1) == pytest.approx(leaf.width)
    along, largest = station_stress(poses[-1], shape)
    assert along.max() == max(largest.values()) == pytest.approx(poses[-1].strength.stress_Pa, rel=1e-3)


def test_wrong_words(poses, tmp_path):
    other = ksd.solve(*ksd.load_scene(shipped_scenes()["gripper"])[:2])
    for given, sentence in (([], "no poses"), ([poses[0], other], "several mechanisms")):
        with pytest.raises(SceneError, match=sentence):
            ksd.view.write_page(given, tmp_path / "a.html")
    with pytest.raises(SceneError, match="1 names for 3 poses"):
        ksd.view.write_page(poses, tmp_path / "a.html", names=["start"])
    with pytest.raises(SceneError, match=r"as \.html"):
        ksd.view.write_page(poses, tmp_path / "a.txt")
