"""Input of CalculiX: solids by ccx with nu = 0 against ours; what the deck cannot say."""

import shutil

import pytest

import ksd
from ksd.cli import main
from ksd.export import confirm
from ksd.export.calculix import Mesh
from ksd.export.calculix_run import twist_text
from ksd.units import GPa, deg, mm

STEEL = ksd.Material(E=200 * GPa, nu=0.0, density=7800)
needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="needs CalculiX: apt-get install calculix-ccx"
)


def guide(along="x", **load):
    m = ksd.Mechanism("guide")
    table = m.link("table", mass=0.5, at=(0, 0.08, 0))
    for x in (-0.03, 0.03):
        m.leaf(
            "ground", table, start=(x, 0, 0), end=(x, 0.06, 0), section=ksd.rectangle(0.3 * mm, 20 * mm),
            material=STEEL, width_axis="z", name=f"leaf {x}",
        )  # fmt: skip
    m.actuate(table, along=along, at=(0, 0.03, 0), name="d")
    if load:
        m.load(table, at=(0.01, 0.07, 0), name="push", **load)
    return m


def cross_flexure():
    joint = ksd.CrossFlexure(STEEL, length=0.1, angle=45 * deg, thickness=0.5 * mm, widths=(20 * mm, 10 * mm))
    m = ksd.Mechanism("cross")
    tip = m.link("tip")
    m.join(m.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    m.actuate(tip, about="z", name="d")
    return m


def loaded():
    m = guide(force=(1, -5, 0))
    m.gravity = (0, -9.81, 0)
    return m


@needs_ccx
@pytest.mark.parametrize(
    ("scene", "value"),
    [(guide((1, 0.02, 0)), 3 * mm), (cross_flexure(), 10 * deg), (loaded(), 1 * mm)],
)
def test_solids_give_the_same_forces_and_positions(scene, value):
    found = confirm(ksd.solve(scene, d=value, method="conventional"), mesh=Mesh(8, 1, end=5.0))
    assert abs(found.relative_force("d")) < 1e-4
    assert all(found.distance(link) < 1e-4 * found.stroke for link in found.displacements)


@needs_ccx
def test_twist_stretches_edges():
    """What the law of thin sheets foretells is what solids have more than restrained warping."""
    m = ksd.Mechanism("twist")
    tip = m.link("tip")
    words = {"section": ksd.rectangle(0.3 * mm, 18 * mm), "material": STEEL, "width_axis": "z"}
    m.leaf(m.ground, tip, start=(0, 0, 0), end=(50 * mm, 0, 0), name="sheet", **words)
    m.actuate(tip, about="x", name="d")
    pose = ksd.solve(m, d=0.1, method="conventional", with_=("warping",))
    assert confirm(pose, mesh=Mesh(8, 1, end=2.0)).relative_force("d") == pytest.approx(0.078, abs=0.01)
    assert "by up to 7.8 % stiffer in torsion (leaf 'sheet', twisted by 5.7 degrees)" in twist_text(pose)


@needs_ccx
def test_restrained_warping_where_the_torque_changes():
    """A bent sheet under a force across its width: the torque is largest at the clamp; without warping 35 % softer."""
    m = ksd.Mechanism("bent")
    tip, end = m.link("tip"), (50 * mm, 0, 0)
    words = {"section": ksd.rectangle(0.3 * mm, 18 * mm), "material": STEEL, "width_axis": "z"}
    m.leaf(m.ground, tip, start=(0, 0, 0), end=end, **words)
    m.actuate(tip, about="z", name="d")
    m.load(tip, force=(0, 0, 0.5), at=end)
    poses = [ksd.solve(m, d=0.15, method="conventional", with_=w) for w in ((), ("warping",))]
    plain, ours = (pose.displacement("tip", at=end)[2] for pose in poses)
    _, solids = confirm(poses[1], mesh=Mesh(16, 1, end=2.0)).displacements["tip"]
    assert solids[2] == pytest.approx(ours, rel=0.01) and plain / ours > 1.35


def test_a_program_that_is_ended_or_gives_no_answer_is_named(tmp_path, monkeypatch):
    program = tmp_path / "ccx"
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    pose = ksd.solve(guide(), d=1 * mm)
    cases = {
        "kill -9 $$": "ended from outside .signal 9.",
        "echo '*ERROR no'": "no answer .*ERROR no.; drive",
    }
    for does, said in cases.items():
        program.write_text(f"#!/bin/sh\n{does}\n")
        program.chmod(0o755)
        with pytest.raises(ksd.ConvergenceError, match=said):
            confirm(pose)


@needs_ccx
def test_the_command_prints_both(tmp_path, capsys):
    ksd.save_scene(guide(), tmp_path / "g.toml", targets={"d": 1 * mm})
    assert main(["confirm", str(tmp_path / "g.toml")]) == 0
    text = capsys.readouterr().out
    assert "force of d:" in text and "position of table:" in text


def test_the_command_exports_and_ccx_may_be_missing(tmp_path, capsys, monkeypatch):
    ksd.save_scene(guide(), tmp_path / "g.toml", targets={"d": 1 * mm})
    assert main(["export", str(tmp_path / "g.toml"), "--to", "calculix"]) == 0
    assert "*RIGID BODY" in (tmp_path / "g.inp").read_text()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["confirm", str(tmp_path / "g.toml")]) == 2
    assert "apt-get install calculix-ccx" in capsys.readouterr().err


def spring(m):
    m.spring(
        "ground", "table", start=(0, 0, 0), end=(0, 0.1, 0), stiffness=10.0, free_length=0.1, name="coil"
    )


def wire(m):
    m.wire(
        "ground", "table", start=(0, 0, 0), end=(0, 0.06, 0), diameter=1 * mm, material=STEEL, name="round"
    )


@pytest.mark.parametrize(
    ("add", "sentence"),
    [
        (spring, "spring 'coil' is not written"),
        (wire, "leaf 'round' is no sheet"),
        (
            lambda m: m.load("table", force=(0, 1, 0), at=(0, 0, 0), following=True, name="f"),
            "load 'f' turns with",
        ),
        (lambda m: m.support("table", about=(0, 1, 1), name="skew"), "'skew' is a rotation about"),
    ],
)
def test_what_the_deck_cannot_say_is_refused_by_name(add, sentence, tmp_path):
    m = guide()
    add(m)
    pose = ksd.solve(m, d=1 * mm, method="conventional", strict=False)
    with pytest.raises(ksd.SceneError, match=sentence):
        pose.export(tmp_path / "a.inp")
