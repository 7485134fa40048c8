"""The README's script runs as printed, its commands exist, and its pictures are there."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "README.md").read_text()


def test_the_script_runs_as_printed(tmp_path):
    (script,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    assert len([s for s in script.splitlines() if s.strip()]) <= 16
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "521" in done.stdout


def test_the_two_commands_are_there():
    assert "pip install . && ksd demo" in TEXT
    assert "pip install '.[test]' && pytest" in TEXT


def test_pictures_exist():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", TEXT):
        assert (ROOT / path).exists(), path


def test_every_command_line_named_exists():
    done = subprocess.run([sys.executable, "-m", "ksd", "--help"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0
    for word in set(re.findall(r"^\| `ksd (\w+)", TEXT, re.M)):
        assert word in done.stdout, word


def test_every_name_of_the_package_is_reached_by_one_import(tmp_path):
    """`ksd.view.write_pvd` as printed, after `import ksd` alone; each in a process that has imported nothing else."""
    names = sorted(set(re.findall(r"\bksd(?:\.[A-Za-z_]\w*)+", TEXT)))
    assert len(names) > 20 and "ksd.Design" in names
    code = "import sys, ksd\nfor n in sys.argv[1:]:\n eval(n, {'ksd': ksd})"
    for group in ([n for n in names if n.startswith(f"ksd.{room}.")] for room in ("view", "modal")):
        assert group
        done = subprocess.run([sys.executable, "-c", code, *group], capture_output=True, text=True, cwd=ROOT)
        assert done.returncode == 0, done.stderr
    done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
