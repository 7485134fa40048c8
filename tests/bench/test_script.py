"""The benchmark script: what is asked of the figures, other engines, operations of a pass, tables of the README."""

import json
import math
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from bench_scenes import FOURBAR_STROKE, chain
from bench_scenes import fourbar as fourbar_scene

from ksd.model.compile import compile_scene
from ksd.numerics.blocks import plan_blocks

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return import_module


def found(measured, method, leaves):
    return next(r for r in measured.rows if (r.method, r.leaves) == (method, leaves))


def test_what_was_asked_is_met_or_missed_with_the_reason(fourbar, reading_1, script):
    told = script("bench").case_with_engines(reading_1, fourbar, quick=True)
    text = script("bench_tables").requirement_table([told])
    lines = {tuple(line.split("|")[1:3]): line for line in text.splitlines()[2:]}
    # six ratios, and two bounds: of the strain-mode leaf, with five elements none of four
    assert len(lines) == 8
    ratio = next(line for line in text.splitlines() if "full / MIP on condensed leaf springs >= 1.8" in line)
    full, mip = (found(fourbar, method, "5 elements") for method in ("full", "conventional"))
    # MIP: 8 solves and a look at the end (acceptance F); full: step 2, two iterations or three and a look
    assert mip.passes == 9 and full.passes in (4, 5)
    if mip.call[1] / full.call[1] < 1.8:
        assert (
            "missed" in ratio
            and f"passes over the leaf springs, full {full.passes}" in ratio
            and "operations" in ratio
        )
    else:
        assert "met" in ratio
    assert "missed" not in next(line for line in text.splitlines() if "conventional, strain" in line)


def test_operations_of_a_pass_grow_with_the_mechanism(script):
    floor = script("floor")
    # a full matrix of six in blocks of three: n^3 / 3 and what the lower blocks take whole
    plan, *_ = plan_blocks(np.array([3, 3]), [(0, 1)])
    assert floor.factor_operations(plan) == 9 + 27 + 54 + 9
    few, many = (floor.one_pass(compile_scene(chain(n)[0]).arrays) for n in (16, 48))
    assert many.leaves == 3 * few.leaves and many.matrix == 3 * few.matrix
    # the ends of the chain are cheaper
    assert 3.0 * few.factor <= many.factor <= 3.3 * few.factor
    assert 2.2 * few.bytes <= many.bytes <= 3 * few.bytes


def test_the_frame_other_engines_get_is_the_scene(script):
    engines = script("bench_engines")
    scene, targets = fourbar_scene(FOURBAR_STROKE)
    frame = engines.frame_of(scene, targets, 4)
    leaves = [bar for bar in frame.bars if math.inf > bar.GA]
    assert len(leaves) == 4 * 2 * 4
    # inner leaf 40 x 1 mm, and the two outer ones in one
    assert {round(bar.EA) for bar in leaves} == {8_000_000}
    assert pytest.approx(5 / 6 * 76.9e9 * 40e-6, rel=1e-6) == leaves[0].GA
    assert pytest.approx(200e9 * 40e-15 / 12 * 1e3, rel=1e-9) == leaves[0].EI
    rows = engines.measure_engines(scene, targets, 521.1948, elements=(10,), repeats=1)
    assert {r.engine for r in rows} == {"OpenSees", "Exudyn"}
    assert all(r.said.startswith("skipped") or r.force_error < 5e-3 for r in rows)


def test_the_whole_script(script, tmp_path):
    script("bench").main(["--quick", "--case", "guide", "--out", str(tmp_path)])
    case = json.loads((tmp_path / "bench.json").read_text())["cases"]["parallel guide, 20 mm"]
    assert case["engines"] == [] and "operations" in case["one_pass"]["strain 4,3,6"]
    assert (tmp_path / "bench.png").stat().st_size > 20_000
    text = (tmp_path / "bench.md").read_text()
    assert text.startswith("# Methods at equal accuracy")
    assert "| full | strain-mode |" in text and "full / plain Newton" in text
