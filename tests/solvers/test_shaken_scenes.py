"""Shipped scenes shaken along every axis: finite, reciprocal, and the effective masses of their modes are what moves."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

import ksd
from ksd.scene.toml_file import scene_from_tables, shipped_scenes


def with_masses(name):
    """A shipped scene with a mass on every link and sensors on the last one, its leaf springs without mass."""
    path = Path(str(shipped_scenes()[name]))
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    for material in tables["material"].values():
        material.pop("density", None)
    tables.pop("mass", None)
    scene, targets, _ = scene_from_tables(tables, path)
    links = scene.scene().links[1:]
    for k, link in enumerate(links):
        at = next(j.origin for j in scene.scene().joints if link in (j.a, j.b))
        scene.mass(link, mass=0.1 * (k + 1), inertia=(2e-4, 3e-4, 4e-4), at=at)
    axes = scene.scene().plane or "xyz"
    for axis in axes:
        scene.sensor(links[-1], along=axis, at=at, name=f"seen {axis}")
    return scene, targets, axes, 0.05 * len(links) * (len(links) + 1)


@pytest.mark.parametrize("name", ["delta_stage", "rrr_stage", "arm", "gripper"])
def test_shipped_scenes_shaken_along_every_axis(name):
    scene, targets, axes, moving = with_masses(name)
    pose = ksd.solve(scene, targets)
    drives = list(pose.model.drive_names)
    modes = pose.frequencies(count=6 * len(scene.scene().links), freed=drives)
    assert modes.effective_mass.sum(axis=0) == pytest.approx(np.full(3, moving), rel=1e-9)
    words = {"inputs": [*drives, *(f"base {a}" for a in axes)], "freed": drives}
    found = pose.response(np.geomspace(0.5, 500, 9), outputs=[*drives, *(f"seen {a}" for a in axes)], **words)
    assert np.isfinite(found.value).all() and np.abs(found.value).min(axis=(0, 1)).min() > 0.0
    own = found.value[:, : len(drives), : len(drives)]
    assert np.abs(own - own.swapaxes(1, 2)).max() < 1e-10 * np.abs(own).max()
