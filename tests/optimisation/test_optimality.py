"""What is called an optimum is one: targets that are infinite or small, rules, edges, functions that fail."""

import json
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from scenes import STEEL
from test_job import pivot
from test_optimise import sheet, small

import ksd
from ksd.optimisation import local_search, optimality
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.scaled_problem import ScaledProblem
from ksd.units import deg, mm, um

SILICON = ksd.Material(E=160e9, nu=0.22, density=2330)


def leaf_springs(length, thickness, width=15 * mm, spacing=30 * mm, material=STEEL):
    """Two parallel leaf springs, driven along y at the stage."""
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    for y in (0, spacing):
        section = ksd.rectangle(thickness, width)
        scene.leaf("ground", stage, start=(0, y, 0), end=(length, y, 0), section=section, material=material)
    scene.actuate(stage, along="y", at=(length, 0.5 * spacing, 0), name="drive")
    return scene


def crossed(angle, thickness, scale=1.0):
    """A crossed pivot with a mass on its arm."""
    joint = ksd.CrossedPivot(
        STEEL, length=60 * mm * scale, angle=angle, thickness=thickness, width=20 * mm * scale
    )
    scene = ksd.Mechanism("crossed")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.mass(arm, mass=0.3 * scale**3, at=(60 * mm * scale, 0, 0), inertia=(1e-4 * scale**5,) * 3)
    scene.actuate_joint(placed, name="turn")
    return scene


def near_designs(best, count=12, step=0.02):
    """Merit over that of the optimum of random designs near it that meet its limits, each solved by itself."""
    job, rng = best.job, np.random.default_rng(0)
    x, gains = np.array(list(best.design.values())), []
    for _ in range(count):
        own = np.clip(x * np.exp(step * rng.uniform(-1, 1, len(x))), *job.bounds.T)
        values, (status,) = job.batch(own)
        if status == "ok" and (job.margins(values[0]) >= 0).all() and (job.rule_values(own) >= 0).all():
            gains.append((job.merit(values[0]) - best.merit) / abs(best.merit))
    return max(gains, default=-np.inf)


@pytest.mark.parametrize("method", ["gradient", "trust-constr", "cobyla"])
@pytest.mark.parametrize(("scale", "unit"), [(1.0, 1.0), (0.02, 1e6)])
def test_infinite_targets_do_not_bind(method, scale, unit):
    """The stiffness along the driven direction is infinite and "held" the optimum at .316 mm."""

    def springs(thickness):
        return leaf_springs(60 * mm * scale, thickness, 15 * mm * scale, 30 * mm * scale)

    thickest = 0.5 * mm * scale
    job = ksd.Job(
        springs, vary={"thickness": (0.2 * mm * scale, thickest)}, maximise={"support_worst_N_per_m": unit},
        limits={"stress_MPa": 1e5}, drive=1 * mm * scale,
    )  # fmt: skip
    best = ksd.optimise(job, method=method)
    assert best.design["thickness"] == pytest.approx(thickest, rel=1e-6) and best.status == "optimum"
    stiffness = ksd.solve(springs(thickest), drive=1 * mm * scale).stiffness("stage")
    finite = stiffness.principal[0][np.isfinite(stiffness.principal[0])]
    assert len(finite) < 3 and best.merit * unit == pytest.approx(finite.min(), rel=1e-6)
    assert not any(np.isinf(best.answers.get(n, 0.0)) for n in best.held)


def test_the_worst_stiffness_of_a_column_beyond_its_load_is_negative():
    """A sweep said 191,067 N/m beside -4.6 along x: the negative members of a set were left out of its worst."""
    C = np.diag([-1 / 4.6, 1 / 191067, 1e-9, 1.0, 2.0, -4.0])
    found = ksd.answers.stiffness.principal_stiffness(C, 1.0)
    assert found[0] == pytest.approx([-4.6, 191067, 1e9]) and found[1] == pytest.approx([-0.25, 0.5, 1.0])


@pytest.mark.parametrize(("limit", "scale"), [(223, 1.0), (223, 0.05), (500, 4.0)])
def test_a_frequency_as_high_as_the_stress_allows(limit, scale):
    """The default method gave up at the start at a limit of 223 MPa. The stress at a turn is that of thickness over length,
    so that the optimum has the least angle and the thickness at which the limit is reached."""
    job = ksd.Job(
        lambda angle, thickness: crossed(angle, thickness, scale), maximise="intended_Hz",
        vary={"angle": (0.55, 1.02), "thickness": (0.2 * mm * scale, 0.9 * mm * scale)}, limits={"stress_MPa": limit},
        turn=[0, 0.12, 0.25],
    )  # fmt: skip
    best = ksd.optimise(job)
    assert best.status == "optimum" and best.design["angle"] == pytest.approx(0.55, rel=1e-6)
    stress = max(v for n, v in best.answers.items() if "stress" in n)
    thick = best.design["thickness"] == pytest.approx(0.9 * mm * scale)
    assert stress <= limit and (thick or stress == pytest.approx(limit, rel=1e-6))
    assert sum(best.held[n] for n in best.held if n.startswith("intended")) == pytest.approx(1.0, abs=1e-6)
    assert near_designs(best) <= 1e-5


@pytest.mark.parametrize("unit", [1e-6, 1e6])
@pytest.mark.parametrize(
    ("target", "length", "material"),
    [("strain_energy_J", 0.5 * mm, SILICON), ("parasitic_rz_mrad", 80 * mm, STEEL)],
)
def test_small_targets_and_their_units(target, length, material, unit):
    """Answers below a tenth of their scale were optimised to an absolute tolerance: .001 pJ was as good as zero."""

    def guide(length, thickness):
        return leaf_springs(length, thickness, 0.2 * length, 0.5 * length, material)

    job = ksd.Job(
        guide, vary={"length": (0.7 * length, 1.2 * length), "thickness": (0.004 * length, 0.01 * length)},
        minimise={target: unit}, limits={"support_z_N_per_m": (3e5 * length, None)}, drive=0.02 * length,
    )  # fmt: skip
    best = ksd.optimise(job)
    assert best.status == "optimum" and near_designs(best, 8) <= 1e-5
    same = ksd.optimise(replace_scale(job, target))
    assert list(best.design.values()) == pytest.approx(list(same.design.values()), rel=1e-6)
    assert best.merit * unit == pytest.approx(same.merit, rel=1e-6)
    # what a limit or bound is worth depends on no unit
    assert best.held == pytest.approx(same.held, rel=1e-3, abs=1e-5)


def replace_scale(job, target):
    """The job with a scale of one unit."""
    return ksd.Job(job.function, **{**job.arguments, "minimise": target})


def test_worth_of_a_small_target_is_that_of_moving_a_bound():
    """The worth of the length was .0003 for 2.91."""

    def guide(length):
        return leaf_springs(length, 0.3 * mm)

    def best(longest):
        return ksd.optimise(
            ksd.Job(guide, vary={"length": (50 * mm, longest)}, minimise="strain_energy_J", drive=0.1 * mm)
        )

    one, longer = best(80 * mm), best(80 * mm * 1.001)
    expected = np.log(longer.merit / one.merit) / np.log(1.001)
    assert one.held["length at its most"] == pytest.approx(-expected, rel=2e-3) and expected < -2.9


def buckling_margin(p):
    """Euler load of a leaf spring of 100 mm held at one end, less .05 N."""
    return np.pi**2 * 200e9 * 10 * mm * p["thickness"] ** 3 / 12 / (0.2) ** 2 - 0.05


@pytest.mark.parametrize(
    ("method", "factor"), [("gradient", 1.0), ("gradient", 1e6), ("trust-constr", 1e6), ("cobyla", 1.0)]
)
def test_rules_that_range_over_orders_are_met(method, factor):
    """Rules counted as met down to -1e-5 of their largest value: 98 % of the load was missing."""
    job = ksd.Job(
        lambda thickness: leaf_springs(100 * mm, thickness, 10 * mm), vary={"thickness": (0.02 * mm, 2 * mm)},
        minimise="drive_force_N", rules=[lambda p: factor * buckling_margin(p)], drive=1 * mm, method="conventional",
    )  # fmt: skip
    best = ksd.optimise(job, method=method)
    thinnest = (0.05 * 12 * 0.2**2 / np.pi**2 / 200e9 / (10 * mm)) ** (1 / 3)
    assert best.design["thickness"] == pytest.approx(thinnest, rel=2e-6)
    assert buckling_margin(best.design) >= -1e-9 and best.status == "optimum"


def test_rules_without_a_number():
    """inf is met and never binds; where a rule fails, is nan or -inf, the design has no answers, with the sentence."""
    free = ksd.optimise(small(rules=[lambda p: np.inf]))
    assert free.merit == pytest.approx(ksd.optimise(small()).merit, rel=1e-6) and "rule 1" not in free.held

    def tabulated(p):
        return 0.0 if p["thickness"] > 0.7 * mm and {}["none"] else 1.0

    best = ksd.optimise(small(rules=[tabulated]))
    assert best.design["thickness"] == pytest.approx(0.7 * mm, rel=1e-4)
    failing = "rule 'tabulated' gives no number: no parameter 'none'"
    # such a design is not solved, and its row says why
    (status,) = {row["status"] for row in best.table.rows()} - {"ok"}
    assert failing in status
    for rule, said in (
        (tabulated, failing),
        (lambda p: np.nan, "rule 1 is nan"),
        (lambda p: -np.inf, "rule 1 is -inf"),
    ):
        job = small()
        object.__setattr__(job, "rules", (rule,))
        problem = ScaledProblem(job, DesignLog(job), "")
        with pytest.raises(Exception, match=said):
            problem.design(problem.scaled(np.array([50 * mm, 0.8 * mm])))


def test_a_limit_of_zero_is_met_in_any_unit():
    """Parasitic motion of a guide that leans: its sign changes at equal lean; met down to -1e-5 of the unit before."""

    def leaning(lean, thickness):
        scene = ksd.Mechanism("leaning", plane="xy")
        stage = scene.link("stage")
        for y, bend in ((0, 0.0), (30 * mm, lean)):
            scene.leaf("ground", stage, start=(0, y, 0), end=(60 * mm, y + bend, 0), material=STEEL,
                       section=ksd.rectangle(thickness, 10 * mm))  # fmt: skip
        scene.actuate(stage, along="y", at=(60 * mm, 15 * mm, 0), name="drive")
        return scene

    job = ksd.Job(
        leaning, vary={"lean": (-4 * mm, 2 * mm), "thickness": (0.2 * mm, 0.4 * mm)}, maximise="drive_stiffness_N_per_m",
        limits={"parasitic_rz_mrad": (0, None)}, drive=0.001 * mm, method="conventional",
    )  # fmt: skip
    best = ksd.optimise(job)
    turn = best.answers["parasitic_rz_mrad"]
    assert -1e-9 * abs(job.values([2 * mm, 0.3 * mm])[job.names.index("parasitic_rz_mrad")]) <= turn
    assert best.status == "optimum" and near_designs(best) <= 1e-4


class Unread(OSError):
    """An error of a file that a function of parameters reads."""


def test_any_error_of_the_function_is_a_status():
    """They came out raw and all designs were lost."""
    errors = (KeyError, IndexError, AttributeError, TypeError, Unread, StopIteration)
    raised = cycle(errors)

    def fails(length, thickness):
        if thickness > 0.6 * mm:
            error = next(raised)
            raise error(f"stock of {error.__name__}")
        return sheet(length, thickness)

    best = ksd.optimise(small(fails, method="conventional"))
    assert best.design["thickness"] == pytest.approx(0.6 * mm, rel=1e-4)
    failed = [row["status"] for row in best.table.rows() if row["status"] != "ok"]
    assert all("cannot be built" in s for s in failed)
    assert all(any(f"stock of {error.__name__}" in s for s in failed) for error in errors)


def test_a_start_without_answers_is_replaced_and_said():
    """It was refused, though most of the bounds answer."""

    def far(length, thickness):
        if thickness < 0.5 * mm:
            raise ValueError("too thin")
        return sheet(length, thickness)

    best = ksd.optimise(small(far), start=[60 * mm, 0.3 * mm])
    assert best.merit == pytest.approx(ksd.optimise(small()).merit, rel=1e-6)
    assert "the start has no answers (this design cannot be built: too thin)" in best.starts[0].note
    assert "the search began at length" in str(best)


def test_a_start_beyond_the_trained_range_takes_the_next_method():
    """The search ended, though the conventional method has no trained ranges."""
    words = {
        "vary": {"angle": (20 * deg, 59 * deg), "thickness": (0.3 * mm, 0.8 * mm)}, "maximise": "support_z_N_per_m",
        "limits": {"stress_MPa": 400}, "turn": 0.3,
    }  # fmt: skip

    def hinge(angle, thickness):
        return pivot(60 * mm, angle, thickness, 40 * mm, 12 * mm)

    start = {"angle": 25 * deg, "thickness": 0.4 * mm}
    best = ksd.optimise(ksd.Job(hinge, **words), start=start)
    said = "Solved by the conventional method, as the start is beyond what the joint records hold: start: angle = 0.436"
    assert (
        best.job.method == "conventional" and said in str(best).replace("\n", " ") and said in str(best.job)
    )
    same = ksd.optimise(ksd.Job(hinge, **words, method="conventional"), start=start)
    assert best.design == pytest.approx(same.design, rel=1e-6) and not same.job.method_note
    # so for a stroke, and from a file; not where the method was given
    far = {
        **words,
        "vary": {"angle": (31 * deg, 59 * deg), "thickness": (0.3 * mm, 0.8 * mm)},
        "turn": 1.4,
        "limits": {"stress_MPa": 1500},
    }
    assert ksd.optimise(ksd.Job(hinge, **far)).job.method == "conventional"
    with pytest.raises(ksd.ConvergenceError, match=r"none of 1 starts"):
        ksd.optimise(ksd.Job(hinge, **far, method="full"))
    with pytest.raises(ksd.SceneError, match=r"angle = 0.436.* lies outside"):
        ksd.optimise(ksd.Job(hinge, **words, method="full"), start=start)


def test_a_run_by_the_next_method_goes_on_from_its_file(tmp_path, monkeypatch):
    def hinge(thickness):
        return pivot(60 * mm, 45 * deg, thickness, 40 * mm, 12 * mm)

    job = ksd.Job(
        hinge,
        vary={"thickness": (0.2 * mm, 0.5 * mm)},
        maximise="support_z_N_per_m",
        limits={"stress_MPa": 900},
        turn=1.4,
    )
    first = ksd.optimise(job, resume=tmp_path / "job.jsonl")
    monkeypatch.setattr(ksd.Job, "batch", None)
    monkeypatch.setattr(ksd.Job, "slopes", None)
    assert ksd.optimise(job, resume=tmp_path / "job.jsonl").design == first.design


def test_names_of_intended_modes_are_those_that_are_answered():
    joint = ksd.UniversalJoint(STEEL, length=60 * mm, thickness=0.4 * mm, width=30 * mm)

    def universal(thickness):
        scene = ksd.Mechanism("universal")
        tip = scene.link("tip")
        own = replace(joint, thickness=thickness)
        placed = scene.join(scene.ground, tip, own, at=(0, 0, 0), axis="z", toward="x", name="joint")
        for motion in own.motions:
            scene.actuate_joint(placed, name=motion.name, motion=motion.name)
        return scene

    words = {"vary": {"thickness": (0.3 * mm, 0.6 * mm)}, "about_z": 0.1, "about_y": 0.0}
    with pytest.raises(
        ksd.SceneError, match=r"no answer 'intended_Hz'; there are .*intended_1_Hz, intended_2_Hz"
    ):
        ksd.Job(universal, maximise="intended_Hz", **words)
    with pytest.raises(ksd.SceneError, match=r"no answer 'intended_1_Hz'; there are .*intended_Hz"):
        small(maximise="intended_1_Hz")
    # of the drives that are freed
    assert ksd.Job(universal, maximise="intended_Hz", freed="about_z", **words).names == ("intended_Hz",)


def shifted(offset, thickness=0.3 * mm):
    """A guide whose upper leaf spring ends `offset` higher."""
    scene = ksd.Mechanism("shifted", plane="xy")
    stage = scene.link("stage")
    for y, lean in ((0, 0.0), (30 * mm, offset)):
        scene.leaf("ground", stage, start=(0, y, 0), end=(60 * mm, y + lean, 0), material=STEEL,
                   section=ksd.rectangle(thickness, 10 * mm))  # fmt: skip
    scene.actuate(stage, along="y", at=(60 * mm, 15 * mm, 0), name="drive")
    return scene


@pytest.mark.parametrize(("low", "high"), [(-5 * um, 5 * um), (-5 * um, 0.0), (-2 * mm, -1 * mm)])
def test_steps_and_worths_by_bounds_at_or_below_zero(low, high):
    """A step was 3e-5 of the size of the mechanism, and the worth one per percent of the range, whatever the bound."""
    job = ksd.Job(shifted, vary={"offset": (low, high)}, maximise="drive_stiffness_N_per_m", drive=1 * mm)
    middle = 0.5 * (low + high)
    h = 0.1 * (high - low)
    exact = (job.values([middle + h])[0] - job.values([middle - h])[0]) / (2 * h)
    assert job.jacobian([middle])[0, 0] == pytest.approx(exact, rel=1e-3)
    assert max(job._step_sizes.values()) == high - low
    best = ksd.optimise(job)
    ((name, worth),) = [(n, w) for n, w in best.held.items() if n.startswith("offset")]
    end = best.design["offset"]
    moved = 0.01 * (abs(end) or high - low)
    other = job.values([end + (moved if name.endswith("most") else -moved)])[0]
    assert worth == pytest.approx(100 * (other / best.merit - 1), rel=0.02)


def test_of_two_lines_for_one_design_the_later_is_taken_and_said(tmp_path):
    from ksd.study.resume import _hash

    path, job = tmp_path / "job.jsonl", small()
    DesignLog(job, resume=path).batch(job.point(None))
    head, line = path.read_text().splitlines()
    body = json.loads(line.partition(" ")[2])
    body["rows"][0]["support_worst_Nm_per_rad"] *= 2
    other = json.dumps(body)
    path.write_text("\n".join([head, line, f"{_hash(other)} {other}"]) + "\n")
    with pytest.warns(
        ksd.SceneWarning, match=r"two lines with different answers for 1 of its entries; the later"
    ):
        log = DesignLog(job, resume=path)
    assert log.values(job.point(None))[0] == body["rows"][0]["support_worst_Nm_per_rad"]


def test_what_is_not_stationary_is_not_called_an_optimum(monkeypatch):
    """Also where the search itself believes it: its end is judged by shares, neighbours and a finer mesh."""
    best = ksd.optimise(small())
    problem = ScaledProblem(best.job, DesignLog(best.job), "")
    y = problem.scaled(np.array(list(best.design.values())))
    proof = optimality.prove(problem, y)[0]
    assert proof.status == "optimum" and proof.target_share == pytest.approx(1.0, abs=1e-6)
    assert proof.remainder < 1e-3 and proof.neighbour_gain < 0
    off = y - 0.02
    worse, _, better = optimality.prove(problem, off)
    assert worse.status == "stopped" and worse.remainder > 0.1 and worse.target_share < 0.99
    assert problem.design(better).merit > problem.design(off).merit
    monkeypatch.setattr(optimality, "neighbours", lambda problem, y: [])
    assert optimality.prove(problem, off)[0].status == "no better neighbour found"
    said = str(best).replace("\n", " ")
    assert (
        "shares of targets sum to 1.0000" in said
        and "neighbours were solved" in said
        and "a finer mesh" in said
    )
    assert (
        best.as_dict()["status"] == "optimum"
        and best.as_dict()["proof"]["neighbours"] == best.proof.neighbours
    )


class Valley:
    """The level is the radius and a little of the angle, and the radius is limited: the best design is a quarter turn on."""

    is_target = np.array([True, False])
    bounds = edges = np.array([[0.0, 2.0], [0.0, 2.0]])
    best_feasible = None
    level, fitness = ScaledProblem.level, ScaledProblem.fitness

    def margins(self, y):
        r, angle = np.hypot(*y), np.arctan2(y[1], y[0])
        return np.array([r + 0.003 * angle, 1.0 - r])

    def slopes(self, y):
        r = np.hypot(*y)
        return np.array([y / r + 0.003 * np.array([-y[1], y[0]]) / r**2, -y / r])


def test_linear_programs_do_not_creep_along_a_limit_that_bends():
    """A search went on in steps of 1e-6 and ended .5 % below the best: every longer step left the limit by its square."""
    problem = Valley()
    y = local_search._descend_by_linear_programs(problem, np.array([1.0, 0.0]))
    assert np.arctan2(y[1], y[0]) > 0.25 and abs(problem.margins(y)[1]) < 1e-4


def test_a_coarse_mesh_is_said_to_change_the_optimum():
    """A merit was 6.2 % off on a finer mesh, untold."""
    coarse = small(mesh=ksd.Mesh("corotational", elements=1))
    best = ksd.optimise(coarse)
    fine = ksd.solve(best.mechanism, turn=0.3).stiffness("arm", at=(0, 0, 0)).worst[1]
    assert best.proof.mesh_change == pytest.approx(fine / best.merit - 1, abs=2e-3)
    assert abs(best.proof.mesh_change) > 5e-3 and f"{100 * best.proof.mesh_change:+.2g} %" in str(best)


def two(first, second):
    """Two leaf springs of different lengths: the size is that of the longer one."""
    scene = ksd.Mechanism("two", plane="xy")
    stage = scene.link("stage")
    for name, y, length in (("first", 0, first), ("second", 30 * mm, second)):
        scene.leaf("ground", stage, start=(0, y, 0), end=(length, y, 0), material=STEEL,
                   section=ksd.rectangle(0.3 * mm, 10 * mm), name=name)  # fmt: skip
    scene.actuate(stage, along="y", at=(60 * mm, 15 * mm, 0), name="drive")
    return scene


@pytest.mark.parametrize("limit", [60, 61])
def test_worth_of_a_size_is_that_of_each_leaf_spring_at_its_end(limit):
    """A size has a kink where two leaf springs end together: its slope was a mean of both, and its worth 33.6 for 1.5."""
    words = {"minimise": "drive_stiffness_N_per_m", "limits": {"size_mm": (limit, None, None)}, "drive": 0.0}
    best = ksd.optimise(
        ksd.Job(two, vary={"first": (40 * mm, 80 * mm), "second": (40 * mm, 80 * mm)}, **words)
    )
    sizes = {n: w for n, w in best.held.items() if n.startswith("size")}
    # the stiffness of a leaf spring is that of its length to the power of -3
    assert sizes == pytest.approx(
        {"size_x_mm[first highest]": 1.5, "size_x_mm[second highest]": 1.5}, rel=1e-3
    )
    assert limit * (1 - 1e-6) < best.answers["size_x_mm"] <= limit and best.status == "optimum"
    assert list(best.design.values()) == pytest.approx([limit * mm] * 2, rel=1e-6)
    assert near_designs(best) < 1e-6 and not best.proof.kinks


def test_the_size_of_a_leaf_spring_that_is_not_varied_is_named_as_a_kink():
    """One ends exactly at the limit, so that it is worth something outwards only; the search crept to it in 80 values."""
    job = ksd.Job(
        lambda second: two(60 * mm, second), vary={"second": (40 * mm, 80 * mm)},
        minimise="drive_stiffness_N_per_m", limits={"size_mm": (60, None, None)}, drive=0.0,
    )  # fmt: skip
    best = ksd.optimise(job)
    assert best.held["size_x_mm[second highest]"] == pytest.approx(1.5, rel=1e-3)
    assert best.design["second"] == pytest.approx(60 * mm, rel=2e-7) and best.evaluations <= 8
    assert best.status == "optimum" and best.proof.kinks == ("size_x_mm",)


def rod(size):
    """A rod of the section of a square of 2 mm, which is stiffest in its softer direction where it is one."""
    scene = ksd.Mechanism("rod")
    stage = scene.link("stage")
    section = ksd.rectangle(4 * mm**2 / size, size)
    scene.leaf("ground", stage, start=(0, 0, 0), end=(60 * mm, 0, 0), material=STEEL, section=section)
    scene.actuate(stage, about="x", name="drive")
    return scene


def slender(size):
    """A guide of two leaf springs with a mass whose inertia about x grows with `size` as that about y falls."""
    scene = leaf_springs(60 * mm, 0.4 * mm, 20 * mm, 40 * mm)
    scene.mass("stage", mass=0.2, at=(60 * mm, 20 * mm, 0), inertia=(8e-4 * size, 8e-4 / size, 8e-4))
    return scene


@pytest.mark.parametrize(
    ("function", "bounds", "column"),
    [
        (rod, (1 * mm, 3.7 * mm), "support_worst_N_per_m"),
        (rod, (1 * mm, 3.7 * mm), "support_worst_Nm_per_rad"),
        (slender, (0.7, 1.4), "first_parasitic_Hz"),
    ],
)
def test_where_two_of_which_the_lower_counts_meet(function, bounds, column):
    """Each has its slope: the mean of both was that of either, so that over 40 values ended at what was not proven."""
    best = ksd.optimise(ksd.Job(function, vary={"size": bounds}, maximise=column, drive=0.0))
    one, two = best.answers[column], best.answers[f"{column}[2]"]
    assert one == pytest.approx(two, rel=1e-6) and best.evaluations <= 10
    assert best.status == "optimum" and best.held[column] + best.held[f"{column}[2]"] == pytest.approx(1.0)
    assert min(best.held[column], best.held[f"{column}[2]"]) > 0.4 and near_designs(best) < 0


def test_a_front_counts_proven_points():
    found = ksd.pareto(small(), against="turn_moment_Nm", points=3)
    assert found.proven == 3 and "3 points are proven optima" in str(found)
    assert set(found.table["proof"]) == {"optimum"}
