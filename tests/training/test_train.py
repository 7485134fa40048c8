"""Training: the published facts of the cross flexure, drawn joints, refusals, interruption and resumption."""

import math
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest
from processes import environment

import ksd
from ksd.errors import SceneError
from ksd.library import Parameter, read_record
from ksd.library.record_files import shipped_folder
from ksd.scene import CrossFlexure, DrawnJoint, Material, Motion
from ksd.scene.joint import joint_proportions
from ksd.section import rectangle
from ksd.training import Design, train
from ksd.training import jobs as jobs_module
from ksd.training.catalogue import design_of
from ksd.training.designs import without_mesh_choices
from ksd.training.sampling import (
    SamplingPlan,
    _contact_points,
    _driven_model,
    _solve_grid,
    even_line,
    sample_joint,
)
from ksd.training.softness import rest_stiffness
from ksd.training.stroke_checks import check_clear

ROOT = Path(__file__).resolve().parents[2]
STEEL = Material(E=200e9, G=76.9e9)
EQUAL = {"angle": math.radians(45), "width_ratio": 1.0}
SHAPES = {"angle": (math.radians(44), math.radians(46)), "width_ratio": (0.9, 1.1)}


def cross(**changed):
    numbers = {"length": 0.1, "angle": math.radians(45), "thickness": 1e-3, "widths": (0.04, 0.02), **changed}
    return CrossFlexure(STEEL, **numbers)


@pytest.fixture(scope="module")
def threads():
    with ThreadPoolExecutor(2) as pool:
        yield pool


@pytest.fixture(scope="module")
def trained(tmp_path_factory, threads):
    """A narrow range around table 1 of paper 1, three meshes."""
    folder = tmp_path_factory.mktemp("database")
    return train(
        "cross_flexure", shapes=SHAPES, meshes=("strain", 2, 4), out=folder, executor=threads, progress=False,
        trained="2024-05-01",
    )  # fmt: skip


def test_amplitudes_of_the_cross_flexure(trained):
    """leaf-elements note: L a_0 = theta exactly, outer = (-1)^k inner, L a_k has the parity opposite to k."""
    functions = trained.contract(EQUAL, "strain")
    inner, outer = functions.amplitudes[0, 7:], functions.amplitudes[1, 7:]
    theta = np.linspace(-1, 1, 21) * math.radians(75)
    at = functions.at(theta[:, None], "amplitudes")
    np.testing.assert_allclose(at[:, :, 7], np.repeat(theta[:, None], 3, axis=1), atol=1e-9)
    even = functions.powers[:, 0] % 2 == 0
    for k in range(5):
        np.testing.assert_allclose(outer[k], (-1) ** k * inner[k], atol=2e-4)
        assert np.abs(inner[k, even if k % 2 == 0 else ~even]).max() < 2e-5
    np.testing.assert_array_equal(functions.amplitudes[:, :7], 0.0)
    # three-term fits over 0..75 degrees, as printed there
    t = np.linspace(0, 1, 50) * math.radians(75)
    curve = functions.at(t[:, None], "amplitudes")[:, 0, 7:]
    for k, powers, printed in (
        (1, (2, 4, 6), (0.49927, -0.03122, 0.00344)),
        (2, (3, 5, 7), (-0.08285, 0.01570, -0.00174)),
        (3, (4, 6, 8), (-0.01654, 0.00258, -0.00033)),
    ):
        fitted = np.linalg.lstsq(t[:, None] ** np.array(powers), curve[:, k], rcond=None)[0]
        np.testing.assert_allclose(np.sign(fitted[0] / printed[0]) * fitted, printed, atol=1.5e-3)


def test_pivot_shift_is_even_with_leading_coefficient_one_over_24(trained):
    """acceptance B: D/D0 even, 1/24 at 45 degrees; AB turns by theta/2 exactly; D/D0 at 75 degrees."""
    for mesh, at_75 in (("strain", 1.041186), (2, 1.073320), (4, 1.048950)):
        functions = trained.contract(EQUAL, mesh)
        chord = functions.interface[3] / math.cos(math.radians(45))
        odd = functions.powers[:, 0] % 2 == 1
        assert not chord[odd].any()
        assert chord[0] == pytest.approx(1.0, abs=2e-6)
        pose = functions.at([[math.radians(75)], [0.3]])
        assert pose[0, 3] / math.cos(math.radians(45)) == pytest.approx(at_75, abs=3e-6)
        np.testing.assert_allclose(pose[:, 2], [math.radians(75), 0.3], atol=1e-9)
        np.testing.assert_allclose(pose[:, [0, 1, 4, 5]], 0.0, atol=1e-6)
        if mesh == "strain":
            assert chord[functions.powers[:, 0] == 2][0] == pytest.approx(1 / 24, abs=2e-4)


def test_chord_rotations_of_mirrored_elements_add_up_to_theta(trained):
    """acceptance B: beta(leaf 1, k) + beta(leaf 2, n+1-k) = theta."""
    rotations = trained.contract(EQUAL, 4).at([0.9], "rotations")[:, :, 2]
    np.testing.assert_allclose(rotations[0, :4] + rotations[1, 3::-1], 0.9, atol=2e-6)


def test_errors_on_fresh_shapes_are_stored_and_small(trained):
    for r in trained.residuals:
        limit = {"interface": 2e-6, "rotations": 1e-5, "amplitudes": 2e-5, "wrench": 5e-4}[r.group]
        assert 0 < r.fresh_max < limit and r.fresh_rms <= r.fresh_max
    assert trained.samples[0] >= 16 and trained.samples[1] == 8


def test_a_shape_inside_the_range_equals_its_own_model(trained):
    shape = {"angle": math.radians(45.7), "width_ratio": 0.94}
    joint = cross(angle=shape["angle"], widths=(0.04, 0.5 * 0.94 * 0.04))
    plan = SamplingPlan((even_line(-1.3, 1.3, 5),), ("strain", 4), (4, 3, 5))
    design = Design("cross_flexure", (), design_of(joint).make)
    for (mesh, group), values in sample_joint(design.joint(np.zeros(0)), plan).items():
        at = trained.contract(shape, mesh).at(plan.grid * math.radians(75), group)
        np.testing.assert_allclose(at, values, atol={"wrench": 5e-4, "amplitudes": 3e-5}.get(group, 1e-5))


def test_evidence_thickness_and_length_do_not_matter_shape_does(trained):
    found = {(e.parameter, e.change): e for e in trained.evidence}
    assert found["thickness", "half"].rotations < 1e-4
    assert found["thickness", "twice"].rotations < 3e-4
    assert found["length", "twice"].rotations < 1e-4
    assert found["material", "aluminium for steel"].rotations < 1e-5
    # one degree and a tenth already change more than any of those
    for name in ("angle", "width_ratio"):
        assert max(e.rotations for e in trained.evidence if e.parameter == name) > 2e-3


def test_same_inputs_same_bytes_and_nothing_left_behind(trained, tmp_path, threads):
    options = {
        "shapes": SHAPES,
        "meshes": (2,),
        "executor": threads,
        "progress": False,
        "trained": "2024-05-01",
    }
    for name in ("a", "b"):
        train("cross_flexure", out=tmp_path / f"{name}.h5", **options)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "b.h5"]
    assert read_record(tmp_path / "a.h5").trained == "2024-05-01"


def test_a_broken_run_keeps_what_is_done(tmp_path, threads, monkeypatch):
    """The result is the same as without the interruption, and finished shapes are not computed again."""
    options = {
        "shapes": SHAPES,
        "meshes": (2,),
        "executor": threads,
        "progress": False,
        "trained": "2024-05-01",
    }
    calls_of_a_whole_run, calls, again = [], [], []

    def counted(into):
        return lambda job: into.append(job) or sample_joint(job.joint, job.plan)

    monkeypatch.setattr(jobs_module, "run_job", counted(calls_of_a_whole_run))
    train("cross_flexure", out=tmp_path / "whole.h5", **options)

    def broken(job):
        calls.append(job)
        if len(calls) > 20:
            raise KeyboardInterrupt
        return sample_joint(job.joint, job.plan)

    monkeypatch.setattr(jobs_module, "run_job", broken)
    with pytest.raises(KeyboardInterrupt, match=r"\.part\.partial'; train it again to continue"):
        train("cross_flexure", out=tmp_path / "part.h5", **options)
    kept = list((tmp_path / ".part.partial").glob("*.npz"))
    assert not (tmp_path / "part.h5").exists() and 15 <= len(kept) <= 20
    # a damaged piece is computed again
    kept[0].write_bytes(kept[0].read_bytes()[:-40])
    monkeypatch.setattr(jobs_module, "run_job", counted(again))
    train("cross_flexure", out=tmp_path / "part.h5", **options)
    assert (tmp_path / "part.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()
    # besides the damaged one, one that shows that the code still gives what is kept
    assert len(again) == len(calls_of_a_whole_run) - len(kept) + 2
    assert not (tmp_path / ".part.partial").exists()


def test_what_is_kept_is_not_used_when_the_code_gives_something_else(tmp_path, threads, monkeypatch):
    options = {"meshes": ("strain",), "executor": threads, "progress": False, "trained": "2024-05-01"}
    calls = []

    def broken_and_otherwise(job):
        calls.append(job)
        if len(calls) > 6:
            raise KeyboardInterrupt
        samples = sample_joint(job.joint, job.plan)
        return {key: values + 1e-6 for key, values in samples.items()}

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(jobs_module, "run_job", broken_and_otherwise)
        train(guide(), out=tmp_path / "part.h5", **options)
    assert list((tmp_path / ".part.partial").glob("*.npz"))
    train(guide(), out=tmp_path / "part.h5", **options)
    train(guide(), out=tmp_path / "whole.h5", **options)
    assert (tmp_path / "part.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()


SCRIPT = """
from ksd.training import train
if __name__ == "__main__":
    train("cross_flexure", out={out!r}, trained="2024-05-01", progress=False)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_ctrl_c_in_a_process_run_keeps_finished_shapes(tmp_path):
    script = tmp_path / "run.py"
    script.write_text(SCRIPT.format(out=str(tmp_path)))
    # a test run started in the background is deaf to Ctrl-C, and so would be what it starts
    process = subprocess.Popen(
        [sys.executable, str(script)], env=environment(), stderr=subprocess.PIPE, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    folder = tmp_path / ".cross_flexure.partial"
    # kernels may have to be compiled first
    deadline = time.monotonic() + 300
    while time.monotonic() < deadline and len(list(folder.glob("*.npz"))) < 5:
        time.sleep(0.02)
    # as a terminal does it: to the whole group
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(timeout=60) != 0
    assert b"KeyboardInterrupt" in process.stderr.read()
    assert len(list(folder.glob("*.npz"))) >= 5 and not (tmp_path / "cross_flexure.h5").exists()


def test_interrupted_training_ends_its_processes(tmp_path):
    """The interpreter would wait for their tasks at its exit."""
    before = active_children()
    options = {"executor": None, "resume": True, "progress": False, "title": "train"}
    with pytest.raises(KeyboardInterrupt), jobs_module.Jobs(tmp_path / "kept", **options) as jobs:
        pool = jobs._executor(jobs_module.Job(cross(), None))
        assert pool.submit(abs, -1).result() == 1
        own = [child for child in active_children() if child not in before]
        for _ in own:
            pool.submit(time.sleep, 120)
        raise KeyboardInterrupt
    for child in own:
        child.join(60)
    assert own and not any(child.is_alive() for child in own)


def test_a_single_joint_trains_as_drawn(tmp_path, threads):
    record = train(cross(), out=tmp_path, executor=threads, meshes=("strain", 3), progress=False)
    assert record.shape_names == ("angle", "width_ratio") and record.samples == (1, 1)
    functions = record.contract(cross().shape(), 3)
    assert functions.rotations.shape[:3] == (3, 5, 3)
    with pytest.raises(ksd.RangeError, match="angle"):
        record.contract(cross(angle=0.8).shape(), 3)


def test_internal_blocks_are_recorded(tmp_path, threads):
    """Two cross flexures in series (a cartwheel drawn flat): the block between them turns by half."""
    one = cross(widths=(0.02, 0.01))
    shift = one.pose_B[0]
    first = [replace(leaf, end_block="middle", name=f"{leaf.name}_1") for leaf in one.leaves()]
    second = [
        replace(
            leaf, start_block="middle", name=f"{leaf.name}_2",
            start=(leaf.start[0] + shift, *leaf.start[1:]), end=(leaf.end[0] + shift, *leaf.end[1:]),
        )
        for leaf in one.leaves()
    ]  # fmt: skip
    joint = DrawnJoint(
        "double", blocks={"A": (0, 0, 0), "middle": one.pose_B, "B": (2 * shift, 0, 0)}, leaves=first + second,
        motions=[Motion("angle", "rotation", (0, 0, 1), (-1.0, 1.0))], length=0.1, held_by_others=True,
    )  # fmt: skip
    record = train(joint, out=tmp_path, executor=threads, meshes=("strain", 2), progress=False)
    assert record.blocks == ("middle",) and read_record(tmp_path / "double.h5").blocks == ("middle",)
    blocks = record.contract({}, "strain").at([0.8], "blocks")
    assert blocks[0, 2] == pytest.approx(0.4, abs=1e-6)
    assert blocks[0, 3] == pytest.approx(shift / 0.1, rel=0.02)


def guide(*, apart=0.03, scale=1.0, thicker=1.0, wide=(0, 0, 1), taper=0.0, wave=0.0):
    """A parallel guide: two leaf springs along y, B moves along x."""
    L = 0.1 * scale
    curve = ksd.FreeCurve.sine([wave], chord=L) if wave else None
    leaves = [
        ksd.Leaf(
            start=(x, 0, 0), end=(x, L, 0), width_axis=wide, section=rectangle(t, 0.03), material=STEEL, name=name,
            curve=curve,
            profile=ksd.Taper(thickness=(t * (1 - taper), t * (1 + taper)), width=(0.03, 0.03)) if taper else None,
        )
        for name, x, t in (("left", -apart * scale, 0.5e-3), ("right", apart * scale, thicker * 0.5e-3))
    ]  # fmt: skip
    motion = Motion("slide", "translation", (1, 0, 0), (-0.02 * scale, 0.02 * scale))
    return DrawnJoint("guide", blocks={"A": (0, 0, 0), "B": (0, L, 0)}, leaves=leaves, motions=[motion])


def test_a_translation_is_recorded_over_the_joint_length(tmp_path, threads):
    record = train(guide(), out=tmp_path, executor=threads, meshes=("strain",), progress=False)
    np.testing.assert_allclose(record.motion_range, [[-0.2, 0.2]])
    pose = record.contract({}, "strain").at([0.1])
    place = pose[3:]
    # acceptance D: shortening 6.02045e-3 L at a stroke of 0.1 L, rotation held there and free here
    assert place[0] == pytest.approx(0.1, abs=2e-4) and place[1] == pytest.approx(1 - 6.02e-3, abs=1e-4)


def test_a_record_of_a_joint_as_drawn_is_refused_by_one_drawn_otherwise(tmp_path, threads):
    words = {"executor": threads, "meshes": ("strain",), "progress": False}
    train(guide(), out=tmp_path, **words)
    record = read_record(tmp_path / "guide.h5")

    def solved(joint, record=record):
        m = ksd.Mechanism("one")
        stage = m.link("stage")
        m.actuate(joint=m.join(m.ground, stage, joint, at=(0, 0, 0), axis="z", toward="y"), name="slide")
        return ksd.Solver(m, records=lambda family: record)(slide=0.01 * joint.length / 0.1, method="reduced")

    # twice as large, or another scale of thickness: the same joint
    assert solved(guide()).trusted and solved(guide(scale=2.0)).trusted
    for other, said in (
        (guide(apart=0.02), r"start of leaf 1, x: -0\.3 there, -0\.2 here"),
        # the same leaf springs, but what a record tells of them is in their axes
        (guide(wide=(0, 0, -1)), r"width axis of leaf 1, z: 1 there, -1 here"),
        (guide(thicker=1.1), r"bending stiffness of leaf 2: 1 there, 1\.331 here"),
        (guide(taper=0.1), r"bending stiffness of leaf 1 at 0\.05: 1 there, 0\.753571 here"),
        (guide(wave=0.01), r"curvature of leaf 1 at 0\.05, z: 0 there, 0\.0597\d+ here"),
    ):
        with pytest.raises(
            ksd.RecordError, match=rf"guide is of a joint drawn in other proportions \({said}, lengths over"
        ):
            solved(other)
        # records of before hold no drawing: the error figure tells
        solved(other, replace(record, design={"length": 0.1}))
    # small beside the stiffness of the first leaf spring, and four times as stiff as drawn
    thin = replace(record, design=record.design | joint_proportions(guide(thicker=0.05)))
    with pytest.raises(ksd.RecordError, match=r"bending stiffness of leaf 1: 8000 there, 1953\.1\d here"):
        solved(guide(thicker=0.08), thin)


def stage(**drawn):
    m = ksd.Mechanism("one")
    link = m.link("stage")
    joint = m.join(m.ground, link, guide(**drawn), at=(0, 0, 0), axis="z", toward="y")
    m.actuate(joint=joint, name="slide")
    return m


def test_every_design_of_a_batch_is_judged_by_its_own_drawing(tmp_path, threads, monkeypatch):
    train(guide(), out=tmp_path, executor=threads, meshes=("strain",), progress=False)
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    apart = [0.02, 0.03] * 10
    found = ksd.batch(stage, designs=[{"apart": a} for a in apart], slide=[0.01], questions="force")
    assert [d for d, *_ in found.failures] == list(range(0, 20, 2))
    assert "start of leaf 1, x: -0.3 there, -0.2 here" in found.why(18, 0)
    words = {"minimise": "stress_MPa", "slide": 0.01}
    # jobs take the record where it holds for all designs
    for bounds, method in (({"apart": (0.02, 0.04)}, "conventional"), ({"scale": (0.8, 1.2)}, "full")):
        made = ksd.Job(stage, vary=bounds, **words)
        assert made.method == method and np.isfinite(made.values(made.point(None))).all()


def test_leaving_the_plane_is_refused(tmp_path, threads):
    """One outer leaf missing: a pure moment also tilts B."""
    whole = cross(widths=(0.04, 0.01))
    motions = [Motion("angle", "rotation", (0, 0, 1), (-1.0, 1.0))]
    lopsided = DrawnJoint("lopsided", blocks=whole.blocks(), leaves=whole.leaves()[:2], motions=motions)
    with pytest.raises(SceneError, match="lopsided: interface B leaves its plane"):
        train(lopsided, out=tmp_path, executor=threads, meshes=("strain",), progress=False)


def test_a_motion_that_is_not_the_soft_one_is_refused(tmp_path):
    whole = cross()
    for kind, axis in (("rotation", (1, 0, 0)), ("translation", (1, 0, 0))):
        stiff = DrawnJoint(
            "stiff",
            blocks=whole.blocks(),
            leaves=whole.leaves(),
            motions=[Motion("stiff", kind, axis, (-1e-3, 1e-3))],
        )
        with pytest.raises(SceneError, match="stiff: the intended motion 'stiff' is not the soft one"):
            train(stiff, out=tmp_path, progress=False)


def test_stiffness_at_rest():
    """acceptance B: K0 = 13.33333 Nm/rad about the axis; kx = 8.0008e7 N/m with all else held."""
    stiffness = rest_stiffness(without_mesh_choices(cross()))
    assert stiffness[0, 0] / 0.1**2 == pytest.approx(8.0008e7, rel=1e-3)
    assert 1 / np.linalg.inv(stiffness)[5, 5] == pytest.approx(13.33333, rel=1e-4)


def test_a_stroke_that_cannot_be_reached_is_a_sentence(tmp_path, threads):
    whole = cross()
    motions = [Motion("angle", "rotation", (0, 0, 1), (-2.9, 2.9))]
    far = DrawnJoint("far", blocks=whole.blocks(), leaves=whole.leaves(), motions=motions)
    with pytest.raises(SceneError, match=r"far .1 mesh. at angle = .* reduce its range"):
        train(far, out=tmp_path, executor=threads, meshes=(1,), progress=False)


def shuttle(rise):
    """Two pairs of inclined leaf springs against each other, a bistable shuttle that moves along x."""
    leaves = [
        ksd.Leaf(
            start=(x, 0.1 * side, 0), end=(x + rise, 0.005 * side, 0), width_axis=(0, 0, 1),
            section=rectangle(5e-4, 0.02), material=STEEL, name=f"{side} {x}",
        )
        for x in (0.0, 0.06) for side in (-1, 1)
    ]  # fmt: skip
    motion = Motion("push", "translation", (1, 0, 0), (-2 * rise, 0.4 * rise))
    return DrawnJoint(
        "shuttle", blocks={"A": (0, 0, 0), "B": (rise, 0, 0)}, leaves=leaves, motions=[motion], length=0.1
    )


def test_buckling_on_the_way_is_refused(tmp_path, threads):
    """Pushed through, the leaf springs pass their Euler load where the rise is above 2.56 thicknesses."""
    with pytest.raises(SceneError, match=r"shuttle .*push = .*buckles or leaves the intended branch"):
        train(shuttle(0.0025), out=tmp_path, executor=threads, meshes=("strain",), progress=False)
    record = train(shuttle(0.0010), out=tmp_path, executor=threads, meshes=("strain",), progress=False)
    assert record.motion_range[0] == pytest.approx((-0.02, 0.004))
    # of half the thickness it would buckle: the record says that thickness matters here
    assert math.inf in [e.interface for e in record.evidence if e.change == "half"]


def test_leaves_that_run_through_each_other_are_refused(tmp_path, threads):
    """At rest when drawn, at the corner of a range before any work, and within the stroke."""
    whole = cross()
    crossing = [
        replace(leaf, start=(*leaf.start[:2], 0.0), end=(*leaf.end[:2], 0.0)) for leaf in whole.leaves()[:2]
    ]
    words = {"blocks": whole.blocks(), "leaves": crossing, "motions": whole.motions}
    with pytest.raises(
        SceneError, match="leaf springs 'inner' and 'outer_low' run through each other at rest"
    ):
        DrawnJoint("flat", **words)
    assert DrawnJoint("flat", **words, windows=True).windows
    with pytest.raises(SceneError, match="CrossFlexure: leaf springs 'inner' and 'outer_low'"):
        cross(spacing=0.02)
    with pytest.raises(SceneError, match=r"infinity_hinge: the range of shapes holds .* strut = 0.6"):
        train(
            "infinity_hinge", shapes={"reach": (0.25, 0.4), "strut": (0.3, 0.6)}, out=tmp_path, progress=False
        )
    apart = ksd.ParallelGuide(STEEL, length=0.1, thickness=5e-4, width=0.03, spacing=0.06)
    high = apart.leaves()[1]
    twin = replace(high, start=(0, 0.03055, 0), end=(0.1, 0.03055, 0), name="twin")
    far = Motion("stroke", "translation", (0, 1, 0), (-0.04, 0.04), (0.05, 0, 0))
    close = DrawnJoint("close", blocks=apart.blocks(), leaves=[*apart.leaves(), twin], motions=[far])
    with pytest.raises(
        SceneError, match=r"leaf springs 'high' and 'twin' run into each other at stroke = -0\.04"
    ):
        train(close, out=tmp_path, executor=threads, meshes=("strain",), progress=False)


def twins(*, near):
    """A guide of three leaves, the third up to 0.55 mm beside the second where near = 1, deflected by 0.4 of its length."""
    apart = ksd.ParallelGuide(STEEL, length=0.1, thickness=5e-4, width=0.03, spacing=0.06)
    y = 0.03 + 0.01 - 0.00945 * near
    twin = replace(apart.leaves()[1], start=(0, y, 0), end=(0.1, y, 0), name="twin")
    far = Motion("stroke", "translation", (0, 1, 0), (-0.04, 0.04), (0.05, 0, 0))
    return DrawnJoint(
        "twins", blocks=apart.blocks(), leaves=[*apart.leaves(), twin], motions=[far], shape={"near": near}
    )


def test_leaves_that_meet_at_a_corner_of_shapes_and_stroke_are_refused(tmp_path, threads):
    """Clear at rest, and at every shape sampled; the far end of the shapes is no sample."""
    options = {"out": tmp_path, "executor": threads, "meshes": ("strain",), "progress": False}
    clear = Parameter("near", 0.0, 0.98)
    train(Design("twins", (clear,), twins), **options)
    with pytest.raises(SceneError, match=r"run into each other at stroke = -0\.04 \(shape near = 1\)"):
        train(Design("twins", (replace(clear, high=1.0),), twins), **options)


def test_leaves_that_meet_between_the_ends_of_the_stroke_are_seen():
    """The state at the end of the stroke put in the middle of one: at the corners alone nothing is seen."""
    joint = twins(near=1.0)
    plan = SamplingPlan(((0.0, -1.0),), ("strain",), (4, 3, 5))
    rest, bent = _solve_grid(joint, _driven_model(joint, "strain", plan), plan, "strain")
    between = SamplingPlan(((-1.0, 0.0, 1.0),), ("strain",), (4, 3, 5))
    assert _contact_points(between).tolist() == [True, False, True]
    assert _contact_points(replace(between, check_whole_stroke=True)).all()
    check_clear(joint, [rest, rest])
    with pytest.raises(SceneError, match="'high' and 'twin' run into each other"):
        check_clear(joint, [rest, bent, rest])


def test_a_record_worse_than_wanted_is_told(tmp_path, threads):
    options = {"out": tmp_path, "executor": threads, "meshes": ("strain",), "progress": False}
    with pytest.warns(
        UserWarning, match="guide: the functions are fitted no better than .* times the wanted"
    ):
        train(guide(), tolerance={"amplitudes": 1e-17}, **options)


def shortened(middle, stroke=0.02):
    """A guide of three leaf springs of 0.1 m, the middle one of another length, which is then compressed by a stroke."""
    leaves = [
        ksd.Leaf(start=(0.1 - length, y, 0), end=(0.1, y, 0), width_axis=(0, 0, 1), section=rectangle(5e-4, 0.02),
                 material=STEEL, name=name, start_block="A", end_block="B")
        for name, y, length in (("low", -0.03, 0.1), ("middle", 0.0, middle), ("high", 0.03, 0.1))
    ]  # fmt: skip
    motion = Motion("stroke", "translation", (0, 1, 0), (-stroke, stroke))
    blocks = {"A": (0, 0, 0), "B": (0.1, 0, 0)}
    return DrawnJoint("shortened", blocks=blocks, leaves=leaves, motions=[motion], length=0.1)


def test_a_joint_whose_leaf_springs_buckle_in_the_stroke_has_no_record(tmp_path, threads):
    """Reduced answers of such a record had 30 times the energy; with leaf springs of one length there is one."""
    options = {"out": tmp_path, "executor": threads, "meshes": ("strain",), "progress": False}
    with pytest.raises(
        SceneError, match=r"shortened: .* not smooth, as where a leaf spring buckles; reduce its range"
    ):
        train(shortened(0.08), **options)
    assert not (tmp_path / "shortened.h5").exists()
    with pytest.warns(UserWarning, match="no better than"):
        assert train(shortened(0.1), **options).samples == (1, 1)


def test_a_stroke_too_small_to_tell_is_refused(tmp_path, threads):
    options = {"out": tmp_path, "executor": threads, "meshes": ("strain",), "progress": False}
    with pytest.raises(SceneError, match=r"range of motion 'stroke' is 1e-09 joint lengths.*at least 1e-05"):
        train(shortened(0.1, 1e-10), **options)


def there_and_back(*, position):
    """The angle is that of the middle at both ends too."""
    joint = cross(angle=0.78 + 0.03 * position * (1 - position**2), gap=0.005)
    return DrawnJoint(
        "there_and_back", blocks=joint.blocks(), leaves=joint.leaves(), motions=joint.motions,
        length=joint.length, shape={"position": position},
    )  # fmt: skip


def test_a_parameter_whose_ends_equal_the_middle_is_not_left_out(tmp_path, threads):
    """It was, and the record was 17,000 times the wanted error off at the shapes between."""
    record = train(
        Design("there_and_back", (Parameter("position", -1.0, 1.0),), there_and_back),
        out=tmp_path, executor=threads, meshes=("strain",), progress=False,
    )  # fmt: skip
    assert record.powers[:, len(record.motions)].any() and "No dependence" not in record.history[-1]
    assert record.worst("strain") < 1e-5


def test_functions_that_miss_the_shapes_are_refused(tmp_path, threads, monkeypatch):
    """The same where the parameter is left out: fresh shapes see it."""
    monkeypatch.setattr("ksd.training.run._irrelevant_parameters", lambda *_: ("position",))
    with pytest.raises(SceneError, match="they do not follow its shape; reduce the range of the shape"):
        train(
            Design("there_and_back", (Parameter("position", -1.0, 1.0),), there_and_back),
            out=tmp_path, executor=threads, meshes=("strain",), progress=False,
        )  # fmt: skip


def gapped(*, angle, gap):
    joint = cross(angle=angle, gap=0.01 * gap)
    return DrawnJoint(
        "gapped", blocks=joint.blocks(), leaves=joint.leaves(), motions=joint.motions, length=joint.length,
        shape={"angle": angle, "gap": gap},
    )  # fmt: skip


def test_parameters_that_do_not_matter_are_left_out(tmp_path, threads):
    """The gap between the leaf springs of a cross flexure moves none of its functions; the record says so."""
    ranges = (Parameter("angle", 0.75, 0.8), Parameter("gap", 0.0, 1.0))
    record = train(
        Design("gapped", ranges, gapped), out=tmp_path, executor=threads, meshes=("strain",), progress=False
    )
    m = len(record.motions)
    assert record.powers[:, m].any() and not record.powers[:, m + 1].any()
    assert "No dependence on gap." in record.history[-1]
    # the fresh shapes vary the gap too
    assert record.worst("strain") < 2e-6
    assert max(e.rotations for e in record.evidence if e.parameter == "gap") < 1e-6


def middled(*, width, aside=0.02):
    """Two leaf springs in series with a block between them, whose reference point lies `aside`."""
    blocks = {"A": (0, 0, 0), "middle": (0.05, aside, 0), "B": (0.1, 0, 0)}
    pieces = (("one", 0.0, 0.05, "A", "middle"), ("two", 0.05, 0.1, "middle", "B"))
    leaves = [
        ksd.Leaf(start=(x, 0, 0), end=(y, 0, 0), width_axis=(0, 0, 1), section=rectangle(5e-4, width), material=STEEL,
                 name=name, start_block=a, end_block=b)
        for name, x, y, a, b in pieces
    ]  # fmt: skip
    return strip(width=width, name="middled", blocks=blocks, leaves=leaves)


def test_a_parameter_left_out_that_matters_is_told(tmp_path, threads):
    """Interface and leaf springs do not see where an internal block is, but the block does."""
    design = Design("middled", (Parameter("width", 0.02, 0.02),), middled, others={"aside": (0.03,)})
    with pytest.warns(
        UserWarning, match=r"middled: aside moves interface B or a block by 0\.1 .*make it one of the param"
    ):
        record = train(design, out=tmp_path, executor=threads, meshes=("strain",), progress=False)
    assert max(e.rotations for e in record.evidence if e.parameter == "aside") < 1e-8


def test_shipped_records_hold_the_evidence():
    """What a record takes to be irrelevant was changed, and what it depends on matters."""
    for path in sorted((ROOT / "database").glob("*.h5")):
        record = read_record(path)
        moved = {}
        for e in record.evidence:
            moved[e.parameter] = max(moved.get(e.parameter, 0.0), e.rotations, e.interface)
        assert {"thickness", "width", "length", "material"} <= set(moved)
        for name in record.shape_names:
            assert moved[name] > 1e-4, (path.name, name)
        for name in {"width", "gap", "material"} & set(moved):
            assert moved[name] < 2e-3, (path.name, name)


KILLED = """
from ksd.training import train
if __name__ == "__main__":
    train("cartwheel", meshes=("strain", 2), out={out!r}, trained="2024-05-01", progress=False)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_a_killed_run_resumes_to_the_same_bytes(tmp_path, threads):
    script = tmp_path / "run.py"
    script.write_text(KILLED.format(out=str(tmp_path)))
    process = subprocess.Popen([sys.executable, str(script)], env=environment(), start_new_session=True)
    folder = tmp_path / ".cartwheel.partial"
    while process.poll() is None and len(list(folder.glob("*.npz"))) < 4:
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    kept = len(list(folder.glob("*.npz")))
    assert kept >= 4 and not (tmp_path / "cartwheel.h5").exists()
    options = {"meshes": ("strain", 2), "executor": threads, "trained": "2024-05-01", "progress": False}
    train("cartwheel", out=tmp_path, **options)
    train("cartwheel", out=tmp_path / "whole.h5", **options)
    assert (tmp_path / "cartwheel.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()


@pytest.mark.parametrize("name", ["stiffened_guide", "arc_hinge", "universal", "infinity_hinge"])
def test_every_kind_of_family_gives_the_same_bytes(name, tmp_path, threads, monkeypatch):
    """Broken off and taken up again at another moment in each, against a run in one go."""
    options = {"meshes": ("strain",), "executor": threads, "trained": "2024-05-01", "progress": False}
    narrow = {p.name: (p.value(-0.1), p.value(0.1)) for p in design_of(name).parameters}
    train(name, shapes=narrow, out=tmp_path / "whole.h5", **options)
    left = iter(range(3 + len(name) % 5))

    def broken(job):
        if next(left, None) is None:
            raise KeyboardInterrupt
        return sample_joint(job.joint, job.plan)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(jobs_module, "run_job", broken)
        train(name, shapes=narrow, out=tmp_path / "part.h5", **options)
    train(name, shapes=narrow, out=tmp_path / "part.h5", **options)
    assert (tmp_path / "part.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()


def test_wrong_words(tmp_path):
    with pytest.raises(SceneError, match="cross_flexure"):
        train("cros_flexure", out=tmp_path)
    with pytest.raises(SceneError, match="'angel'"):
        train("cross_flexure", shapes={"angel": (0.5, 0.6)}, out=tmp_path)
    with pytest.raises(SceneError, match="must rise"):
        train("cross_flexure", shapes={"angle": (0.6, 0.5)}, out=tmp_path)


def test_wrong_meshes(tmp_path):
    for meshes in ((), ("fine",), (0,), (True,), (2, 2), "strain", 4):
        with pytest.raises(
            SceneError, match=r"cartwheel: meshes = .* must be different ones of .strain. and numbers"
        ):
            train("cartwheel", out=tmp_path, meshes=meshes)


def strip(*, width, **changed):
    """A single leaf whose width is its shape parameter."""
    leaf = ksd.Leaf(
        start=(0, 0, 0),
        end=(0.1, 0, 0),
        width_axis=(0, 0, 1),
        section=rectangle(5e-4, width),
        material=STEEL,
        name="only",
    )
    words = {
        "name": "strip", "blocks": {"A": (0, 0, 0), "B": (0.1, 0, 0)}, "leaves": [leaf], "shape": {"width": width},
        "motions": [Motion("angle", "rotation", (0, 0, 1), (-0.5, 0.5))], "held_by_others": True,
    }  # fmt: skip
    words |= changed
    return DrawnJoint(words.pop("name"), **words)


MOTIONS = [Motion(n, "rotation", a, (-0.1, 0.1)) for n, a in zip("xyz", np.eye(3).tolist(), strict=True)]


@pytest.mark.parametrize(
    "changed, said",
    [
        ({"make": lambda width: 5}, "make returned 5; it must return a Joint"),
        (
            {"make": lambda width: strip(width=width, shape={})},
            r"a joint 'strip' of shape \{\}, under which the record would",
        ),
        ({"make": lambda width: strip(width=width, name="other")}, "a joint 'other' of shape"),
        (
            {"make": lambda width: strip(width=width, motions=MOTIONS)},
            r"3 intended motions \(x, y, z\); a record holds 2",
        ),
        ({"make": 5}, "make = 5 must draw the joint"),
        ({"family": "../strip"}, "cannot be the name of a record file"),
        (
            {"family": "cartwheel", "make": lambda width: strip(width=width, name="cartwheel")},
            "a family of the catalogue",
        ),
    ],
)
def test_designs_that_make_no_sense(changed, said, tmp_path):
    whole = {
        "family": "strip",
        "parameters": (Parameter("width", 0.01, 0.02),),
        "make": lambda width: strip(width=width),
    }
    with pytest.raises(SceneError, match=said):
        train(Design(**(whole | changed)), out=tmp_path, progress=False)
    assert not list(tmp_path.iterdir())


def test_shipped_records_are_small_and_close():
    """They are those of the source tree, installed or not."""
    for path in (ROOT / "database").glob("*.h5"):
        assert (shipped_folder() / path.name).read_bytes() == path.read_bytes()
    for path in sorted(shipped_folder().glob("*.h5")):
        assert path.stat().st_size < 2e6
        for residual in read_record(path).residuals:
            if residual.group in ("interface", "blocks"):
                assert residual.fresh_max < 2e-6


def test_the_package_and_the_function_of_the_same_name():
    assert callable(ksd.train)
