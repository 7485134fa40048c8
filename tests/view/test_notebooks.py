"""What a notebook shows: the printed numbers as tables of the page, and figures as the pictures they are."""

import io
import json
import re
import runpy
import warnings
from html.parser import HTMLParser
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from PIL import Image
from scenes import fourbar

import ksd
from ksd.answers.printing import empty_table, render_text
from ksd.html import as_html


class Page(HTMLParser):
    """Words of a page in order, and its tables as rows of cells."""

    def __init__(self, text):
        super().__init__()
        self.words, self.tables, self.open = [], [], []
        self.feed(text)
        assert not self.open, "every tag is closed"

    def handle_starttag(self, tag, attrs):
        if tag != "br":
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)
        if self.open[-1] in ("td", "th"):
            self.tables[-1][-1][-1] += data


@pytest.fixture(scope="module")
def pose():
    return ksd.solve(fourbar(), {"top": 0.2}, method="conventional")


def test_the_numbers_of_print_are_those_of_the_page(pose):
    """Every answer, the pose, its model, its scene and a sweep: the same words in the same order, in tables."""
    swept = ksd.sweep(fourbar(), questions="force", method="full", top=[0.0, 0.1, 0.2], progress=False)
    answers = [
        fourbar(), pose.model.scene, pose.model, pose, pose.stress(), pose.frequencies(), pose.stiffness("top"),
        pose.interface_forces(), pose.section_forces(), pose.parasitic(), swept, ksd.doctor(fourbar()),
    ]  # fmt: skip
    for answer in answers:
        page = Page(answer._repr_html_())

        def marks(text):
            return sorted(re.findall(r"[-+\w.]*\d[\w.+-]*", text))

        assert marks(" ".join(page.words)) == marks(str(answer)), type(answer).__name__
        assert page.tables or type(answer).__name__ in ("Diagnosis", "Parasitic", "Stress"), answer
        for rows in page.tables:
            assert len({len(row) for row in rows}) == 1


def test_names_are_no_markup():
    grid = empty_table("name", "[x]")
    grid.add_row("<b>&", "1")
    text = as_html(render_text("a < b", grid))
    assert Page(text).tables == [[["name", "[x]"], ["<b>&", "1"]]] and "<b>" not in text


def test_a_scene_prints_what_is_said_in_it():
    scene = fourbar()
    scene.load("left", force=(0.0, -7.0, 0.0), at=(-0.2, 0.2, 0.0), name="weight")
    scene.mass("right", mass=2.0, at=(0.2, 0.2, 0.0))
    scene.gravity = (0, -9.81, 0)
    said = str(scene)
    for words in ("force (0, -7, 0) N", "2 kg at (200, 200, 0) mm", "cross flexure, 100 mm", "(0, -9.81, 0)"):
        assert words in said
    assert str(scene.scene()) == said and repr(scene).startswith("Mechanism(")


def test_a_figure_is_shown_once_and_as_a_picture(pose):
    """What IPython asks of the value of a cell: a picture without magic commands; no warning on the way."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = pose.plot()
        content, size = figure._repr_png_()
    assert isinstance(figure, Figure)
    assert Image.open(io.BytesIO(content)).size[0] > 1.5 * size["width"] > 500
    # no figure of pyplot's, which a notebook would show a second time at the end of the cell
    from matplotlib import pyplot

    assert not pyplot.get_fignums()


def test_the_executed_notebook_of_the_documentation():
    """As its script has it, without a warning; every answer as tables, every figure once."""
    folder = Path(__file__).resolve().parents[2] / "docs"
    stored = json.loads((folder / "notebook.ipynb").read_text())
    script = runpy.run_path(str(folder / "make_notebook.py"))
    assert tuple("".join(cell["source"]) for cell in stored["cells"]) == script["CELLS"]
    code = [cell for cell in stored["cells"] if cell["cell_type"] == "code"]
    assert len(code) > 6 and all(len(cell["outputs"]) == 1 for cell in code)
    for cell in code:
        (output,) = cell["outputs"]
        assert output["output_type"] == "execute_result", "nothing is written to stderr, nothing shown twice"
        drawn = ".plot(" in "".join(cell["source"])
        assert set(output["data"]) == {"image/png" if drawn else "text/html", "text/plain"}
        assert "<Figure" not in "".join(output["data"]["text/plain"])
    # the numbers in it are today's
    words = {}
    for cell in code[:2]:
        exec(compile("".join(cell["source"]), "cell", "exec"), words)
    stored_force = re.search(r"forces top ([\d.]+)", "".join(code[1]["outputs"][0]["data"]["text/plain"]))[1]
    assert float(stored_force) == pytest.approx(words["pose"].forces["top"], rel=1e-5)


def test_rich_shows_nothing_by_itself_in_a_notebook(pose, monkeypatch, capsys):
    """Where rich believes to be in a notebook it would show what is printed to a text, and warn of missing widgets."""
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert "fourbar: solved" in str(pose)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ksd.sweep(fourbar(), questions="force", method="full", top=[0.0, 0.1], progress=True)
    said = capsys.readouterr()
    assert not said.out and not said.err
