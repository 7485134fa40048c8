"""Records on disk: round trip, sealing, atomic replacement, refusals in one sentence."""

import datetime
import os
from dataclasses import fields, replace

import h5py
import numpy as np
import pytest

import ksd.library.record_files as files
from ksd.errors import RangeError, RecordError
from ksd.library import describe_database, find_record, read_record, write_record


def refused(path, word):
    with pytest.raises(RecordError, match=word) as caught:
        read_record(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_round_trip_keeps_every_number(record, tmp_path):
    path = write_record(record, tmp_path / "toy.h5")
    back = read_record(path)
    for mesh, functions in record.functions.items():
        for group, array in functions.groups().items():
            np.testing.assert_array_equal(back.functions[mesh].groups()[group], array)
    np.testing.assert_array_equal(back.powers, record.powers)
    for field in fields(record):
        if field.name not in ("functions", "powers", "probes"):
            assert getattr(back, field.name) == getattr(record, field.name), field.name
    for field in fields(record.probes):
        np.testing.assert_array_equal(getattr(back.probes, field.name), getattr(record.probes, field.name))


def test_a_file_of_format_1_is_read_and_holds_no_probes(record, tmp_path):
    path = tmp_path / "toy.h5"
    body = files.record_bytes(replace(record, probes=None))[files.HEADER_BYTES :]
    path.write_bytes(files.sealed_header(body, 1) + body)
    back = read_record(path)
    assert back.probes is None and back.history == record.history


def test_a_joint_without_internal_blocks(record, tmp_path):
    functions = {
        mesh: replace(f, blocks=np.zeros((0, 6, len(record.powers)))) for mesh, f in record.functions.items()
    }
    back = read_record(
        write_record(replace(record, blocks=(), probes=None, functions=functions), tmp_path / "toy.h5")
    )
    assert back.functions[2].blocks.shape == (0, 6, len(record.powers))


def test_same_record_gives_the_same_bytes(record, tmp_path):
    first, second = (write_record(record, tmp_path / name).read_bytes() for name in ("a.h5", "b.h5"))
    assert first == second


def test_any_hdf5_program_reads_it_and_finds_units_and_checksums(record, tmp_path):
    with h5py.File(write_record(record, tmp_path / "toy.h5")) as file:
        found = []
        file.visititems(lambda name, item: found.append(item) if isinstance(item, h5py.Dataset) else None)
        assert len(found) == 11
        for item in found:
            assert item.attrs["units"]
            assert item.fletcher32
        assert file.attrs["format"] == files.FORMAT


def test_each_flipped_bit_is_refused(record, tmp_path):
    path = write_record(record, tmp_path / "toy.h5")
    content = path.read_bytes()
    chosen = np.random.default_rng(1).choice(8 * len(content), 300, replace=False)
    for bit in [*range(0, 8 * 100, 3), *chosen]:
        altered = bytearray(content)
        altered[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(altered)
        files._record_cache.clear()
        refused(path, "damaged|not a ksd joint record")


def test_truncated_and_extended_files_are_refused(record, tmp_path):
    path = write_record(record, tmp_path / "toy.h5")
    content = path.read_bytes()
    for length in [0, 1, 20, 511, 512, 513, *np.linspace(600, len(content) - 1, 30, dtype=int)]:
        path.write_bytes(content[:length])
        refused(path, "damaged|not a ksd joint record")
    path.write_bytes(content + b"\0")
    refused(path, "damaged")


def test_foreign_missing_and_newer_files_are_refused(record, tmp_path, monkeypatch):
    path = tmp_path / "toy.h5"
    refused(path, r"ksd\.train\(joint\)")
    path.write_bytes(b"hello")
    refused(path, "not a ksd joint record")
    with h5py.File(path, "w") as file:
        file["x"] = 1.0
    refused(path, "not a ksd joint record")
    refused(tmp_path, "cannot be read")
    monkeypatch.setattr(files, "FORMAT", 4)
    write_record(record, path)
    monkeypatch.undo()
    refused(path, "format 4, newer than the 3")


def test_sealed_but_incomplete_content_is_refused(tmp_path):
    path = tmp_path / "toy.h5"
    body = b"\0" * 100
    path.write_bytes(files.sealed_header(body, 1) + body)
    refused(path, "not a readable joint record")


def test_a_crash_while_writing_leaves_the_old_record(record, tmp_path, monkeypatch):
    path = write_record(record, tmp_path / "toy.h5")
    before = path.read_bytes()
    for step in ("fsync", "replace"):

        def crash(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(os, step, crash)
        with pytest.raises(KeyboardInterrupt):
            write_record(replace(record, trained="2031-01-01"), path)
        monkeypatch.undo()
        assert path.read_bytes() == before
        assert [p.name for p in tmp_path.iterdir()] == ["toy.h5"]


def test_a_folder_that_cannot_be_written_is_a_sentence(record, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RecordError, match=r"folder .* cannot be made"):
        write_record(record, tmp_path / "file" / "toy.h5")


def test_unchanged_files_are_read_once_and_changed_ones_again(record, tmp_path):
    path = write_record(record, tmp_path / "toy.h5")
    assert read_record(path) is read_record(path)
    write_record(replace(record, history=("again", "and again")), path)
    assert read_record(path).history == ("again", "and again")


def test_search_order_and_missing_family(record, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path / "mine"))
    with pytest.raises(RecordError, match=r"ksd\.train\(joint\).*KSD_DATABASE"):
        find_record("toy")
    write_record(record, tmp_path / "database" / "toy.h5")
    assert find_record("toy").history == record.history
    write_record(replace(record, history=("mine",)), tmp_path / "mine" / "toy.h5")
    assert find_record("toy").history == ("mine",)


def test_the_database_describes_itself_and_names_damaged_files(record, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    write_record(record, tmp_path / "toy.h5")
    (tmp_path / "broken.h5").write_bytes(b"nothing")
    rows = {row.family: row for row in describe_database(datetime.date(2024, 1, 31))}
    toy, broken = rows["toy"], rows["broken"]
    assert toy.age == 30.0 and toy.size > 0 and len(toy.checksum) == 64 and not toy.problem
    assert toy.meshes == ("strain", 2) or set(toy.meshes) == {"strain", 2}
    assert dict(toy.worst)["interface"] == 3e-6
    assert "not a ksd joint record" in broken.problem


def test_errors_carry_the_exit_codes(record):
    with pytest.raises(RangeError) as caught:
        record.contract({"angle": 2.0, "ratio": 1.0}, "strain")
    assert caught.value.exit_code == 2
    assert RecordError.exit_code == 4
