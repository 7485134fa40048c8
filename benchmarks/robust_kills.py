"""Files under attack: bit flips, cuts, kills of training at random moments; prints what was tried and what got through.

    python benchmarks/robust_kills.py [--kills 100] [--flips 20000]

The tests of `tests/library/test_damage.py` with larger numbers. Nothing may get through.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "library"), str(ROOT / "tests"), str(ROOT)]

from test_damage import SMALLEST, all_refused, killed_training  # noqa: E402

from ksd.library import read_record, read_result  # noqa: E402
from ksd.library.result_files import write_result  # noqa: E402
from ksd.study import Table  # noqa: E402


def main() -> int:
    """Returns the number of damaged files that were read without complaint, plus 1 if killed training differs."""
    words = argparse.ArgumentParser()
    words.add_argument("--kills", type=int, default=100)
    words.add_argument("--flips", type=int, default=20_000)
    asked = words.parse_args()
    rng, through = np.random.default_rng(0), 0
    many = {"flips": asked.flips, "cuts": asked.flips // 5}
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as name:
        folder = Path(name)
        record = folder / SMALLEST.name
        record.write_bytes(SMALLEST.read_bytes())
        columns = {n: tuple(rng.normal(size=31).tolist()) for n in ("top_mm", "force_N")}
        table = Table({**columns, "status": ("ok",) * 31}, ("top_mm",)).to_hdf5(folder / "table.h5")
        answer = write_result({n: list(v) for n, v in columns.items()}, folder / "answer.json")
        for path, read in ((record, read_record), (table, Table.from_hdf5), (answer, read_result)):
            got = all_refused(path, read, rng, **many)
            through += got
            print(f"{path.name}: {asked.flips} bit flips and {asked.flips // 5} cuts, {got} read", flush=True)
        killed_training(folder / "whole", 0, rng, span=(0.0, 1.0))
        hit = killed_training(folder / "killed", asked.kills, rng, span=(0.3, 2.5))
        one, other = ((folder / n / "cross_flexure.h5").read_bytes() for n in ("whole", "killed"))
        print(
            f"training killed {hit} times of {asked.kills}: {'same bytes' if one == other else 'OTHER BYTES'}"
        )
        return through + (one != other)


if __name__ == "__main__":
    sys.exit(main())
