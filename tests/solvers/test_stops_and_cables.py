"""End stops and cables against drives, bars, springs and formulas; their words; what is refused."""

import math
import pickle

import numpy as np
import pytest

import ksd
from ksd.units import GPa, deg, mm

STEEL = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
SECTION = ksd.rectangle(0.5 * mm, 20 * mm)
END = (0.1, 0.0, 0.0)


def guide(plane="xy", *, force=(0, 20, 0), turn=None):
    """A parallel guide of two leaf springs along x under a force across; turn (3, 3): of the whole scene."""
    R = np.eye(3) if turn is None else turn
    scene = ksd.Mechanism("guide", plane=plane)
    stage = scene.link("stage")
    for i, y in enumerate((-0.03, 0.03)):
        start, end = R @ (0, y, 0), R @ (0.1, y, 0)
        scene.leaf(
            "ground",
            stage,
            start=start,
            end=end,
            width_axis=R @ (0, 0, 1),
            section=SECTION,
            material=STEEL,
            name=f"l{i}",
        )
    scene.load(stage, force=R @ force, at=R @ END)
    return scene


@pytest.mark.parametrize("plane", ["xy", None])
@pytest.mark.parametrize("side", [1, -1])
def test_a_stop_pushes_like_a_drive_that_holds_the_motion_there(plane, side):
    scene = guide(plane, force=(0, 20 * side, 0))
    scene.stop("stage", along="y", at=END, low=-2 * mm, high=3 * mm, name="end")
    held = guide(plane, force=(0, 20 * side, 0))
    held.actuate("stage", along="y", at=END, name="d")
    value = 3 * mm if side > 0 else -2 * mm
    pose, by_hand = ksd.solve(scene), ksd.solve(held, d=value, method="conventional")
    own, other = ("end.high", "end.low") if side > 0 else ("end.low", "end.high")
    assert pose.stops[own].force == pytest.approx(abs(by_hand.forces["d"]), rel=1e-9)
    assert pose.stops[other].force == 0.0 and pose.stops[other].gap == pytest.approx(5 * mm)
    assert np.abs(pose.motion.x - by_hand.motion.x).max() < 1e-11
    assert pose.trust.trusted and "acts" not in str(pose.warnings)


def test_a_stop_of_a_joint_with_softness(tmp_path):
    """Force of a soft stop = what it gives way by / softness."""
    made = {}
    for softness in (0.0, 0.02):
        scene = ksd.Mechanism("lever")
        lever = scene.link("lever")
        joint = ksd.ParallelGuide(STEEL, length=80 * mm, thickness=0.4 * mm, width=25 * mm, spacing=60 * mm)
        placed = scene.join("ground", lever, joint, at=(0, 0, 0), axis="z", toward="x", name="guide")
        scene.load(lever, force=(0, 8, 0), at=(40 * mm, 0, 0))
        scene.stop(joint=placed, high=3 * mm, softness=softness * mm, name="end")
        made[softness] = ksd.solve(scene)
        ksd.save_scene(scene, tmp_path / "lever.toml")
        again, _, _ = ksd.load_scene(tmp_path / "lever.toml")
        assert again.scene() == scene.scene()
    hard, soft = (made[s].stops["end.high"] for s in (0.0, 0.02))
    assert soft.force == pytest.approx(-soft.gap / (0.02 * mm), rel=1e-9)
    assert hard.force > soft.force > 0.5 * hard.force


def test_a_cable_pulls_like_an_inextensible_bar():
    start, end = (0.04, -0.08, 0.0), (0.1, 0.01, 0.0)
    scene, bar = guide(), guide()
    scene.cable("ground", "stage", start=start, end=end, name="tendon")
    rod = bar.link("rod")
    bar.pin("ground", rod, at=start)
    bar.pin(rod, "stage", at=end, name="tip")
    pose, held = ksd.solve(scene), ksd.solve(bar, method="conventional")
    pulled = held.interface_forces()
    force = next(r.force for r in pulled.rows if r.name == "tip" and r.link == "stage")
    assert pose.cables["tendon"].force == pytest.approx(np.linalg.norm(force), rel=1e-8)
    assert np.abs(pose.motion.x - held.motion.x[:2]).max() < 1e-10


def test_a_cable_that_stretches_is_a_spring_while_it_pulls_and_nothing_while_it_is_slack():
    ends = {"start": (0.1, -0.08, 0.0), "end": END}
    scene, sprung = guide(), guide()
    scene.cable("ground", "stage", **ends, stiffness=2e3, length=0.081, name="tendon")
    sprung.spring("ground", "stage", **ends, stiffness=2e3, free_length=0.081)
    pose, other = ksd.solve(scene), ksd.solve(sprung, method="conventional")
    assert np.abs(pose.motion.x - other.motion.x).max() < 1e-12
    assert pose.cables["tendon"].force == pytest.approx(-2e3 * pose.cables["tendon"].gap, rel=1e-9)
    slack = ksd.solve(scene, tendon=-20 * mm)
    assert slack.cables["tendon"].force == 0.0
    assert (slack.motion.x == ksd.solve(guide()).motion.x).all()


def test_a_tendon_through_a_guide_bends_a_finger():
    """Capstan without friction: the same tension in both parts, so the guide takes their resultant; check by balance."""
    scene = ksd.Mechanism("finger", plane="xy")
    middle, tip = scene.links("middle", "tip")
    thin = ksd.rectangle(0.3 * mm, 10 * mm)
    scene.leaf("ground", middle, start=(0, 0, 0), end=(0.04, 0, 0), section=thin, material=STEEL)
    scene.leaf(middle, tip, start=(0.05, 0, 0), end=(0.09, 0, 0), section=thin, material=STEEL)
    via = [("ground", (0, 5 * mm, 0)), (middle, (0.045, 5 * mm, 0))]
    scene.cable("ground", tip, start=(-0.02, 5 * mm, 0), end=(0.09, 5 * mm, 0), via=via, name="tendon")
    pose = ksd.solve(scene, tendon=3 * mm)
    T = pose.cables["tendon"].force
    x, R = pose.motion.x, pose.motion.R
    rest = pose.model.rest.x
    at = [
        np.array((0, 5 * mm, 0)),
        *(x[k] + R[k] @ (np.array(p) - rest[k]) for k, p in ((1, via[1][1]), (2, (0.09, 5 * mm, 0)))),
    ]
    length = math.dist(at[0], at[1]) + math.dist(at[1], at[2])
    assert length == pytest.approx(0.09 - 3 * mm, abs=1e-12)
    rows = {(r.name, r.link): r for r in pose.interface_forces().rows}
    u, v = (at[1] - at[0]) / math.dist(at[0], at[1]), (at[2] - at[1]) / math.dist(at[1], at[2])
    on_tip = rows["leaf.2", "tip"].force - T * v
    on_middle = rows["leaf.2", "middle"].force + rows["leaf", "middle"].force + T * (v - u)
    assert T > 1.0 and np.abs(on_tip).max() < 1e-7 * T and np.abs(on_middle).max() < 1e-7 * T
    assert pose.rotation("tip")[2] > 20 * deg
    with pytest.raises(
        ksd.ConvergenceError,
        match=r"cable 'tendon' cannot be shortened by 100 mm: at \d\S* mm it pulls with \d\S* N, and nothing gives way to "
        r"make it shorter; shorten it less, or let it stretch \(stiffness=\)",
    ):
        ksd.solve(scene, tendon=100 * mm)


def random_scene(seed):
    """A guide with one, two or three stops and a cable at random, under a random force."""
    rng = np.random.default_rng(seed)
    scene = guide(None if seed % 2 else "xy", force=(rng.uniform(-5, 5), rng.uniform(-25, 25), 0))
    for i in range(1 + seed % 3):
        # far from the guide's stiff direction, along which a stop has two states
        a = rng.uniform(0.5, 2.6)
        along = (np.cos(a), np.sin(a), 0)
        at = (0.1 + rng.uniform(0, 0.02), rng.uniform(-0.04, 0.04), 0)
        limit = 10 ** rng.uniform(-5, -2.5)
        scene.stop("stage", along=along, at=at, low=-limit, high=1.5 * limit, name=f"s{i}")
    scene.cable(
        "ground", "stage", start=(0.1, rng.uniform(-0.1, 0.1), 0), end=(0.12, 0.001, 0), length=None, name="c"
    )
    return scene


def check_balance(scene, pose):
    """Balance, complementarity and signs from the pose alone: no function of the solver; returns the largest force."""
    rest, x, R = pose.model.rest.x, pose.motion.x[1], pose.motion.R[1]

    def place(at):
        return x + R @ (np.asarray(at) - rest[1])

    F, M = np.zeros(3), np.zeros(3)
    rows = [(r.force, r.moment, r.point) for r in pose.interface_forces().rows if r.link == "stage"]
    rows += [(np.asarray(load.force), 0.0, place(load.at)) for load in scene.scene().loads]
    largest = max(np.linalg.norm(r[0]) for r in rows)
    for stop in scene.scene().stops:
        u = np.asarray(stop.terms[0].direction)
        value = u @ (place(stop.terms[0].point) - stop.terms[0].point)
        for name, limit in stop.limits.items():
            N, sign = pose.stops[name].force, 1.0 if name.endswith(".low") else -1.0
            gap = sign * (value - limit)
            assert N >= 0.0 and gap > -1e-11 and min(N, gap * 1e6) < 1e-5
            rows.append((sign * N * u, 0.0, place(stop.terms[0].point)))
            largest = max(largest, N)
    for cable in scene.scene().cables:
        end, T = place(cable.end), pose.cables[cable.name].force
        slack = cable.rest_length - math.dist(end, cable.start)
        assert T >= 0.0 and slack > -1e-11 and min(T, slack * 1e6) < 1e-5
        rows.append((T * (np.asarray(cable.start) - end) / math.dist(end, cable.start), 0.0, end))
        largest = max(largest, T)
    for force, moment, point in rows:
        F += force
        M += moment + np.cross(point - x, force)
    assert np.abs(F).max() < 1e-8 * largest and np.abs(M).max() < 1e-9 * largest
    return largest


@pytest.mark.parametrize("seed", range(12))
def test_random_stops_and_cables_balance_and_agree_with_drives_set_by_hand(seed):
    scene = random_scene(seed)
    pose = ksd.solve(scene, strict=False)
    largest = check_balance(scene, pose)
    by_hand = guide(scene.plane, force=scene.scene().loads[0].force)
    targets = {}
    for stop in scene.scene().stops:
        for name, limit in stop.limits.items():
            if pose.stops[name].force > 0.0:
                term = stop.terms[0]
                by_hand.actuate("stage", along=term.direction, at=term.point, name=name)
                targets[name] = limit
    if pose.cables["c"].force > 0.0 or not targets:
        return
    other = ksd.solve(by_hand, targets, method="conventional", strict=False)
    assert np.abs(other.motion.x - pose.motion.x).max() < 1e-10
    for name in targets:
        assert abs(abs(other.forces[name]) - pose.stops[name].force) < 1e-8 * largest


def test_the_answer_depends_neither_on_order_and_names_nor_on_a_turn_or_a_mirror_of_the_scene():
    a = 0.7
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    mirror = np.diag([1.0, -1.0, 1.0])
    forces = []
    for R, order in ((np.eye(3), 1), (turn, 1), (mirror, 1), (np.eye(3), -1)):
        scene = guide(None, turn=R)
        stops = [(R @ (0, 1, 0), R @ (0.12, 0.04, 0), 2 * mm), (R @ (1, 0, 0), R @ (0.1, -0.03, 0), 0.1 * mm)]
        for i, (along, at, high) in enumerate(stops[::order]):
            scene.stop("stage", along=along, at=at, high=high, name=f"{'ab'[order]}{i}")
        scene.cable("ground", "stage", start=R @ (0.1, -0.1, 0), end=R @ END, stiffness=1e3, name="c")
        pose = ksd.solve(scene)
        own = [part.force for part in pose.stops.values()][::order]
        forces.append([*own, pose.cables["c"].force, np.linalg.norm(pose.displacement("stage"))])
    assert np.abs(np.array(forces) - forces[0]).max() < 1e-9 * max(forces[0])


def test_open_stops_and_slack_cables_change_no_digit():
    scene = guide()
    scene.stop("stage", along="y", at=END, low=-1, high=1)
    scene.cable("ground", "stage", start=(0.1, -0.1, 0), end=END, length=0.3)
    pose, plain = ksd.solve(scene), ksd.solve(guide())
    for one, other in zip(pose.motion, plain.motion, strict=True):
        assert (one == other).all()
    assert pose.steps[0].iterations == plain.steps[0].iterations
    assert pose.frequencies(count=2).frequency_Hz == pytest.approx(
        plain.frequencies(count=2).frequency_Hz, rel=0
    )


def test_a_stop_may_be_moved_and_a_pose_continued():
    scene = guide()
    scene.stop("stage", along="y", at=END, high=3 * mm, name="end")
    first = ksd.solve(scene)
    moved = ksd.solve(scene, {"end.high": -1 * mm}, start=first)
    assert moved.displacement("stage", END)[1] == pytest.approx(-1 * mm, abs=1e-12)
    direct = ksd.solve(scene, {"end.high": -1 * mm})
    assert direct.stops["end.high"].force == pytest.approx(moved.stops["end.high"].force, rel=1e-9)
    freed = ksd.solve(scene, {"end.high": 1.0}, start=first)
    assert freed.stops["end.high"].force == 0.0
    assert np.abs(freed.motion.x - ksd.solve(guide()).motion.x).max() < 1e-11
    again = pickle.loads(pickle.dumps(moved))
    assert again.stops["end.high"] == moved.stops["end.high"]


def test_a_walk_prints_units_and_what_stops_push_with():
    scene = ksd.Mechanism("blade", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=END, section=SECTION, material=STEEL)
    scene.actuate(tip, along="y", at=END, name="push")
    scene.stop(tip, about="z", high=3 * deg, name="end")
    walk = ksd.walk(scene, [{"push": 1 * mm}, {"push": 6 * mm}])
    head, *rows = (line.split("  ") for line in str(walk).splitlines() if line.strip(" ─"))
    assert [word.strip() for word in rows.pop(0) if word] == [
        "push [mm]",
        "end.high [deg]",
        "end.high [Nm]",
    ], head
    pushed = walk[-1].stops["end.high"].force
    assert [[float(word) for word in row if word] for row in rows] == [
        [1.0, 3.0, 0.0],
        [6.0, 3.0, pytest.approx(pushed, rel=1e-3)],
    ]
    assert pushed > 0.0


def test_a_link_that_hangs_on_a_cable_alone():
    """Nothing but a cable and a hinge holds the lever: the tension follows from the moment about the pin."""
    scene = ksd.Mechanism("lever", plane="xy")
    lever, _ = scene.links("lever", "post")
    stout = ksd.rectangle(8 * mm, 20 * mm)
    scene.leaf("ground", "post", start=(0, 0, 0), end=(0, 0.1, 0), section=stout, material=STEEL)
    scene.pin("post", lever, at=(0, 0.1, 0))
    scene.load(lever, force=(0, -2, 0), at=(0.2, 0.1, 0))
    scene.cable("post", lever, start=(0, 0.3, 0), end=(0.2, 0.1, 0), name="stay")
    pose = ksd.solve(scene)
    assert pose.cables["stay"].force == pytest.approx(2 * math.sqrt(2), rel=2e-3)
    assert pose.stable


def test_contradicting_stops_are_refused_with_how_far_it_got():
    scene = guide()
    scene.actuate("stage", along="y", at=END, name="d")
    scene.stop("stage", along="y", at=END, high=3 * mm, name="end")
    said = r"stopped at .* with contact: no contact forces hold the mechanism there: an object slides out"
    with pytest.raises(ksd.ConvergenceError, match=said):
        ksd.solve(scene, d=4 * mm)


def test_words_are_written_read_drawn_listed_and_known_to_the_doctor(tmp_path):
    scene = random_scene(1)
    scene.stop("stage", about="z", high=5 * deg, softness=0.1)
    ksd.save_scene(scene, tmp_path / "s.toml")
    again, _, _ = ksd.load_scene(tmp_path / "s.toml")
    assert again.scene() == scene.scene()
    assert "cable" in str(scene) and "stop" in str(scene)
    said = str(ksd.doctor(scene))
    assert (
        "cable 'c' from 'ground' to 'stage' is taut at rest" in said
        and "stop 's0' holds a motion of 'stage'" in said
    )
    pose = ksd.solve(scene, strict=False)
    shape = pose.shape()
    assert len(shape.cables) == 1 and len(shape.stops) == 4
    drawn = {line.get_gid() for line in pose.plot().axes[0].lines}
    assert {"cable", "stop"} <= drawn
    assert "tension" in str(pose.cables) and "limit" in str(pose.stops)


def test_units_in_scene_files(tmp_path):
    text = """
        name = "guide"
        links = ["stage"]
        [material.steel]
        E = "200 GPa"
        nu = 0.3
        [[leaf]]
        a = "ground"
        b = "stage"
        start = [0, 0, 0]
        end = ["100 mm", 0, 0]
        width_axis = "z"
        thickness = "0.5 mm"
        width = "20 mm"
        material = "steel"
        [[stop]]
        link = "stage"
        about = "z"
        low = "-2 deg"
        softness = "1 deg/Nm"
        [[cable]]
        a = "ground"
        b = "stage"
        start = [0, "10 mm", 0]
        end = ["100 mm", "10 mm", 0]
        via = [{link = "ground", at = ["20 mm", "15 mm", 0]}]
        stiffness = "5 N/mm"
    """
    (tmp_path / "s.toml").write_text(text)
    scene, _, _ = ksd.load_scene(tmp_path / "s.toml")
    stop, cable = scene.scene().stops[0], scene.scene().cables[0]
    assert stop.low == pytest.approx(-2 * deg) and stop.softness == pytest.approx(deg)
    assert cable.stiffness == 5000.0 and cable.via == (("ground", (0.02, 0.015, 0.0)),)
    (tmp_path / "s.toml").write_text(text.replace('low = "-2 deg"', 'low = "-2 mm"'))
    with pytest.raises(ksd.SceneError, match="low = '-2 mm'"):
        ksd.load_scene(tmp_path / "s.toml")


CASES = [
    (lambda s: s.stop("stage", along="y", at=END), "give low=, high= or both"),
    (lambda s: s.stop("stage", along="y", at=END, low=2, high=1), "low = 2 is above high = 1"),
    (lambda s: s.stop("stage", along="z", at=END, low=-1), "leaves the plane xy"),
    (lambda s: s.stop("stage", along="y", at=END, low=-1, softness=-1), "softness"),
    (lambda s: s.cable("stage", "stage", start=END, end=(0, 0, 0)), "connects link 'stage' with itself"),
    (lambda s: s.cable("ground", "stage", start=END, end=END), "both at"),
    (lambda s: s.cable("ground", "stage", start=(0, 0, 0), end=END, length=-1), "length = -1"),
    (
        lambda s: s.cable("ground", "stage", start=(0, 0, 0), end=END, length=0.09),
        "shorter than its way at rest",
    ),
    (lambda s: s.cable("ground", "stage", start=(0, 0, 0), end=END, stiffness=0), "stiffness = 0"),
    (
        lambda s: s.cable("ground", "stage", start=(0, 0, 0), end=END, friction=0.2),
        "guides of a cable are without friction",
    ),
    (
        lambda s: s.cable("ground", "stage", start=(0, 0, 0), end=END, via=["stage"]),
        "pairs \\(link, point\\)",
    ),
    (lambda s: s.cable("ground", "lid", start=(0, 0, 0), end=END), "link 'lid' does not exist"),
]


@pytest.mark.parametrize(("state", "message"), CASES)
def test_wrong_words_are_refused_in_one_sentence(state, message):
    with pytest.raises(ksd.SceneError, match=message):
        state(guide())


def test_a_stop_that_is_closed_at_rest_is_refused():
    scene = guide()
    scene.stop("stage", along="y", at=END, low=2 * mm, name="end")
    with pytest.raises(
        ksd.SceneError, match=r"stop 'end' is closed at rest by 2 mm, as low = 0.002; draw it open"
    ):
        ksd.solve(scene)


def test_names_of_drives_stops_and_cables_differ():
    scene = guide()
    scene.actuate("stage", along="y", at=END, name="d")
    with pytest.raises(ksd.SceneError, match="the cable name 'd' is used already"):
        scene.cable("ground", "stage", start=(0, 0, 0), end=END, name="d")
    scene.cable("ground", "stage", start=(0, 0.01, 0), end=END, name="c")
    with pytest.raises(ksd.SceneError, match="the drive name 'c' is used already"):
        scene.actuate("stage", about="z", name="c")


@pytest.fixture(scope="module")
def stopped():
    scene = guide()
    scene.stop("stage", along="y", at=END, high=3 * mm, name="end")
    return scene, ksd.solve(scene)


QUESTIONS = [
    lambda p: p.verify(),
    lambda p: p.gradient(lambda q: q.strain_energy(), by=[]),
    lambda p: p.internal_stress(), lambda p: p.sensitivity(lambda q: 1.0, "stage", at=END, force=(1, 0, 0)),
]  # fmt: skip


@pytest.mark.parametrize("question", QUESTIONS)
def test_questions_that_know_no_stops_are_refused_where_one_acts(stopped, question):
    with pytest.raises(ksd.SceneError, match="'end' acts in this pose, and this question knows no stops"):
        question(stopped[1])


CALLS = [
    ksd.follow,
    lambda s: ksd.simulate(s, until=0.1),
    ksd.compile_scene,
]


@pytest.mark.parametrize("call", CALLS)
def test_calls_that_know_no_stops_are_refused(call):
    scene = guide()
    scene.actuate("stage", along="x", at=END, name="d")
    scene.stop("stage", along="y", at=END, high=3 * mm, name="end")
    with pytest.raises(
        ksd.SceneError, match=r"stop 'end': stops, cables and contacts are known to ksd.solve"
    ):
        call(scene)


@pytest.mark.parametrize("method", ["kinematic", "reduced", "modal", "constant"])
def test_other_methods_are_refused_where_a_stop_acts(stopped, method):
    with pytest.raises(ksd.SceneError, match=r"only load steps on all leaf springs know|no catalogue joints"):
        ksd.solve(stopped[0], method=method)


def test_unknown_values_are_refused(stopped):
    with pytest.raises(ksd.SceneError, match=r"drive 'end.low' is not in this mechanism"):
        ksd.solve(stopped[0], {"end.low": 1.0})
