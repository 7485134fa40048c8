"""The identity of the sources of a record: it changes with what gives numbers, not with words."""

import pytest

from ksd.library import read_record
from ksd.library.files import record_bytes, shipped_folder
from ksd.train import sources as module
from ksd.train.catalogue import ENTRIES
from ksd.train.sources import ASIDE, PACKAGE, REFUSALS, code, source_hash, sources


def test_words_are_left_out():
    text = '"""Doc."""\n\nA = 1  # one\n"""Said of A."""\n\n\ndef f():\n    """Doc."""\n    return "#"\n'
    assert code(text) == 'A = 1\ndef f():\n    return "#"'
    assert code(text.replace("one", "unity")) == code(text) != code(text.replace("A = 1", "A = 2"))


def test_what_gives_numbers_is_counted_and_what_does_not_is_not():
    counted = set(sources())
    for path in ("beam/strain.py", "beam/corotational.py", "solve/newton.py", "model/pack.py", "scene/profile.py",
                 "scene/families/infinity.py", "train/fit.py", "train/sweep.py", "train/catalogue.py", "library/chains.py",
                 "section/closed_forms.py", "numerics/rotations.py"):  # fmt: skip
        assert path in counted
    assert not any(p.startswith((*ASIDE, "view/", "cli/", "design/", "bodies/", "modal/")) for p in counted)


def test_every_exception_exists():
    for start in (*ASIDE, *REFUSALS):
        assert list(PACKAGE.glob(f"{start}*")) or (PACKAGE / start).exists(), start


@pytest.fixture
def copy(tmp_path, monkeypatch):
    """The counted sources in another place, to be changed."""
    for path in (*sources(), *REFUSALS):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text((PACKAGE / path).read_text())
    monkeypatch.setattr(module, "PACKAGE", tmp_path)
    return tmp_path


def test_the_hash_changes_with_a_number_and_not_with_a_comment(copy):
    def now():
        return module._hash(sources()), module._hash((*sources(), *REFUSALS))

    before = now()
    assert before[0] == source_hash()
    place = copy / "train/fit.py"
    place.write_text("# said otherwise\n" + place.read_text())
    assert now() == before
    check = copy / "train/checks.py"
    check.write_text(check.read_text().replace("WINDOW = 0.25", "WINDOW = 0.26"))
    # the same numbers, but kept results are not trusted any more
    assert now()[0] == before[0] and now()[1] != before[1]
    place.write_text(place.read_text().replace("DIGITS = 10", "DIGITS = 9"))
    assert now()[0] != before[0]


@pytest.mark.parametrize("path", sorted(shipped_folder().glob("*.h5")), ids=lambda path: path.stem)
def test_shipped_records_are_of_these_sources(path):
    """What ships was trained with the sources beside it: `ksd train all` writes all records anew in a few minutes."""
    assert read_record(path).source == source_hash(), (
        "sources that give numbers have changed: run `ksd train all`"
    )


def test_every_family_of_the_catalogue_ships():
    assert {path.stem for path in shipped_folder().glob("*.h5")} == set(ENTRIES)


@pytest.mark.parametrize("path", sorted(shipped_folder().glob("*.h5")), ids=lambda path: path.stem)
def test_a_shipped_record_written_again_is_the_same_file(path):
    assert record_bytes(read_record(path)) == path.read_bytes()
