"""The HTML report: complete, self-contained, and shown by a browser where there is one."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from checked_page import Checked
from PIL import Image

import ksd
from ksd.cli import main
from ksd.pages.report_page import ComparedSolve, report_page
from ksd.solvers.method_choice import FIVE_STEPS, MethodChoice

SCENES = Path(ksd.__file__).parent / "scenes"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "headless_shell")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The report of the fourbar, seven poses."""
    path = tmp_path_factory.mktemp("report") / "fourbar.html"
    assert main(["report", str(SCENES / "fourbar.toml"), "--out", str(path), "--poses", "7", "--quiet"]) == 0
    return path


def test_page_is_well_formed_and_whole(written):
    page = Checked()
    page.feed(written.read_text(encoding="utf-8"))
    assert not page.open
    assert page.headings == [
        "The scene", "What was simulated, and what was left out", "The pose",
        "Vibrations about the pose, with top let go", "Over the stroke", "Convergence and error",
    ]  # fmt: skip


def test_page_says_what_integration_finds(written):
    assert "Verified by integration of every leaf spring: " in written.read_text(encoding="utf-8")


def test_page_needs_no_network(written):
    text = written.read_text(encoding="utf-8")
    page = Checked()
    page.feed(text)
    assert len(page.addresses) == 5 and all(a.startswith("data:image/png;base64,") for a in page.addresses)
    assert not re.search(r"https?://|url\(|@import|<script|<link", text)


def test_page_holds_the_numbers(written):
    text = written.read_text(encoding="utf-8")
    for words in (
        "521.19",
        "Estimated error: 6.4 %, the force by plate stiffening, which is not in the model; against the model: 6.4e-06 %, "
        "all of it of the mesh",
        "Not in the model: plate stiffening (force +6.4 %",
        "lower left",
        "ground to left</td>",
        "cross flexure, 100 mm</td>",
        "orders (6, 5, 8)",
        "reduced",
        "left out",
        "stable: a minimum",
        "0.78",
        "buckling negative",
        "-4.5072",
        "<b>4.51 times</b><span>all stresses, reversed: the first buckling over the stroke",
    ):
        assert words in text, words
    assert "nan" not in re.sub(r"base64,[^\"]*", "", text)


def cards(page):
    """The main numbers of a page and what they are."""
    return dict(re.findall(r"<b>([^<]*)</b><span>([^<]*)", page[page.index('class="cards"') :]))


def test_the_headline_is_the_worst_answer_to_every_question(tmp_path):
    """Bounds by hand: 250.7 MPa of 900 MPa; the stiffness is asked at the point that the scene names, which lies above."""
    scene, targets, _ = ksd.load_scene("guide")
    scene.report = {"link": "table", "at": (0, 80e-3, 0), "along": "x", "freed": []}
    ksd.save_scene(scene, tmp_path / "guide.toml", targets=targets)
    argv = [
        "report",
        str(tmp_path / "guide.toml"),
        "--poses",
        "3",
        "--quiet",
        "--out",
        str(tmp_path / "a.html"),
    ]
    assert main(argv) == 0
    found = cards((tmp_path / "a.html").read_text())
    table = ksd.sweep(scene, table=np.linspace(0, 5e-3, 3), link="table", at=(0, 80e-3, 0), progress=False)
    least = f"{min(table['support_worst_N_per_m']):.0f} N/m"
    assert list(found.items())[:2] == [
        ("27.9 %", "of the yield stress at most, over the stroke"),
        ("250.7 MPa", "largest stress over the stroke"),
    ]
    assert found[least] == "least support stiffness over the stroke"
    assert found["5.036 N"] == "table: largest drive force over the stroke"
    # with the drive held, the first mode is another one
    held = min(scene_pose.frequencies(freed=()).frequency_Hz[0] for scene_pose in [ksd.solve(scene, targets)])
    assert f"{held:.4g}" in "".join(found)


def test_several_drives_share_one_stroke(tmp_path):
    out = tmp_path / "stage.html"
    assert main(["report", str(SCENES / "rrr_stage.toml"), "--out", str(out), "--poses", "3", "--quiet"]) == 0
    assert "intended 3" in out.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--poses", "1"], "--poses"),
        (["--out", "/no/such/a.html"], "folder"),
        (["--set", "lift=1mm"], "lift"),
    ],
)
def test_bad_input_exits_2(capsys, words, told):
    assert main(["report", str(SCENES / "fourbar.toml"), "--quiet", *words]) == 2
    assert told in capsys.readouterr().err


def test_a_method_that_changes_along_the_stroke_is_a_column(written, monkeypatch):
    # else by what the first pose took
    monkeypatch.setattr(MethodChoice, "next", property(lambda _: (FIVE_STEPS, "chosen here")))
    scene, targets, _ = ksd.load_scene(SCENES / "delta_stage.toml")
    drives = {n: v * np.array([0.0, 1.0]) for n, v in targets.items()}
    pose = ksd.solve(scene, targets)
    table = ksd.sweep(scene, drives, together=True, questions="force", progress=False, accuracy=1e-2)
    assert set(table["method"]) == {"full", "reduced"}
    page = report_page(pose, table, [ComparedSolve("reduced")])
    assert "<td class=t>full</td>" in page and "the estimated error jumps" in page
    assert "<td class=t>conventional</td>" not in written.read_text(encoding="utf-8")
    assert "about z " in page and "about_z" not in page


def test_warnings_are_sentences(written):
    warnings = re.findall(r'<p class="warn">(.*?)</p>', written.read_text(encoding="utf-8"), re.DOTALL)
    assert warnings and all(w[0].isupper() and w.endswith(".") for w in warnings)


def test_page_opens_in_a_browser(written, tmp_path):
    browser = next((b for b in map(shutil.which, BROWSERS) if b), None)
    if browser is None:
        pytest.skip("no Chromium on this machine: the page is checked by its markup only")
    flags = [
        "--headless",
        "--disable-gpu",
        "--no-sandbox",
        "--hide-scrollbars",
        f"--user-data-dir={tmp_path / 'user'}",
    ]
    shot = tmp_path / "page.png"
    subprocess.run(
        [browser, *flags, "--window-size=1200,1600", f"--screenshot={shot}", written.as_uri()],
        check=True,
        timeout=120,
    )
    colours = Image.open(shot).convert("RGB").getcolors(1 << 24)
    assert len(colours) > 200, "pictures and text are drawn"
    dumped = subprocess.run(
        [browser, *flags, "--dump-dom", written.as_uri()],
        check=True,
        timeout=120,
        capture_output=True,
        text=True,
    )
    assert "521.19" in dumped.stdout
