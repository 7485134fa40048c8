"""Pages of the site in a browser that reaches no other machine: formulas are drawn, nothing is missing, no line is cut."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mathjax")
pytest.importorskip("furo")
sync_api = pytest.importorskip("playwright.sync_api")
DOCS = Path(__file__).resolve().parents[1] / "docs"
CONF = f"""
import sys
from pathlib import Path
sys.path.insert(0, {str(DOCS)!r})
from offline import offline_settings
extensions = ["myst_nb", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath"]
html_theme = "furo"
nb_execution_mode = "off"
exclude_patterns = ["_made", "[a-z_]*/index.md"]
globals().update(offline_settings(Path(__file__).parent / "_made" / "static"))
"""
PAGE = f"""# Page

Inline $M = E I \\kappa$ and alone

$$\\boldsymbol{{K}} = \\begin{{bmatrix}} 1 & 0 \\\\ 0 & \\cancel{{2}} \\end{{bmatrix}}$$

```python
{"x" * 118} = 1
```

```text
{"a word " * 60}
```
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The page above, and two pages of the theory."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "conf.py").write_text(CONF)
    (folder / "index.md").write_text(PAGE)
    for name in ("corotational", "vibrations"):
        text = (DOCS / "theory" / f"{name}.md").read_text()
        (folder / f"{name}.md").write_text("---\norphan: true\n---\n\n" + text)
    command = [sys.executable, "-m", "sphinx", "-q", str(folder), str(folder / "out")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "out"


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as play:
        try:
            opened = play.chromium.launch()
        except sync_api.Error:
            try:
                opened = play.chromium.launch(executable_path="/usr/bin/chromium")
            except sync_api.Error:
                pytest.skip("no browser on this machine")
        yield opened
        opened.close()


@pytest.mark.parametrize("name", ["index", "corotational", "vibrations"])
def test_a_page_is_whole_without_network(site, browser, name):
    page = browser.new_page(viewport={"width": 1400, "height": 900})
    outside, missing = [], []

    def answer(route):
        inside = route.request.url.startswith(("file:", "data:"))
        outside.extend([] if inside else [route.request.url])
        return route.continue_() if inside else route.abort()

    page.route("**/*", answer)
    page.on("requestfailed", lambda request: missing.append(request.url))
    page.goto((site / f"{name}.html").as_uri())
    page.wait_for_function("window.MathJax && MathJax.startup && MathJax.startup.promise")
    page.evaluate("MathJax.startup.promise")
    formulas = page.locator("mjx-container svg").count()
    assert formulas == page.locator(".math").count() >= 2
    shown = page.inner_text("body")
    assert "\\(" not in shown and "\\[" not in shown and page.locator("[data-mjx-error]").count() == 0
    assert not outside and not missing
    cut = "[...document.querySelectorAll('pre')].filter(e => e.scrollWidth > e.clientWidth + 1).length"
    assert page.evaluate(cut) == 0
    # 118 letters and " = 1" stand in one line
    if name == "index":
        assert page.locator("pre").first.bounding_box()["height"] < 60
    page.close()
