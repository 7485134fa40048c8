"""The schema for editors takes what the reader takes, and refuses what is wrong whatever the names and numbers."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import STORED
from test_toml import GOOD, MISTAKES, UNITS
from test_toml_effects import SCENE

import ksd
from ksd.cli import main
from ksd.cli.schema import schema_text
from ksd.errors import SceneError
from ksd.scene.json_schema import json_schema
from ksd.scene.toml_table import quantity

SCENES = Path(ksd.__file__).parent / "scenes"
SCHEMA = json.loads(schema_text())
JOBS = json.loads(schema_text(jobs=True))
TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "number": (int, float),
    "integer": int,
}
WORDS = {
    "$schema", "$ref", "title", "description", "definitions", "type", "properties", "additionalProperties", "required",
    "items", "minItems", "maxItems", "anyOf", "oneOf", "enum", "const", "pattern",
}  # fmt: skip


def fits(value, schema, whole=SCHEMA):
    """Whether a value fits a schema of the words above, as draft 7 of JSON schema has them."""
    assert schema.keys() <= WORDS, schema.keys() - WORDS
    if "$ref" in schema:
        return fits(value, whole["definitions"][schema["$ref"].removeprefix("#/definitions/")], whole)
    kind = TYPES.get(schema.get("type"), object)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind not in (bool, object)):
        return False
    if value not in schema.get("enum", [value]) or value != schema.get("const", value):
        return False
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        return False
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            return False
        if not all(fits(item, schema.get("items", {}), whole) for item in value):
            return False
    if isinstance(value, dict):
        known, other = schema.get("properties", {}), schema.get("additionalProperties", {})
        if not value.keys() >= set(schema.get("required", ())):
            return False
        for key, item in value.items():
            if (key not in known and other is False) or not fits(item, known.get(key, other), whole):
                return False
    if "anyOf" in schema and not any(fits(value, one, whole) for one in schema["anyOf"]):
        return False
    return "oneOf" not in schema or sum(fits(value, one, whole) for one in schema["oneOf"]) == 1


def drawn():
    """A file with a joint drawn leaf by leaf, as it is saved."""
    return """
links = ["arm"]
[material.steel]
E = 2e11
nu = 0.3
[section.thread]
kind = "circle"
diameter = "1 mm"
[joint.mine]
family = "drawn"
[joint.mine.blocks]
A = [0, 0, 0]
B = ["100 mm", 0, 0]
[[joint.mine.wire]]
start = [0, 0, 0]
end = ["100 mm", 0, 0]
start_block = "A"
end_block = "B"
diameter = "1 mm"
material = "steel"
[[joint.mine.motion]]
name = "tilt"
kind = "rotation"
axis = "z"
range = ["-10 deg", "10 deg"]
[[join]]
a = "ground"
b = "arm"
joint = "mine"
at = [0, 0, 0]
axis = "z"
toward = "x"
"""


# jobs are for `ksd optimise`
FILES = {f.stem: f.read_text() for f in sorted(SCENES.glob("*.toml")) if not f.stem.endswith("_job")}
FILES |= {"good": GOOD, "effects": SCENE, "stored": STORED, "drawn": drawn()}


@pytest.mark.parametrize("name", FILES)
def test_every_scene_fits(name, tmp_path):
    (tmp_path / "a.toml").write_text(FILES[name])
    mechanism, targets, options = ksd.load_scene(tmp_path / "a.toml")
    assert fits(tomllib.loads(FILES[name]), SCHEMA)
    ksd.save_scene(mechanism, tmp_path / "again.toml", targets=targets, options=options)
    assert fits(tomllib.loads((tmp_path / "again.toml").read_text()), SCHEMA)


STRUCTURE = re.compile(
    r"key '\w+' is (missing|unknown)|, e\.g\. '|the unit '"
    r"|must be (a list of|text in quotes|true or false|a table|written as)|not a direction|(family|kind) '\w+' is unknown"
)
"""What the reader says of keys, types and units, which a schema can tell too."""


def test_what_is_wrong_in_keys_types_and_units_does_not_fit(tmp_path):
    tried = 0
    for old, new, _ in MISTAKES:
        text = GOOD.replace(old, new, 1)
        (tmp_path / "a.toml").write_text(text)
        with pytest.raises(SceneError) as caught:
            ksd.load_scene(tmp_path / "a.toml")
        # whether a value is a length or an angle depends on another key
        if STRUCTURE.search(str(caught.value)) and "value = " not in str(caught.value):
            assert not fits(tomllib.loads(text), SCHEMA), (old, new)
            tried += 1
    assert tried > 40


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(UNITS),
    st.sampled_from(["1", "-2.5", "+.5", "3.", "1e-3", "1E+2", "", "1,5", "one", "1e"]),
    st.sampled_from(["", " ", "  ", "\t", "x", "."]),
    st.sampled_from([None, "", "MM", "m N", "N m", "kg/m3", "/K", "mm²", "°"]),
)
def test_texts_with_units_fit_as_they_are_read(kind, number, space, unit):
    dimension, own = kind
    text = f"{number}{space}{own if unit is None else unit}"
    try:
        quantity(text, dimension, "x")
        read = True
    except SceneError:
        read = False
    assert fits(text, SCHEMA["definitions"][dimension]) == read, text


@pytest.mark.parametrize("said", ["x", "-z", "w", [0, 0.6, 0.8], [1, 0], [1, 0, 0, 0], ["x", 0, 0]])
def test_directions_fit_as_they_are_read(said):
    fine = said in ("x", "-z") or said == [0, 0.6, 0.8]
    assert fits(said, SCHEMA["definitions"]["direction"]) == fine


def test_the_command_prints_or_writes_it(capsys, tmp_path):
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == SCHEMA
    assert main(["schema", "--out", str(tmp_path / "a.json")]) == 0
    assert json.loads((tmp_path / "a.json").read_text()) == SCHEMA
    assert fits({"links": [], "options": {"anything": 3}}, json_schema())
    assert not fits({"links": [], "options": {"anything": 3}}, SCHEMA)


JOB = (SCENES / "pivot_job.toml").read_text()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("", ""),
        ('link = "arm"\n', 'link = "arm"\nmethod = "conventional"\ntogether = true\n'),
        ('turn = ["0 deg", "15 deg", "30 deg"]', 'turn = "0deg:30deg:3"'),
        ('length = "70 mm"', 'length = "= 7 * joint.cross.thickness / 0.04"'),
        (
            "[job.vary]",
            '[[job.loads.payload]]\nlink = "arm"\nforce = [0, 0, "-20 N"]\nat = ["0.1 m", 0, 0]\n[job.vary]',
        ),
    ],
)
def test_a_job_file_fits_the_schema_of_jobs_alone(old, new, tmp_path):
    text = JOB.replace(old, new, 1)
    (tmp_path / "a.toml").write_text(text)
    ksd.load_job(tmp_path / "a.toml")
    assert fits(tomllib.loads(text), JOBS, JOBS) and not fits(tomllib.loads(text), SCHEMA)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[job]", "[jobs]"),
        ('link = "arm"', 'links = "arm"'),
        ("starts = 2", "start = 2"),
        ('length = "70 mm"', 'length = "70 deg"'),
        ("[job.vary]", '[[job.loads.payload]]\nlinc = "arm"\n[job.vary]'),
    ],
)
def test_what_is_wrong_in_a_job_does_not_fit(old, new, tmp_path):
    text = JOB.replace(old, new, 1)
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(SceneError):
        ksd.load_job(tmp_path / "a.toml")
    assert not fits(tomllib.loads(text), JOBS, JOBS)


def test_a_job_may_name_its_scene():
    text = '[job]\nscene = "pivot.toml"\nmaximise = "stress_MPa"\n[job.vary]\njoint.cross.thickness = ["0.2 mm", "1 mm"]\n'
    assert fits(tomllib.loads(text), JOBS, JOBS)


def test_the_command_prints_that_of_jobs(capsys):
    assert main(["schema", "--job"]) == 0
    assert json.loads(capsys.readouterr().out) == JOBS
