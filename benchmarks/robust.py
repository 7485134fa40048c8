"""Everything that may not go wrong in silence, one script after the other; what each counts goes to results/robust.md.

    python benchmarks/robust.py [arms estimates files kills trust]

arms: open chains of joints against differences and pivoting; estimates: error figures against the truth; files: damage;
kills: bit flips and training killed at random moments; trust: scenes no flexure has, taut leaves.
Only a run of all parts is written.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from common import RESULTS, machine, machine_line

HERE = Path(__file__).resolve().parent
PARTS = {path.stem.removeprefix("robust_"): path for path in sorted(HERE.glob("robust_*.py"))}


def run_part(part: str) -> tuple[bool, list[str]]:
    """Whether a part ends without errors, and the lines it prints, which are also printed here."""
    said = []
    with subprocess.Popen([sys.executable, "-u", str(PARTS[part])], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        for line in run.stdout:
            print(line, end="", flush=True)
            said.append(line.rstrip())
    return run.returncode == 0, said


def main(wanted: list[str]) -> int:
    """Number of the wanted parts (all when none is named) that ended with errors."""
    unknown = [part for part in wanted if part not in PARTS]
    if unknown:
        print(f"'{unknown[0]}' is no part; the parts are {', '.join(PARTS)}", file=sys.stderr)
        return 2
    lines, wrong = (
        [
            "# What may not go wrong in silence",
            "",
            f"By `python benchmarks/robust.py`, {machine_line(machine())}.",
        ],
        0,
    )
    for part in wanted or PARTS:
        print(f"== {part}", flush=True)
        good, said = run_part(part)
        wrong += not good
        about = (ast.get_docstring(ast.parse(PARTS[part].read_text())) or "").partition("\n\n")[0]
        lines += ["", f"## {part}{'' if good else ': SOMETHING WRONG'}", "", " ".join(about.split()), ""]
        lines += [f"- {line.strip()}" for line in said if line.strip()]
    if not wanted:
        (RESULTS / "robust.md").write_text("\n".join(lines) + "\n")
    return wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
