"""Probe states: a record is judged by what it gives, against what it kept and against the solver of today."""

from dataclasses import replace

import numpy as np
import pytest

from ksd.cli import main
from ksd.errors import RecordError
from ksd.library import Probes, find_record, read_record, write_record
from ksd.library.record_files import record_bytes, shipped_folder
from ksd.training import check_probes, design_of, up_to_date
from ksd.training import probes as module
from ksd.training.catalogue import FAMILY_DESIGNS
from ksd.training.fit import TOLERANCE
from ksd.training.sampling import sample_joint

SHIPPED = sorted(shipped_folder().glob("*.h5"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_records_agree_with_the_solver(path):
    """Functions as kept to rounding, and each probe solved again within the error told."""
    record = read_record(path)
    assert len(record.probes.values) == module.PROBE_STATES
    assert "solved again, within" in check_probes(record, design_of(record.family))


def test_every_family_of_the_catalogue_ships():
    assert {path.stem for path in SHIPPED} == set(FAMILY_DESIGNS)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_record_written_again_is_the_same_file(path):
    assert record_bytes(read_record(path)) == path.read_bytes()


@pytest.fixture
def record():
    return find_record("cartwheel")


def test_probes_reach_the_ends_of_the_stroke_and_other_shapes(record):
    motions = record.probes.motions[:, 0]
    assert (motions.min(), motions.max()) == pytest.approx((record.motions[0].low, record.motions[0].high))
    assert len(np.unique(record.probes.shapes[:, 0])) == module.PROBE_STATES


def test_functions_that_come_out_otherwise_are_found_without_solving(record):
    """One coefficient by 1e-6, as a change of how polynomials are evaluated would."""
    assert "functions as kept" in check_probes(record)
    tables = record.functions["strain"]
    moved = tables.amplitudes.copy()
    moved[0, 8, 3] += 1e-6
    moved = replace(record, functions={**record.functions, "strain": replace(tables, amplitudes=moved)})
    with pytest.raises(RecordError, match=r"'cartwheel' does not agree .* amplitudes of mesh 'strain'"):
        check_probes(moved)


def test_a_solver_that_gives_something_else_is_found(record, monkeypatch):
    def otherwise(joint, plan):
        samples = sample_joint(joint, plan)
        return {**samples, (4, "rotations"): samples[4, "rotations"] + 3e-6}

    design = design_of("cartwheel")
    monkeypatch.setattr(module, "sample_joint", otherwise)
    with pytest.raises(RecordError, match=r"rotations of mesh 4 by the solver differ .* run `ksd train cart"):
        check_probes(record, design)


@pytest.mark.parametrize(("field", "of"), [("fit_rms", "motion"), ("fresh_rms", "the shape")])
def test_a_record_far_from_its_joint_is_refused(record, field, of, tmp_path, monkeypatch, capsys):
    """As earlier versions wrote of joints whose leaf springs buckle: it agrees with its own errors, which are large."""
    r = record.residuals[0]
    bad = replace(r, **{field: 150 * TOLERANCE[r.group]}, fresh_max=1.0)
    worse = replace(record, residuals=(bad, *record.residuals[1:]))
    sentence = rf"'cartwheel' misses its joint by 1.5e\+02 times .* smaller range of {of}"
    for design in (None, design_of("cartwheel")):
        with pytest.raises(RecordError, match=sentence):
            check_probes(worse, design)
    write_record(worse, tmp_path / "cartwheel.h5")
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    assert main(["info", "cartwheel", "--check"]) == 4
    assert "misses its joint" in capsys.readouterr().err
    within = replace(r, **{field: 90 * TOLERANCE[r.group]})
    assert "functions as kept" in check_probes(replace(record, residuals=(within, *record.residuals[1:])))


def test_a_record_without_probes_says_so(record):
    with pytest.raises(RecordError, match="holds no probe states"):
        check_probes(replace(record, probes=None))
    none = Probes(np.zeros((0, 1)), np.zeros((0, 1)), record.probes.values[:0])
    with pytest.raises(RecordError, match="holds no probe states"):
        check_probes(replace(record, probes=none))


def test_a_record_of_other_ranges_is_solved_at_its_own_shapes(record):
    """As of `train(family, shapes=...)`: what the family is trained on by itself does not matter."""
    narrow = design_of("cartwheel", {"angle": (0.6, 0.7)})
    assert "solved again, within" in check_probes(record, narrow)


def test_a_record_of_other_shape_parameters_says_so(record):
    with pytest.raises(
        RecordError, match=r"'cartwheel' is of the shape parameters angle; .* inner_ratio, half_angle"
    ):
        check_probes(record, design_of("butterfly"))


def test_up_to_date_is_a_record_of_what_is_asked_that_agrees(record, tmp_path, monkeypatch):
    path = tmp_path / "cartwheel.h5"
    assert up_to_date("cartwheel", out=tmp_path) == ""
    write_record(record, path)
    assert "4 probe states" in up_to_date("cartwheel", out=tmp_path)
    stroke = replace(record.motions[0], high=0.1)
    worse = tuple(replace(r, fit_rms=1.0) for r in record.residuals)
    fewer = {mesh: record.functions[mesh] for mesh in ("strain", 1)}
    for changed in (
        {"motions": (stroke,)}, {"residuals": worse}, {"functions": fewer}, {"orders": (4, 3, 6)}, {"probes": None},
        {"parameters": (replace(record.parameters[0], low=0.6),)}, {"design": {}},
    ):  # fmt: skip
        write_record(replace(record, **changed), path)
        assert up_to_date("cartwheel", out=tmp_path) == "", changed
    write_record(record, path)
    path.write_bytes(path.read_bytes()[:-1])
    assert up_to_date("cartwheel", out=tmp_path) == ""
