"""Moments per length along leaf springs, against shooting of rods, closed forms and one another."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

import ksd
from ksd.interactive.drawing import Drawing
from ksd.interactive.sliders import load_size, with_loads
from ksd.model import line_moments
from ksd.model.chosen_effects import with_load_points
from ksd.model.line_moments import missing_moment, moments_on_points

E, NU, T, W, L = 200e9, 0.3, 0.5e-3, 10e-3, 0.1
STEEL, STRIP = ksd.Material(E=E, nu=NU, density=7800), ksd.rectangle(T, W)
EI, G = E * STRIP.Iz, E / (2 * (1 + NU))
UNIT = EI / L**2
"""Moment per length [Nm/m] that turns the end of the strip by half a radian."""


def strip(plane="xy", **words):
    """A strip from ground to a tip, and the leaf."""
    scene = ksd.Mechanism("strip", plane=plane)
    leaf = scene.leaf(
        "ground", scene.link("tip"), start=(0, 0, 0), end=(L, 0, 0), width_axis="z", section=STRIP, material=STEEL,
        name="strip", **words,
    )  # fmt: skip
    return scene, leaf


def loaded(plane="xy", **words):
    """The strip under one line load."""
    scene, leaf = strip(plane)
    scene.line_load(leaf, **words)
    return scene


def solved(scene, **words):
    return ksd.solve(scene, method="conventional", estimate=False, **words)


def shot(moment, spans, tip):
    """Position, rotation and inner wrench (6,), in section axes, as functions of s, of the strip as a rod, by shooting.

    moment: function of s (3,) [Nm/m]; spans: cuts of the integration; tip: dead force (3,) [N] there.
    """
    stiff = np.array([G * STRIP.J, E * STRIP.Iy, EI])
    soft = np.array([1 / (E * STRIP.A), 1 / (STRIP.ky * G * STRIP.A), 1 / (STRIP.kz * G * STRIP.A)])

    def slope(s, y):
        R, n, m = y[3:12].reshape(3, 3), y[12:15], y[15:]
        a, b, c = (R.T @ m) / stiff
        v = R @ (np.array([1.0, 0, 0]) + soft * (R.T @ n))
        turned = R @ np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
        return np.concatenate([v, turned.ravel(), np.zeros(3), -np.cross(v, n) - moment(s)])

    def parts(wrench):
        y = np.concatenate([np.zeros(3), np.eye(3).ravel(), wrench])
        for part in itertools.pairwise(spans):
            found = solve_ivp(slope, part, y, method="DOP853", rtol=1e-11, atol=1e-12, dense_output=True)
            y = found.y[:, -1]
            yield found

    def gap(wrench, share):
        y = list(parts(wrench))[-1].y[:, -1]
        return np.concatenate([y[12:15] - share * np.array(tip), y[15:] / L])

    wrench = np.zeros(6)
    for share in (0.3, 0.6, 1.0):
        wrench = root(gap, wrench, args=(share,), tol=1e-13).x
    assert np.abs(gap(wrench, 1.0)).max() < 1e-8
    pieces = list(parts(wrench))

    def at(s):
        y = next(p for p in pieces if s <= p.t[-1] + 1e-12).sol(s)
        R = y[3:12].reshape(3, 3)
        return y[:3], R, np.concatenate([R.T @ y[12:15], R.T @ y[15:]])

    return at


SHOT = {
    "planar": ("xy", {"moment": (0, 0, 2 * UNIT)}, (0, -1.0, 0)),
    "linear, of a part": (
        "xy", {"moment": (0, 0, 2 * UNIT), "to_moment": (0, 0, -UNIT), "start": 0.02, "end": 0.08}, (0, 1.0, 0),
    ),
    "in space": (None, {"moment": (UNIT, 0.4 * UNIT, 2 * UNIT)}, (0, -0.5, 0.3)),
    "linear in space": (None, {"moment": (0, 0, 2 * UNIT), "to_moment": (UNIT, -UNIT, 0)}, (0, 0.5, 0.3)),
}  # fmt: skip


@pytest.mark.parametrize("name", SHOT)
def test_shooting(name):
    plane, words, tip = SHOT[name]
    scene, leaf = strip(plane)
    scene.point(leaf, 0.037, name="point")
    scene.line_load(leaf, **words)
    scene.load("tip", force=tip, at=(L, 0, 0))
    pose = solved(scene)
    first, start, end = np.array(words["moment"]), words.get("start", 0.0), words.get("end", L)
    last = np.array(words.get("to_moment", first))

    def moment(s):
        return (first + (last - first) * (s - start) / (end - start)) * (start <= s <= end)

    shape = shot(moment, sorted({0.0, start, end, L}), tip)
    moved = shape(L)[0] - (L, 0, 0)
    for link, s in (("tip", L), ("point", 0.037)):
        place, R, _ = shape(s)
        assert pose.displacement(link) == pytest.approx(place - (s, 0, 0), abs=1e-6 * np.linalg.norm(moved))
        assert pose.links[link][1] == pytest.approx(R, abs=1e-6)
    clamp = pose.interface_forces().of("strip", "ground")
    assert np.concatenate([clamp.force, clamp.moment]) == pytest.approx(shape(0.0)[2], abs=2e-7)
    # inside the moment is continuous
    along = pose.section_forces()["strip"]
    true = np.array([shape(s)[2][3:] for s in along.s])
    assert along.values[:, 3:] == pytest.approx(true, abs=1e-3 * np.abs(true).max())
    assert pose.iterations <= 6
    # the sign matters
    other = loaded(plane, **words | {"moment": -first, "to_moment": -last})
    other.load("tip", force=tip, at=(L, 0, 0))
    assert np.abs(solved(other).displacement("tip") - moved).max() > 0.1 * np.linalg.norm(moved)


def test_small_moments_are_those_of_beam_theory():
    """Of m per length: turned by m L^2 / 2 EI, moved by m L^3 / 3 EI, twisted by m L^2 / 2 GJ, inner moment m (L - s)."""
    m = 1e-3 * UNIT
    pose = solved(loaded(moment=(0, 0, m)))
    assert pose.rotation("tip")[2] == pytest.approx(m * L**2 / (2 * EI), rel=1e-6)
    assert pose.displacement("tip")[1] == pytest.approx(m * L**3 / (3 * EI), rel=1e-6)
    along = pose.section_forces()["strip"]
    assert along.values[:, 5] == pytest.approx(m * (L - along.s), abs=1e-6 * m * L)
    stress = pose.stress()["strip"]
    assert stress.bending_Pa == pytest.approx(
        m * (L - stress.s) * (T / 2) / STRIP.Iz, abs=1e-5 * stress.largest_Pa
    )
    twisted = solved(loaded(None, moment=(m, 0, 0)))
    assert twisted.rotation("tip")[0] == pytest.approx(m * L**2 / (2 * G * STRIP.J), rel=1e-9)
    assert twisted.section_forces()["strip"].values[:, 3] == pytest.approx(
        m * (L - along.s), abs=1e-9 * m * L
    )


@pytest.mark.parametrize("plane", ["xy", None])
def test_parts_are_the_whole(plane):
    first, last = np.array([0, 0, 2 * UNIT]), np.array([0, 0, -UNIT])
    if plane is None:
        first[:2], last[0] = (0.5 * UNIT, UNIT), UNIT
    one = solved(loaded(plane, moment=first, to_moment=last))
    parts, leaf = strip(plane)
    for a, b in itertools.pairwise((0.0, 0.03, 0.055, L)):
        ends = [first + (last - first) * s / L for s in (a, b)]
        parts.line_load(leaf, moment=ends[0], to_moment=ends[1], start=a, end=b if b < L else None)
    other = solved(parts)
    assert other.displacement("tip") == pytest.approx(one.displacement("tip"), abs=3e-7 * L)
    for pose in (one, other):
        clamp = pose.interface_forces().of("strip", "ground")
        assert clamp.moment == pytest.approx(0.5 * L * (first + last), abs=1e-9 * UNIT * L)
        assert clamp.force == pytest.approx(0.0, abs=1e-9)


def test_moment_that_the_points_miss():
    """It is zero at the ends and at a point of one's own, and small in the middle of a piece."""
    scene, leaf = strip()
    scene.point(leaf, 0.05)
    line = scene.line_load(leaf, start=0.02, end=0.09, moment=(1.0, 0, 2.0), to_moment=(0, 3.0, 4.0))
    at, moments = moments_on_points(line, L, [0.05])
    total = 0.5 * 0.07 * np.array([1.0, 3.0, 6.0])
    assert moments.sum(axis=0) == pytest.approx(total, rel=1e-12)
    cut = with_load_points(scene.scene())
    for s in (0.0, 0.02, 0.05, 0.09, L):
        near = 1e-6 if s < 0.07 else -1e-6
        assert missing_moment(cut, "strip", L, np.array([s]), s + near) == pytest.approx(0.0, abs=1e-12)
    half = 0.5 * (at[2] + at[3])
    assert np.abs(missing_moment(cut, "strip", L, np.array([half]), half)).max() < 2e-2 * total.max()


@pytest.mark.parametrize("held", ["free", "pushed", "slid", "clamped"])
def test_the_error_counts_the_points(held, monkeypatch):
    """The steps shorten the leaf, which pulls one that is held at both ends, and no mesh tells it."""

    def pose(points):
        monkeypatch.setattr(line_moments, "POINTS", points)
        scene, leaf = strip()
        scene.line_load(leaf, moment=(0, 0, 2 * UNIT), name=f"film of {points}")
        if held == "pushed":
            scene.load("tip", force=(0, -1.0, 0), at=(L, 0, 0))
        for along in {"slid": "y", "clamped": "yx"}.get(held, ""):
            scene.actuate("tip", along=along, at=(L, 0, 0), name=along)
        if held in ("slid", "clamped"):
            scene.support("tip", about="z")
        values = {"y": 0.1 * L} if held == "slid" else {}
        return ksd.solve(scene, values | dict.fromkeys({"clamped": "yx"}.get(held, ""), 0.0), strict=False)

    own, finer = pose(12), pose(30)
    off = np.linalg.norm(own.displacement("tip") - finer.displacement("tip"))
    assert own.error.displacement == pytest.approx(off, rel=0.3, abs=1e-9)
    if held != "clamped":
        assert own.error.relative > 20.0 * finer.error.relative
    else:
        assert abs(own.forces["x"]) > 0.1
        assert own.error.relative == pytest.approx(abs(own.forces["x"] / own.forces["y"]), rel=0.05)
        assert own.error.force[1] == pytest.approx(abs(own.forces["x"]), rel=0.05)
        _, error = own.with_error(lambda p: p.forces["x"])
        assert error == pytest.approx(own.error.force[1], rel=1e-6)


def test_force_and_moment_in_one():
    force, moment = (0, -10.0, 4.0), (0.2 * UNIT, 0, UNIT)
    both = solved(loaded(None, force=force, to=(0, 0, 0), moment=moment))
    scene = loaded(None, force=force, to=(0, 0, 0), name="a")
    scene.line_load("strip", moment=moment, name="b")
    assert both.displacement("tip") == pytest.approx(solved(scene).displacement("tip"), abs=1e-12)


def test_gradients():
    def at(z=0.0, x=0.0, length=L, start=0.01):
        scene = ksd.Mechanism("strip")
        leaf = scene.leaf(
            "ground", scene.link("tip"), start=(0, 0, 0), end=(length, 0, 0), width_axis="z", section=STRIP,
            material=STEEL, name="strip",
        )  # fmt: skip
        moment, to = np.array([x, 0, UNIT + z]), np.array([UNIT + x, 0, z])
        scene.line_load(leaf, moment=moment, to_moment=to, start=start)
        scene.load("tip", force=(0, 0.2, 0.1), at=(length, 0, 0))
        return scene

    def answer(pose):
        return pose.displacement("tip")[2]

    names = ("strip.line_load_moment_z", "strip.line_load_moment_x", "length", "start")
    given = {"z": 0.0, "x": 0.0, "length": L, "start": 0.01}
    found = solved(at()).gradient(answer, by=names, design=at, at_design=given)
    steps = {"z": 1e-3 * UNIT, "x": 1e-3 * UNIT, "length": 1e-4 * L, "start": 1e-4 * L}
    for name, (word, h) in zip(names, steps.items(), strict=True):
        sides = [answer(solved(at(**given | {word: given[word] + sign * h}))) for sign in (1, -1)]
        assert found[name] == pytest.approx((sides[0] - sides[1]) / (2 * h), rel=1e-5)
    with pytest.raises(ksd.SceneError, match=r"there is no gradient by 'strip\.line_load_force_y'"):
        solved(at()).gradient(answer, by="strip.line_load_force_y")


def test_stiffness_is_the_derivative_of_the_answer():
    """In space, where the tangent is not symmetric."""

    def at(force=(0, 0, 0)):
        scene = loaded(None, moment=(UNIT, 0, UNIT))
        scene.load("tip", force=np.array([0, 0.5, 0.3]) + force, at=(L, 0, 0))
        return solved(scene)

    pose = at()
    assert not pose.model.conservative
    compliance = pose.stiffness("tip").compliance[:3, :3]
    for k, axis in enumerate(np.eye(3)):
        found = (at(1e-3 * axis).displacement("tip") - at(-1e-3 * axis).displacement("tip")) / 2e-3
        assert compliance[:, k] == pytest.approx(found, abs=1e-5 * np.abs(compliance).max())


def test_paths_and_buckling():
    scene = loaded(moment=(0, 0, 3 * UNIT), force=(0, 5.0, 0))
    assert ksd.follow(scene, until=1.0).states[-1].displacement("tip") == pytest.approx(
        solved(scene).displacement("tip"), abs=1e-8
    )


def test_buckling_and_frequencies():
    """Of a column that it bends, as by 24 moments on points of one's own."""
    x, weight = np.polynomial.legendre.leggauss(24)
    own, leaf = strip(None)
    for s, w in zip(0.5 * L * (1 + x), 0.5 * L * weight, strict=True):
        own.load(own.point(leaf, s), moment=(0, 0, 0.2 * w * UNIT))
    found = []
    for scene in (own, loaded(None, moment=(0, 0, 0.2 * UNIT))):
        scene.load("tip", force=(-0.3 * UNIT, 0, 0), at=(L, 0, 0))
        pose = ksd.solve(scene)
        assert pose.stable
        found.append([pose.buckling(count=1).positive, *pose.frequencies(count=3).frequency_Hz])
    assert found[1] == pytest.approx(found[0], rel=1e-4)
    assert found[0][0] < 10


def test_chains_take_it():
    scene = loaded(moment=(0, 0, UNIT), to_moment=(0, 0, 0))
    one, other = solved(scene), solved(scene, mesh=ksd.Mesh("corotational", elements=2))
    size = np.linalg.norm(one.displacement("tip"))
    assert other.displacement("tip") == pytest.approx(one.displacement("tip"), abs=1e-3 * size)
    forces = other.section_forces()["strip"]
    true = one.section_forces()["strip"]
    assert forces.values[:, 5] == pytest.approx(
        np.interp(forces.s, true.s, true.values[:, 5]), abs=2e-2 * UNIT * L
    )


def test_it_answers_as_one_leaf():
    scene, leaf = strip()
    scene.point(leaf, 0.04, name="middle")
    scene.line_load(leaf, moment=(0, 0, 0.5), to_moment=(0, 0, 1.0), start=0.01, name="film")
    pose = ksd.solve(scene)
    assert pose.trusted
    assert list(pose.links) == ["ground", "tip", "middle"]
    assert list(pose.stress().leaves) == ["strip"] == list(pose.strain_energy())
    rows = pose.link_forces().rows
    assert [row.at for row in rows if row.part == "inside"] == ["start, at 'ground'", "end, at 'tip'"]
    assert "film 1" not in str(pose) + str(pose.model) + str(pose.interface_forces())
    assert "2 links, 0 joints, 2 leaf springs" in str(pose.model)
    assert "moment (0, 0, 0.5) to (0, 0, 1) Nm/m, from 10 mm to its end" in str(scene)
    (shape,) = pose.shape().line_loads
    assert (shape.name, shape.kind, shape.text) == ("film", "moment", "0.5 to 1 Nm/m")
    assert shape.value[:, 2] == pytest.approx(np.linspace(0.5, 1.0, len(shape.value)))
    assert pose.shape().loads == ()
    assert any("film: 0.5 to 1 Nm/m" in t.get_text() for t in pose.plot().axes[0].texts)
    diagnosis = ksd.doctor(scene)
    bare, leaf = strip()
    bare.point(leaf, 0.04, name="middle")
    assert (diagnosis.freedoms, diagnosis.constraints) == (
        ksd.doctor(bare).freedoms,
        ksd.doctor(bare).constraints,
    )
    assert ksd.doctor(pose.model).freedoms == diagnosis.freedoms


def test_out_of_its_plane():
    pose = solved(loaded(None, moment=(0.1, 0, 1.0)))
    assert "line load 'strip.line_load' turns about" in pose.model.plane
    (said,) = ksd.doctor(loaded(moment=(0.1, 0, 1.0), force=(0, 0, 3.0))).unusual
    assert "0.3 N along z and 0.01 Nm about axes in it of line load 'strip.line_load'" in said


def test_motion():
    """Slow, it is statics under its factor; the section forces of an instant are those of then."""
    m = 0.2 * UNIT
    scene = loaded(moment=(0, 0, m), name="film")
    scene.mass("tip", mass=0.01, at=(L, 0, 0))
    history = ksd.simulate(scene, until=0.3, dt=1e-3, loads={"film": ksd.Ramp("250 ms")}, progress=False)
    assert np.abs(history.energy.lost).max() < 1e-5 * history.energy.work.max()
    assert not any("film" in name for name in history.signals)
    half = history[0.125].section_forces()["strip"]
    assert half.values[:, 5] == pytest.approx(0.5 * m * (L - half.s), abs=0.05 * m * L)
    assert history["tip"].position[-1, 1] == pytest.approx(solved(scene).displacement("tip")[1], rel=0.05)
    step = ksd.stepper(scene, longest="1 ms")
    still = step(step.start, {}, 0.02)
    let_go = step(step.start, {"film": 0.0}, 0.02)
    assert let_go.pose.displacement("tip")[1] < 0.7 * still.pose.displacement("tip")[1]


def test_joints_are_condensed_beside_it():
    guide = ksd.ParallelGuide(STEEL, length=0.06, thickness=0.3e-3, width=10e-3, spacing=0.04)
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, guide, at=(0, 0, 0), axis="z", toward="y", name="guide")
    blade = scene.leaf(
        "ground", stage, start=(0.05, 0, 0), end=(0.05, 0.06, 0), width_axis="z", section=STRIP, material=STEEL,
        name="blade",
    )  # fmt: skip
    scene.line_load(blade, moment=(0, 0, 2.0), start=0.03)
    scene.actuate_joint(placed, name="push")
    full, reduced = (ksd.solve(scene, push=2e-3, method=m, estimate=False) for m in ("conventional", "full"))
    assert reduced.forces["push"] == pytest.approx(full.forces["push"], rel=1e-6)


def test_scene_file(tmp_path):
    scene, leaf = strip()
    scene.line_load(leaf, moment=(0, 0, 2), to_moment=(0, 0, 1), end=0.06, name="a")
    scene.line_load(leaf, force=(0, -2, 0), moment=(0, 0, 1), name="b")
    scene.line_load(leaf, force=(0, -2, 0), name="c")
    ksd.save_scene(scene, tmp_path / "strip.toml")
    assert ksd.load_scene(tmp_path / "strip.toml")[0].scene() == scene.scene()
    text = (tmp_path / "strip.toml").read_text()
    assert text.count("force =") == text.count("moment = [") - text.count("to_moment = [") == 2
    words = text.replace("moment = [0, 0, 2]", 'moment = [0, 0, "2000 mNm/m"]')
    words = words.replace("moment = [0, 0, 1]", 'moment = [0, 0, "1 N·mm/mm"]')
    assert words.count("mNm/m") == 1 < words.count("N·mm/mm")
    (tmp_path / "words.toml").write_text(words)
    assert ksd.load_scene(tmp_path / "words.toml")[0].scene().line_loads == scene.scene().line_loads


def test_sliders(tmp_path):
    scene = loaded(moment=(0, 0, 2), to_moment=(0, 0, 4)).scene()
    assert load_size(scene.line_loads[0]) == (4.0, "moment per length")
    line = with_loads(scene, {"strip.line_load": 8.0}).line_loads[0]
    assert (line.moment, line.to_moment) == ((0, 0, 4), (0, 0, 8))
    ksd.save_scene(scene, tmp_path / "strip.toml")
    drawing = Drawing(tmp_path / "strip.toml")
    drawing.set_load("strip.line_load", 8.0)
    (table,) = drawing.tables["line_load"]
    assert "force" not in table
    assert [*map(float, table["moment"])] == [0, 0, 4]
    assert [*map(float, table["to_moment"])] == [0, 0, 8]


BAD = {
    "nothing": ({}, "line load 'strip.line_load': give force, moment, or both"),
    "end of no force": (
        {"moment": (0, 0, 1), "to": (0, 1, 0)},
        "to = .* is its force at the end; give force too",
    ),
    "end of no moment": ({"force": (0, 1, 0), "to_moment": (0, 0, 1)}, "to_moment = .* give moment too"),
    "number": ({"moment": 3.0}, "moment = 3.0 must be three numbers .* in Nm/m"),
    "beyond": ({"moment": (0, 0, 1), "end": 0.2}, "end = 0.2 m is beyond the end of leaf 'strip'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name):
    scene, leaf = strip()
    words, message = BAD[name]
    with pytest.raises(ksd.SceneError, match=message):
        scene.line_load(leaf, **words)


def test_refused(tmp_path):
    scene = loaded(moment=(0, 0, 1), name="film")
    for method in ("constant", "modal"):
        with pytest.raises(ksd.SceneError, match=r"'film': .* loads along leaf springs; use another method"):
            ksd.solve(scene, method=method)
    with pytest.raises(
        ksd.SceneError, match="has loads along leaf springs, of which rest shapes are not known"
    ):
        ksd.rest_shape(scene)
    with pytest.raises(ksd.SceneError, match="the load 'film' along leaf 'strip' is not written"):
        solved(scene).export(tmp_path / "strip.inp")
    with pytest.raises(ksd.SceneError, match="line load 'film' acts on the inertia of leaf 'strip'"):
        ksd.simulate(scene, until=0.01, mass_at_ends=True, progress=False)
    bow, leaf = strip(curve=ksd.Arc(radius=L, angle=2 * math.asin(0.5)))
    bow.line_load(leaf, moment=(0, 0, 1), name="film")
    assert solved(bow).converged
    bow.fit("strip", shift=(0, 1e-5, 0))
    with pytest.raises(
        ksd.SceneError, match="line load 'film': its moment acts on points of leaf 'strip', which may not"
    ):
        solved(bow)
    guide = ksd.Mechanism("guide")
    joint = ksd.ParallelGuide(STEEL, length=0.06, thickness=0.3e-3, width=10e-3, spacing=0.04)
    guide.join(guide.ground, guide.link("stage"), joint, at=(0, 0, 0), axis="z", toward="y", name="guide")
    with pytest.raises(ksd.SceneError, match="line load: there is no free-form leaf 'guide/low'"):
        guide.line_load("guide/low", moment=(0, 0, 1))


def test_its_points_are_named_by_no_answer():
    """Those of `moment` are points of the leaf alone."""
    pose = solved(loaded(moment=(0, 0, UNIT)))
    texts = [str(pose.frequencies()), str(pose.buckling())]
    for ask in (pose.stiffness, pose.displacement):
        with pytest.raises(ksd.SceneError, match="tip") as reason:
            ask("handle")
        texts.append(str(reason.value))
    assert "'strip" in texts[0] + texts[1] and not any("line_load" in text for text in texts)


def test_in_space_beside_contact_that_cannot_be_held():
    """What is not known is whether it is stable; the state is."""
    poses = []
    for moment in ((0, 0, 0), (0, 0, UNIT)):
        scene, leaf = strip(None)
        if any(moment):
            scene.line_load(leaf, moment=moment)
        ball, at = scene.link("ball"), (0.06, 0.5 * T + 0.02, 0)
        for axis in "xyz":
            scene.actuate(ball, along=axis, at=at, name=axis)
            scene.support(ball, about=axis)
        scene.contact(leaf, scene.surface(ball, ksd.shapes.ball(0.02), at=at), name="c")
        poses.append(ksd.solve(scene, x=0.0, y=-5e-3, z=0.0, strict=False))
    free, pushed = poses
    assert free.stable and not pushed.stable and pushed.converged
    assert pushed.contacts["c"].N > free.contacts["c"].N
    assert pushed.trust.stable.sentence.startswith(
        "NOT CERTAIN: whether it is stable is not known: contact 'c'"
    )
    with pytest.raises(ksd.TrustError, match="NOT CERTAIN"):
        ksd.solve(scene, x=0.0, y=-5e-3, z=0.0)
