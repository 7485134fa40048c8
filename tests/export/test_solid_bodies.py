"""Bodies: closed surfaces, volumes against closed forms, files read again by trimesh and gmsh."""

import os
import subprocess
import sys

import numpy as np
import pytest
from processes import environment

import ksd
from ksd.cli import main
from ksd.export import write_bodies
from ksd.export.solids import STEP_STATIONS, _step_solid, bodies_of, start_gmsh
from ksd.scene.toml_file import shipped_scenes
from ksd.units import mm

STEEL = ksd.Material(E=200e9, G=77e9, density=7800)
trimesh = pytest.importorskip("trimesh", reason="what is written is read by trimesh: pip install 'ksd[test]'")


def stage():
    """A sheet, a wire, a tapered sheet and an arc of 90 degrees, all from ground to a table."""
    m = ksd.Mechanism("stage")
    table = m.link("tisch <ä>")
    words = {"width_axis": "z", "material": STEEL}
    own = {"start": (0, 0, 0), "end": (0, 0.05, 0), "section": ksd.rectangle(0.3e-3, 0.02)}
    m.leaf("ground", table, name="sheet", **own, **words)
    own = {"start": (0.03, 0, 0), "end": (0.03, 0.05, 0), "section": ksd.circle(1e-3)}
    m.leaf("ground", table, material=STEEL, name="wire", **own)
    taper = ksd.Taper(thickness=(0.3 * mm, 0.6 * mm), width=(20 * mm, 10 * mm))
    own = {"start": (0.06, 0, 0), "end": (0.06, 0.05, 0), "section": ksd.rectangle(4e-4, 0.015)}
    m.leaf("ground", table, profile=taper, name="taper", **own, **words)
    arc = ksd.Arc(radius=0.03, angle=np.pi / 2)
    own = {"start": (0.09, 0, 0), "end": (0.12, 0.03, 0), "section": ksd.rectangle(4e-4, 0.015)}
    m.leaf("ground", table, curve=arc, name="arc", **own, **words)
    m.actuate(table, along="x", at=(0.03, 0.05, 0), name="d")
    return m


@pytest.fixture(scope="module")
def pose():
    return ksd.solve(stage(), d=2 * mm)


def test_volumes_are_those_of_closed_forms(pose):
    found = {b.name: b.volume for b in bodies_of(pose, False, 97) if "idea" not in b.name}
    ends = 0.3e-3 * 0.02 + 0.6e-3 * 0.01 + 0.5 * (0.3e-3 * 0.01 + 0.6e-3 * 0.02)
    assert found["sheet"] == pytest.approx(0.3e-3 * 0.02 * 0.05, rel=1e-9)
    assert found["wire"] == pytest.approx(np.pi / 4 * 1e-6 * 0.05, rel=1e-9)
    assert found["taper"] == pytest.approx(0.05 * ends / 3, rel=1e-4)
    # chords between stations: a turn of 90 degrees over 96 of them
    assert found["arc"] == pytest.approx(4e-4 * 0.015 * 0.03 * np.pi / 2, rel=2 * (np.pi / 2 / 96) ** 2)
    bent = {b.name: b.volume for b in bodies_of(pose, True, 97)}
    rest = {b.name: b.volume for b in bodies_of(pose, False, 97)}
    # what is a link does not deform
    assert all(bent[n] == pytest.approx(v, rel=1e-9 if "idea" in n else 1e-3) for n, v in rest.items())


@pytest.mark.parametrize("deformed", [True, False])
@pytest.mark.parametrize("kind", ["stl", "3mf"])
def test_meshes_are_watertight_with_the_volume_of_sheets_and_links(kind, deformed, pose, tmp_path):
    bodies = list(bodies_of(pose, deformed, 97))
    path = write_bodies(pose, tmp_path / f"a.{kind}", deformed=deformed)
    pytest.importorskip("lxml", reason="trimesh reads 3MF with lxml")
    meshes = trimesh.load_scene(path).geometry
    assert len(meshes) == len(bodies) and all(mesh.is_watertight for mesh in meshes.values())
    total = sum(mesh.volume for mesh in meshes.values())
    assert total == pytest.approx(1e9 * sum(body.volume for body in bodies), rel=1e-6)
    names = " ".join(meshes)
    assert "sheet" in names and "tisch <ä> (its form is an idea)" in names
    tip = pose.displacement("tisch <ä>", (0.0, 0.05, 0)) if deformed else np.zeros(3)
    sheet = next(mesh for name, mesh in meshes.items() if "sheet" in name)
    end = sheet.vertices[np.argsort(sheet.vertices[:, 1])[-4:]].mean(axis=0)
    assert end == pytest.approx(1e3 * (np.array([0.0, 0.05, 0]) + tip), abs=1e-6)


@pytest.mark.parametrize("deformed", [True, False])
def test_step_is_one_body_with_the_volume_that_was_fused(deformed, pose, tmp_path, capfd):
    gmsh = _gmsh()
    start_gmsh(gmsh)
    with pytest.raises(ksd.SceneError, match="gmsh is in use in this process"):
        write_bodies(pose, tmp_path / "a.step")
    gmsh.finalize()
    path = write_bodies(pose, tmp_path / "a.step", deformed=deformed)
    assert not capfd.readouterr().out
    start_gmsh(gmsh)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        fused = _fused(gmsh.model.occ, bodies_of(pose, deformed, STEP_STATIONS))
        gmsh.model.occ.remove(gmsh.model.occ.getEntities(3), recursive=True)
        solids = [tag for tag in gmsh.model.occ.importShapes(str(path)) if tag[0] == 3]
        volume = sum(gmsh.model.occ.getMass(*tag) for tag in solids)
    finally:
        gmsh.finalize()
    assert volume == pytest.approx(fused, rel=1e-9)
    bodies = list(bodies_of(pose, deformed, 97))
    leaves = 1e9 * sum(b.volume for b in bodies if "idea" not in b.name)
    everything = 1e9 * sum(b.volume for b in bodies)
    # sheets go on inside of links, and parts of a link lie in one another
    assert len(solids) == 1 and leaves < volume < everything
    assert "sheet; wire; taper; arc; ground (its form is an idea)" in "".join(
        path.read_text().split("\n")[:9]
    )


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
@pytest.mark.parametrize("thread", [False, True])
def test_after_a_step_file_a_broken_pipe_is_still_an_exception(thread):
    """gmsh has the signal end the process without a word: after an export one that is gone would have ended ours."""
    _gmsh()
    code = (
        "import os, threading; import gmsh; from ksd.export.solids import start_gmsh\n"
        f"if {thread}:\n    one = threading.Thread(target=start_gmsh, args=(gmsh,)); one.start(); one.join()\n"
        "else:\n    start_gmsh(gmsh)\n"
        "gmsh.finalize(); read, write = os.pipe(); os.close(read)\n"
        "try:\n    os.write(write, b'1')\nexcept BrokenPipeError:\n    print('an exception')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environment()
    )
    assert (done.returncode, done.stdout.strip().split("\n")[-1]) == (0, "an exception"), done.stderr


def _fused(occ, bodies):
    """Volume of the bodies fused in memory [mm^3]."""
    first, *others = [(3, _step_solid(occ, body)) for body in bodies]
    return sum(occ.getMass(*tag) for tag in occ.fuse([first], others)[0])


def _gmsh():
    try:
        import gmsh
    except (ImportError, OSError) as reason:
        pytest.skip(f"STEP needs gmsh and its libraries: {reason}")
    return gmsh


@pytest.mark.parametrize(
    ("name", "words", "said"),
    [
        ("a.obj", {}, "bodies are written to .stl, .3mf, .step, .stp"),
        ("no folder/a.stl", {}, "does not exist"),
        ("a.stl", {"points": 1}, "points = 1"),
        ("a.stl", {"deformed": "yes"}, "deformed"),
        ("a.stl", {"size": 1}, "size"),
    ],
)
def test_wrong_words(name, words, said, pose, tmp_path):
    with pytest.raises(ksd.SceneError, match=said):
        write_bodies(pose, tmp_path / name, **words)
    assert not list(tmp_path.iterdir())


def test_pose_and_command(pose, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert pose.export("b.stl", points=5).stat().st_size > 1000
    assert pose.export("b.vtu").read_text().startswith("<?xml")
    with pytest.raises(ksd.SceneError, match=r"'b.xyz': files end in .dxf, .vtu, .inp, .stl"):
        pose.export("b.xyz")
    with pytest.raises(ksd.SceneError, match=r"export: deformed says nothing of a file .dxf"):
        pose.export("b.dxf", deformed=False)
    scene = str(shipped_scenes()["guide"])
    for words in (["--to", "stl"], ["--out", "c.3mf", "--undeformed"], ["--to", "vtu", "--set", "table=1mm"]):
        out = [] if "--out" in words else ["--out", f"c.{words[1]}"]
        assert main(["export", scene, *words, *out]) == 0
    assert "c.3mf: written" in capsys.readouterr().out
    assert len(trimesh.load_scene("c.stl").geometry) > 4


def test_without_the_package(pose, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "gmsh", None)
    with pytest.raises(ksd.SceneError, match=r"STEP needs the package gmsh: pip install 'ksd\[cad\]'"):
        pose.export(tmp_path / "a.step")
