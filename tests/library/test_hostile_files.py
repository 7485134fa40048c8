"""Files that lie: pipes, devices, sizes of 80 GB, links to other files, records sealed again. A sentence each, in bounds."""

import math
import os
import stat
import subprocess
import sys
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import ksd
import ksd.files
from ksd.errors import KsdError, RecordError, SceneError
from ksd.files import read_file, write_file
from ksd.library import describe_database, find_record, read_record, read_result, record_files, write_record
from ksd.library.result_files import sealed_header, write_result
from ksd.optimisation.design_log import DesignLog
from ksd.study import Table
from ksd.study.resume import ResumeFile, _hash

POINTS = np.array([[0.0, 0, 0], [0.2, 0, 0]])
needs_posix = pytest.mark.skipif(os.name != "posix", reason="pipes and devices of POSIX")


def one_sentence(error, path):
    said = str(error)
    assert "\n" not in said and Path(path).name in said and said.endswith("."), said
    assert len(said) < 600, said


def refused(read, path, kind, match="."):
    with pytest.raises(kind, match=match) as caught:
        read(path)
    one_sentence(caught.value, path)


def stiffness():
    """A free link whose ends are joined by a stiffness of all six directions."""
    arm = POINTS[1] - POINTS[0]
    lever = np.eye(6)
    x, y, z = arm
    lever[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    change = np.hstack([-lever, np.eye(6)])
    return change.T @ np.diag([1e6, 2e6, 3e6, 4e3, 5e3, 6e3]) @ change


@pytest.fixture
def matrices(tmp_path):
    np.savez(tmp_path / "arm.npz", K=stiffness(), points=POINTS)
    with h5py.File(tmp_path / "arm.h5", "w") as file:
        file["K"], file["points"] = stiffness(), POINTS
    for path in (tmp_path / "arm.npz", tmp_path / "arm.h5"):
        assert np.allclose(ksd.link_matrix(path).stiffness, stiffness())
    return tmp_path / "arm.npz", tmp_path / "arm.h5"


def readers(folder):
    """Everything that reads a file: function, name of the file, error."""
    return {
        "record": (read_record, folder / "toy.h5", RecordError),
        "table": (Table.from_hdf5, folder / "table.h5", RecordError),
        "result": (read_result, folder / "answer.json", RecordError),
        "matrix": (ksd.link_matrix, folder / "arm.npz", SceneError),
        "matrix in HDF5": (ksd.link_matrix, folder / "arm.h5", SceneError),
        "scene": (ksd.load_scene, folder / "scene.toml", SceneError),
        "sweep": (lambda path: ResumeFile(path, lambda: "x"), folder / "sweep.jsonl", SceneError),
    }


@needs_posix
@pytest.mark.parametrize("name", readers(Path()))
def test_what_is_no_file_is_refused_at_once(name, tmp_path):
    """A pipe that nobody writes to would be waited for, a device without end read for ever."""
    read, path, kind = readers(tmp_path)[name]
    os.mkfifo(path)
    refused(read, path, kind, "a pipe")
    path.unlink()
    path.symlink_to("/dev/zero")
    refused(read, path, kind, "a device")
    path.unlink()
    path.mkdir()
    refused(read, path, kind)
    path.rmdir()
    with open(path, "wb") as file:
        # takes no room on disk
        file.truncate(80 << 30)
    refused(read, path, kind, "larger than the")
    path.unlink()
    for content in (b"", b"text\n", b"\xff\x00" * 300):
        if name == "sweep" and not content:
            continue
        path.write_bytes(content)
        refused(read, path, kind)


@needs_posix
def test_a_pipe_in_the_database_is_listed_with_its_problem(record, tmp_path, monkeypatch):
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    os.mkfifo(tmp_path / "toy.h5")
    (listing,) = (entry for entry in describe_database() if entry.family == "toy")
    assert "a pipe" in listing.problem


def damages(content, rng, count):
    for bit in rng.integers(0, 8 * len(content), count):
        altered = bytearray(content)
        altered[bit // 8] ^= 1 << (bit % 8)
        yield bytes(altered)
    for length in rng.integers(0, len(content), count // 2):
        yield content[:length]


def test_damaged_link_matrices_are_refused_or_almost_the_same(matrices, rng):
    """Bits flipped and ends cut: a sentence, or a matrix that is symmetric and has its rigid motions."""
    for path in matrices:
        content = path.read_bytes()
        for damaged in damages(content, rng, 150):
            path.write_bytes(damaged)
            try:
                found = ksd.link_matrix(path)
            except SceneError as error:
                assert "\n" not in str(error)
            else:
                assert np.all(np.isfinite(found.stiffness))


@pytest.mark.parametrize("value", [1e300, 1.7e308, 1e40])
def test_a_link_matrix_beyond_all_sizes_is_refused(value, tmp_path):
    """One flipped bit of an exponent does this; eigenvalues of it do not converge."""
    K = stiffness()
    K[3, 3] = K[9, 9] = value
    K[3, 9] = K[9, 3] = -value
    np.savez(tmp_path / "arm.npz", K=K, points=POINTS)
    with pytest.raises(SceneError, match="link matrix: stiffness holds"):
        ksd.link_matrix(tmp_path / "arm.npz")


def npy(descr, shape, body):
    head = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + body


@pytest.mark.parametrize("case", ["huge", "short", "objects", "text", "unpacks", "nothing", "complex"])
def test_numpy_files_that_lie(case, tmp_path):
    path = tmp_path / "arm.npz"
    body = stiffness().tobytes()
    made = {
        "huge": npy("<f8", (100_000, 100_000), body),
        "short": npy("<f8", (12, 12), body[:-8]),
        "objects": npy("|O", (12, 12), body),
        "complex": npy("<c16", (12, 6), body),
        "text": b"text",
        "nothing": b"",
        "unpacks": npy("<f8", (12, 12), body) + bytes(ksd.files.MAX_READ_BYTES),
    }[case]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", npy("<f8", (2, 3), POINTS.tobytes()))
        archive.writestr("K.npy", made)
    refused(ksd.link_matrix, path, SceneError, "cannot be read")


def lies(tmp_path):
    """HDF5 files with a dataset K that is not what it seems, by name."""
    (tmp_path / "numbers").write_bytes(stiffness().tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["K"] = stiffness()

    def virtual(file):
        layout = h5py.VirtualLayout((12, 12), float)
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "K", (12, 12))
        file.create_virtual_dataset("K", layout)

    def bomb(file):
        data = file.create_dataset("K", (12, 12), float, chunks=(12, 12), compression="gzip")
        data.id.write_direct_chunk((0, 0), zlib.compress(bytes(10_000_000)))

    def short(file):
        data = file.create_dataset("K", (12, 12), float, chunks=(12, 12), compression="gzip", shuffle=True)
        data.id.write_direct_chunk((0, 0), zlib.compress(bytes(100)))

    def biased(file):
        kind = h5py.h5t.IEEE_F64LE.copy()
        kind.set_ebias(1023 - 64)
        space = h5py.h5s.create_simple((12, 12))
        h5py.h5d.create(file.id, b"K", kind, space).write(h5py.h5s.ALL, h5py.h5s.ALL, stiffness(), kind)

    return {
        "biased": biased,
        "external link": lambda f: f.__setitem__("K", h5py.ExternalLink(str(tmp_path / "other.h5"), "K")),
        "soft link": lambda f: (f.__setitem__("L", stiffness()), f.__setitem__("K", h5py.SoftLink("/L"))),
        "external storage": lambda f: f.create_dataset(
            "K", (12, 12), float, external=[(str(tmp_path / "numbers"), 0, h5py.h5f.UNLIMITED)]
        ),
        "virtual": virtual,
        "bomb": bomb,
        "short piece": short,
        "huge": lambda f: f.create_dataset("K", (100_000, 100_000), float, chunks=(10, 10)),
        "huge pieces": lambda f: f.create_dataset(
            "K", (12, 12), float, chunks=(20_000, 20_000), maxshape=(None, None)
        ),
        "group": lambda f: f.create_group("K"),
        "text": lambda f: f.__setitem__("K", "text"),
        "none": lambda f: f.__setitem__("K", h5py.Empty("f8")),
        "complex": lambda f: f.__setitem__("K", stiffness() * 1j),
        "compound": lambda f: f.__setitem__("K", np.zeros(3, [("a", float), ("b", int)])),
        "one number": lambda f: f.__setitem__("K", 3.0),
        "not finite": lambda f: f.__setitem__("K", stiffness() * math.nan),
    }


LIES = [
    "biased", "external link", "soft link", "external storage", "virtual", "bomb", "short piece", "huge", "huge pieces",
    "group", "text", "none", "complex", "compound", "one number", "not finite",
]  # fmt: skip


@pytest.mark.parametrize("case", LIES)
def test_hdf5_files_that_lie(case, tmp_path):
    path = tmp_path / "arm.h5"
    with h5py.File(path, "w") as file:
        file["points"] = POINTS
        lies(tmp_path)[case](file)
    refused(ksd.link_matrix, path, SceneError)


def resealed(path, spoil, number=record_files.FORMAT, signature=record_files.SIGNATURE):
    """Alter the HDF5 image of a sealed file and seal it again, as anyone can."""
    with h5py.File(path, "r+") as file:
        spoil(file)
    body = path.read_bytes()[record_files.HEADER_BYTES :]
    path.write_bytes(sealed_header(body, number, signature) + body)


def put(name, values):
    def spoil(file):
        del file[name]
        file[name] = values

    return spoil


def said(name, value):
    return lambda file: file.attrs.__setitem__(name, value)


SPOILS = {
    "powers short": put("powers", np.zeros((29, 3), np.int16)),
    "powers narrow": put("powers", np.zeros((30, 2), np.int16)),
    "powers below zero": put("powers", np.full((30, 3), -1, np.int16)),
    "powers high": put("powers", np.full((30, 3), 30_000, np.int16)),
    "powers flat": put("powers", np.zeros(30, np.int16)),
    "powers text": put("powers", "text"),
    "interface": put("functions/strain/interface", np.zeros((5, 30))),
    "interface nan": put("functions/strain/interface", np.full((6, 30), math.nan)),
    "amplitudes": put("functions/strain/amplitudes", np.zeros((2, 11, 30))),
    "wrench": put("functions/strain/wrench", np.zeros((3, 6, 30))),
    "rotations": put("functions/2/rotations", np.zeros((2, 4, 3, 30))),
    "blocks": put("functions/2/blocks", np.zeros((2, 6, 30))),
    "no group": lambda f: f["functions/2"].__delitem__("rotations"),
    "other group": lambda f: f["functions/2"].__setitem__("more", np.zeros(3)),
    "mesh": lambda f: f.move("functions/2", "functions/0"),
    "mesh name": lambda f: f.move("functions/2", "functions/two"),
    "no mesh": lambda f: f["functions"].clear(),
    "no functions": lambda f: f.__delitem__("functions"),
    "functions elsewhere": lambda f: (f.__delitem__("functions"), f.__setitem__("functions", h5py.SoftLink("/"))),
    "leaves": said("leaves", "[]"),
    "leaf springs three": said("leaves", '["a", "b", "c"]'),
    "leaf springs numbers": said("leaves", "[1, 2]"),
    "orders": said("orders", "[4, 3]"),
    "orders other": said("orders", "[4, 3, 6]"),
    "motions none": said("motions", "[]"),
    "motions deep": said("motions", "[" * 100_000),
    "motions reversed": said("motions", '[{"name": "a", "kind": "rotation", "low": 1, "high": -1}]'),
    "motions tiny": said("motions", '[{"name": "a", "kind": "rotation", "low": 0, "high": 1e-200}]'),
    "motions text": said("motions", '[{"name": "a", "kind": "rotation", "low": "0", "high": "1"}]'),
    "motions word": said("motions", '[{"name": "a", "kind": "x", "low": 0, "high": 1}]'),
    "parameters": said("parameters", "[{}]"),
    "parameters log": said(
        "parameters",
        '[{"name": "a", "low": 0, "high": 1, "scale": "log"}, {"name": "b", "low": 0, "high": 1, "scale": "linear"}]',
    ),
    "design": said("design", "[]"),
    "residuals": said("residuals", '[{"mesh": 1}]'),
    "samples": said("samples", '["a", "b"]'),
    "family": said("family", 3),
    "family list": said("family", ["toy", "toy"]),
    "history": said("history", "[[]]"),
    "probes": put("probes/values", np.zeros((2, 77))),
    "probes nan": put("probes/motions", np.full((2, 1), math.nan)),
    "probes gone": lambda f: f["probes"].__delitem__("shapes"),
}  # fmt: skip


@pytest.mark.parametrize("case", SPOILS)
def test_records_sealed_again_are_refused(case, record, tmp_path):
    path = write_record(record, tmp_path / "toy.h5")
    assert read_record(path).leaves == record.leaves
    resealed(path, SPOILS[case])
    refused(read_record, path, RecordError, "sealed but not a readable joint record")


def test_a_record_under_another_name_is_refused(record, tmp_path, monkeypatch):
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    write_record(record, tmp_path / "cross_flexure.h5")
    with pytest.raises(RecordError, match="holds the record of 'toy'"):
        find_record("cross_flexure")


def test_a_record_of_another_joint_is_refused(record, tmp_path, monkeypatch):
    """Two leaf springs in the record, three in the joint: no index error later."""
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    kept = read_record(record_files.shipped_folder() / "cross_flexure.h5")
    names = tuple(p.name for p in kept.parameters)
    parameters = tuple(replace(record.parameters[0], name=n, low=0.01, high=10.0) for n in names)
    write_record(
        replace(record, family="cross_flexure", parameters=parameters), tmp_path / "cross_flexure.h5"
    )
    mechanism, targets, _ = ksd.load_scene(Path(ksd.__file__).parent / "scenes" / "cross_flexure.toml")
    with pytest.raises(RecordError, match="of a joint with 2 leaf springs, this one has 3"):
        ksd.prepare(mechanism)(targets, method="kinematic")


def test_tables_sealed_again_are_refused(tmp_path):
    columns = {"top_mm": (0.0, 1.0), "force_N": (2.0, 3.0), "status": ("ok", "ok")}
    spoils = {
        "short": put("force_N", np.zeros(1)),
        "flat": put("force_N", 3.0),
        "no number": lambda f: f["force_N"].attrs.__delitem__("column"),
        "texts": lambda f: f["force_N"].attrs.__setitem__("column", "one"),
        "group": lambda f: f.create_group("more"),
        "link": lambda f: f.__setitem__("more", h5py.ExternalLink("other.h5", "/")),
        "about": lambda f: f.attrs.__setitem__("name", np.zeros(3)),
        "complex": put("force_N", np.zeros(2, complex)),
        "huge": lambda f: f.create_dataset("more", (10**11,), float, chunks=(10,)),
        "no status": lambda f: f.__delitem__("status"),
    }
    for case, spoil in spoils.items():
        path = Table(columns, ("top_mm",)).to_hdf5(tmp_path / "table.h5")
        resealed(path, spoil, 1, b"ksd table\n")
        refused(Table.from_hdf5, path, RecordError, "no ksd table|no table of a sweep")
        assert path.is_file(), case


def test_kept_lines_with_a_right_hash_and_wrong_content_are_computed_again(tmp_path):
    path = tmp_path / "sweep.jsonl"
    bodies = ("3", "[]", "{", '{"line": 0}', '{"line": "a", "rows": []}', '{"line": 1, "rows": [3]}')
    for body in (*bodies, '{"line": 1, "rows": [{"force_N": [1]}]}', "[" * 100_000):
        path.unlink(missing_ok=True)
        ResumeFile(path, lambda: "x").add(0, [{"force_N": 1.0}])
        with open(path, "a") as file:
            file.write(f"{_hash(body)} {body}\n")
        assert ResumeFile(path, lambda: "x").entries == {0: [{"force_N": 1.0}]}


def test_kept_designs_with_a_right_hash_and_wrong_content_are_computed_again(tmp_path):
    path, job = (
        tmp_path / "job.jsonl",
        SimpleNamespace(parameters=("t",), names=("force_N",), fingerprint=lambda: "x"),
    )
    good = {"t": 1.0, "force_N": 2.0, "status": "ok"}
    for key, rows in (("a", []), ("b", [{"t": 1.0}]), ("slopes a", [good, good]), ("slopes b", [{"t": 1.0}])):
        path.unlink(missing_ok=True)
        kept = ResumeFile(path, lambda: "x", what="job")
        kept.add("0x1p+0", [good])
        kept.add(key, rows)
        assert DesignLog(job, resume=path).file.entries == {"0x1p+0": [good]}


def test_an_answer_that_is_no_json_is_refused_before_it_is_written(tmp_path):
    for numbers in ({"a": math.nan}, {"a": {1, 2}}):
        with pytest.raises(SceneError, match="cannot be written"):
            write_result(numbers, tmp_path / "a.json")
    assert list(tmp_path.iterdir()) == []


@needs_posix
def test_devices_pipes_and_the_output_itself_are_never_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for place in ("/dev/full", "/dev/null", tmp_path / "pipe", tmp_path):
        before = os.stat(place)
        with pytest.raises(SceneError, match="cannot be written: it is a"):
            write_file(place, b"content")
        assert (os.stat(place).st_ino, os.stat(place).st_mode) == (before.st_ino, before.st_mode)
    out = tmp_path / "out.txt"
    code = f"from ksd.files import write_file; print(1, flush=True); write_file({str(out)!r}, 'x')"
    with open(out, "w") as file:
        done = subprocess.run([sys.executable, "-c", code], stdout=file, stderr=subprocess.PIPE, text=True)
    assert "where standard output goes" in done.stderr and out.read_text() == "1\n"


@needs_posix
def test_a_link_stays_a_link_and_permissions_stay(tmp_path):
    kept = tmp_path / "kept.json"
    kept.write_text("old")
    kept.chmod(0o600)
    (tmp_path / "link.json").symlink_to("kept.json")
    write_file(tmp_path / "link.json", "new")
    assert (tmp_path / "link.json").is_symlink() and kept.read_text() == "new"
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600
    # a name as long as names may be leaves no room for another ending
    write_file(tmp_path / ("n" * 255), "new")
    assert read_file(tmp_path / ("n" * 255)) == b"new"


def test_names_that_are_none_are_sentences(tmp_path):
    for path in ("a\0b", "a\ud800b", "", None, 1 << 70):
        for use in (read_file, lambda p: write_file(p, b"x")):
            with pytest.raises(KsdError) as caught:
                use(path)
            assert "\n" not in str(caught.value)
    with pytest.raises(SceneError) as caught:
        read_file("two\nlines")
    assert "\n" not in str(caught.value)


def test_a_record_replaced_while_a_process_runs_serves_the_next_solve(tmp_path, monkeypatch):
    """The next solve of the scene uses the new record, or says that it is damaged; a prepared solver stays as it was."""
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    kept = read_record(record_files.shipped_folder() / "cross_flexure.h5")
    path = write_record(kept, tmp_path / "cross_flexure.h5")
    mechanism, targets, _ = ksd.load_scene(Path(ksd.__file__).parent / "scenes" / "cross_flexure.toml")
    how = {"method": "kinematic", "strict": False}
    prepared = ksd.prepare(mechanism)
    first, old = (
        solve(targets, **how).forces for solve in (lambda t, **h: ksd.solve(mechanism, t, **h), prepared)
    )
    strain = kept.functions["strain"]
    bent = replace(strain, amplitudes=1.2 * strain.amplitudes)
    write_record(replace(kept, functions={**kept.functions, "strain": bent}), path)
    second = ksd.solve(mechanism, targets, **how).forces
    assert second != first and prepared(targets, **how).forces == old
    write_record(kept, path)
    assert ksd.solve(mechanism, targets, **how).forces == first
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RecordError, match="damaged"):
        ksd.solve(mechanism, targets, **how)
    assert prepared(targets, **how).forces == old
