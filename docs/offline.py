"""What the site needs to be read without a network, and wide enough for code: MathJax as a file of its own, and a style."""

from __future__ import annotations

import shutil
from importlib.resources import as_file, files
from pathlib import Path

STYLE = """
/* code and prints are 80 to 125 characters wide; what is longer still goes on in the next line instead of being cut */
.content { width: 66em; max-width: 100%; }
.content iframe { width: 100%; height: 28em; border: 1px solid var(--color-background-border); }
.content pre { white-space: pre-wrap; overflow-wrap: anywhere; }
.highlight pre, .literal-block-wrapper pre { font-size: 0.8rem; }
@media (max-width: 110em) { .toc-drawer { display: none; } }
"""


def offline_settings(folder: Path) -> dict[str, object]:
    """Settings of Sphinx whose files are put into `folder`: no page asks another machine for anything."""
    folder.mkdir(parents=True, exist_ok=True)
    # all extensions of TeX in one file, which draws without fonts
    with as_file(files("mathjax") / "static" / "mathjax" / "es5" / "tex-svg-full.js") as path:
        shutil.copy(path, folder / "mathjax.js")
    (folder / "wide.css").write_text(STYLE)
    return {"html_static_path": [str(folder)], "mathjax_path": "mathjax.js", "html_css_files": ["wide.css"]}
