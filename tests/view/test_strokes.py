"""Pictures over the stroke are drawn, labelled with units, and say what failed; the animation has its frames."""

import numpy as np
import pytest
from PIL import Image
from scenes import cross_flexure, fourbar, single_joint

import ksd
from ksd.design.questions import KNOWN
from ksd.view import animate_mode, animate_stroke


@pytest.fixture(scope="module")
def table():
    """Nine poses of the fourbar, the last out of reach."""
    values = [*np.linspace(0, 0.3, 8), 0.6]
    return ksd.sweep(fourbar(), method="full", questions=KNOWN, top=values, progress=False)


def test_every_panel_has_labels_with_units(table):
    figure = table.plot()
    shown = [a for a in figure.axes if a.get_visible()]
    assert len(shown) == 12
    for axes in shown:
        assert axes.get_xlabel() == "top [mm]" and "[" in axes.get_ylabel() and axes.get_title(loc="left")
        assert any(len(line.get_xdata()) > 1 for line in axes.lines), "something is drawn"


def test_stiffness_and_frequencies_have_log_axes(table):
    figure = table.plot("support_stiffness", "frequencies")
    assert [a.get_yscale() for a in figure.axes if a.get_visible()] == ["log"] * 3
    assert [a.get_yscale() for a in table.plot("force").axes] == ["linear"]


def test_failures_are_told_in_the_picture(table):
    assert "1 pose without full answer" in table.plot("force").get_suptitle()


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
    assert "thickness 0.0008" in figure.get_suptitle()
    assert Image.open(tmp_path / "a.png").size[0] > 400


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
    from ksd.properties.shape import member_ends, member_parts, strain_curve

    for i in range(len(modes.model.arrays.members.kind)):
        ends = [member_ends(modes.model, m, i).d for m in (modes.motion, moved)]
        tips = [strain_curve(*member_parts(modes.model, m, i), 25)[1][-1] for m in (modes.motion, moved)]
        assert (tips[1] - tips[0]) / size == pytest.approx((ends[1] - ends[0]) / size, abs=5e-3)
    with pytest.raises(ksd.SceneError, match=f"1 to {len(modes)}"):
        animate_mode(pose, tmp_path / "m.gif", mode=99, modes=modes)
