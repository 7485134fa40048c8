"""Damage done to files: bits flipped, ends cut, disks full, folders closed, readers beside a writer, training killed."""

import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from processes import environment

import ksd.library.record_files as files
from ksd.errors import RecordError, SceneError
from ksd.files import check_target
from ksd.library import read_record, read_result, write_record
from ksd.library.result_files import write_result
from ksd.study import Table
from ksd.study.resume import ResumeFile

FLIPS, CUTS = 5000, 1000
SMALLEST = files.shipped_folder() / "filleted_notch.h5"
"""The smallest record that ships: 10 kB."""


def damages(content, rng, *, flips, cuts):
    """`content` with one random bit flipped, then cut at a random place, that many times."""
    for bit in rng.integers(0, 8 * len(content), flips):
        altered = bytearray(content)
        altered[bit // 8] ^= 1 << (bit % 8)
        yield bytes(altered)
    for length in rng.integers(0, len(content), cuts):
        yield content[:length]


def all_refused(path, read, rng, *, flips=FLIPS, cuts=CUTS):
    """How many damaged copies of `path` were read without complaint; each refusal is one sentence."""
    content, accepted = path.read_bytes(), 0
    read(path)
    for damaged in damages(content, rng, flips=flips, cuts=cuts):
        path.write_bytes(damaged)
        try:
            read(path)
        except RecordError as error:
            assert str(path) in str(error) and "\n" not in str(error)
        else:
            accepted += 1
    path.write_bytes(content)
    read(path)
    return accepted


def test_every_damage_to_a_record_is_refused(memory, rng):
    path = memory / SMALLEST.name
    path.write_bytes(SMALLEST.read_bytes())
    assert all_refused(path, read_record, rng) == 0


@pytest.fixture
def memory(tmp_path):
    """A folder that is no disk where there is one, so that thousands of writes take no time."""
    if not Path("/dev/shm").is_dir():
        yield tmp_path
        return
    with tempfile.TemporaryDirectory(dir="/dev/shm") as name:
        yield Path(name)


@pytest.fixture
def table():
    numbers = np.random.default_rng(3).normal(size=(3, 7)).tolist()
    status = ("ok",) * 6 + ("joint 'a' would turn too far",)
    columns = {
        "top_mm": tuple(numbers[0]),
        "force_N": tuple(numbers[1]),
        "µ": tuple(numbers[2]),
        "status": status,
    }
    return Table(columns, ("top_mm",), moving=("top_mm",), name="stroke", facts={"method": "reduced"})


def test_every_damage_to_a_table_is_refused(table, memory, rng):
    path = table.to_hdf5(memory / "stroke.h5")
    assert Table.from_hdf5(path) == table
    assert all_refused(path, Table.from_hdf5, rng, flips=2000, cuts=500) == 0
    with pytest.raises(RecordError, match="cannot be read: it does not exist"):
        Table.from_hdf5(memory / "none.h5")
    with pytest.raises(RecordError, match="no ksd table"):
        Table.from_hdf5(SMALLEST)


def test_every_damage_to_an_answer_is_refused(memory, rng):
    numbers = {
        "mechanism": "µ",
        "force_N": [1.0 / 3.0, -0.0, 5e-324],
        "steps": [{"name": "1", "time_us": None}] * 20,
    }
    path = write_result(numbers, memory / "answer.json")
    assert read_result(path) == numbers
    assert json.loads(path.read_text())["force_N"] == numbers["force_N"]
    assert all_refused(path, read_result, rng) == 0
    for text in ("", "3", "[]", "{}", '{"sha256": 1}', "[" * 100_000):
        path.write_text(text)
        with pytest.raises(RecordError, match="no ksd result"):
            read_result(path)


def test_files_replaced_within_the_grain_of_the_clock_are_read_again(record, tmp_path):
    """Same size, written within a millisecond: the inode tells."""
    path = tmp_path / "toy.h5"
    for n in range(50):
        write_record(replace(record, trained=f"2024-01-{n % 28 + 1:02d}"), path)
        assert read_record(path).trained == f"2024-01-{n % 28 + 1:02d}"


READER = """
import sys, time
from ksd.library import read_record
seen, end = set(), time.monotonic() + 60
while "2024-12-31" not in seen and time.monotonic() < end:
    seen.add(read_record(sys.argv[1]).trained)
    if len(seen) == 5:
        open(f"{sys.argv[1]}.{sys.argv[2]}", "w").close()
print(len(seen), flush=True)
"""


def test_four_processes_read_while_one_replaces(record, tmp_path):
    """Each reader sees whole records only, ends with the last, and none was ever refused."""
    path = write_record(record, tmp_path / "toy.h5")
    start = [sys.executable, "-c", READER, str(path)]
    pipes = {"env": environment(), "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    readers = [subprocess.Popen([*start, str(n)], **pipes) for n in range(4)]
    n = 0
    while any(r.poll() is None for r in readers):
        n += 1
        last = all(Path(f"{path}.{k}").exists() for k in range(4))
        write_record(replace(record, trained="2024-12-31" if last else f"2024-01-{n % 28 + 1:02d}"), path)
        time.sleep(0.003)
    for reader in readers:
        out, err = reader.communicate()
        assert reader.returncode == 0, err.decode()
        assert int(out) > 5


def writers(record, table, folder):
    """Everything that writes a file, as functions without arguments."""

    return {
        "record": lambda: write_record(record, folder / "toy.h5"),
        "table": lambda: table.to_hdf5(folder / "table.h5"),
        "csv": lambda: table.to_csv(folder / "table.csv"),
        "mat": lambda: table.to_mat(folder / "table.mat"),
        "answer": lambda: write_result({"a": list(range(1000))}, folder / "answer.json"),
        "sweep": lambda: ResumeFile(folder / "sweep.jsonl", lambda: "x").add(
            0, [{"force_N": float(n)} for n in range(1000)]
        ),
        "new sweep": lambda: ResumeFile(folder / f"new sweep {os.getpid()}", lambda: "x").add(
            0, [{"force_N": 1.0}] * 50
        ),
    }


def sentences(record, table, folder, prepare):
    """What every writer says in a child process that `prepare` has put in a bad place; old files must be as they were."""
    for write in writers(record, table, folder).values():
        write()
    before = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            prepare()
            for name, write in writers(record, table, folder).items():
                try:
                    write()
                    said = "nothing"
                except ksd_errors() as error:
                    said = str(error)
                except BaseException as error:
                    said = f"TRACEBACK {error!r}"
                os.write(write_end, (json.dumps([name, said]) + "\n").encode())
        finally:
            os._exit(0)
    os.close(write_end)
    with os.fdopen(read_end) as pipe:
        found = dict(json.loads(line) for line in pipe)
    os.waitpid(child, 0)
    after = {
        p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir() if "sweep" not in p.name
    }
    assert {n: h for n, h in before.items() if "sweep" not in n} == after
    # of the sweep, finished lines stay and the one that did not fit is left out

    assert len(ResumeFile(folder / "sweep.jsonl", lambda: "x").entries) == 1
    return found


def ksd_errors():
    from ksd.errors import KsdError

    return KsdError


def full_disk():
    """Files may not grow beyond 50 bytes: what a full disk does to a writer."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50, 50))


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX limits")
def test_a_full_disk_is_one_sentence_and_old_files_stay(record, table, tmp_path):
    found = sentences(record, table, tmp_path, full_disk)
    assert len(found) == 7
    for name, said in found.items():
        assert "cannot be written" in said, (name, said)
        assert "\n" not in said and "too large" in said


def test_a_read_only_folder_is_refused_before_anything_is_computed(monkeypatch, tmp_path):
    closed, access = tmp_path / "closed", os.access
    closed.mkdir()
    (closed / "old.csv").touch()
    monkeypatch.setattr(os, "access", lambda path, mode: path != closed and access(path, mode))
    for name in ("new.csv", "old.csv"):
        with pytest.raises(
            SceneError, match=rf"--out '.*{name}' cannot be written: .* its folder is read-only"
        ):
            check_target(closed / name, what="--out")
        assert check_target(tmp_path / name) == tmp_path / name


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX permissions")
def test_a_read_only_folder_is_one_sentence(record, table, tmp_path):
    def closed():
        if os.geteuid() == 0:
            os.setuid(65534)

    folder = tmp_path / "closed"
    folder.mkdir()
    for place in (tmp_path, *list(tmp_path.parents)[:2]):
        place.chmod(place.stat().st_mode | 0o055)
    folder.chmod(0o755)

    def prepare():
        folder.chmod(0o555)
        closed()

    found = sentences(record, table, folder, prepare)
    folder.chmod(0o755)
    for name, said in found.items():
        assert "Permission denied" in said and "\n" not in said, (name, said)


TRAINING = """
import math, sys
from concurrent.futures import ThreadPoolExecutor
from ksd.training import train
shapes = {"angle": (math.radians(44), math.radians(46)), "width_ratio": (0.9, 1.1)}
with ThreadPoolExecutor(1) as pool:
    train("cross_flexure", shapes=shapes, meshes=("strain",), out=sys.argv[1], trained="2024-05-01", progress=False,
          executor=pool)
"""


def killed_training(folder, kills, rng, *, span):
    """Train into `folder` with `kills` kills (SIGKILL) after random times within span [s], then to the end.

    Nothing finished is lost: what is kept never becomes less, and there is no record before the end. Returns how many of
    the kills found the training at work.
    """
    start = [sys.executable, "-c", TRAINING, str(folder)]
    kept, hit = set(), 0
    for wait in rng.uniform(*span, kills):
        process = subprocess.Popen(start, env=environment())
        time.sleep(wait)
        process.kill()
        hit += process.wait() == -signal.SIGKILL
        now = {p.name for p in (folder / ".cross_flexure.partial").glob("*.npz")}
        done = folder / "cross_flexure.h5"
        if done.exists():
            read_record(done)
            done.unlink()
            kept = set()
            continue
        assert kept <= now
        kept = now
    assert subprocess.run(start, env=environment()).returncode == 0
    assert not (folder / ".cross_flexure.partial").exists()
    return hit


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_killed_training_resumes_to_the_same_bytes(tmp_path, rng):
    """A hundred kills: `python benchmarks/robust_kills.py`."""
    killed_training(tmp_path / "whole", 0, rng, span=(0, 1))
    assert killed_training(tmp_path / "killed", 3, rng, span=(1.0, 2.5)) >= 1
    whole, resumed = ((tmp_path / n / "cross_flexure.h5").read_bytes() for n in ("whole", "killed"))
    assert whole == resumed
