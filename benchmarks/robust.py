"""Everything that may not go wrong in silence, one script after the other, each printing its counts.

    python benchmarks/robust.py [arms estimates files kills trust use]

arms: open chains of joints against differences and pivoting; estimates: error figures against the truth; files: damage;
kills: bit flips and training killed at random moments; trust: scenes no flexure has, taut leaves; use: memory, threads.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PARTS = tuple(sorted(path.stem.removeprefix("robust_") for path in HERE.glob("robust_*.py")))


def main(wanted: list[str]) -> int:
    """Returns how many of the parts wanted (all when none is named) ended with something wrong."""
    unknown = [part for part in wanted if part not in PARTS]
    if unknown:
        print(f"'{unknown[0]}' is no part; the parts are {', '.join(PARTS)}", file=sys.stderr)
        return 2
    wrong = 0
    for part in wanted or PARTS:
        print(f"== {part}", flush=True)
        wrong += (
            subprocess.run([sys.executable, str(HERE / f"robust_{part}.py")], check=False).returncode != 0
        )
    return wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
