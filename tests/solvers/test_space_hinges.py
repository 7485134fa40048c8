"""Ball joints, cylindrical hinges and leaf springs with both ends on one link, against closed forms and all methods."""

import math

import numpy as np
import pytest

import ksd

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800, expansion=12e-6)
BLADE = ksd.rectangle(1e-3, 10e-3)
L = 0.2
EI = STEEL.E * BLADE.Iz


def rod(spin=True):
    """A cantilever whose tip stands on a rod with a ball at both ends."""
    scene = ksd.Mechanism("rod")
    tip, strut = scene.links("tip", "rod")
    scene.leaf(
        "ground",
        tip,
        start=(0, 0, 0),
        end=(0.1, 0, 0),
        width_axis="z",
        section=BLADE,
        material=STEEL,
        name="beam",
    )
    scene.ball(tip, strut, at=(0.1, 0, 0), name="A")
    scene.ball("ground", strut, at=(0.1, 0.05, 0.03), name="B")
    if spin:
        scene.support(strut, about=(0, 0.05, 0.03), name="spin")
    scene.load(tip, force=(0, -30, 5), at=(0.1, 0, 0))
    return scene


def test_a_rod_between_balls_keeps_its_length_and_carries_a_force_along_it():
    pose = ksd.solve(rod())
    assert pose.trusted
    arm = np.array([0.1, 0.05, 0.03]) - np.array([0.1, 0, 0]) - pose.displacement("tip")
    assert np.linalg.norm(arm) == pytest.approx(math.hypot(0.05, 0.03), rel=1e-9)
    force = np.array([pose.reactions[f"B.{n}"] for n in "xyz"])
    assert np.linalg.norm(np.cross(force, arm)) < 1e-9 * np.linalg.norm(force) * np.linalg.norm(arm) + 1e-12
    rows = {(row.name, row.link): row for row in pose.interface_forces().rows}
    assert rows["A", "rod"].force == pytest.approx(-rows["B", "rod"].force, abs=1e-9)
    assert np.abs(rows["A", "rod"].moment).max() < 1e-12
    # the beam and the rod hold the load
    assert rows["beam", "tip"].force + rows["A", "tip"].force == pytest.approx([0, 30, -5], abs=1e-6)


def test_what_is_free_of_a_rod_between_balls_is_told():
    free = ksd.doctor(rod(spin=False)).free
    assert [f for f in free if f.stiffness < 1e-6 and "'rod' can turn" in f.sentence]


def cylinder(axis=(0, 0, 1), plane=None, kind="cylindrical"):
    """A link on a cylindrical hinge that a leaf holds, its end loaded along and about the axis."""
    scene = ksd.Mechanism("cylinder", plane=plane)
    drum = scene.link("drum")
    getattr(scene, kind)("ground", drum, at=(0, 0, 0), name="C", **({} if kind == "ball" else {"axis": axis}))
    scene.leaf(
        "ground", drum, start=(0.01, 0, 0), end=(0.11, 0, 0), width_axis="z", section=BLADE, material=STEEL
    )
    return scene


def test_a_cylindrical_hinge_turns_and_slides():
    """The hinge has no moment about its axis and no force along it; what it holds is that of a pin."""
    scene = cylinder(axis="x")
    scene.actuate("drum", about="x", at=(0, 0, 0), name="turn")
    scene.actuate("drum", along="x", at=(0, 0, 0), name="slide")
    pose = ksd.solve(scene, turn=0.2, slide=-1e-5)
    assert pose.links["drum"][0][1:] == pytest.approx([0, 0], abs=1e-12)
    assert pose.rotation("drum") == pytest.approx([0.2, 0, 0], abs=1e-12)
    # Saint-Venant's torsion with the shortening of a twisted blade, which the slide here outweighs
    assert pose.forces["turn"] == pytest.approx(0.2 * STEEL.G * BLADE.J / 0.1, rel=2e-2)
    assert set(pose.reactions) == {"C.y", "C.z", "C.ry", "C.rz"}
    assert {f.sentence for f in ksd.doctor(scene).free} == set()


@pytest.mark.parametrize(
    "kind, axis, same", [("ball", None, "pin"), ("cylindrical", "z", "pin"), ("cylindrical", "y", "slider")]
)
def test_in_a_plane_they_are_pins_and_sliders(kind, axis, same):
    def solved(made):
        made.load("drum", force=(3, 4, 0), moment=(0, 0, 0.1), at=(0, 0.02, 0))
        return ksd.solve(made)

    plain = ksd.Mechanism("cylinder", plane="xy")
    drum = plain.link("drum")
    if same == "pin":
        plain.pin("ground", drum, at=(0, 0, 0), name="C")
    else:
        plain.slider(drum, along=axis, at=(0, 0, 0), name="C")
    plain.leaf("ground", drum, start=(0.01, 0, 0), end=(0.11, 0, 0), section=BLADE, material=STEEL)
    one, other = solved(plain), solved(cylinder(axis=axis, plane="xy", kind=kind))
    assert other.displacement("drum") == pytest.approx(one.displacement("drum"), abs=1e-12)
    assert other.reactions == pytest.approx(one.reactions, rel=1e-9, abs=1e-9)


def test_wrong_words_of_hinges():
    scene = cylinder()
    with pytest.raises(ksd.SceneError, match=r"ball: .*'axis'"):
        scene.ball("ground", "drum", at=(0, 0, 0), axis="z")
    with pytest.raises(ksd.SceneError, match=r"cylindrical: .*axis"):
        scene.cylindrical("ground", "drum", at=(0, 0, 0))
    with pytest.raises(ksd.SceneError, match=r"ball 'b': 'at' is missing"):
        scene.ball("ground", "drum", name="b")
    with pytest.raises(ksd.SceneError, match=r"ball 'drum-drum' connects link 'drum' with itself"):
        scene.ball("drum", "drum", at=(0, 0, 0))
    with pytest.raises(ksd.SceneError, match=r"cylindrical 'C': axis = .* leaves the plane xy"):
        cylinder(axis=(0, 1, 1), plane="xy")
    with pytest.raises(ksd.UnknownWordError, match=r"say mechanism.ball"):
        scene.spherical("ground", "drum")


def test_files_and_pictures_hold_them(tmp_path):
    scene = rod()
    drum = scene.link("drum")
    scene.cylindrical("tip", drum, at=(0.1, 0, 0), axis=(0, 0.6, 0.8), name="C")
    scene.leaf(
        "tip", drum, start=(0.1, 0, 0), end=(0.1, 0.05, 0), width_axis="z", section=BLADE, material=STEEL
    )
    scene.leaf(
        "ground",
        "ground",
        start=(0, 0.1, 0),
        end=(0.1, 0.1, 0),
        width_axis="z",
        section=BLADE,
        material=STEEL,
        name="string",
    )
    ksd.save_scene(scene, tmp_path / "scene.toml")
    read = ksd.load_scene(tmp_path / "scene.toml")[0].scene()
    assert read == scene.scene()
    assert [h.kind for h in read.hinges] == ["ball", "ball", "cylindrical"]
    pose = ksd.solve(scene)
    assert {h.name for h in pose.shape().hinges} == {"A", "B", "C"}
    pose.plot(tmp_path / "scene.png")
    assert "cylindrical" in str(scene) and "ball" in str(scene)


def string(marks=(), on="ground"):
    """A blade clamped at both ends to one link, with points at fractions of its length; the link may stand on a post."""
    scene = ksd.Mechanism("string")
    if on != "ground":
        scene.link(on)
        scene.leaf(
            "ground",
            on,
            start=(0, -0.1, 0),
            end=(0, 0, 0),
            width_axis="z",
            section=BLADE,
            material=STEEL,
            name="post",
        )
    scene.leaf(
        on, on, start=(0, 0, 0), end=(L, 0, 0), width_axis="z", section=BLADE, material=STEEL, name="s"
    )
    for k, s in enumerate(marks):
        scene.point("s", s * L, name=f"p{k}")
    return scene


def test_a_blade_between_two_points_of_ground():
    """Clamped at both ends: middle force, own weight, first frequency, thermal force and critical heat."""
    scene = string((0.5,))
    scene.load("p0", force=(0, 1e-3, 0))
    pose = ksd.solve(scene)
    shear = 1e-3 * L / (4 * BLADE.ky * STEEL.G * BLADE.A)
    assert pose.displacement("p0")[1] == pytest.approx(1e-3 * L**3 / (192 * EI) + shear, rel=1e-6)
    ends = [row.force for row in pose.interface_forces().rows if row.name == "s"]
    assert np.sum(ends, axis=0) == pytest.approx([0, 1e-3, 0], abs=1e-9)

    heavy = string()
    heavy.gravity = (0, -9.81, 0)
    pose = ksd.solve(heavy)
    line = STEEL.density * BLADE.A
    assert pose.displacement("s middle")[1] == pytest.approx(-line * 9.81 * L**4 / (384 * EI), rel=1e-3)
    first = 22.3733 / (2 * math.pi) * math.sqrt(EI / (line * L**4))
    assert pose.frequencies().frequency_Hz[0] == pytest.approx(first, rel=1e-3)

    critical = 4 * math.pi**2 * BLADE.Iz / (BLADE.A * L**2 * STEEL.expansion)
    for share, holds in ((0.98, True), (1.02, False)):
        hot = string()
        hot.heat(share * critical)
        if holds:
            (one, _) = (row.force for row in ksd.solve(hot).interface_forces().rows if row.name == "s")
            strain = STEEL.expansion * share * critical
            assert abs(one[0]) == pytest.approx(STEEL.E * BLADE.A * strain / (1 + strain), rel=1e-6)
        else:
            with pytest.raises(ksd.TrustError, match="UNSTABLE"):
                ksd.solve(hot)


@pytest.mark.parametrize("mesh", [ksd.Mesh(), ksd.Mesh("corotational", elements=6)])
def test_it_does_nothing_to_the_link_that_carries_it(mesh):
    """A string without load on a moving link: the link moves as without it, the string with the link."""
    bare, with_string = ksd.Mechanism("bare"), string(on="stage")
    bare.link("stage")
    bare.leaf(
        "ground",
        "stage",
        start=(0, -0.1, 0),
        end=(0, 0, 0),
        width_axis="z",
        section=BLADE,
        material=STEEL,
        name="post",
    )
    for scene in (bare, with_string):
        scene.actuate("stage", along="x", at=(0, 0, 0), name="d")
    one, other = (ksd.solve(scene, d=0.02, mesh=mesh, method="conventional") for scene in (bare, with_string))
    assert other.forces["d"] == pytest.approx(one.forces["d"], rel=1e-9)
    middle = one.displacement("stage", at=(L / 2, 0, 0))
    assert other.displacement("s middle") == pytest.approx(middle, abs=1e-9)
    assert other.verify().relative < (1e-5 if mesh.leaf == "strain" else 1e-3)


@pytest.mark.parametrize("method", ["kinematic", "reduced", "full", "conventional"])
def test_methods_with_records_know_it(method):
    """A guide that carries a string: its force and motion are those without."""
    found = []
    for strung in (False, True):
        scene = ksd.Mechanism("guide")
        stage = scene.link("stage")
        guide = ksd.ParallelGuide(STEEL, length=0.1, thickness=0.5e-3, width=0.03, spacing=0.05)
        scene.join("ground", stage, guide, at=(0, 0, 0), axis="z", toward="x", name="g")
        if strung:
            scene.leaf(
                stage,
                stage,
                start=(0.1, 0, 0),
                end=(0.1, 0.04, 0),
                width_axis="z",
                section=BLADE,
                material=STEEL,
            )
        scene.actuate_joint("g", name="d")
        pose = ksd.solve(scene, d=0.01, method=method)
        found.append([pose.forces["d"], *pose.displacement("stage", at=(0.1, 0, 0))])
    assert found[1] == pytest.approx(found[0], rel=1e-6, abs=1e-9)
