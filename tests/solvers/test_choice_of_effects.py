"""Effects by mention: what is said is simulated whatever the drives do; of what is absent nothing is made or called."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, fourbar, single_joint
from scipy.integrate import solve_bvp

import ksd
from ksd.errors import SceneError
from ksd.model import chosen_effects as effects
from ksd.model import compile as compiling
from ksd.model import leaves, newton
from ksd.model.arrays import make_workspace
from ksd.model.chosen_effects import choose_effects
from ksd.model.warping_runs import (
    _piece,
    clamped_twist,
    half_clamped_torsion_factor,
    run_twists,
)

HOT = ksd.Material(E=200e9, nu=0.3, density=7800, expansion=12e-6, name="steel")
LIGHT = ksd.Material(E=200e9, nu=0.3, name="steel without weight")
PLASTIC = ksd.Material(E=2e9, nu=0.35, density=1200, expansion=8e-5, name="plastic")


def lever(t=1e-3, w=20e-3, L=0.1, material=HOT, *, space=False, push=0.0, following=False):
    """A parallel pair of leaf springs or, in space, crossed ones, with a tip driven across them."""
    scene = ksd.Mechanism(f"lever {t} {w} {L}")
    tip = scene.link("tip")
    words = {"section": ksd.rectangle(t, w), "material": material, "width_axis": (0, 0, 1)}
    scene.leaf("ground", tip, start=(0, 0, 0), end=(L, 0, 0), name="one", **words)
    words |= {"width_axis": (0, 1, 0)} if space else {}
    scene.leaf("ground", tip, start=(0, 0.3 * L, 0), end=(L, 0.3 * L, 0), name="two", **words)
    scene.actuate(tip, along="y", at=(L, 0.15 * L, 0), name="d")
    if push:
        scene.load(tip, force=(0, 0, push) if space else (push, 0, 0), at=(L, 0, 0), following=following)
    return scene


def light():
    """The fourbar of leaf springs that weigh nothing."""
    sizes = {"length": 0.1, "angle": np.pi / 4, "thickness": 1e-3, "widths": (0.04, 0.02)}
    return fourbar(joint=ksd.CrossFlexure(LIGHT, **sizes))


def wires(d=0.5e-3, L=0.08):
    """A table on three wires."""
    scene = ksd.Mechanism("wires")
    table = scene.link("table")
    for k in range(3):
        x, y = 0.05 * np.cos(2 * k), 0.05 * np.sin(2 * k)
        scene.wire("ground", table, start=(x, y, 0), end=(x, y, L), diameter=d, material=HOT)
    scene.actuate(table, along="x", at=(0, 0, L), name="d")
    return scene


def also(scene, *sentences):
    """The scene with more said of it; every scene considers both effects of the leaf material."""
    for say in sentences:
        say(scene)
    scene.consider("warping", "plate")
    return scene


def weight(mass, link, at, g=(0, -9.81, 0)):
    def say(scene):
        scene.mass(link, mass=mass, at=at)
        scene.gravity = g

    return say


def thirty():
    """(scene, targets) of thirty scenes, planar and spatial, with all effects strong somewhere and weak elsewhere."""
    top, tip = (0, 0.37, 0), (0.1, 0.015, 0)
    link = {"section": ksd.rectangle(0.1, 0.1), "material": STEEL}
    weak = {"section": ksd.rectangle(3e-3, 20e-3), "material": STEEL}
    pull = {"start": (0, -0.1, 0), "end": (0, 0.37, 0)}
    found = [(fourbar(), {"top": d}) for d in (0.01, 0.1, 0.3)]
    found += [(also(light(), weight(m, "top", top)), {"top": 0.1}) for m in (1e-5, 1e-3, 1.0)]
    found += [
        (also(fourbar(), lambda s, k=k: s.spring("ground", "top", stiffness=k, **pull)), {"top": 0.1})
        for k in (1e-5, 200.0)
    ]
    found += [(also(fourbar(), lambda s, c=c: s.compliance("top", **c)), {"top": 0.1}) for c in (link, weak)]
    found += [
        (single_joint(cross_flexure(thickness=t)), {"turn": a})
        for t, a in ((1e-3, 0.5), (0.2e-3, 0.1), (3e-3, 0.3))
    ]
    found += [
        (also(single_joint(), lambda s, k=k: s.joint_spring("hinge", stiffness=k)), {"turn": 0.4})
        for k in (1e-6, 0.5)
    ]
    found += [
        (lever(t=t, w=w), {"d": 2e-3})
        for t, w in ((1e-3, 20e-3), (0.3e-3, 3e-3), (4e-3, 5e-3), (0.2e-3, 60e-3))
    ]
    found += [(lever(material=PLASTIC, t=2e-3), {"d": 5e-3}), (lever(space=True), {"d": 1e-4})]
    found += [(also(lever(), lambda s, h=h: s.heat(h)), {"d": 1e-3}) for h in (1e-5, 30.0)]
    found += [
        (also(lever(), lambda s, n=n: s.fit("one", natural_length=n)), {"d": 1e-3})
        for n in (0.1 * (1 - 1e-10), 0.0999)
    ]
    found += [
        (also(lever(material=LIGHT), weight(m, "tip", tip, (0, 0, -9.81))), {"d": 1e-3}) for m in (1e-5, 0.4)
    ]
    found += [(lever(push=1e-4, following=True), {"d": 1e-4})]
    turning = {"force": (0, 1.0, 0), "at": (0.1, 0, 0), "following": True}
    found += [(also(single_joint(), lambda s: s.load("tip", **turning)), {"turn": 0.4})]
    found += [(wires(), {"d": 2e-3})]
    return found


SCENES = thirty()


def answers(pose):
    """Drive forces, then displacement (m) and rotation (rad, times 0.1 m) of every link both variants have."""
    links = [n for n in pose.model.scene.links if "/" not in n]
    index = [pose.model.scene.links.index(n) for n in links[1:]]
    rest = pose.model.rest
    shift = (pose.motion.x - rest.x)[index]
    turned = 0.1 * (pose.motion.R[index] - np.eye(3)).reshape(len(index), 9)
    return np.array(list(pose.forces.values())), np.hstack([shift, turned])


@pytest.mark.parametrize("k", range(30))
def test_what_is_mentioned_is_simulated(k):
    """However little it changes; in the plane as with everything in space."""
    assert len(SCENES) == 30
    scene, targets = SCENES[k]
    # the last one has round wires, which do not curl
    scene.consider("warping", *(["plate"] if k < 29 else []))
    chosen = ksd.solve(scene, targets, method="conventional", mesh=ksd.Mesh())
    everything = ksd.solve(scene, targets, method="conventional", effects="all", mesh=ksd.Mesh())
    said = set(effects.mentioned_effects(scene.scene(), ksd.Mesh()))
    assert set(everything.model.choice.present) == said | {"plate"}
    assert set(chosen.model.choice.present) == said - {"spatial"}
    for mine, theirs in zip(answers(chosen), answers(everything), strict=True):
        assert np.abs(mine - theirs).max() <= 2e-4 * np.abs(theirs).max()


def full_of_effects():
    """The fourbar with gravity, a spring, heat, assembly error, an elastic link and a follower load, all next to nothing."""
    hot = ksd.CrossFlexure(HOT, length=0.1, angle=np.pi / 4, thickness=1e-3, widths=(0.04, 0.02))
    scene = fourbar(joint=hot)
    scene.mass("top", mass=1e-9, at=(0, 0.37, 0))
    scene.gravity = (0, -1e-9, 0)
    scene.spring("ground", "top", start=(0, -0.1, 0), end=(0, 0.37, 0), stiffness=1e-9)
    scene.heat(1e-9)
    scene.fit("lower left/inner", turn=(0, 0, 1e-12))
    scene.compliance("top", section=ksd.rectangle(0.1, 0.1), material=STEEL)
    scene.load("left", force=(1e-9, 0, 0), at=(-0.2, 0.2, 0), following=True)
    return scene


ALL_SAID = ("shear", "gravity", "following", "compliance", "springs", "heat", "fit")


@pytest.mark.parametrize("kept", [True, False], ids=["mechanism", "scene"])
def test_drive_values_do_not_change_the_model(kept):
    """One model for all drive values and accuracies."""
    scene = full_of_effects()
    scene = scene if kept else scene.scene()
    models = [
        ksd.solve(scene, top=d, method="conventional", mesh=ksd.Mesh(), **words).model
        for d in (0.0, 1e-6, 0.1, -0.2)
        for words in ({}, {"accuracy": 1e-5}, {"accuracy": 0.1})
    ]
    assert all(m is models[0] for m in models[1:])
    assert models[0].choice.present == ALL_SAID


def test_no_accuracy_changes_the_model_of_a_prepared_solver():
    solver = ksd.prepare(wires(d=0.5e-3))
    before = solver.model
    assert before.mesh.shear
    for accuracy in (None, 0.1, 1e-6):
        solver(d=1e-3, accuracy=accuracy)
        assert solver.model is before


def test_plate_factors_do_not_depend_on_the_answers_before():
    scene = fourbar()
    scene.consider("plate")
    solver = ksd.prepare(scene)
    before, first = solver.model, solver(top=0.1)
    solver(top=0.3)
    assert solver(top=0.1).forces == first.forces and solver.model is before


def test_a_walk_in_load_steps_has_plates():
    """Sweeps by the conventional solver took every leaf as if it were not bent."""
    scene = fourbar()
    scene.consider("plate")
    table = ksd.sweep(scene, top=[0.1, 0.3], method="conventional", progress=False)
    one = ksd.solve(scene, top=0.3, method="conventional").forces["top"]
    assert table["top_force_N"][1] == pytest.approx(one, rel=1e-4)
    assert one > 1.02 * ksd.solve(fourbar(), top=0.3, method="conventional").forces["top"]


def test_batches_have_plates():
    """They were refused: every leaf is now stiffened by its own curvature inside the solve."""
    scene = fourbar()
    scene.consider("plate")
    found = ksd.batch(scene, top=[0.1, 0.2], method="full")
    one = ksd.solve(scene, top=0.2, method="conventional").forces["top"]
    assert found.forces["top"].ravel()[1] == pytest.approx(one, rel=1e-6)
    assert one > 1.02 * ksd.solve(fourbar(), top=0.2, method="conventional").forces["top"]


def test_sensitivity_keeps_the_plate_factors():
    """Next to a load of nothing is the state itself."""
    pose = ksd.solve(fourbar(), top=0.3, with_="plate", method="conventional")
    seen = []
    pose.sensitivity(
        lambda p: seen.append(p.forces["top"]) or 0.0, "top", force=(0, 1e-2, 0), at=(0, 0.37, 0)
    )
    assert seen == pytest.approx([pose.forces["top"]] * 2, rel=1e-6)


def test_required_loads_have_the_plate_factors_of_the_pose():
    """They kept those of rest: 7 % less here."""
    scene = ksd.Mechanism("strip", plane="xy")
    arm = scene.link("arm")
    scene.leaf(
        scene.ground, arm, start=(0, 0, 0), end=(0.06, 0, 0), section=ksd.rectangle(3e-4, 0.03),
        material=ksd.Material(E=200e9, nu=0.3),
    )  # fmt: skip
    scene.actuate(arm, about="z", name="turn")
    scene.consider("plate")
    pose = ksd.solve(scene, turn=0.5, method="conventional")
    need = ksd.required_loads(scene, pose.links)
    assert need.forces["turn"] == pytest.approx(pose.forces["turn"], rel=1e-6)


def test_questions_out_of_the_plane_have_the_warping_considered():
    """Nothing twists in a plane: the same state with and without restrained warping, but not the same support stiffness."""
    scene = fourbar()
    scene.consider("warping")
    pose, plain = ksd.solve(scene, top=0.2), ksd.solve(fourbar(), top=0.2)
    assert pose.model.mesh.warping and pose.unreduced_equilibrium[0] is pose.model
    assert pose.forces["top"] == pytest.approx(plain.forces["top"], rel=1e-9)
    # what warping is worth to each of them, as measured
    for ask, worth in (
        (lambda p: p.stiffness("top", at=(0, 0.37, 0)).support("z"), 0.277),
        (lambda p: p.frequencies(count=2).frequency_Hz[0], 0.1443),
        (lambda p: p.buckling().negative, 0.00477),
        (lambda p: p.with_error(lambda q: q.stiffness("top").support("rx"))[0], 0.340),
    ):
        assert 1 - ask(plain) / ask(pose) == pytest.approx(worth, rel=0.01)
    table = ksd.sweep(scene, top=[0.1, 0.2], questions=("support_stiffness",), progress=False)
    assert table["support_z_N_per_m"][1] == pytest.approx(
        pose.stiffness("top", at=(0, 0.37071, 0)).support("z"), rel=1e-4
    )
    # not mentioned, its weight stands on the answer
    assert plain.left_out["warping"]["force"] == pytest.approx(0.0, abs=1e-6)
    assert plain.left_out["warping"]["support_stiffness"] > 0.01 and "warping" not in pose.left_out


def test_a_scene_that_leaves_its_plane_is_solved_with_warping():
    """One leaf of two beside the plane of the drive: it twists, which is seen when the plane has been tried."""
    scene = ksd.Mechanism("lopsided")
    tip = scene.link("tip")
    words = {"section": ksd.rectangle(0.5e-3, 20e-3), "material": HOT, "width_axis": (0, 0, 1)}
    scene.leaf("ground", tip, start=(0, 0, 0.03), end=(0.06, 0, 0.03), name="one", **words)
    scene.actuate(tip, along="y", at=(0.06, 0, 0), name="d")
    scene.consider("warping")
    pose = ksd.solve(scene, d=5e-3)
    assert pose.model.mesh.warping and pose.model.choice["warping"].present
    assert abs(pose.forces["d"] / ksd.solve(scene, d=5e-3, without="warping").forces["d"] - 1) > 1e-3


def test_the_model_says_what_it_simulates_in_the_words_of_the_scene():
    text = str(ksd.compile_scene(full_of_effects()))
    for said in (
        "with gravity: (0, -1e-09, 0) m/s^2 on 1 mass and 12 of 12 leaf springs, those of known density",
        "with following: a load of 'left' turns with its link",
        "with compliance: 'top' elastic",
        "with springs: 'spring'",
        "with heat: 1e-09 K on all leaf springs",
        "with fit: of 'lower left/inner'",
        "with shear: part of the beam model",
        "without warping: not mentioned; would be 23 % more torsional stiffness",
        "without plate: not mentioned; would be 3 % more bending stiffness at small curvature, 6.1 % with its ends",
    ):
        assert said in text, text
    bare = str(ksd.compile_scene(fourbar()))
    assert "left out: gravity on links, payloads and along the leaf springs, follower loads" in bare
    assert "prestress and assembly error of leaf springs: the scene does not mention them" in bare
    off = str(ksd.compile_scene(full_of_effects(), without=("heat", "shear")))
    assert (
        "without heat: switched off; 1e-09 K on all leaf springs" in off
        and "without shear: switched off" in off
    )


def test_effects_of_the_material_stay_off_unless_mentioned():
    plain = ksd.solve(fourbar(), top=0.3)
    assert {"warping", "plate"} <= set(plain.model.choice.absent)
    said = fourbar()
    said.consider("plate")
    assert ksd.solve(said, top=0.3).forces["top"] > 1.02 * plain.forces["top"]
    for words in ({"with_": "plate"}, {"effects": "all"}, {"effects": ("shear", "plate")}):
        assert ksd.solve(fourbar(), top=0.3, **words).forces["top"] > 1.02 * plain.forces["top"]


def test_single_words_and_lists():
    scene = also(fourbar(), weight(1.0, "top", (0, 0.37, 0)))
    model = ksd.compile_scene(scene, without="gravity")
    assert not len(model.arrays.loads.node) and "switched off" in model.choice["gravity"].reason
    model = ksd.compile_scene(scene, effects=())
    assert model.choice.present == () and not model.mesh.shear
    for words in (["shear", "gravity"], np.array(["shear", "gravity"]), {"gravity": 1, "shear": 2}):
        model = ksd.compile_scene(scene, effects=words)
        assert model.choice.present == ("shear", "gravity")
    model = ksd.compile_scene(scene, effects="all")
    assert model.choice.present == ("spatial", "shear", "warping", "plate", "gravity")
    assert isinstance(model.plane, str)
    assert ksd.compile_scene(scene, mesh=ksd.Mesh(warping=True)).mesh.warping


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"without": "sheer"}, "did you mean .shear."),
        ({"with_": "springs"}, "mechanism.spring"),
        ({"with_": "shear", "without": "shear"}, "both in with_ and in without"),
        ({"effects": "most"}, "no effect"),
        ({"effects": 3}, "name effects"),
    ],
)
def test_wrong_words_get_a_sentence(words, said):
    with pytest.raises(SceneError, match=said):
        ksd.solve(fourbar(), top=0.1, **words)
    with pytest.raises(SceneError, match=said):
        ksd.compile_scene(fourbar(), **words)


@pytest.mark.parametrize("words", [{"mesh": ksd.Mesh()}, {"with_": "warping"}, {"effects": "all"}])
def test_a_compiled_model_has_its_mesh_and_effects(words):
    model = ksd.compile_scene(fourbar())
    with pytest.raises(SceneError, match="chosen when a model is compiled"):
        ksd.solve(model, top=0.1, **words)
    with pytest.raises(SceneError, match="chosen when a model is compiled"):
        ksd.prepare(model, **words)


def test_a_path_of_a_compiled_model_has_its_mesh():
    with pytest.raises(SceneError, match="chosen when a model is compiled"):
        ksd.follow(ksd.compile_scene(fourbar()), {"top": 0.1}, control="drives", mesh=ksd.Mesh())


COUNTED = {
    "springs": (
        ("ksd.model.scene_layout", "spring_members"),
        lambda s: s.joint_spring("lower left", stiffness=1.0),
    ),
    "compliance": (
        ("ksd.model.chosen_effects", "with_elastic_links"),
        lambda s: s.compliance("top", section=ksd.rectangle(5e-3, 20e-3), material=STEEL),
    ),
    "heat": (
        ("ksd.model.chosen_effects", "leaf_conditions"),
        lambda s: s.fit("lower left/inner", turn=(0, 0, 1e-3)),
    ),
    "plate": (("ksd.model.chosen_effects", "plate_conditions"), lambda s: s.consider("plate")),
}


@pytest.mark.parametrize("name", COUNTED)
def test_an_absent_effect_is_not_called(name, monkeypatch):
    (home, function), mention = COUNTED[name]
    module = __import__(home, fromlist=[function])
    calls, original = [], getattr(module, function)

    def counted(*args, **options):
        calls.append(1)
        return original(*args, **options)

    monkeypatch.setattr(module, function, counted)
    ksd.prepare(fourbar())(top=0.05)
    assert not calls
    scene = fourbar()
    mention(scene)
    ksd.prepare(scene)(top=0.05, method="conventional")
    assert calls


def test_the_assembly_calls_nothing_for_what_is_absent(monkeypatch):
    """The compiled assembly, run as Python with its parts replaced by counters."""
    calls = []
    answers = {"add_members": (0, 0.0, 0), "add_loads": None, "add_terms": 0.0}
    for part, answer in answers.items():
        monkeypatch.setattr(
            newton, part, lambda *a, part=part, answer=answer: (calls.append(part), answer)[1]
        )

    def assembled(scene):
        calls.clear()
        model = ksd.compile_scene(scene)
        arrays, rest, work = model.arrays, model.rest, make_workspace(model.arrays)
        newton._newton.py_func(
            newton.add_members,
            *7 * [None],
            newton._skip_bodies,
            *2 * [None],
            lambda step: False,
            *arrays.flat,
            *rest,
            np.zeros(1),
            work.flat,
            work.at,
            newton.ASSEMBLE,
            *(0, 0, 1.0, 1e-8, 10.0, math.inf, math.inf),
        )
        return set(calls)

    assert assembled(fourbar()) == {"add_members", "add_terms"}
    heavy = also(fourbar(), weight(1.0, "top", (0, 0.37, 0)))
    assert assembled(heavy) == {"add_members", "add_terms", "add_loads"}


def size(arrays):
    """Bytes of all arrays of a model."""
    return sum(field.nbytes for field in arrays.flat)


def test_an_absent_effect_allocates_nothing():
    plain = ksd.compile_scene(fourbar())
    assert len(plain.arrays.springs.kind) == len(plain.plane.arrays.springs.kind) == 0
    for _, mention in COUNTED.values():
        scene = fourbar()
        mention(scene)
        off = ksd.compile_scene(scene, without=_switched(scene))
        assert size(off.arrays) == size(plain.arrays)
        assert off.arrays.plan.unknowns == plain.arrays.plan.unknowns
    assert len(plain.arrays.loads.node) == 0
    sprung = fourbar()
    sprung.joint_spring("lower left", stiffness=1.0)
    assert size(ksd.compile_scene(sprung).arrays) > size(plain.arrays)


def _switched(scene):
    """The words that switch off whatever the scene mentions."""
    return tuple(effects.mentioned_effects(scene.scene(), ksd.Mesh()).keys() - {"spatial", "shear"})


def test_gravity_without_mass_and_the_mesh_without_shear():
    scene = fourbar()
    scene.gravity = (0, -9.81, 0)
    massless = ksd.Material(E=200e9, G=76.9e9)
    joint = ksd.CrossFlexure(massless, length=0.1, angle=np.pi / 4, thickness=1e-3, widths=(0.04, 0.02))
    bare = fourbar(joint=joint)
    bare.gravity = (0, -9.81, 0)
    assert "gravity" not in effects.mentioned_effects(bare.scene(), ksd.Mesh())
    assert "without gravity: no link has a mass and no leaf a density" in str(ksd.compile_scene(bare))
    assert "gravity" in effects.mentioned_effects(scene.scene(), ksd.Mesh())
    choice = choose_effects(scene.scene(), ksd.Mesh(shear=False))
    assert not choice["shear"].present


def strip(lengths, *, said=lambda scene, links: None, material=HOT, t=0.5e-3):
    """A leaf 20 mm wide drawn in pieces of `lengths`, its tip turned about its length; `said` says more of it."""
    scene = ksd.Mechanism("pieces")
    links = [scene.ground, *scene.links(*(f"link {k}" for k in range(len(lengths))))]
    x = np.concatenate([[0.0], np.cumsum(lengths)])
    words = {"section": ksd.rectangle(t, 20e-3), "material": material, "width_axis": (0, 0, 1)}
    for k, (a, b) in enumerate(pairwise(x)):
        scene.leaf(links[k], links[k + 1], start=(a, 0, 0), end=(b, 0, 0), name=f"piece {k}", **words)
    scene.actuate(links[-1], about="x", name="twist")
    said(scene, links)
    return scene


def torsion_factors(scene):
    return {name: twist.factor for name, twist in run_twists(scene.scene()).items()}


def torsion(scene, **words):
    """Torque over twist [Nm/rad]."""
    return ksd.solve(scene, twist=1e-4, method="conventional", **words).forces["twist"] / 1e-4


@pytest.mark.parametrize("lengths", [(0.02, 0.02), (0.01, 0.03), (0.01, 0.01, 0.02)])
def test_warping_passes_through_pieces_of_one_leaf(lengths):
    """The bimoment where pieces meet is eliminated: together they twist like the whole leaf of 40 mm."""
    pieces, whole = strip(lengths), strip((0.04,))
    assert torsion(pieces, with_="warping") == pytest.approx(torsion(whole, with_="warping"), rel=1e-9)
    assert torsion(pieces) == pytest.approx(torsion(whole), rel=1e-9)
    factor = ksd.section.restrained_warping_factor(length=0.04, width=20e-3, nu=HOT.nu)
    assert torsion(pieces, with_="warping") / torsion(pieces) == pytest.approx(factor, rel=1e-9)
    assert "carries nothing else: one run, whose factors are 1." in str(ksd.compile_scene(pieces))
    # bending and its shear know nothing of it
    stiff = [ksd.solve(s, twist=0.0, with_="warping").stiffness("link 0" if s is whole else f"link {len(lengths) - 1}")
             for s in (pieces, whole)]  # fmt: skip
    assert stiff[0].support("z") == pytest.approx(stiff[1].support("z"), rel=1e-6)


@pytest.mark.parametrize(
    "said",
    [
        lambda s, links: s.mass(links[1], mass=0.1, at=(0.02, 0, 0)),
        lambda s, links: s.load(links[1], force=(0, 0, 1e-9), at=(0.02, 0, 0)),
        lambda s, links: s.turn_spring("ground", links[1], at=(0.02, 0, 0), axis="y", stiffness=1e-9),
    ],
    ids=["mass", "load", "spring"],
)
def test_a_body_between_pieces_holds_their_ends_plane(said):
    scene = strip((0.02, 0.02), said=said)
    factor = ksd.section.restrained_warping_factor(length=0.02, width=20e-3, nu=HOT.nu)
    # a spring of next to nothing holds the warping, not the twist
    assert torsion(scene, with_="warping") / torsion(scene) == pytest.approx(factor, rel=1e-6)
    assert "a body that holds their ends plane" in str(ksd.compile_scene(scene))


def unlike(sizes):
    """A strip of pieces of (length, thickness, width) [m], clamped at both ends, twisted at the far one."""
    scene = ksd.Mechanism("unlike")
    links = [scene.ground, *scene.links(*(f"link {k}" for k in range(len(sizes))))]
    at = 0.0
    for k, (long, thick, wide) in enumerate(sizes):
        words = {"section": ksd.rectangle(thick, wide), "material": HOT, "width_axis": (0, 0, 1)}
        scene.leaf(
            links[k], links[k + 1], start=(at, 0, 0), end=(at + long, 0, 0), name=f"piece {k}", **words
        )
        at += long
    scene.actuate(links[-1], about="x", name="twist")
    return scene


def vlasov(sizes):
    """Twist per torque [rad/Nm] of such a strip by collocation of T = GJ g - (EG g')', and of each piece."""
    ends = np.cumsum([0.0, *(long for long, _, _ in sizes)])
    stiff = np.array([HOT.G * ksd.rectangle(t, w).J for _, t, w in sizes])
    warping = stiff * np.array([w * w * (1 + HOT.nu) / 24 for _, _, w in sizes])
    scale = float(stiff.mean())

    def slope(u, y):
        """Every piece on 0..1: rate g (times the scale) and bimoment flux EG g' of each."""
        rows = []
        for i, (long, _, _) in enumerate(sizes):
            g, flux = y[2 * i], y[2 * i + 1]
            rows += [long * flux * scale / warping[i], long * (stiff[i] * g / scale - 1.0)]
        return np.array(rows)

    def met(a, b):
        inner = [
            v for i in range(len(sizes) - 1) for v in (b[2 * i] - a[2 * i + 2], b[2 * i + 1] - a[2 * i + 3])
        ]
        return np.array([a[0], b[-2], *inner])

    grid = np.linspace(0, 1, 201)
    found = solve_bvp(slope, met, grid, np.zeros((2 * len(sizes), 201)), tol=1e-10, max_nodes=100000)
    assert found.success
    fine = np.linspace(0, 1, 20001)
    rates = found.sol(fine)[::2] / scale
    return np.array(
        [long * np.trapezoid(g, fine) for (long, _, _), g in zip(sizes, rates, strict=True)]
    ), ends


@pytest.mark.parametrize(
    "sizes",
    [
        [(0.02, 0.5e-3, 0.02), (0.02, 1e-3, 0.02)],
        [(0.01, 0.5e-3, 0.02), (0.02, 2e-3, 0.03), (0.015, 0.4e-3, 0.02)],
    ],
    ids=["two", "stiff middle"],
)
def test_warping_passes_through_unlike_pieces(sizes):
    """The bimoment between unlike segments: every piece twists as Vlasov's equation along the whole run says."""
    scene = unlike(sizes)
    each, _ = vlasov(sizes)
    assert torsion(scene, with_="warping") == pytest.approx(1.0 / each.sum(), rel=1e-6)
    factors = torsion_factors(scene)
    free = [long / (HOT.G * ksd.rectangle(t, w).J) for long, t, w in sizes]
    assert [factors[f"piece {k}"] for k in range(len(sizes))] == pytest.approx(list(free / each), rel=1e-6)
    # between free and held plane at every meeting
    alone = sum(
        f / ksd.section.restrained_warping_factor(length=s[0], width=s[2], nu=HOT.nu)
        for f, s in zip(free, sizes, strict=True)
    )
    assert alone < each.sum() < sum(free)


def test_a_profile_is_a_run_of_its_own():
    """A stiffened middle drawn as a profile of one leaf twists as the same drawn in three pieces."""
    whole = ksd.Mechanism("stiff middle")
    tip = whole.link("tip")
    words = {"section": ksd.rectangle(0.4e-3, 20e-3), "material": HOT, "width_axis": (0, 0, 1)}
    middle = ksd.StiffenedMiddle(thickness=0.4e-3, width=20e-3, middle=2e-3, part=0.5)
    whole.leaf(whole.ground, tip, start=(0, 0, 0), end=(0.04, 0, 0), name="leaf", profile=middle, **words)
    whole.actuate(tip, about="x", name="twist")
    pieces = unlike([(0.01, 0.4e-3, 0.02), (0.02, 2e-3, 0.02), (0.01, 0.4e-3, 0.02)])
    one, three = (torsion(s, with_="warping") for s in (whole, pieces))
    assert one == pytest.approx(three, rel=1e-6)


def test_a_piece_drawn_backwards_is_the_same_run():
    sizes = [(0.02, 0.5e-3, 0.02), (0.01, 1e-3, 0.02)]
    taper = ksd.Taper(thickness=(1e-3, 2e-3), width=(0.02, 0.02))
    words = {"material": HOT, "width_axis": (0, 0, 1)}
    found = []
    for turned in (False, True):
        scene = ksd.Mechanism("backwards")
        middle, end = scene.links("middle", "end")
        scene.leaf(
            scene.ground,
            middle,
            start=(0, 0, 0),
            end=(0.02, 0, 0),
            name="one",
            section=ksd.rectangle(*sizes[0][1:]),
            **words,
        )
        ends = {"start": (0.02, 0, 0), "end": (0.03, 0, 0)}
        profile = taper
        if turned:
            ends = {"start": ends["end"], "end": ends["start"]}
            profile = ksd.Taper(thickness=taper.thickness[::-1], width=taper.width)
        pair = (end, middle) if turned else (middle, end)
        scene.leaf(*pair, name="two", section=ksd.rectangle(*sizes[1][1:]), profile=profile, **ends, **words)
        scene.actuate(end, about="x", name="twist")
        found.append((torsion_factors(scene), torsion(scene, with_="warping")))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-12)
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-6)


def test_corners_and_bodies_are_no_run():
    words = {"section": ksd.rectangle(0.5e-3, 20e-3), "material": HOT, "width_axis": (0, 0, 1)}
    corner = strip((0.02,))
    corner.leaf("link 0", corner.link("end"), start=(0.02, 0, 0), end=(0.02, 0.02, 0), name="round", **words)
    assert run_twists(corner.scene()) == {}
    leaf = corner.scene().leaf_names()["round"]
    x = leaf.length * _piece(leaf, True).slices[0].decay
    # torque of a strip that cannot warp at one end: G J / (1 - tanh(x) / x) per twist (Timoshenko 1945)
    assert half_clamped_torsion_factor(leaf) == pytest.approx(1 / (1 - np.tanh(x) / x), rel=1e-12)
    fold = ksd.Mechanism("fold")
    middle, end = fold.links("middle", "end")
    fold.leaf(fold.ground, middle, start=(0, 0, 0), end=(0.02, 0, 0), name="first", **words)
    fold.leaf(middle, end, start=(0.02, 0, 0), end=(0.02, 0.02, 0), name="round", **words)
    fold.actuate(end, along="x", at=(0.02, 0.02, 0))
    said = str(ksd.compile_scene(fold, with_="warping"))
    assert "leaf springs 'first' and 'round' meet at an angle on 'middle'" in said
    assert (
        f"{clamped_twist(leaf).factor:.3g}" in said
        and f"{half_clamped_torsion_factor(leaf):.3g} if it did not hold" in said
    )
    assert "meet end to end" not in str(ksd.compile_scene(fourbar()))


def test_listed_parts_of_the_drawing():
    joint = ksd.CircularNotchHinge(STEEL, radius=3e-3, minimum=0.3e-3, width=10e-3)
    assert "with a circular notch" in str(ksd.compile_scene(single_joint(joint)))
    assert compiling.compile_as_is and leaves.stress_free_leaf
