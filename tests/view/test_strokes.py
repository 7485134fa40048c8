"""Pictures over the stroke are drawn, labelled with units, and say what failed; the animation has its frames."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from readable import assert_readable
from scenes import cross_flexure, fourbar, single_joint

import ksd
from ksd.study.table import Table
from ksd.units import mm
from ksd.view import animate_mode, animate_stroke, plot_mode
from ksd.view.effect_cost_plot import plot_effect_cost
from ksd.view.figure import new_figure


def test_every_panel_has_labels_with_units(table):
    figure = table.plot()
    shown = [a for a in figure.axes if a.get_visible()]
    assert len(shown) == 12
    for axes in shown:
        assert axes.get_xlabel() == "top [mm]" and "[" in axes.get_ylabel() and axes.get_title(loc="left")
        assert any(len(line.get_xdata()) > 1 for line in axes.lines), "something is drawn"


def key(figure):
    """Words of the key above the panels, which lies on none of them."""
    figure.canvas.draw()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x1 <= figure.bbox.x1 and not any(
        box.overlaps(a.get_tightbbox()) for a in figure.axes if a.get_visible()
    )
    return [text.get_text() for text, _ in by_rows(legend)]


def by_rows(legend):
    """Words and lines of a legend as they are read, row by row."""
    places = [text.get_window_extent() for text in legend.get_texts()]
    order = sorted(range(len(places)), key=lambda k: (-round(places[k].y0), places[k].x0))
    return [(legend.get_texts()[k], legend.legend_handles[k]) for k in order]


def test_two_drives_have_a_key_from_light_to_dark():
    """One line per value of the drive that is not along the stroke, darker and darker, told in its unit; of many, a few."""
    values = np.linspace(0.0, 0.1, 12)
    poses = [
        {"x_mm": 1e3 * x, "y_mm": float(y), "y_force_N": x + y, "status": "ok"}
        for x in values
        for y in range(3)
    ]
    table = Table.of_rows(poses, ("x_mm", "y_mm"), moving=("y_mm",))
    figure = table.plot("force")
    said = key(figure)
    assert len(said) == 8 and said[0] == "x 0 mm" and said[-1] == "x 100 mm"
    tones = [sum(to_rgb(line.get_color())) for line in figure.axes[0].lines]
    assert len(tones) == 12 and (np.diff(tones) < 0).all()
    marks = [sum(to_rgb(line.get_color())) for _, line in by_rows(figure.legends[0])]
    assert (np.diff(marks) < 0).all()


def test_legends_and_numbers_of_many_curves():
    """Above many curves the legend has room of its own; numbers on an axis of two decades lie apart."""
    columns = ("x_mm", "y_mm", "support_x_N_per_m", "support_z_N_per_m", "status")
    poses = [
        dict(zip(columns, (x, float(y), 10.0 ** (6 + 0.3 * x), 10.0 ** (7.5 - 0.3 * x), "ok"), strict=True))
        for x in range(5)
        for y in range(3)
    ]
    figure = Table.of_rows(poses, ("x_mm", "y_mm"), moving=("y_mm",)).plot("support_stiffness")
    assert_readable(figure)
    axes = figure.axes[0]
    low = axes.get_legend().get_window_extent().y0
    assert all(axes.transData.transform(line.get_xydata())[:, 1].max() < low for line in axes.lines)
    bottom, top = axes.get_ylim()
    # older ones of matplotlib have some beyond what is shown
    numbers = [t for t in axes.get_yticklabels() if t.get_text() and bottom <= t.get_position()[1] <= top]
    assert 3 <= len(numbers) <= 8


@pytest.mark.parametrize(
    "label,value,said",
    [
        ("thickness", 8e-4, "thickness 0.8 mm"), ("arm_length", 0.1, "arm length 100 mm"),
        ("half_angle", np.pi / 4, "half angle 45\N{DEGREE SIGN}"),
        ("turn_deg", 5.0, "turn 5\N{DEGREE SIGN}"), ("thickness", 0.8, "thickness 0.8"), ("ratio", 2.0, "ratio 2"),
    ],
)  # fmt: skip
def test_units_of_design_parameters(label, value, said):
    """Lengths [m] and angles [rad] by their names; what is too large for one is in a unit of the user's own."""
    rows = [
        {label: v, "y_mm": y, "y_force_N": 1.0 + y * v, "status": "ok"}
        for v in (value, value / 2)
        for y in (0.0, 1.0)
    ]
    assert key(Table.of_rows(rows, (label, "y_mm"), moving=("y_mm",)).plot("force"))[0] == said


def test_the_effect_picture_tells_why():
    """Under every name what is left out, and why; the bars are the numbers."""
    figure = new_figure(10, 3)
    axes = figure.subplots(1, 2)
    why = ["by its nature", "not mentioned; would be 23 % more torsional stiffness"]
    words = {"kept": [True, False], "reasons": why, "accuracy": 1e-3}
    plot_effect_cost(tuple(axes), ["shear", "warping"], [1e-3, 0.07], [0.0, 0.1], **words)
    said = [t.get_text() for t in axes[0].texts]
    assert said == [f"shear, simulated: {why[0]}", f"warping, left out: {why[1]}"]
    assert [bar.get_width() for bar in axes[0].patches] == pytest.approx([0.1, 7.0])
    assert [bar.get_width() for bar in axes[1].patches] == pytest.approx([0.0, 10.0])
    figure.canvas.draw()
    words = [t.get_window_extent() for t in axes[0].texts]
    assert not words[0].overlaps(words[1])
    assert not any(box.overlaps(bar.get_window_extent()) for box in words for bar in axes[0].patches)


def test_stiffness_and_frequencies_have_log_axes(table):
    figure = table.plot("support_stiffness", "frequencies")
    assert [a.get_yscale() for a in figure.axes if a.get_visible()] == ["log"] * 3
    assert [a.get_yscale() for a in table.plot("force").axes] == ["linear"]


def test_the_worst_direction_hides_no_other(table):
    """It equals one of the others at every pose, and is a pale band below them."""
    for axes in table.plot("support_stiffness").axes[:2]:
        by = {line.get_label(): line for line in axes.lines}
        worst = by.pop("worst")
        assert worst.get_alpha() < 0.5 and all(worst.get_zorder() < line.get_zorder() for line in by.values())
        assert all(worst.get_linewidth() > 2 * line.get_linewidth() for line in by.values())


def test_a_curve_below_another_is_seen():
    """Of two equal frequencies the first is a pale band below the second; a third, 2 % off, is a line."""
    rows = [
        {"x_mm": x, "parasitic_1_Hz": 200 + x, "parasitic_2_Hz": 200 + x, "parasitic_3_Hz": 1.02 * (200 + x), "status": "ok"}
        for x in (0.0, 1.0, 2.0)
    ]  # fmt: skip
    figure = Table.of_rows(rows, ("x_mm",), moving=("x_mm",)).plot("frequencies")
    assert [line.get_linewidth() > 4 for line in figure.axes[0].lines] == [True, False, False]


def test_failures_are_told_in_the_picture(table):
    assert key(table.plot("force")) == ["1 pose without full answer"]


def test_labels_do_not_overlap(table):
    figure = table.plot()
    figure.canvas.draw()
    boxes = []
    for axes in (a for a in figure.axes if a.get_visible()):
        boxes += [axes.xaxis.label, axes.yaxis.label, axes._left_title]
    boxes = [b.get_window_extent() for b in boxes]
    assert not [(i, j) for i, a in enumerate(boxes) for j, b in enumerate(boxes) if i < j and a.overlaps(b)]


def test_designs_are_told_apart_by_style(tmp_path):
    table = ksd.sweep(
        lambda thickness: single_joint(cross_flexure(thickness=thickness)), designs={"thickness": [8e-4, 1e-3]},
        questions="force", method="full", turn=[0.0, 0.2, 0.4], progress=False,
    )  # fmt: skip
    figure = table.plot("force", path=tmp_path / "a.png")
    assert [line.get_linestyle() for line in figure.axes[0].lines] == ["-", "--"]
    assert key(figure) == ["thickness 0.8 mm", "thickness 1 mm"]
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size[0] > 400


def test_what_cannot_be_drawn_is_refused(table):
    with pytest.raises(ksd.SceneError, match="no picture"):
        table.plot("colour")
    one = ksd.sweep(fourbar(), questions="force", method="full", top=0.1, progress=False)
    with pytest.raises(ksd.SceneError, match="one pose"):
        one.plot()
    with pytest.raises(ksd.SceneError, match="no answers"):
        ksd.sweep(fourbar(), questions="force", method="full", top=[0.1, 0.2], progress=False).plot("stress")


def test_animation_of_the_stroke(tmp_path):
    solver = ksd.prepare(fourbar())
    poses = [solver(top=d, method="full") for d in (0.0, 0.1, 0.2)]
    with Image.open(animate_stroke(poses, tmp_path / "a.gif")) as gif:
        assert gif.n_frames == 4 and gif.size[0] == 560
    for path, words in ((tmp_path / "a.mp4", "gif"), (tmp_path / "no" / "a.gif", "folder")):
        with pytest.raises(ksd.SceneError, match=words):
            animate_stroke(poses, path)


def test_labels_of_a_film_do_not_lie_on_one_another(tmp_path, monkeypatch):
    guide, _, _ = ksd.load_scene("guide")
    for name in ("sum", "coil"):
        guide.load("table", force=(2, 0, 0), at=(0, 30 * mm, 0), name=name)
    made = []
    monkeypatch.setattr(
        "ksd.view.animate.new_figure", lambda *a, **k: made.append(new_figure(*a, **k)) or made[-1]
    )
    animate_stroke([ksd.solve(guide, table=d) for d in (0.0, 2 * mm)], tmp_path / "a.gif", back=False)
    assert_readable(made[0])


def test_animation_of_a_mode(tmp_path):
    """The leaf springs follow their links: a swing closes, and the moved state is the mode to first order."""
    pose = ksd.solve(fourbar(), top=0.2, method="full")
    modes = pose.frequencies(freed=("top",))
    with Image.open(animate_mode(pose, tmp_path / "m.gif", mode=2, modes=modes, frames=4)) as gif:
        assert gif.n_frames == 4
    size = 1e-6
    moved = modes.moved(1, size)
    assert (moved.x - modes.motion.x) / size == pytest.approx(modes.shape[1, :, :3], abs=1e-9)
    # a leaf drawn from its own curvature ends where its link is, but for its stretch
    from ksd.answers.centrelines import member_arrays, member_ends, strain_curves

    for i in range(len(modes.model.arrays.members.kind)):
        ends = [member_ends(modes.model, m, i).d for m in (modes.motion, moved)]
        inside = [member_arrays(modes.model, m, i) for m in (modes.motion, moved)]
        tips = [strain_curves(value[None], n, inner[None], 25)[1][0, -1] for value, n, inner in inside]
        assert (tips[1] - tips[0]) / size == pytest.approx((ends[1] - ends[0]) / size, abs=5e-3)
    with pytest.raises(ksd.SceneError, match=f"1 to {len(modes)}"):
        animate_mode(pose, tmp_path / "m.gif", mode=99, modes=modes)


def test_picture_of_a_mode():
    """In the plane where the mode is, in space where it leaves it, titled with its name and frequency."""
    pose = ksd.solve(fourbar(), top=0.2)
    modes = pose.frequencies(freed="top")
    for mode in ("intended", "parasitic_1"):
        (axes,) = plot_mode(pose, mode=mode, modes=modes).axes
        row = modes.names.index(mode)
        assert axes.get_title(loc="left").startswith(
            f"mode {row + 1}, {mode}: {modes.frequency_Hz[row]:.4g} Hz"
        )
        assert axes.get_xlabel() == ("x [mm]" if mode == "intended" else "")
    with pytest.raises(ksd.SceneError, match=f"1 to {len(modes)}"):
        plot_mode(pose, mode=0, modes=modes)
