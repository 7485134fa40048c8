"""Compiled kernels are kept only where nobody but the user can put something else in their place."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from ksd.model import newton
from ksd.numerics import cache

pytestmark = pytest.mark.skipif(os.name == "nt", reason="modes and owners of POSIX")
KEY = cache.cache_name()


@pytest.fixture
def places(tmp_path, monkeypatch):
    """Nothing but `KSD_CACHE_DIR` in a folder of this test, and a home and a temporary folder that do not serve."""
    monkeypatch.setenv("KSD_CACHE_DIR", str(tmp_path / "named"))
    # below a file no folder can be made, by root neither
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path / "file"))
    return tmp_path


def another_user(path, monkeypatch):
    """Let `path` look as if it belonged to somebody else: only root could make it so."""
    real = os.path.realpath(path) if not os.path.islink(path) else None

    def pretend(find):
        def found(self, **ways):
            info = find(self, **ways)
            mine = str(self) == str(path) or (real and os.path.realpath(self) == real)
            return os.stat_result((*info[:4], os.geteuid() + 1, *info[5:])) if mine else info

        return found

    monkeypatch.setattr(cache.Path, "lstat", pretend(cache.Path.lstat))


@pytest.mark.parametrize("umask", [0o022, 0o002, 0o000])
def test_the_folder_is_made_for_the_user_alone(places, umask, caplog):
    before = os.umask(umask)
    try:
        found = cache.cache_folder()
    finally:
        os.umask(before)
    assert found == places / "named" / KEY
    assert stat.S_IMODE(found.stat().st_mode) == 0o700
    assert caplog.text == ""


def test_a_folder_that_others_could_read_is_closed_to_them(places):
    folder = places / "named" / KEY
    folder.mkdir(parents=True, mode=0o755)
    folder.chmod(0o755)
    assert cache.cache_folder() == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.parametrize("which", ["the kernels", "the place", "above"])
def test_a_folder_that_others_can_write_is_not_used(places, which, caplog):
    folder = places / "named" / KEY
    folder.mkdir(parents=True)
    opened = {"the kernels": folder, "the place": folder.parent, "above": places}[which]
    opened.chmod(0o777)
    try:
        assert cache.cache_folder() is None
    finally:
        opened.chmod(0o700)
    said = caplog.text
    assert f"{opened} can be written by other users" in said
    assert "kernels are compiled in memory, at every start" in said


def test_a_shared_folder_with_the_sticky_bit_may_hold_it(places):
    (places / "named").mkdir()
    (places / "named").chmod(0o1777)
    assert cache.cache_folder() == places / "named" / KEY


@pytest.mark.parametrize("kind", ["folder", "link"])
def test_what_belongs_to_another_user_is_not_used(places, kind, monkeypatch, caplog):
    shared = places / "named"
    shared.mkdir()
    shared.chmod(0o1777)
    own = places / "own"
    own.mkdir(mode=0o700)
    theirs = shared / KEY
    if kind == "folder":
        theirs.mkdir(mode=0o700)
    else:
        theirs.symlink_to(own)
    another_user(theirs, monkeypatch)
    assert cache.cache_folder() is None
    assert f"{theirs} belongs to another user" in caplog.text
    assert not any(own.iterdir())


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give a folder away"
)
def test_a_folder_given_away_is_not_used(places):
    theirs = places / "named" / KEY
    theirs.mkdir(parents=True, mode=0o700)
    os.chown(theirs, 12345, 12345)
    assert cache.cache_folder() is None


def test_a_link_of_the_users_own_is_followed(places):
    (places / "disk").mkdir(mode=0o700)
    (places / "named").symlink_to(places / "disk")
    assert cache.cache_folder() == places / "disk" / KEY


def test_another_place_is_told_when_the_named_one_is_not_used(places, monkeypatch, caplog):
    monkeypatch.setenv("KSD_CACHE_DIR", str(places / "file" / "below"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(places / "home"))
    assert cache.cache_folder() == places / "home" / "ksd" / KEY
    assert f"{places / 'home' / 'ksd' / KEY} is used" in caplog.text


def test_without_a_folder_kernels_are_compiled_in_memory(tmp_path):
    (tmp_path / "file").touch()
    nowhere = str(tmp_path / "file")
    code = (
        "from ksd.numerics import cache, kernel\n"
        "@kernel.kernel\n"
        "def double(x):\n    return 2.0 * x\n"
        "print(cache.CACHE_FOLDER, double(1.5))"
    )
    ways = {
        "KSD_CACHE_DIR": nowhere,
        "XDG_CACHE_HOME": nowhere,
        "TMPDIR": nowhere,
        "TEMP": nowhere,
        "TMP": nowhere,
    }
    away = "import tempfile; tempfile.tempdir = " + repr(nowhere) + "\n"
    done = subprocess.run(
        [sys.executable, "-c", away + code], env={**os.environ, **ways}, capture_output=True, text=True
    )
    assert done.stdout == "None 3.0\n", done.stderr
    assert done.stderr.count("kernels are compiled in memory, at every start") == 1


@pytest.mark.parametrize("compiled", [False, True])
def test_the_process_that_compiles_looks_for_garbage_less_often(tmp_path, compiled):
    """Only with an empty cache; a collector that was switched off stays so."""
    if compiled:
        folder = tmp_path / KEY / cache.source_hash(Path(newton.__file__))
        folder.mkdir(parents=True)
        (folder / "newton.newton-1.nbi").touch()
    told = []
    for own in (700, 0):
        program = f"import gc; gc.set_threshold({own}, 10, 10); import ksd.solvers.precompile; print(*gc.get_threshold())"
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True,
            env={**os.environ, "KSD_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "0"},
        )  # fmt: skip
        told.append(done.stdout.split())
    assert told == [["700" if compiled else "100000", "10", "10"], ["0", "10", "10"]]


def test_a_changed_callee_or_number_gives_its_callers_another_folder(tmp_path):
    """And nothing else: a kernel compiled before is not compiled again where it has nothing to do with the change."""
    package = tmp_path / "ksd"
    shutil.copytree(Path(cache.__file__).parents[1], package, ignore=shutil.ignore_patterns("__pycache__"))

    def hashes():
        program = (
            "from pathlib import Path; import sys; from ksd.numerics import cache\n"
            "print(*(cache.source_hash(Path(cache.__file__).parents[1] / p) for p in sys.argv[1:]))"
        )
        names = [
            "numerics/rotations.py",
            "elements/strain.py",
            "numerics/blocks.py",
            "joints/substructures.py",
        ]
        done = subprocess.run(
            [sys.executable, "-c", program, *names], capture_output=True, text=True, check=True, cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
        )  # fmt: skip
        return dict(zip(names, done.stdout.split(), strict=True))

    def changed_by(name, old, new):
        before = hashes()
        path = package / name
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new, 1))
        return [name for name, found in hashes().items() if found != before[name]]

    assert changed_by("numerics/rotations.py", "@kernel", "@kernel  # changed") == [
        "numerics/rotations.py", "elements/strain.py", "joints/substructures.py",
    ]  # fmt: skip
    # numbers that kernels take as they are come from sources without kernels too
    assert changed_by("joints/joint_arrays.py", '"""', '"""Changed. ') == ["joints/substructures.py"]
    assert changed_by("scene/mechanism.py", '"""', '"""Changed. ') == []
