"""The Python blocks of a page run in order, as one program; below each stands what it prints and draws."""

from __future__ import annotations

import ast
import contextlib
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from figures import css_width
from matplotlib.figure import Figure

BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.S | re.M)


def run_blocks(page: str, text: str) -> Iterator[tuple[str, Figure | None]]:
    """Run every ```python block of a page; yields what each one printed and the figure of its last line."""
    names: dict[str, Any] = {"__name__": page}
    for found in BLOCK.finditer(text):
        line = text.count("\n", 0, found.start()) + 1
        tree = ast.parse(found[1], page)
        ast.increment_lineno(tree, line)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        printed, value = io.StringIO(), None
        with contextlib.redirect_stdout(printed):
            exec(compile(tree, page, "exec"), names)
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), page, "eval"), names)
        yield printed.getvalue(), value if isinstance(value, Figure) else None


def with_blocks(app: Any, env: Any, *changes: set[str]) -> list[str]:
    """For Sphinx's `env-get-outdated`: pages with blocks, whose answers change with the program."""
    pages = {page: Path(env.doc2path(page)) for page in env.found_docs}
    return [page for page, path in pages.items() if path.suffix == ".md" and BLOCK.search(path.read_text())]


def show_blocks(app: Any, page: str, source: list[str]) -> None:
    """For Sphinx's `source-read`: put below each block what it printed and drew."""
    text = source[0]
    if not BLOCK.search(text):
        return
    folder = Path(app.srcdir) / "_made" / "blocks"
    folder.mkdir(parents=True, exist_ok=True)
    shown = []
    with contextlib.chdir(folder):
        for number, (printed, figure) in enumerate(run_blocks(page, text)):
            below = f"\n```text\n{printed.rstrip()}\n```\n" if printed.strip() else ""
            if figure:
                path = folder / f"{page.replace('/', '_')}_{number}.png"
                figure.savefig(path, dpi=150)
                below += f"\n```{{image}} /_made/blocks/{path.name}\n:alt: picture drawn by the block above\n"
                below += f":width: {css_width(path)}\n```\n"
            shown.append(below)
    below_each = iter(shown)
    source[0] = BLOCK.sub(lambda found: found[0] + next(below_each), text)
