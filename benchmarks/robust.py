"""Everything that may not go wrong in silence, one script after the other; what each counts goes to results/robust.md.

    python benchmarks/robust.py [arms estimates files kills trust use]

arms: open chains of joints against differences and pivoting; estimates: error figures against the truth; files: damage;
kills: bit flips and training killed at random moments; trust: scenes no flexure has, taut leaves; use: memory, threads.
Only a run of all parts is written.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from common import RESULTS, machine, spoken_machine

HERE = Path(__file__).resolve().parent
PARTS = {path.stem.removeprefix("robust_"): path for path in sorted(HERE.glob("robust_*.py"))}


def told(part: str) -> tuple[bool, list[str]]:
    """Whether a part ends well, and the lines it prints, which are printed on the way."""
    said = []
    with subprocess.Popen([sys.executable, "-u", str(PARTS[part])], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        for line in run.stdout:
            print(line, end="", flush=True)
            said.append(line.rstrip())
    return run.returncode == 0, said


def main(wanted: list[str]) -> int:
    """Returns how many of the parts wanted (all when none is named) ended with something wrong."""
    unknown = [part for part in wanted if part not in PARTS]
    if unknown:
        print(f"'{unknown[0]}' is no part; the parts are {', '.join(PARTS)}", file=sys.stderr)
        return 2
    lines, wrong = (
        [
            "# What may not go wrong in silence",
            "",
            f"By `python benchmarks/robust.py`, {spoken_machine(machine())}.",
        ],
        0,
    )
    for part in wanted or PARTS:
        print(f"== {part}", flush=True)
        good, said = told(part)
        wrong += not good
        about = (ast.get_docstring(ast.parse(PARTS[part].read_text())) or "").partition("\n\n")[0]
        lines += ["", f"## {part}{'' if good else ': SOMETHING WRONG'}", "", " ".join(about.split()), ""]
        lines += [f"- {line.strip()}" for line in said if line.strip()]
    if not wanted:
        (RESULTS / "robust.md").write_text("\n".join(lines) + "\n")
    return wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
