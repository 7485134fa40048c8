"""One verdict for a pose, whoever asks: `ksd.solve`, sweeps, batches, gradients, jobs and the command line."""

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.cli import main
from ksd.solvers import branch_check, five_step_solver
from ksd.solvers.left_out import LeftOut
from ksd.units import mm

EULER = np.pi**2 * STEEL.E * 20 * mm * (0.5 * mm) ** 3 / 12 / (4 * (100 * mm) ** 2)
"""Load that buckles the upright leaf spring below, clamped at its foot [N] (Euler)."""
QUIET = {"progress": False, "questions": ("force", "stress")}
METHODS = ("reduced", "full", "conventional", None)


def upright(load):
    """A leaf spring of 100 mm that carries a load, and is twisted about its own axis."""
    scene = ksd.Mechanism("upright leaf")
    top = scene.link("top", at=(0, 0.1, 0))
    scene.leaf(
        scene.ground, top, start=(0, 0, 0), end=(0, 0.1, 0), section=ksd.rectangle(0.5 * mm, 20 * mm), material=STEEL,
        width_axis="z",
    )  # fmt: skip
    scene.load(top, force=(0, -load, 0), at=(0, 0.1, 0), name="weight")
    scene.actuate(top, about="y", name="turn")
    return scene


def loaded_guide(load):
    """A parallel guide that carries a load along its leaf springs: beyond 8 pi^2 EI/L^2 they buckle between their ends."""
    scene = ksd.Mechanism("loaded guide")
    stage = scene.link("stage")
    guide = ksd.ParallelGuide(STEEL, length=100 * mm, thickness=0.5 * mm, width=20 * mm, spacing=60 * mm)
    scene.join(scene.ground, stage, guide, at=(0, 0, 0), axis="z", toward="y", name="guide")
    scene.actuate_joint("guide", name="push")
    scene.load(stage, force=(0, -load, 0), at=(0, 0.1, 0), name="weight")
    return scene


def sentence(scene, **drives):
    with pytest.raises(ksd.TrustError) as refused:
        ksd.solve(scene, **drives)
    return str(refused.value)


def test_a_sweep_refuses_what_a_solve_refuses_with_its_sentence(tmp_path, capsys):
    heavy = upright(1.4 * EULER)
    said = sentence(heavy, turn=0.1)
    table = ksd.sweep(heavy, turn=[0.05, 0.1], **QUIET)
    assert table["status"][1] == said and [row["turn_deg"] for row in table.refused] == list(
        table["turn_deg"]
    )
    assert "0 failed, 2 refused" in repr(table) and "stress_MPa" not in table.columns
    flagged = ksd.sweep(heavy, turn=[0.05, 0.1], strict=False, **QUIET)
    assert flagged["status"] == table["status"] and len(flagged.refused) == 2
    assert flagged["turn_moment_Nm"][1] == pytest.approx(
        ksd.solve(heavy, turn=0.1, strict=False).forces["turn"]
    )
    light = ksd.sweep(upright(0.7 * EULER), turn=[0.05, 0.1], **QUIET)
    assert light["status"] == ["ok", "ok"] and not light.refused
    with pytest.raises(ksd.SceneError, match="strict"):
        ksd.sweep(heavy, turn=0.1, strict="no", **QUIET)
    path = tmp_path / "heavy.toml"
    ksd.save_scene(heavy, path)
    assert main(["sweep", str(path), "--quiet", "--set", "turn=0deg:5deg:2", "--question", "force"]) == 3
    assert "not to be trusted: UNSTABLE" in capsys.readouterr().err


def test_refused_poses_of_a_load_case_are_gaps():
    """Under the load that the leaf spring does not bear, not under the other; curves end where poses are refused."""
    scene = upright(0.0)
    cases = {
        name: [{"link": "top", "force": (0, -load, 0), "at": (0, 0.1, 0)}]
        for name, load in (("light", 0.7 * EULER), ("heavy", 1.4 * EULER))
    }
    table = ksd.sweep(scene, turn=np.linspace(0, 0.1, 3), loads=cases, **QUIET)
    moment, heavy = table["turn_moment_Nm"], np.array(table["load_case"]) == "heavy"
    assert np.isnan(moment[heavy]).all() and np.isfinite(moment[~heavy]).all()
    assert len(table.refused) == len(table.failures) == 3
    drawn = [line.get_ydata() for line in table.plot("force").axes[0].lines if len(line.get_ydata()) == 3]
    assert any(np.isnan(np.asarray(y, float)).all() for y in drawn)


def test_a_gradient_is_refused_where_a_solve_is():
    heavy = upright(1.4 * EULER)
    with pytest.raises(ksd.TrustError) as refused:
        ksd.gradient(heavy, questions="force", turn=0.1)
    assert str(refused.value) == sentence(heavy, turn=0.1)
    flagged = ksd.gradient(heavy, questions="force", turn=[0.1], strict=False)
    assert flagged.refused == {0: str(refused.value)} and str(refused.value) in str(flagged)
    # a leaf spring turns about its axis with GJ/L, which a load along it does not change to first order
    slope = float(flagged["turn_moment_Nm", "turn"][0])
    other = ksd.gradient(upright(0.7 * EULER), questions="force", turn=[0.1])
    assert not other.refused and slope == pytest.approx(float(other["turn_moment_Nm", "turn"][0]), rel=0.03)


@pytest.mark.parametrize("options", ({"method": "reduced"}, {"method": "full"}, {"tabulated": True}))
def test_a_batch_sees_leaf_springs_that_buckle_inside_a_joint(options):
    """Condensed joints cannot buckle; each of the two clamped leaf springs does beyond 4 pi^2 EI/L^2."""
    critical, method = 2 * 16 * EULER, options.get("method", "reduced")
    push = [5 * mm, 10 * mm]
    light = ksd.batch(loaded_guide(0.6 * critical), push=push, threads=1, **options)
    assert light.solved == 2
    heavy = ksd.batch(loaded_guide(1.2 * critical), push=push, threads=1, **options)
    said = heavy.why(0, 1)
    assert (
        heavy.solved == 0
        and np.isnan(heavy.forces["push"]).all()
        and said.startswith("not to be trusted: UNSTABLE")
    )
    with pytest.raises(ksd.TrustError) as refused:
        ksd.solve(loaded_guide(1.2 * critical), push=10 * mm, method=method, estimate=False, mesh=ksd.Mesh())
    assert said.split(";")[0] == str(refused.value).split(";")[0]
    flagged = ksd.batch(loaded_guide(1.2 * critical), push=push, threads=1, strict=False, **options)
    assert flagged.solved == 0 and flagged.why(0, 1) == said and np.isfinite(flagged.forces["push"]).all()


@pytest.mark.parametrize("method", ("reduced", "full"))
def test_a_batch_carries_doubts_about_the_branch(method, monkeypatch):
    for module in (branch_check, five_step_solver):
        monkeypatch.setattr(module, "MANY_ITERATIONS", 0)
    scene = loaded_guide(20.0)
    with pytest.raises(ksd.TrustError) as refused:
        ksd.solve(scene, push=10 * mm, method=method, estimate=False, mesh=ksd.Mesh())
    found = ksd.batch(scene, push=10 * mm, method=method, mesh=ksd.Mesh(), threads=1, questions="stress")
    assert found.why(0, 0) == str(refused.value) and "another branch is possible" in found.why(0, 0)
    assert "stress_MPa" not in found.answers
    loose = ksd.batch(
        scene, push=10 * mm, method=method, mesh=ksd.Mesh(), threads=1, questions="stress", strict=False
    )
    assert loose.why(0, 0) == found.why(0, 0) and loose["stress_MPa"][0, 0] > 100


def wide_strip(**words):
    """A wide cantilever of one leaf spring, its tip bent down: a plate, (1 - nu^2) times stiffer than the beam that it is
    modelled as unless the scene considers plate stiffening."""
    scene = ksd.Mechanism("wide strip")
    tip = scene.link("tip", at=(0.1, 0, 0))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(0.3 * mm, 60 * mm), material=STEEL,
        width_axis="z",
    )  # fmt: skip
    scene.actuate(tip, along="y", at=(0.1, 0, 0), name="push")
    return ksd.solve(scene, push=30 * mm, **words)


def test_the_error_of_a_pose_is_the_larger_of_its_own_and_of_what_its_model_leaves_out():
    """The change that is told is that of a second solve with the effect."""
    pose, stiffer = wide_strip(), wide_strip(effects="all")
    change = stiffer.forces["push"] / pose.forces["push"] - 1.0
    assert pose.error.relative < 1e-6 < 0.01 < change < 0.1
    assert pose.uncertainty[1:] == ("plate", "force")
    assert pose.uncertainty.relative == pytest.approx(change, rel=0.02)
    said, told = pose.trust.trusted.sentence, f"{100 * pose.uncertainty.relative:.2g} %"
    assert pose.trusted and f"within {told}: its model leaves out plate stiffening (force +{told}" in said
    assert "an estimated error of under 1e-06 % against it" in said
    page = " ".join(str(pose).split())
    assert (
        f"Estimated error: {told}, the force by plate stiffening, which is not in the model; against" in page
    )
    numbers = pose.as_dict()["uncertainty"]
    assert numbers["effect"] == "plate" and numbers["percent"] == pytest.approx(100 * change, rel=0.02)
    assert stiffer.uncertainty[1:] == ("", "") and "leaves out" not in stiffer.trust.trusted.sentence
    # named where it changes more than the accuracy asked for
    coarse = wide_strip(accuracy=0.2).trust.trusted.sentence
    assert "plate" not in coarse and f"within {told}, of which an estimated error of" in coarse


def test_another_effect_left_out_shows_up_by_itself_and_decides():
    pose = wide_strip()
    changes = {"force": -0.02, "displacement": 0.0, "support_stiffness": 0.15}
    pose.__dict__["left_out"] = LeftOut({"clamped_width": changes})
    said = pose.trust.trusted.sentence
    assert pose.trusted
    assert "within 2 %: its model leaves out clamped width (force -2 %, support stiffness +15 %)" in said
    assert "clamped width" in str(pose)
    pose = wide_strip()
    pose.__dict__["left_out"] = LeftOut({"clamped_width": {"force": 0.3}})
    assert not pose.trusted
    said = "not to be trusted: its model leaves out clamped width (force +30 %), more than 10 %"
    assert said in pose.trust.trusted.sentence


@pytest.mark.parametrize(("push", "trusted"), ((1, True), (45, False)))
def test_an_error_above_a_tenth_is_not_trusted(push, trusted):
    """Leaf springs of constant stiffness, by which a guide moved far is far off."""
    words = {"push": push * mm, "method": "constant", "strict": False, "effects": "all"}
    pose = ksd.solve(loaded_guide(0.0), **words)
    assert (pose.error.relative <= 0.1) == trusted == pose.trusted
    if not trusted:
        assert "not to be trusted" in pose.trust.trusted.sentence


def test_a_basis_of_the_plane_alone_refuses_load_out_of_it():
    """Its stiffness along z is far above that of the full basis: the force is refused, the stiffness warned of."""

    def strip(force):
        scene = upright(0.0)
        scene.load("top", force=force, at=(0, 0.1, 0))
        return scene

    flat, full = ksd.ModalBasis(plane=True), ksd.ModalBasis()
    with pytest.raises(
        ksd.SceneError, match=r"carries load out of its plane, .*plane=True.*; give ksd.ModalBasis"
    ):
        ksd.solve(strip((0, 0, 1.0)), turn=0.0, basis=flat, method="modal")
    push = {"turn": 0.0, "method": "modal"}
    one, other = (ksd.solve(strip((1.5, 0, 0)), basis=basis, **push) for basis in (flat, full))
    stiffness = [p.stiffness("top", at=(0, 0.1, 0)).supports["z"] for p in (one, other)]
    assert stiffness[0] > 2 * stiffness[1]
    assert any("plane=True" in w and "far too high" in w for w in one.warnings)
    assert not any("plane=True" in w for w in other.warnings)
    assert one.displacement("top")[0] == pytest.approx(other.displacement("top")[0], rel=1e-3)


def test_a_batch_tells_no_similarity_of_modes_and_a_sweep_an_infinite_stiffness():
    """Modes of a batch are numbered at every pose and followed from none; the point of `held` is held in all directions."""
    scene = loaded_guide(0.0)
    push = {"push": [1 * mm, 8 * mm]}
    words = {"questions": ("frequencies", "support_stiffness"), "link": "stage", "at": (0, 0.1, 0)}
    found = ksd.batch(scene, **push, threads=1, **words)
    table = ksd.sweep(scene, **push, progress=False, **words)
    assert "mac" not in found.answers and "intended_Hz" in found.answers and table["mac"].max() <= 1.0
    held = upright(0.0)
    for axis in "xyz":
        held.support("top", along=axis, at=(0, 0.1, 0))
    asked = {"link": "top", "at": (0, 0.1, 0)}
    worst = ksd.solve(held, turn=0.1).stiffness(**asked).worst
    table = ksd.sweep(held, turn=[0.0, 0.1], questions="support_stiffness", progress=False, **asked)
    assert np.isinf(worst[0]) and np.isinf(table["support_worst_N_per_m"]).all()
    assert table["support_worst_Nm_per_rad"][1] == pytest.approx(worst[1], rel=1e-6)
    assert "inf" in str(table)
    # nothing to draw where all is infinite
    visible = [panel for panel in table.plot("support_stiffness").axes if panel.get_visible()]
    assert [panel.get_ylabel() for panel in visible] == ["support stiffness [Nm/rad]"]
