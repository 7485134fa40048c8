"""Files under random attack: 6,700 damaged records, tables, results, link matrices, scenes and kept sweeps.

    python benchmarks/robust_files.py [--files 6700]

Bits flipped, ends cut, pieces overwritten, doubled or zeroed. Every file must be refused in one sentence of its own error
type (a scene in one for each mistake), or give what the undamaged one gives (or, without a checksum in the file, something
that passes all checks). Prints counts and the largest memory; returns the number of files that did anything else.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "library"), str(ROOT)]

from test_hostile_files import POINTS, stiffness  # noqa: E402

import ksd  # noqa: E402
from ksd.errors import KsdError  # noqa: E402
from ksd.library import read_record, read_result  # noqa: E402
from ksd.library.record_files import shipped_folder  # noqa: E402
from ksd.library.result_files import write_result  # noqa: E402
from ksd.study import Table  # noqa: E402
from ksd.study.resume import ResumeFile  # noqa: E402

CHECKSUMMED = {"record", "table", "result"}


def damages(content: bytes, rng: np.random.Generator) -> Iterator[bytes]:
    """Endless damaged copies."""
    while True:
        altered, kind = bytearray(content), int(rng.integers(5))
        first, last = sorted(int(n) for n in rng.integers(0, len(content), 2))
        last = min(last, first + 64)
        if kind == 0:
            for bit in rng.integers(0, 8 * len(content), int(rng.integers(1, 4))):
                altered[bit // 8] ^= 1 << (bit % 8)
        elif kind == 1:
            del altered[first:]
        elif kind == 2:
            altered[first:last] = rng.bytes(last - first)
        elif kind == 3:
            altered[first:first] = altered[first:last]
        else:
            altered[first:last] = bytes(last - first)
        if bytes(altered) != content:
            yield bytes(altered)


def kinds(folder: Path) -> dict[str, tuple[Path, Callable[[Path], Any]]]:
    """Every kind of file: path and reader."""
    record = folder / "filleted_notch.h5"
    record.write_bytes((shipped_folder() / record.name).read_bytes())
    columns = {n: tuple(float(k) for k in range(31)) for n in ("top_mm", "force_N")}
    table = Table({**columns, "status": ("ok",) * 31}, ("top_mm",)).to_hdf5(folder / "table.h5")
    answer = write_result({n: list(v) for n, v in columns.items()}, folder / "answer.json")
    np.savez(folder / "arm.npz", K=stiffness(), points=POINTS)
    with h5py.File(folder / "arm.h5", "w") as file:
        file["K"], file["points"] = stiffness(), POINTS
    with h5py.File(folder / "packed.h5", "w") as file:
        for name, values in (("K", stiffness()), ("points", POINTS)):
            file.create_dataset(name, data=values, compression="gzip", shuffle=True, fletcher32=True)
    with h5py.File(folder / "pieces.h5", "w", libver="latest") as file:
        for name, values in (("K", stiffness()), ("points", POINTS)):
            file.create_dataset(name, data=values, chunks=(2, 3))
    scene = folder / "scene.toml"
    scene.write_bytes((ROOT / "ksd" / "scenes" / "fourbar.toml").read_bytes())
    ResumeFile(folder / "sweep.jsonl", lambda: "x").add(0, [{"force_N": 1.0}] * 20)
    return {
        "record": (record, read_record),
        "table": (table, Table.from_hdf5),
        "result": (answer, read_result),
        "matrix, numpy": (folder / "arm.npz", ksd.link_matrix),
        "matrix, HDF5": (folder / "arm.h5", ksd.link_matrix),
        "matrix, HDF5 packed": (folder / "packed.h5", ksd.link_matrix),
        "matrix, HDF5 in pieces": (folder / "pieces.h5", ksd.link_matrix),
        "scene": (scene, ksd.load_scene),
        "sweep": (folder / "sweep.jsonl", lambda path: ResumeFile(path, lambda: "x")),
    }


def main() -> int:
    """Returns the number of damaged files that were neither refused nor read as they may be."""
    words = argparse.ArgumentParser()
    words.add_argument("--files", type=int, default=6700)
    asked, rng, wrong = words.parse_args(), np.random.default_rng(0), 0
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as name:
        every = kinds(Path(name))
        for kind, (path, read) in every.items():
            content = path.read_bytes()
            told: Counter[str] = Counter()
            read(path)
            for _, damaged in zip(range(-(-asked.files // len(every))), damages(content, rng), strict=False):
                path.write_bytes(damaged)
                try:
                    read(path)
                    told["read" if kind not in CHECKSUMMED else "WRONG"] += 1
                except KsdError as error:
                    # a scene lists its mistakes, one to a line
                    told["refused" if kind == "scene" or "\n" not in str(error) else "WRONG"] += 1
                except Exception as error:
                    told["WRONG"] += 1
                    print(f"{kind}: {error!r}")
            wrong += told["WRONG"]
            print(f"{kind}: {dict(told)}", flush=True)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"{wrong} wrong; largest memory {memory} MB")
    return wrong


if __name__ == "__main__":
    sys.exit(main())
