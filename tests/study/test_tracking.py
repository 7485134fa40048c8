"""Modes keep their name through a crossing; the three-configuration curve; state space against the full tangent."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import cross_flexure, fourbar, single_joint

import ksd
from ksd.answers.frequencies import Modes, intended_modes
from ksd.study.frequency_curve import even_curve, frequency_curve
from ksd.study.state_space import state_space
from ksd.study.sweep import sweep
from ksd.study.tracking import continue_tracks, follow_with_bisection, start_tracks


class Made(Modes):
    """Modes of unit vectors with unit mass."""

    __setattr__ = object.__setattr__

    def __init__(self, names, frequency, freed=("drive",)):
        order = np.argsort(frequency)
        self.model, self.freed = (
            SimpleNamespace(drive_names=("drive",), support_names=(), node_names=()),
            freed,
        )
        self.frequency_Hz = np.array(frequency)[order]
        self.omega_squared = (2 * np.pi * self.frequency_Hz) ** 2
        self.vector = np.eye(9)[np.array(names)[order]]
        self.drive_motion = (self.vector[:, :1] > 0).astype(float)
        self.drive_compliance = self.drive_motion.T @ (self.drive_motion / self.omega_squared[:, None])

    @property
    def intended(self):
        own = self.drive_motion[:, : len(self.freed)]
        return intended_modes(own, self.omega_squared, self.drive_compliance)

    def __len__(self):
        return len(self.frequency_Hz)

    def mac(self, other):
        return (self.vector @ other.vector.T) ** 2


def test_a_crossing_swaps_rank_and_not_name():
    tracks = continue_tracks(None, Made([0, 1, 2], [5, 100, 120]), 2)
    assert tracks.names == ("intended", "parasitic_1", "parasitic_2")
    tracks = continue_tracks(tracks, Made([0, 1, 2], [6, 130, 110]), 2)
    assert [tracks.frequency_Hz(t) for t in range(3)] == [6, 130, 110]
    assert tracks.names[tracks.first_parasitic] == "parasitic_2"


def test_intended_motion_may_cross_the_others():
    tracks = continue_tracks(None, Made([0, 1, 2], [50, 60, 120]), 2)
    tracks = continue_tracks(tracks, Made([0, 1, 2], [70, 65, 120]), 2)
    assert tracks.frequency_Hz(tracks.names.index("intended")) == 70
    assert tracks.frequency_Hz(tracks.first_parasitic) == 65


def test_a_lost_mode_ends_and_a_new_one_begins():
    tracks = continue_tracks(None, Made([0, 1, 2], [5, 100, 120]), 2)
    tracks = continue_tracks(tracks, Made([0, 1, 3], [5, 100, 90]), 2)
    assert tracks.names[-1] == "parasitic_3" and tracks.frequency_Hz(3) == 90
    assert np.isnan(tracks.frequency_Hz(2)), "parasitic_2 has no partner"
    assert tracks.names[tracks.first_parasitic] == "parasitic_3"


def test_several_drives_have_several_intended_modes():
    motion = np.array([[0.5, 0.5], [0.5, -0.5], [0.0, 0.01]])
    squared = np.array([1.0, 1.0, 2.0])
    assert intended_modes(motion, squared, motion.T @ (motion / squared[:, None])).tolist() == [0, 1]
    # any combination of the motions is as good a drive
    other = motion @ np.array([[1.0, 1.0], [1.0, 1.0001]])
    assert intended_modes(other, squared, other.T @ (other / squared[:, None])).tolist() == [0, 1]


def test_an_intended_motion_above_the_modes_computed_leaves_its_name_to_no_other():
    """A stiff second drive: what it does in the modes below is rounding beside its compliance."""
    motion, squared = (
        np.array([[1.0, 0.0], [0.0, 0.01], [0.0, 0.02], [0.0, 1.0]]),
        np.array([1.0, 2.0, 3.0, 50.0]),
    )
    whole = motion.T @ (motion / squared[:, None])
    assert intended_modes(motion[:3], squared[:3], whole).tolist() == [0]
    assert intended_modes(motion, squared, whole).tolist() == [0, 3]


def test_no_track_keeps_a_name_that_the_pose_denies():
    """The intended motion hands over to the mode beside it: both tracks go on, each with the frequency of its kind."""
    tracks, after = continue_tracks(None, Made([0, 1, 2], [50, 60, 120]), 2), Made([0, 1, 2], [51, 59, 120])
    after.drive_motion = np.array([[0.0], [1.0], [0.0]])
    after.drive_compliance = np.array([[1.0 / after.omega_squared[1]]])
    tracks = continue_tracks(tracks, after, 2)
    assert tracks.names == ("intended", "parasitic_1", "parasitic_2")
    assert [tracks.frequency_Hz(t) for t in range(3)] == [59, 51, 120]
    assert tracks.frequency_Hz(tracks.first_parasitic) == after.first_parasitic_Hz == 51


def test_modes_of_a_real_crossing_are_followed():
    table = sweep(
        single_joint(),
        questions="frequencies",
        method="full",
        turn=np.deg2rad(np.linspace(0, 40, 21)),
        progress=False,
    )
    one, two = table["parasitic_1_Hz"], table["parasitic_2_Hz"]
    assert np.any(np.sign(one - two) != np.sign(one[1] - two[1])), "they cross"
    assert table["mac"].min() > 0.7
    assert np.allclose(table["first_parasitic_Hz"], np.minimum(one, two))
    # a followed mode has no kink: second differences stay small
    for f in (one, two):
        assert np.abs(np.diff(f[1:], 2)).max() < 0.05 * f.max()


def test_whatever_comes_from_above_is_followed():
    """A mode that was not among the lowest sinks below them all: it is the first parasitic one, under a name of its own."""
    tracks = continue_tracks(None, Made([0, 1, 2, 3], [5, 100, 120, 140]), 2)
    tracks = continue_tracks(tracks, Made([0, 1, 2, 3], [5, 100, 120, 80]), 2)
    assert tracks.names[tracks.first_parasitic] == "parasitic_3"
    assert [tracks.frequency_Hz(t) for t in range(4)] == [5, 100, 120, 80]


def test_modes_of_equal_frequency_are_known_by_what_they_span():
    before, after = Made([0, 1, 2], [5, 100, 100.1]), Made([0, 1, 2], [6, 90, 90.2])
    turn = np.eye(9)
    turn[1:3, 1:3] = [[0.6, 0.8], [-0.8, 0.6]]
    after.vector = after.vector @ turn
    start = continue_tracks(None, before, 2)
    assert continue_tracks(start, after, 2, by_span=True).mac == pytest.approx((1.0, 1.0, 1.0))


def test_the_way_is_halved_where_modes_exchange_their_shapes():
    """Two modes that turn into each other by 90 degrees over the way: paired end to end they would swap names."""

    def at(share, more=0):
        made, x = Made([0, 1, 2], [5, 100, 130]), 0.5 * np.pi * share
        made.vector = np.eye(9)[:3].copy()
        made.vector[1:, 1:3] = [[np.cos(x), np.sin(x)], [-np.sin(x), np.cos(x)]]
        return made

    start = continue_tracks(None, at(0.0), 2)
    # asked about the corners alone they would
    assert continue_tracks(start, at(1.0), 2).rank == (0, 2, 1)
    asked = []
    between = lambda share, more: asked.append(share) or at(share)  # noqa: E731
    assert follow_with_bisection(start, at(0.6), 2, lambda s, m: at(0.6 * s)).rank == (0, 1, 2)
    assert follow_with_bisection(start, at(0.2), 2, between).rank == (0, 1, 2) and not asked


def test_modes_of_the_fourbar_are_followed_from_rest():
    """At rest its twelve leaf springs vibrate at 519 to 521 Hz, all mixed, and within 10 mm they part: coarse poses find the
    partners that fine ones do, and through rest to the other side as well."""
    solver = ksd.prepare(fourbar())
    tracks = None
    for d in np.linspace(0.0, 0.01, 21):
        tracks = continue_tracks(tracks, solver(top=d, method="full").frequencies(count=16, freed="top"), 3)
    table = sweep(fourbar(), questions="frequencies", method="full", top=[0.0, 0.01, 0.02], progress=False)
    names = [c.removesuffix("_Hz") for c in table.columns if c.startswith(("intended", "parasitic"))]
    assert names == ["intended", "parasitic_1", "parasitic_2", "parasitic_3"]
    for n in names:
        fine = tracks.frequency_Hz(tracks.names.index(n))
        assert table[f"{n}_Hz"][1] == pytest.approx(fine, rel=1e-6)
        assert np.isfinite(table[f"{n}_Hz"]).all()
    through = sweep(
        fourbar(), questions="frequencies", method="full", top=[-0.02, -0.01, 0.0, 0.01, 0.02], progress=False
    )
    for n in names:
        assert np.isfinite(through[f"{n}_Hz"]).all()


def test_even_curve_is_exact_for_its_own_kind():
    d = np.array([0.0, 0.5, 1.0])
    law = lambda x: 1 / (2 * np.pi * np.sqrt(1e-5 * (1 + 3 * x**2 + 2 * x**4)))  # noqa: E731
    curve = even_curve("top", d, law(d), {0.3: law(0.3), -0.7: law(-0.7)})
    assert curve.error < 1e-12 and curve.asymmetry < 1e-12
    assert curve(0.8) == pytest.approx(law(0.8))


def test_three_configurations_tell_the_frequency_of_the_stroke():
    intended = frequency_curve(fourbar(), "top", 0.2, mode="intended")
    assert intended.error < 5e-3 and intended.asymmetry < 5e-3
    first = frequency_curve(fourbar(), "top", 0.2)
    assert first.error < 0.03
    # the middle leaf is one-sided out of the plane, and the curve says so
    assert first.asymmetry > 0.1
    followed = frequency_curve(single_joint(), "turn", 0.3, mode="parasitic_1")
    assert followed.error < 0.05
    with pytest.raises(ksd.SceneError, match="drive"):
        frequency_curve(fourbar(), "lift", 0.2)


def test_state_space_has_the_poles_and_the_static_gain_of_the_mechanism(tmp_path):
    from scipy.io import loadmat

    pose = ksd.solve(fourbar(), top=0.2, method="full")
    system = state_space(pose, modes=6, damping=0.02)
    poles = np.linalg.eigvals(system.A)
    modes = pose.frequencies(freed=("top",))
    assert np.sort(np.abs(poles))[::2] / (2 * np.pi) == pytest.approx(modes.frequency_Hz, rel=1e-9)
    assert -poles.real / np.abs(poles) == pytest.approx(np.full(12, 0.02), rel=1e-6)
    assert system.response(0.0)[0, 0, 0].real == pytest.approx(1 / pose.drive_stiffness()["top"], rel=1e-9)
    f = modes.frequency_Hz[modes.intended]
    assert abs(system.response(f)[0, 0, 0]) > 20 * abs(system.response(0.1 * f)[0, 0, 0])
    found = loadmat(system.to_mat(tmp_path / "a.mat"))
    assert found["A"].shape == (12, 12) and found["B"].shape == (12, 1) and found["D"].shape == (1, 1)
    assert system.input_units == ("N",) and system.output_units == ("m",)


def test_exports_of_a_state_space_come_back(tmp_path):
    """MATLAB: every number to the bit, names not of ASCII; scipy: its responses are ours; numpy: the same formula."""
    from scipy.io import loadmat
    from scipy.signal import freqresp

    scene = fourbar()
    scene.sensor("top", along="y", at=(0, 0.4, 0), name="Höhe")
    scene.sensor("top", along="x", at=(0, 0.4, 0), kind="acceleration", name="felt")
    pose = ksd.solve(scene, top=0.1)
    system = state_space(
        pose, modes=4, inputs=["top", "base x"], outputs=["top", "Höhe", "felt"], damping=0.02
    )
    found = loadmat(system.to_mat(tmp_path / "a.mat"))
    for key in "ABCD":
        assert np.array_equal(found[key], getattr(system, key))
    names = [str(n[0]) for n in found["outputs"].ravel()]
    assert names == ["top", "Höhe", "felt"] and str(found["input_units"].ravel()[1][0]) == "m/s^2"
    f = np.geomspace(0.5, 200, 7)
    ours = system.response(f)
    scipys = system.to_scipy()
    for o in range(3):
        for i in range(2):
            one = (scipys.A, scipys.B[:, i : i + 1], scipys.C[o : o + 1], scipys.D[o : o + 1, i : i + 1])
            assert freqresp(one, 2 * np.pi * f)[1] == pytest.approx(ours[:, o, i], rel=1e-5)
    # without the term that grows with the square of the frequency, an acceleration is another one
    expected = pose.response(f, inputs=system.inputs, outputs=system.outputs, damping=0.02, modes=4).value
    assert ours[:, :2] == pytest.approx(expected[:, :2], rel=1e-9)


def test_state_space_refuses_what_it_cannot():
    pose = ksd.solve(single_joint(cross_flexure()), turn=0.2, method="full")
    for how, words in (
        ({"drives": ("lift",)}, "drives"),
        ({"damping": 1.5}, "damping"),
        ({"modes": 0}, "modes"),
    ):
        with pytest.raises(ksd.SceneError, match=words):
            state_space(pose, **how)


def test_first_tracks_of_held_drives_are_all_parasitic():
    modes = Made([1, 2, 3], [10, 20, 30], freed=())
    assert start_tracks(modes, 2).names == ("parasitic_1", "parasitic_2")


@pytest.mark.parametrize("method", ["reduced", "modal"])
def test_a_curve_of_a_fast_method_tells_the_error_of_its_configurations(method):
    """By the error figure of the frequencies, next to that of the polynomial; strain-mode leaves of an exact method have
    next to none."""
    curve = frequency_curve(fourbar(), "top", 0.3, checks=(0.75,), method=method)
    exact = frequency_curve(
        ksd.prepare(fourbar(), mesh=ksd.Mesh(orders=(6, 5, 9), points=11)), "top", 0.3, checks=(0.75,)
    )
    off = max(abs(a / b - 1) for a, b in zip(curve.frequency_Hz, exact.frequency_Hz, strict=True))
    assert exact.solved_error < 1e-5 and 0.7 * off < curve.solved_error < 1.5 * off
    assert curve.solved_error < 0.06


def test_sweeps_name_modes_along_the_stroke_and_batches_jobs_and_gradients_at_every_pose():
    """Names of a sweep are those that partners by MAC of neighbouring shapes, in steps of 1 degree, hand on; elsewhere they
    are by size."""
    turn = np.deg2rad([0.0, 20.0, 40.0])
    name, columns = "parasitic_1", [f"parasitic_{k}_Hz" for k in (1, 2, 3)]
    words = {"questions": "frequencies", "method": "full", "mesh": ksd.Mesh(orders=(4, 5, 9), points=12)}
    solver = ksd.prepare(single_joint(), mesh=words["mesh"])
    poses = [
        solver(turn=a, method="full").frequencies(count=10, freed="turn") for a in np.deg2rad(np.arange(41.0))
    ]
    k, handed_on = poses[0].names.index(name), []
    for one, two in pairwise(poses):
        k = int(one.mac(two)[k].argmax())
        handed_on.append(two.frequency_Hz[k])
    by_size = np.array([[p.frequency_Hz[p.names.index(c[:-3])] for p in poses[::20]] for c in columns])
    swept = ksd.sweep(single_joint(), turn=turn, progress=False, **words)
    assert swept[columns[0]][1:] == pytest.approx(handed_on[19::20], rel=1e-6)
    assert swept[columns[0]][1] > 1.01 * by_size[0, 1]
    batch = ksd.batch(single_joint(), turn=turn, **words)
    design = lambda width: single_joint(cross_flexure(widths=(width, 0.02)))  # noqa: E731
    found = ksd.gradient(design, {"width": 0.04}, turn=turn, **words)
    for column, own in zip(columns, by_size, strict=True):
        assert batch[column][0] == pytest.approx(own, rel=1e-6)
        assert found.values[column] == pytest.approx(own, rel=1e-6)
    for method in ("full", "conventional"):
        job = ksd.Job(
            design, vary={"width": (0.039, 0.041)}, maximise=columns[0], turn=turn, method=method,
            mesh=words["mesh"],
        )  # fmt: skip
        assert job.values([0.04]) == pytest.approx(by_size[0], rel=1e-6)
        assert job.slopes([0.04])[0] == pytest.approx(by_size[0], rel=1e-6)
