"""Every Python block of the documentation's pages runs, and the commands the pages name exist."""

import argparse
import json
import math
import pkgutil
import re
import runpy
import sys
from pathlib import Path

import pytest
from readable import assert_readable

import ksd
from ksd.cli.commands import parser
from ksd.cli.schema import schema_text
from ksd.solvers.five_step_solver import LOOSE_CLOSURE_TOLERANCE
from ksd.solvers.nonconservative_stability import MAX_DAMPED_SKEW_SHARE
from ksd.solvers.solver import DEFAULT_ACCURACY
from ksd.training.softness import SOFTENING_FACTOR

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = sorted(
    path for path in DOCS.rglob("*.md") if not {"_made", "gallery", "tutorial", "build"} & set(path.parts)
)
NAMES = [str(path.relative_to(DOCS)) for path in PAGES]
sys.path.insert(0, str(DOCS))
TABLES = runpy.run_path(str(DOCS / "tables.py"))
without_page = TABLES["without_page"]
run_blocks = runpy.run_path(str(DOCS / "blocks.py"))["run_blocks"]


@pytest.mark.parametrize("page", [n for n in NAMES if "```python\n" in (DOCS / n).read_text()])
def test_blocks_of_a_page_run_in_order(page, monkeypatch, tmp_path):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    shown = list(run_blocks(page, (DOCS / page).read_text()))
    assert any(printed or figure for printed, figure in shown), "the page shows no answer"
    for _, figure in shown:
        if figure:
            assert_readable(figure)


@pytest.mark.parametrize("page", NAMES)
def test_commands_of_a_page_exist(page):
    commands = next(a.choices for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    text = (DOCS / page).read_text()
    named = re.findall(r"`ksd +([a-z]\w*)([^`]*)`", text) + re.findall(
        r"^(?:\$ )?ksd ([a-z]\w*)(.*)$", text, re.M
    )
    for word, rest in named:
        assert word in commands, f"{page}: ksd {word}"
        for option in re.findall(r"(?<!\S)--[\w-]+", rest):
            assert option in commands[word].format_help(), f"{page}: ksd {word} {option}"


@pytest.mark.parametrize("page", NAMES)
def test_what_a_page_points_at_exists(page):
    """Tests by file and name, files of the repository, and modules or names of the package."""
    text = (DOCS / page).read_text()
    for file, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text):
        source = (DOCS.parent / file).read_text()
        assert not name or f"def {name}(" in source, f"{page}: {file}::{name}"
    for path in re.findall(r"`((?:benchmarks|examples|ksd)/[\w./]+)`", text):
        assert (DOCS.parent / path).exists(), f"{page}: {path}"
    for name in re.findall(r"`(ksd(?:\.\w+)+)", text):
        pkgutil.resolve_name(name)


BOUNDS = {
    "limits.md": [f"beyond {100 * LOOSE_CLOSURE_TOLERANCE:g} % of the size the five steps refuse"],
    "how_to/method_and_accuracy.md": ["one part in a thousand"] * (DEFAULT_ACCURACY == 1e-3),
    "theory/non_conservative.md": [rf"\rho = 10^{{{round(math.log10(MAX_DAMPED_SKEW_SHARE))}}}$"],
    "theory/element_orientations.md": ["a quarter of their stiffness"] * (SOFTENING_FACTOR == 0.25),
}
"""Sentences of pages that tell a bound of the package, made from the bound."""


@pytest.mark.parametrize("page", BOUNDS)
def test_bounds_in_prose_are_those_of_the_package(page):
    assert BOUNDS[page] and all(sentence in (DOCS / page).read_text() for sentence in BOUNDS[page])


def test_numbers_of_the_vibrations_tutorial(monkeypatch):
    """Closed forms: beams clamped at both ends with 13/35 of their mass, a load on them, and one resonance."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    found = runpy.run_path(str(DOCS / "tutorials" / "7_vibrations_of_a_guide.py"))
    free = found["free"].frequency_Hz
    assert free[0] == pytest.approx(found["by_hand"], rel=1e-4)
    # the rigid stage alone: no mass of the leaf springs, so a little high, three ways of which are in the table
    lumped = found["lumped_Hz"]
    assert lumped[0] == pytest.approx(
        free[0] * math.sqrt(1 + 2 * 13 / 35 * found["leaf_mass"] / 0.5), rel=1e-4
    )
    for f in lumped[1:4]:
        assert free[abs(free - f).argmin()] == pytest.approx(f, rel=1e-2) and free[abs(free - f).argmin()] < f
    assert found["static_gain"] == pytest.approx(1.0, rel=1e-6)
    told = found["plant"].frequency_Hz[0] * math.sqrt(1 - 2 * found["damping"] ** 2)
    assert found["peak_Hz"] == pytest.approx(told, rel=2e-5)
    assert found["amplification"] == pytest.approx(1 / (2 * found["damping"]), rel=1e-3)
    assert found["overshoot"] == pytest.approx(1 + math.exp(-math.pi * found["damping"]), rel=1e-3)
    for stiffness, expected in found["upright"]:
        assert stiffness == pytest.approx(expected, rel=2e-4)


def test_numbers_of_the_motion_tutorial(monkeypatch):
    """An oscillator: two beams clamped at both ends, their mass, and its response; a film of some frames."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(ksd.History, "animate", lambda *_, **__: None)
    found = runpy.run_path(str(DOCS / "tutorials" / "8_motion_of_a_guide.py"))
    EI, L = 200e9 * 20e-3 * 0.3e-3**3 / 12, 60e-3
    stiffness, mass = 24 * EI / L**3, 0.5 + 2 * 13 / 35 * 7800 * L * 20e-3 * 0.3e-3
    assert found["frequency"] == pytest.approx(math.sqrt(stiffness / mass) / (2 * math.pi), rel=3e-4)
    resisted = stiffness * (1 + 0.06j * 4 / found["frequency"]) - mass * (8 * math.pi) ** 2
    assert found["linear"] == pytest.approx(1 / abs(resisted), rel=1.5e-3)
    # the pose of the linear answer is 1 mm aside, where it is a little stiffer
    assert found["amplitude"] == pytest.approx(found["linear"], rel=1.5e-3)
    # 3/5 of the square of the stroke over the length, for small ones
    assert found["sink"] == pytest.approx(0.6 * max(found["pushed"].sensors["place"]) ** 2 / L, rel=4e-2)
    assert 1.0 < found["ring"] / found["frequency"] < 1.1 and found["pushed"].error < 1e-3


def test_numbers_of_the_contact_pages():
    """The stop and the grip by superposition of small deflections: forces that close a gap over a compliance."""
    said = ""
    for page in ("how_to/stops_and_cables", "theory/contact"):
        text = (DOCS / f"{page}.md").read_text()
        said += "".join(printed for printed, _ in run_blocks(page, text))
    found = {
        key: float(re.search(pattern, said)[1])
        for key, pattern in {"stop": r"end\.high +([\d.]+) ", "grip": r"gripping with ([\d.]+) N"}.items()
    }
    E, L, width, t = 200e9, 80e-3, 25e-3, 0.4e-3
    assert found["stop"] == pytest.approx(8 - 24 * E * width * t**3 / 12 / L**3 * 3e-3, rel=3e-3)
    EI, L, push, tip = 2.2e9 * 8e-3 * 1e-9 / 12, 30e-3, 10e-3, 30e-3

    def across(arm):
        """Motion of a tip for a force at this height above the leaf spring."""
        return (L**3 / 3 + L**2 * (arm + tip) / 2 + L * arm * tip) / EI

    assert found["grip"] == pytest.approx((0.15 * across(push) - 1e-3) / across(tip), rel=5e-3)


def test_a_block_that_fails_is_found_with_its_line():
    text = "# page\n\n```python\na = 1\nprint(a)\n```\n\n```python\nprint(a)\na / 0\n```\n"
    shown = run_blocks("page.md", text)
    assert next(shown) == ("1\n", None)
    with pytest.raises(ZeroDivisionError) as caught:
        next(shown)
    assert caught.traceback[-1].lineno + 1 == 10


@pytest.mark.parametrize("family", ["cross_flexure", "wire_flexure"])
def test_the_catalogue_shows_picture_stiffness_and_range_of_a_joint(tmp_path, monkeypatch, family):
    kind = ksd.joint_families()[family]
    monkeypatch.setattr(ksd, "joint_families", lambda: {family: kind})
    TABLES["joints"](tmp_path)
    page = (tmp_path / "joints.md").read_text()
    assert f"## {kind.__name__}\n" in page and "| closed form |" in page and f'`family = "{family}"`' in page
    assert (tmp_path / "joints" / f"{family}.png").stat().st_size > 5000
    assert ("| range | angle: -75 to 75 degrees |" in page and "E I / L" in page) == (
        family == "cross_flexure"
    )


def test_every_public_name_is_on_a_page_of_the_reference():
    assert not without_page(), "name them in docs/tables.py"


def tables_of_schema(path, tree):
    """Every table of the JSON schema, by the name the page gives it: its keys, and those of them that are tables."""
    for one in tree.get("oneOf", [tree]):
        known = one.get("properties", {})
        said = "".join(f', {key} = "{v["const"]}"' for key, v in known.items() if "const" in v)
        inner = {key: v.get("items", v) for key, v in known.items()}
        inner = {key: v for key, v in inner.items() if "properties" in v or "oneOf" in v}
        plain = {key for key, v in known.items() if "const" not in v}
        yield path + said, plain, inner.keys()
        for key, table in inner.items():
            inside = (
                f"{path}.{key}".removeprefix("joint.NAME.")
                if key in ("curve", "profile")
                else f"{path}.{key}"
            )
            yield from tables_of_schema(inside, table)


def test_the_page_of_the_scene_format_has_every_key_of_the_schema_and_no_other(tmp_path):
    TABLES["scene_format"](tmp_path)
    found = {}
    for part in (tmp_path / "scene_tables.md").read_text().split("### ")[1:]:
        places, _, kind = part.splitlines()[0].partition(", ")
        for place in places.split(" or "):
            found[f"{place.strip('[]')}{', ' if kind else ''}{kind}"] = set(
                re.findall(r"^\| `(\w+)` \|", part, re.M)
            )
    schema = json.loads(schema_text())
    tops = {}
    for key, value in schema["properties"].items():
        if key in ("material", "section", "joint"):
            tops[f"{key}.NAME"] = value["additionalProperties"]
        elif "properties" in value or "properties" in value.get("items", {}):
            tops[key] = value.get("items", value)
    assert found.pop("Top of the file") == schema["properties"].keys() - {
        p.removesuffix(".NAME") for p in tops
    }
    seen = set()
    for top, tree in tops.items():
        for name, keys, inner in tables_of_schema(top, tree):
            assert keys - inner <= found[name] <= keys, name
            seen.add(name)
    assert seen == found.keys()


def test_what_is_measured_is_on_one_page(tmp_path):
    """What users pay with its numbers, and every script with the files it wrote; each file of results is some script's."""
    measured = runpy.run_path(str(DOCS / "measured.py"))
    measured["write_measured"](tmp_path)
    page = (tmp_path / "index.md").read_text()
    assert "`full`, in space" in page and "| 24 | 12 |" in page and "benchmarks/results/pays.md" not in page
    for path in measured["RESULTS"].iterdir():
        assert f"`{path.name}`" in page, path.name
    assert {path.stem for path in measured["BENCHMARKS"].glob("*.py")} - {"machine"} >= set(
        re.findall(r"\| `(\w+)\.py` \|", page)
    )
