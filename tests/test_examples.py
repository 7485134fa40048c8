"""Every script of examples/ runs, prints its answers, draws its picture, and its numbers are those of this table."""

import cmath
import math
import runpy
import sys
from pathlib import Path

import pytest
from readable import assert_readable

FOLDER = Path(__file__).resolve().parents[1] / "examples"
LINES = 60
SHOOTING = "shooting of exact rods, order 8"


def EI(thickness: float, width: float) -> float:
    """Bending stiffness [N m^2] of a leaf of steel, 200 GPa."""
    return 200e9 * width * thickness**3 / 12


FOLDED = 0.5 / (40e-3**3 / (3 * EI(20e-3, 0.3e-3)) + 6 * 40e-3 / (5 * 200e9 / 2.6 * 20e-3 * 0.3e-3))
"""Stiffness [N/m] along the fold line of the folded leaf springs of the examples."""
HALF_EULER = math.pi * math.sqrt(0.5)
SWAY = HALF_EULER**3 / 12 / (2 * math.tan(HALF_EULER / 2) - HALF_EULER)
"""Sideways stiffness of a clamped and guided beam under half of its buckling load, over that without load."""

SWING, FOURBAR_SWING = 2 * math.pi * 19.637, 2 * math.pi * 37.61
"""Angular frequencies [rad/s] of the payloads of `pick_and_place` and `fourbar_pick_and_place`, leaf springs included."""


def left_over(acceleration, duration=0.1, swing=SWING) -> float:
    """Amplitude [m] of an oscillator on a carriage after a stroke: the integral of a(t) e^(i w t) over w."""
    dt = 1e-4 * duration
    t = [(k + 0.5) * dt for k in range(10_000)]
    return abs(sum(acceleration(one) * cmath.exp(1j * swing * one) for one in t)) * dt / swing


NOD = 2 * math.pi * math.radians(2) / 12e-3**2
"""Largest angular acceleration [rad/s^2] of `steering_mirror`."""


def off_after(t: float) -> float:
    """Step response less one of an oscillator of 7.103 Hz with a ratio of .05."""
    w, z = 2 * math.pi * 7.1028, 0.05
    wd = w * math.sqrt(1 - z * z)
    return math.exp(-z * w * t) * (math.cos(wd * t) + z / math.sqrt(1 - z * z) * math.sin(wd * t))


NUMBERS = {
    "balanced_pivot": {
        "K": (2 * EI(0.3e-3, 20e-3) / 60e-3, 1e-9, "2 EI/L"),
        "moment": (0.16393407249, 1e-6, SHOOTING),
        "left": (0.0181268159, 1e-5, SHOOTING),
        "at_rest": (-0.00185812870, 1e-4, SHOOTING),
    },
    "bistable": {
        # Qiu, Lang and Slocum 2004 for a perfect beam of large h/t: 740, -370, 1.99
        "top": (669.264, 1e-4, SHOOTING),
        "bottom": (-294.337, 1e-4, SHOOTING),
        "rest": (1.960412, 5e-4, SHOOTING),
    },
    "cantilever": {
        "x": (0.0859561617, 1e-6, "Lan 2005, table 2.3"),
        "y": (0.0491835530, 1e-6, "Lan 2005, table 2.3"),
        "angle": (0.7651820133, 1e-6, "Lan 2005, table 2.3"),
    },
    "cross_flexure": {
        "stiffness": (2 * EI(0.5e-3, 40e-3) / 100e-3, 1e-6, "paper 1, eq. 4.3"),
        "moment": (1.4309743209, 1e-6, SHOOTING),
        "axial_at_rest": (2 * 200e9 * 0.5e-3 * 40e-3 / 100e-3 * 0.5, 1e-4, "EA/L cos^2"),
    },
    "confirmed_by_solids": {
        "force": (24 * EI(0.3e-3, 20e-3) / 60e-3**3 * 0.1e-3, 1e-3, "beam theory"),
        "explained": (0.05, 0.3, "a plate of this width between clamps"),
    },
    "plant_for_a_controller": {
        # two masses on one guide, leaf springs without mass
        "mode": (math.sqrt(24 * EI(1e-3, 30e-3) / 40e-3**3 * (1 / 3 + 1 / 1)) / (2 * math.pi), 2e-2, "k (1/M + 1/m)"),
"margin": (
            math.degrees(math.atan(3 * 15.31 / 15) - math.atan(15.31 / 45) - math.atan2(0.6 * 0.193, 1 - 0.193**2)),
            2e-2, "lead and notch",
        ),
    },
    "shaken_stage": {
        # white noise at the mode: pi f S/(4 zeta)/w^4, with S = w^2 v^2/(.2316 f)
        "rms": (math.sqrt(math.pi * 12.5e-6**2 / (4 * 0.2316 * 0.002)) / (2 * math.pi * 4.590), 2e-2, "one resonance"),
        # a short pulse is a change of speed
        "hit": (0.5 * 2 / math.pi * 11e-3 / (2 * math.pi * 4.590), 2e-2, "momentum"),
    },
    "settling": {
        "overshoot": (math.exp(-math.pi * 0.05 / math.sqrt(1 - 0.05**2)), 2e-3, "one mass"),
        "settled": (max(t for k in range(30_000) if abs(off_after(t := k * 1e-4)) > 0.01), 2e-3, "one mass"),
    },
    "pick_and_place": {
        "cycloid": (left_over(lambda t: 2 * math.pi * 5 * math.sin(20 * math.pi * t)), 6e-2, "Fourier integral"),
        "trapezoid": (left_over(lambda t: 22.5 * ((t < 0.1 / 3) - (t > 0.2 / 3))), 1e-2, "Fourier integral"),
    },
    "fourbar_pick_and_place": {
        "cycloid": (
            left_over(lambda t: 6.4 * math.pi * math.sin(8 * math.pi * t), 0.25, FOURBAR_SWING), 2e-2, "Fourier integral"
        ),
        "trapezoid": (
            left_over(lambda t: 14.4 * ((t < 0.25 / 3) - (t > 0.5 / 3)), 0.25, FOURBAR_SWING), 5e-2, "Fourier integral"
        ),
    },
    "released_rod": {
        "x": (1.049328, 1e-4, "finite elements, extrapolated"),
        "y": (-0.332983, 5e-4, "finite elements, extrapolated"),
        "kept": (1.0, 1e-4, "no damping"),
    },
    "steering_mirror": {
        "quarter": (
            (1e-5 + 0.04 * 8e-3**2) * NOD + EI(0.1e-3, 10e-3) / 15e-3 * math.radians(2) * (1 / 4 - 1 / (2 * math.pi)),
            2e-3, "rigid body on a hinge",
        ),
        "shake": (-0.04 * 8e-3 * NOD, 2e-2, "m r alpha"),
    },
    "swinging_arm": {"ratio": (1.0, 1e-3, "leaf springs with their own inertia")},
    "controlled_guide": {
        "end": (0.5e-3 * 7895.7 / (7895.7 + 0.5 * (2 * math.pi * 7.1028) ** 2), 1e-3, "stiffness of the loop"),
        "overshoot": (math.exp(-math.pi * 0.4713 / math.sqrt(1 - 0.4713**2)), 2e-2, "one mass"),
    },
    "ball_in_three_fingers": {
        "beam": (1, 1e-3, "24 EI/L^3"),
        "held": (1, 2e-2, "3 mu N"),
        "drive": (1, 2e-4, "a drive in the place of the weight"),
    },
    "delta_stage": {
        # pivots of flexures shift: a milliradian
        "first": (math.radians(-1.3680), 6e-2, "circles of rigid links"),
        "second": (math.radians(-2.8373), 2e-2, "circles of rigid links"),
        "third": (math.radians(-4.3742), 5e-3, "circles of rigid links"),
    },
    "disc_gripper": {
        "drive": (1, 1e-3, "a drive in the place of the force"),
        "balance": (1, 1e-8, "balance of the disc"),
        "slips": (1, 1e-8, "Coulomb: |T| = mu N"),
    },
    "finger_around_ellipse": {
        "smooth": (40.66054, 3e-6, SHOOTING),
        "along": (47.33721, 3e-6, SHOOTING),
        "back": (34.77059, 3e-6, SHOOTING),
        "where": (0.08853318, 3e-6, SHOOTING),
    },
    "folded_leaf_stage": {
        "x": (1.5 * FOLDED, 2e-3, "van Eijk 1985"),
        "rz": (3 * FOLDED * (60e-3 + 40e-3 / math.sqrt(2)) ** 2, 2e-3, "van Eijk 1985"),
        "first": (math.sqrt(5061.33 / 0.5) / (2 * math.pi), 1e-2, "piston stiffness over mass, leaf springs without"),
    },
    "grasper": {
        "force_1": (7.6215, 5e-4, SHOOTING),
        "force_2": (6.0171, 5e-4, SHOOTING),
        "force_3": (5.4410, 5e-4, SHOOTING),
        "most_solves": (20, 0.5, "values and gradients of a start: at most 30"),
    },
    "guide_buckling": {
        "let_go": (2 * math.pi**2 * EI(0.5e-3, 20e-3) / 0.1**2, 1e-3, "Euler"),
        "held": (8 * math.pi**2 * EI(0.5e-3, 20e-3) / 0.1**2, 1e-3, "Euler"),
        "left": (SWAY, 1e-3, "beam column, ends clamped and guided"),
    },
    "guide_stiffness": {
        "drive": (24 * EI(0.5e-3, 20e-3) / 0.1**3, 1e-3, "24 EI/L^3"),
        "sink": (0.0006020272343, 1e-6, SHOOTING),
        "at_rest": (2 * 200e9 * 0.5e-3 * 20e-3 / 0.1, 1e-9, "2 EA/L"),
        "halfway": (1 / (0.1**3 / EI(0.5e-3, 20e-3) * (0.005**2 / 24 + 0.05**2 / 1400)), 1e-2, "Awtar 2007"),
        "at_end": (4938866.1, 1e-4, SHOOTING),
    },
    "guide_with_stops": {
        "share": (1, 1e-3, "the push less 24 EI/L^3 times the distance of the stop"),
        "bears": (40 - 24 * EI(0.4e-3, 25e-3) / 80e-3**3 * 3e-3, 1e-3, "24 EI/L^3"),
        "within": (3 * 200e9 * 0.4e-3 * 3e-3 / 80e-3**2 / 1.2e9, 2e-2, "3 E t d/L^2"),
    },
    "heat_drift": {
        "grows": (12e-6 * 5 * 80e-3, 1e-9, "expansion"),
        "tilts": (12e-6 * 5 * 80e-3 / 60e-3 * (1 - 0.4**2 / 60**2 / 3), 1e-4, "expansion over distance"),
        "sideways": (12e-6 * 5 * 80e-3 / 60e-3 * 40e-3, 1e-4, "tilt times the lever to the drive"),
    },
    "indexer": {
        "force_one": (126.9213, 1e-5, SHOOTING),
        "turn": (-0.0365683, 1e-5, SHOOTING),
        "force_two": (212.4774, 1e-5, SHOOTING),
        "C_x": (0.8138033e-3, 1e-5, SHOOTING),
        "C_y": (-0.0506014e-3, 1e-5, SHOOTING),
    },
    "job_as_component": {
        "thickness": ((1.5 * 12 * 60e-3 / (2 * 200e9 * 20e-3)) ** (1 / 3), 1e-5, "2 E w t^3 / (12 L)"),
    },
    "job_in_cma": {
        "length": (60e-3, 1e-3, "its bound"),
        # without the shear force in the leaf springs, which adds to their stress
        "thickness": (2 * 60e-3 * 60e6 / (200e9 * math.radians(2)), 2e-2, "2 L sigma / (E turn)"),
    },
    "job_in_scipy": {
        "thickness": (0.3e-3, 1e-6, "its bound"),
        "flexible": (0.0906, 1e-3, "specification; closed form of second order .0903"),
    },
    "job_on_a_cluster": {
        "agreed": (3, 0, "every start ends at the same pivot"),
        "length": (60e-3, 1e-6, "its bound"),
        "thickness": (2 * 60e-3 * 60e6 / (200e9 * math.radians(2)), 2e-2, "2 L sigma / (E turn)"),
    },
    "notch_hinge": {
        "stiffness": (2 * 70e9 * 10e-3 * 0.1e-3**2.5 / (9 * math.pi * math.sqrt(5e-3)), 5e-3, "Paros and Weisbord 1965"),
        "stress": (6 * 0.07020 * math.pi / 180 / (10e-3 * 0.1e-3**2), 1e-3, "6 M/(b t^2)"),
    },
    "overconstrained_guide": {
        "redundant": (1, 0, "both leaf springs hold the turn in their plane"),
        "solved": (178979.20, 1e-5, "what the other leaf tells, from internal_stress"),
    },
    "parallel_mechanism": {
        "force_quarter": (2948.737, 1e-5, SHOOTING),
        "drop_A": (-0.94576e-3, 1e-5, SHOOTING),
        "drop_B": (-0.98923e-3, 1e-5, SHOOTING),
        "force_half": (7370.185, 1e-5, SHOOTING),
        "tilt": (0.0107066, 1e-5, SHOOTING),
    },
    "pivot_centre": {
        "shift_middle": (60e-3 * math.radians(5) ** 2 / (12 * math.cos(math.pi / 4)), 1e-3, "Zhao 2011"),
        "shift_best": (4.31520569e-07, 1e-5, SHOOTING),
        "stiffness_middle": (0.00582513814857 / math.radians(5), 1e-6, SHOOTING),
        "stiffness_best": (0.0155164021451 / math.radians(5), 1e-6, SHOOTING),
    },
    "pivot_tolerance": {
        "thickness": (3, 1e-5, "K = EI/L"),
        "length": (-1, 1e-5, "K = EI/L"),
        "width": (1, 1e-5, "K = EI/L"),
        "scatter": (math.sqrt(0.05**2 + (1 / 3000) ** 2 + 0.001**2), 1e-5, "squares of the parts"),
    },
    "planar_spring": {
        "pull": (34224.63, 1e-5, SHOOTING),
        "press": (31148.72, 1e-5, SHOOTING),
        # the reference is the secant of 1 nm, 2.4e-5 stiffer
        "at_rest": (32572.91 - 0.77, 1e-5, SHOOTING),
    },
    "slider": {
        "force": (5.199210, 1e-5, SHOOTING),
        "pin_x": (5.199210, 1e-5, SHOOTING),
        "pin_y": (-0.737897, 1e-5, SHOOTING),
        "C_x": (-0.03552664e-3, 1e-5, SHOOTING),
        "C_y": (-2.440338e-3, 1e-5, SHOOTING),
    },
    "snap_fit": {
        "inward": (1, 1e-6, "balance on the flank with friction"),
        "outward": (1, 1e-6, "balance on the flank with friction"),
        "beam": (1, 5e-2, "3 EI/L^3"),
    },
    "passive_gripper": {
        # without stretch and shear; the thesis has a figure
        "paper_x": (2.634660, 5e-3, SHOOTING),
        "paper_y": (4.280069, 5e-3, SHOOTING),
        "inward": (1, 1e-6, "balance on the flank with friction"),
        "outward": (1, 1e-6, "balance on the flank with friction"),
    },
    "strip_under_pressure": {
        "small": (1, 2e-4, "p w L^4 / 8 EI"),
        "push": (9.75142, 1e-5, SHOOTING),
        "chord": (0.0975143, 1e-5, SHOOTING),
    },
    "tendon_finger": {
        "castigliano": (1, 1e-5, "change of the energy by the length"),
        "alike": (2, 1e-6, "the same tension and arm in both flexures"),
    },
    "tip_tilt_piston": {
        "moment_share": (1, 3e-3, "stiffness of a point with the drives let go"),
        "force_share": (1, 3e-4, "stiffness of a point with the drives let go"),
        "shift": (5e-3 * 40e-3 / math.sqrt(2), 1e-3, "turn about the plane of the fold lines"),
    },
    "which_joint": {
        "crossed": (0.0526242729 * 60e-3 / (EI(0.3e-3, 20e-3) * math.radians(10)), 1e-6, SHOOTING),
        "quiet": (0.1397179558 * 60e-3 / (EI(0.3e-3, 20e-3) * math.radians(10)), 1e-6, SHOOTING),
        "cartwheel": (8, 2e-3, "8 EI/L"),
        "butterfly": (2 * (1 + 3 * 4 / 17 + 3 * (4 / 17) ** 2) * 60 / 17, 1e-2, "a quarter of a pivot crossing at -4/17"),
    },
    "xy_stage": {
        "x_mode": (math.sqrt(24 * EI(0.3e-3, 25e-3) / 60e-3**3 / 0.8) / (2 * math.pi), 1e-3, "24 EI/L^3 over the mass"),
        "y_mode": (math.sqrt(24 * EI(0.3e-3, 25e-3) / 60e-3**3 / 0.5) / (2 * math.pi), 1e-3, "24 EI/L^3 over the mass"),
    },
}  # fmt: skip
"""Script: answer: value [SI], relative tolerance, and where the value comes from."""

NEEDS = {"job_in_cma": "cma", "job_on_a_cluster": "distributed"}
"""Packages that a script needs besides."""


def test_table_and_folder_agree():
    assert sorted(path.stem for path in FOLDER.glob("*.py")) == sorted(NUMBERS)


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_example(name, capsys, monkeypatch, tmp_path):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    script = FOLDER / f"{name}.py"
    assert len(script.read_text().splitlines()) <= LINES
    # not as "__main__": nothing is written
    answers = runpy.run_path(str(script))
    assert "?" in answers["__doc__"].splitlines()[0], "the docstring begins with the question"
    printed = capsys.readouterr().out
    assert any(sign.isdigit() for sign in printed), "no numbers printed"
    for answer, (value, within, source) in NUMBERS[name].items():
        found = float(answers[answer])
        assert math.isclose(found, value, rel_tol=within, abs_tol=1e-300), (
            f"{answer} {found}: {value}, {source}"
        )
    drawn = answers["picture"]()
    assert drawn.axes, "nothing drawn"
    assert_readable(drawn)
    assert not list(tmp_path.iterdir()), "a picture that nobody asked for"


@pytest.mark.parametrize("name", sorted(NEEDS))
def test_what_is_missing_is_told(name, monkeypatch):
    monkeypatch.setitem(sys.modules, NEEDS[name], None)
    with pytest.raises(SystemExit, match="pip install"):
        runpy.run_path(str(FOLDER / f"{name}.py"))
