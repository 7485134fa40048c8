"""One verdict for a pose, whoever asks: `ksd.solve`, sweeps, batches, gradients, jobs and the command line."""

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.cli import main
from ksd.solve import branch_check, five_step_solver
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
