"""Every kind of picture the package makes can be read, and has the colours of the package alone."""

import re
from pathlib import Path

import numpy as np
import pytest
from readable import assert_readable
from scenes import cross_flexure, single_joint

import ksd
from ksd.study.questions import ALL_QUESTIONS
from ksd.units import mm
from ksd.view import figure as palette
from ksd.view.cost_plot import Mark, plot_cost
from ksd.view.effect_cost_plot import plot_effect_cost
from ksd.view.figure import new_figure

ROOT = Path(__file__).resolve().parents[2]
PALETTE = ROOT / "ksd" / "view" / "figure.py"
SCENES = Path(ksd.__file__).parent / "scenes"
SHIPPED = sorted(
    f.stem for f in SCENES.glob("*.toml") if not f.stem.endswith("_job") and f.stem != "six_joint_arm"
)


def test_what_cannot_be_read_is_found():
    figure = new_figure(4, 3)
    axes = figure.add_subplot()
    axes.annotate("one", (0.5, 0.5))
    assert_readable(figure)
    axes.annotate("two", (0.51, 0.51))
    with pytest.raises(AssertionError, match="'one' lies on 'two'"):
        assert_readable(figure)
    axes.texts[1].set_position((0.98, 0.2))
    axes.texts[1].set_text("a longer word that ends outside")
    axes.texts[1].set_in_layout(False)
    with pytest.raises(AssertionError, match="is cut off"):
        assert_readable(figure)
    axes.texts[1].remove()
    (line,) = axes.plot([0, 1])
    with pytest.raises(AssertionError, match="matplotlib's own"):
        assert_readable(figure)
    line.set_color(palette.LEAF_COLOR)
    axes.imshow([[0.0, 1.0]])
    with pytest.raises(AssertionError, match="another colour map"):
        assert_readable(figure)


@pytest.mark.parametrize("name", SHIPPED)
def test_mechanisms(name):
    mechanism, targets, options = ksd.load_scene(SCENES / f"{name}.toml")
    pose = ksd.solve(mechanism, targets, **options)
    for words in ({}, {"color": "stress"}, {"view": "3d"}):
        assert_readable(pose.plot(**words))


def test_small_and_slender_mechanisms():
    """Words longer than the mechanism is wide; micrometres."""
    scene = ksd.Mechanism("a slender column with a name that is longer than it is wide")
    tip = scene.link("tip")
    steel = ksd.Material(E=200e9, nu=0.3)
    section = ksd.rectangle(1e-6, 10e-6)
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0, 1e-4, 0), section=section, material=steel)
    scene.actuate(tip, along="x", at=(0, 1e-4, 0), name="push")
    figure = ksd.solve(scene, push=5e-6).plot()
    assert_readable(figure)
    assert figure.axes[0].get_xlabel() == "x [µm]" and "\n" in figure.axes[0].get_title(loc="left")
    assert any("5 µm" in text.get_text() for text in figure.axes[0].texts)


def test_strokes(table):
    assert_readable(table.plot())
    assert_readable(table.plot(wide=3))
    assert ALL_QUESTIONS[-1] == "distance"  # of which the scene says none
    for question in ALL_QUESTIONS[:-1]:
        assert_readable(table.plot(question))
    designs = ksd.sweep(
        lambda thickness: single_joint(cross_flexure(thickness=thickness)),
        designs={"thickness": [8e-4, 9e-4, 1e-3]}, questions="force", method="full", turn=[0.0, 0.2, 0.4], progress=False,
    )  # fmt: skip
    assert_readable(designs.plot())


def guide(length, thickness):
    """A parallel guide."""
    scene = ksd.Mechanism("guide")
    joint = ksd.ParallelGuide(
        ksd.Material(E=200e9, nu=0.3), length=length, thickness=thickness, width=20 * mm, spacing=40 * mm
    )
    placed = scene.join(scene.ground, scene.link("stage"), joint, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="push")
    return scene


def test_optimum_and_front():
    """Designs are lines from light to dark, of the one colour map; the best is drawn last and thick."""
    vary = {"length": (40 * mm, 80 * mm), "thickness": (0.2 * mm, 1 * mm)}
    words = {"minimise": "stress_MPa", "limits": {"push_stiffness_N_per_m": 2e4}, "push": 2 * mm}
    job = ksd.Job(guide, vary=vary, **words)
    best = ksd.optimise(job, starts=2)
    figure = best.plot()
    assert_readable(figure)
    designs = figure.axes[2]
    (thick,) = (line for line in designs.lines if line.get_gid() == "best")
    assert thick.get_color() == palette.TEXT_COLOR
    known = {tuple(np.round(palette.color_map()(x), 6)) for x in np.linspace(0, 1, 256)}
    tried = [
        line
        for line in designs.lines
        if line is not thick and len(line.get_xdata()) == 2 and line.get_zorder() == 2
    ]
    assert tried and all(tuple(np.round(line.get_color(), 6)) in known for line in tried)
    greys = [np.dot(line.get_color()[:3], [0.2126, 0.7152, 0.0722]) for line in tried]
    assert (np.diff(greys) <= 1e-9).all(), "the better the darker"
    assert {"40 mm", "80 mm", "0.2 mm", "1 mm"} <= {text.get_text() for text in designs.texts}
    assert_readable(ksd.pareto(job, against="push_force_N", points=3, span=(20, 60)).plot())


def test_methods_and_effects():
    figure = new_figure(8.0, 5.0)
    marks = [Mark(n, g, t, e) for n, g, t, e in (("a", "strain-mode", 1e-4, 1e-6), ("b", "strain-mode", 2e-4, 1e-6),
                                                 ("c", "2 elements", 1e-3, 1e-2))]  # fmt: skip
    plot_cost(figure.subplots(), marks, title="time and error of every method")
    assert_readable(figure)
    figure = new_figure(10.0, 3.0)
    why = ["by its nature", "not mentioned; would be 23 % more torsional stiffness"]
    plot_effect_cost(
        tuple(figure.subplots(1, 2)), ["shear", "warping"], [1e-3, 0.07], [0.0, 0.1], kept=[True, False], reasons=why,
        accuracy=1e-3,
    )  # fmt: skip
    assert_readable(figure)


MADE = {"_made", "gallery", "tutorial", "build"}
"""Folders of the documentation that are made."""


def sources():
    """Python of the package, the benchmarks, the examples and the documentation, but for the palette itself."""
    folders = ("ksd", "benchmarks", "examples", "docs")
    return [
        path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))
        if path != PALETTE and not MADE & set(path.relative_to(ROOT).parts)
    ]  # fmt: skip


def test_no_colours_but_those_of_the_palette():
    """Nowhere else a colour map, a grey by number or one of matplotlib's cycle; colours in codes are the palette's."""
    known = set(re.findall(r"#[0-9a-f]{6}", PALETTE.read_text()))
    foreign = re.compile(
        r"""cmap=["']|get_cmap|colormaps|color=["'](?:C\d|0?\.\d+|[a-z]+)["']|["']C\d["']|f"C\{"""
    )
    for path in sources():
        text = path.read_text()
        found = foreign.findall(re.sub(r'color=["\'](?:stress|white|none|heat)["\']', "", text))
        assert not found, f"{path.relative_to(ROOT)}: {found}"
        if path.name != "page_parts.py":  # pages have shades of their own
            odd = {code.lower() for code in re.findall(r"#[0-9a-fA-F]{6}\b", text)} - known
            assert not odd, f"{path.relative_to(ROOT)}: {odd}"


def test_one_colour_map_from_light_to_dark():
    tones = np.array([color[:3] for color in palette.ordered_colors(7)]) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(tones) < 0).all() and tones[0] < 0.85
    assert len(palette.ordered_colors(1)) == 1
