"""Input of SPACAR Light, saved by GNU Octave (spacar/make.m): the answers of the same mechanisms made in Python."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import ksd
from ksd.cli import main
from ksd.importing import read_spacar

FILES = Path(__file__).parent / "spacar"
ROUNDING = 1e-9


def loaded(name, tmp_path):
    path = tmp_path / f"{name}.toml"
    path.write_text(read_spacar(FILES / f"{name}.mat"))
    mechanism, targets, _ = ksd.load_scene(path)
    return mechanism, targets


def test_guide_of_the_page(tmp_path):
    L, W = 0.1, 0.05
    guide = ksd.Mechanism("guide")
    block = guide.link("block")
    words = {
        "section": ksd.rectangle(0.5e-3, 50e-3),
        "material": ksd.Material(E=210e9, G=79e9, density=7800),
        "width_axis": "z",
    }
    guide.leaf("ground", block, start=(0, 0, 0), end=(0, L, 0), **words)
    guide.leaf("ground", block, start=(W, 0, 0), end=(W, L, 0), **words)
    mass, sides = 2700 * 50e-3 * 25e-3 * W, np.array([W, 25e-3, 50e-3])
    guide.mass(block, mass=mass, at=(W / 2, L, 0), inertia=mass / 12 * (np.sum(sides**2) - sides**2))
    guide.actuate(block, along="x", at=(0, L, 0), name="stroke")
    pose = ksd.solve(guide, stroke=10e-3)
    mechanism, targets = loaded("guide", tmp_path)
    same = ksd.solve(mechanism, targets)
    assert same.forces["displ_x 2"] == pytest.approx(pose.forces["stroke"], rel=ROUNDING)
    assert same.frequencies(count=3).frequency_Hz == pytest.approx(
        pose.frequencies(count=3).frequency_Hz, rel=1e-7
    )


def test_cross_hinge_with_rigid_elements_loads_gravity_and_warping(tmp_path):
    m, h = ksd.Mechanism("cross"), 0.02
    arm = m.link("arm")
    m.gravity = (0, -9.81, 0)
    m.consider("warping")
    words = {
        "section": ksd.rectangle(0.4e-3, 10e-3),
        "material": ksd.Material(E=70e9, G=26e9, density=2700),
        "width_axis": "z",
    }
    m.leaf("ground", arm, start=(0, 0, 0), end=(0.06, 0.06, 0), **words)
    m.leaf("ground", arm, start=(0.06, 0, h), end=(0, 0.06, h), **words)
    tip = (0.03, 0.1, h / 2)
    m.load(arm, force=(1, 0, 0), moment=(0, 0, 0.2), at=tip)
    m.mass(arm, mass=0.3, at=tip, inertia=[[1e-4, 2e-5, 0], [2e-5, 2e-4, 0], [0, 0, 3e-4]])
    pose = ksd.solve(m)
    mechanism, targets = loaded("cross", tmp_path)
    assert not targets
    same = ksd.solve(mechanism)
    moved = pose.displacement("arm", tip)
    assert np.linalg.norm(moved) > 1e-3
    assert same.displacement("nodes 2 4 5", tip) == pytest.approx(moved, rel=ROUNDING, abs=1e-12)
    assert same.frequencies(count=1).frequency_Hz == pytest.approx(
        pose.frequencies(count=1).frequency_Hz, rel=1e-7
    )


def test_cartwheel_and_what_has_no_counterpart(tmp_path):
    m = ksd.Mechanism("wheel")
    hub, top = m.links("hub", "top")
    words = {
        "section": ksd.rectangle(0.3e-3, 20e-3),
        "material": ksd.Material(E=200e9, G=77e9),
        "width_axis": "z",
    }
    for x in (-0.02, 0.02):
        m.leaf("ground", hub, start=(x, -0.03, 0), end=(0, 0, 0), **words)
        m.leaf(hub, top, start=(0, 0, 0), end=(x, 0.03, 0), **words)
    m.actuate(top, about="z", name="turn")
    mechanism, targets = loaded("cartwheel", tmp_path)
    assert targets == {"rot_z 6": pytest.approx(0.15)}
    same = ksd.solve(mechanism, targets)
    assert same.forces["rot_z 6"] == pytest.approx(ksd.solve(m, turn=0.15).forces["turn"], rel=ROUNDING)
    text = (tmp_path / "cartwheel.toml").read_text()
    assert "# nprops(6).transfer_in has no counterpart" in text and "# opt.rls has no counterpart" in text


def test_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "--from", str(FILES / "guide.mat")]) == 0
    assert "ksd doctor guide.toml" in capsys.readouterr().out
    mechanism, targets, _ = ksd.load_scene("guide.toml")
    assert mechanism.name == "guide" and targets == {"displ_x 2": 0.01}
    source = ["--from", str(FILES / "guide.mat")]
    for words, said in (
        (["other", *source, "--unit", "mm"], "--unit is for drawings"),
        (["other", "--from", "guide.toml"], "a drawing (.dxf) or input of SPACAR Light (.mat)"),
        ([], "give the NAME"),
        (["other", "--like", "pivot", "--from", "a.dxf"], "exclude each other"),
        (source, "is there already"),
    ):
        assert main(["new", *words]) == 2 and said in capsys.readouterr().err


GOOD = {
    "nodes": np.array([[0, 0, 0], [0, 0.1, 0.0]]),
    "elements": np.array([[1, 2]]),
    "eprops": [
        {
            "elems": 1, "emod": 2e11, "smod": 8e10, "cshape": "rect", "dim": [0.02, 1e-3], "orien": [0, 0, 1],
            "flex": [1, 2, 3, 4, 5, 6],
        }
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"nodes": None}, "no variable 'nodes'"),
        ({"nodes": np.zeros((2, 2))}, "nodes must be a table of finite numbers with 3 columns"),
        ({"nodes": np.array([[0, 0, 0], [0, np.nan, 0]])}, "nodes must be a table of finite"),
        ({"nodes": np.array([[0, 0, 0], [0, 1e300, 0]])}, "lengths are in m"),
        ({"nodes": np.array([[0, 0, 0], [0, 1j, 0]])}, "nodes must be a table of finite"),
        ({"nodes": np.zeros((100_000, 3))}, "100000 rows, more than the 2000"),
        ({"elements": np.array([[1, 3]])}, "whole numbers from 1 to 2"),
        ({"elements": np.array([[1.5, 2]])}, "whole numbers from 1 to 2"),
        ({"eprops": []}, "no element with `flex`"),
        ({"eprops": [{"emod": 1.0}]}, "eprops(1) has no elems"),
        ({"eprops": [GOOD["eprops"][0], {"elems": 1}]}, "element 1 is in two sets"),
        ({"eprops": [{**GOOD["eprops"][0], "cshape": "tube"}]}, "'rect' or 'circ'"),
        ({"eprops": [{**GOOD["eprops"][0], "dim": [1e-3]}]}, "eprops(1).dim must be 2 numbers"),
        ({"eprops": [{**GOOD["eprops"][0], "orien": [0, 1, 0]}]}, "orien lies along element 1"),
        ({"eprops": [{**GOOD["eprops"][0], "emod": -1.0}]}, "gives no scene"),
        ({"nprops": [{"fix": 1}] * 3}, "nprops has 3 entries for 2 nodes"),
        ({"nprops": [{"fix": 1}, {"force": [1.0, 2.0]}]}, "nprops(2).force must be 3 numbers"),
    ],
)
def test_bad_input_is_one_sentence(changes, said, tmp_path):
    words = {key: value for key, value in (GOOD | changes).items() if value is not None}
    for key in ("eprops", "nprops"):
        if key in words:
            names = sorted({name for one in words[key] for name in one}) or ["elems"]
            rows = [tuple(np.asarray(one.get(name, np.zeros(0)) if not isinstance(one.get(name), str) else one[name])
                          for name in names) for one in words[key]]  # fmt: skip
            words[key] = np.array(rows, dtype=[(name, object) for name in names])
    savemat(tmp_path / "bad.mat", words, do_compression=True)
    with pytest.raises(ksd.SceneError, match=r"bad\.mat") as caught:
        read_spacar(tmp_path / "bad.mat")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [b"", b"\x00\x01\x02" * 999, b"nodes = [0 0 0];\n", b"MATLAB 5.0 MAT-file" + b" " * 200],
)
def test_files_that_are_none(content, tmp_path):
    path = tmp_path / "Führung.mat"
    path.write_bytes(content)
    with pytest.raises(
        ksd.SceneError, match=r"Führung.mat cannot be read as a MAT file of version 7"
    ) as caught:
        read_spacar(path)
    assert "save -v7" in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(ksd.SceneError, match="does not exist"):
        read_spacar(tmp_path / "none.mat")


def test_damage_and_versions_without_check_sums(tmp_path):
    """Of version 7.3, as MATLAB begins it; of 6 and 4, in which scipy does not see damage; damaged at every place."""
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    (tmp_path / "new.mat").write_bytes(head.ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n")
    words = {key: GOOD[key] for key in ("nodes", "elements")}
    savemat(tmp_path / "six.mat", words)
    savemat(tmp_path / "four.mat", words, format="4")
    for name, said in (
        ("new", "it is one of version 7.3"),
        ("six", "version 6"),
        ("four", "not begin like one"),
    ):
        with pytest.raises(ksd.SceneError, match=said):
            read_spacar(tmp_path / f"{name}.mat")
    whole = (FILES / "cross.mat").read_bytes()
    for at in range(126, len(whole), 37):
        (tmp_path / "a.mat").write_bytes(whole[:at] + bytes([whole[at] ^ 0x15]) + whole[at + 1 :])
        with pytest.raises(ksd.SceneError, match=r"a\.mat cannot be read"):
            read_spacar(tmp_path / "a.mat")
