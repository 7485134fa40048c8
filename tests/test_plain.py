"""Every kernel as plain Python: run with NUMBA_DISABLE_JIT=1, it is entered by these few solves.

``NUMBA_DISABLE_JIT=1 pytest -m plain -n 0`` runs them and the tests of kernels in three minutes, and says at the end how
many lines of kernels were run; without the variable the same solves run compiled.
"""

import ast
import inspect
import os
import sys
from pathlib import Path
from types import CodeType

import numpy as np
import pytest
from scenes import STEEL, fourbar, guided_leaf, single_joint

import ksd
from ksd.joints.joint_poses import pose_from_polynomials
from ksd.modal import ModalBasis, with_modal_bodies
from ksd.modal.solid import block
from ksd.modal.solid_basis import reduce_solid
from ksd.model.assembly import (
    skip_add_weight,
    skip_planar_loads,
    skip_rotate_gravity,
    skip_set_gravity,
    skip_spatial_loads,
)
from ksd.model.compile import compile_scene
from ksd.model.complementarity import _sweep, solve_complementarity, unknown_count
from ksd.model.gaps import WRENCH
from ksd.model.newton import _skip_bodies, _skip_step_correction
from ksd.solvers import joint_tables
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.touching import touching

pytestmark = pytest.mark.plain
INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT") == "1"
PACKAGE = Path(ksd.__file__).parent
RUN: dict[str, set[int]] = {}
"""Lines that were run, by file."""
CHAIN = ksd.Mesh("corotational", elements=3)


@pytest.fixture(autouse=True)
def run():
    """Notes, interpreted, which lines of the package are run."""

    def note(frame, event, _):
        name = frame.f_code.co_filename
        if not name.startswith(str(PACKAGE)):
            return None
        lines = RUN.setdefault(name, set())

        def line(frame, event, _):
            if event == "line":
                lines.add(frame.f_lineno)
            return line

        return line

    before = sys.gettrace()
    if INTERPRETED:
        sys.settrace(note)
    # compiled code divides by zero in silence; what comes of it is looked at where it matters
    with np.errstate(all="ignore"):
        yield
    sys.settrace(before)


def blade(*, thickness=0.5e-3, load=(), chain=False):
    """One leaf along x, loaded at its end."""
    scene = ksd.Mechanism("blade")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(thickness, 0.02), material=STEEL,
        width_axis="z", name="blade",
    )  # fmt: skip
    for options in load:
        scene.load(tip, at=(0.1, 0, 0), **options)
    return scene, compile_scene(scene, mesh=CHAIN if chain else None)


@pytest.mark.parametrize("method", ["conventional", "kinematic", "reduced", "full"])
def test_methods(method):
    pose = ksd.solve(fourbar(), {"top": 0.05}, method=method)
    assert pose.forces["top"] == pytest.approx(30.19, rel=3e-2 if method == "kinematic" else 2e-3)


def test_chains_in_plane_and_space():
    model = compile_scene(single_joint(), mesh=CHAIN)
    one, other = (solve_conventional(model, {"turn": 0.2}, planar=p) for p in (True, False))
    assert one.forces["turn"] == pytest.approx(other.forces["turn"], rel=1e-8)
    ksd.solve(single_joint(), {"turn": 0.2}, method="reduced", mesh=CHAIN)


@pytest.mark.parametrize("chain", [False, True], ids=["modes", "chain"])
def test_weight_and_loads_of_every_kind(chain):
    loads = ({"force": (0, 0.05, 0.01)}, {"force": (0, 0.02, 0), "moment": (0, 0, 1e-3), "following": True})
    scene, _ = blade(load=loads)
    scene.gravity = (0, -9.81, 0)
    model = compile_scene(scene, mesh=CHAIN if chain else None, with_="gravity")
    assert solve_conventional(model, {}, planar=False).converged
    scene, _ = blade()
    scene.gravity = (0, -9.81, 0)
    model = compile_scene(scene, mesh=CHAIN if chain else None, with_="gravity")
    one, other = (solve_conventional(model, {}, planar=p).motion.x[1] for p in (True, False))
    assert one == pytest.approx(other, abs=1e-12)


def test_springs_and_constraints_of_every_kind():
    scene, _ = blade(load=({"force": (0, 0.05, 0)},))
    scene.spring("ground", "tip", start=(0.1, -0.1, 0), end=(0.1, 0, 0), stiffness=10.0, free_length=0.08)
    scene.turn_spring("ground", "tip", at=(0.1, 0, 0), axis="z", stiffness=1e-2)
    scene.support("tip", about="x")
    assert solve_conventional(compile_scene(scene), {}, planar=False).converged


def test_plates():
    scene, _ = blade(load=({"force": (0, 0.05, 0)},))
    scene.consider("plate")
    model = compile_scene(scene)
    one, other = (solve_conventional(model, {}, planar=p).motion.x[1] for p in (True, False))
    assert one == pytest.approx(other, abs=1e-12)


def test_a_chain_of_leaf_springs_is_carried_along():
    scene, count = ksd.Mechanism("chain"), 9
    links = [scene.ground, *scene.links(*(f"p{k}" for k in range(count)))]
    for k in range(count):
        scene.leaf(
            links[k], links[k + 1], start=(0.02 * k, 0, 0), end=(0.02 * (k + 1), 0, 0), material=STEEL,
            section=ksd.rectangle(0.5e-3, 0.02), width_axis="z",
        )  # fmt: skip
    scene.load(links[-1], force=(0, 1.0, 0), at=(0.02 * count, 0, 0))
    pose = ksd.solve(scene)
    assert pose.converged and pose.rotation(links[-1])[2] > 0.0


def test_leaves_curved_at_rest():
    scene = ksd.Mechanism("arc")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(0.5e-3, 0.02), material=STEEL,
        width_axis="z", curve=ksd.Arc(radius=0.05 / np.sin(0.15), angle=0.3), name="arc",
    )  # fmt: skip
    scene.load(tip, force=(0, 0.05, 0), at=(0.1, 0, 0))
    assert ksd.solve(scene).converged


@pytest.mark.parametrize("chain", [False, True], ids=["modes", "chain"])
def test_questions(chain):
    scene = fourbar()
    scene.mass("top", mass=0.3, at=(0, 0.4, 0), inertia=1e-3 * np.eye(3))
    pose = ksd.solve(scene, {"top": 0.05}, method="conventional", mesh=CHAIN if chain else None)
    pose.stiffness("top", at=(0, 0.4, 0))
    pose.stress()
    pose.section_forces()
    pose.strain_energy()
    pose.buckling("top", force=(0, -1.0, 0), at=(0, 0.4, 0))
    pose.frequencies()


def test_verification_of_a_taut_leaf_and_of_a_heavy_one():
    taut = ksd.solve(
        guided_leaf(100, taut=True), {"drive": 0.002}, mesh=CHAIN, method="conventional", strict=False
    )
    assert not taut.verify().unclosed
    scene = single_joint()
    scene.gravity = (0, -9.81, 0)
    assert not ksd.solve(scene, {"turn": 0.1}, method="conventional", mesh=CHAIN).verify().unclosed


def test_verification_of_a_curved_leaf():
    scene = ksd.Mechanism("finger", plane="xy")
    tip, end = scene.link("tip"), (0.02 * np.sin(1.0), 0.02 * (1.0 - np.cos(1.0)), 0.0)
    words = {"section": ksd.rectangle(5e-4, 5e-3), "material": ksd.Material(E=2e9, nu=0.3)}
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=end, curve=ksd.Arc(radius=0.02, angle=1.0), **words)
    scene.load(tip, force=(0, 0.01, 0), at=end)
    assert not ksd.solve(scene).verify().unclosed


@pytest.mark.parametrize("plane", ["xy", None])
def test_motions(plane):
    steel = ksd.Material(E=200e9, nu=0.3, density=7800, loss_factor=0.01)
    joint = ksd.ParallelGuide(steel, length=0.1, thickness=0.5e-3, width=0.03, spacing=0.06)
    scene = ksd.Mechanism("guide", plane=plane)
    stage = scene.link("stage", mass=0.5, inertia=(4e-4, 4e-4, 4e-4), at=(0.1, 0, 0))
    scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.load(stage, force=(0, 5, 0), at=(0.1, 0, 0), name="push")
    scene.damper(scene.ground, stage, damping=2.0, along="y", at=(0.1, 0, 0))
    scene.gravity = (0, -9.81, 0)
    found = ksd.simulate(scene, until=4e-3, dt=1e-3, loads={"push": ksd.Ramp(2e-3)}, damping_at=10.0)
    assert found.stop is None and found.energy.kinetic[-1] > 0


def test_batches(monkeypatch):
    monkeypatch.setattr(joint_tables, "INITIAL_PIECES", 8)
    monkeypatch.setattr(joint_tables, "MAX_PIECES", 8)
    turns = {"turn": np.linspace(0.2, 0.25, 4)}
    one, other = (ksd.batch(single_joint(), turns, tabulated=t) for t in (False, True))
    assert one.forces["turn"] == pytest.approx(other.forces["turn"], rel=0.01)


def test_weight_of_condensed_joints():
    scene = single_joint()
    scene.gravity = (0, -9.81, 0)
    assert ksd.solve(scene, {"turn": 0.1}, method="reduced").converged


def test_joints_that_move_out_of_their_plane():
    """Pose and its derivative from polynomials of all six numbers, against differences."""
    coefficient, at = np.random.default_rng(1).normal(size=6 * 3) * 0.2, 0.3

    def place(t):
        series, put = np.array([[1.0, t, t * t], [0.0, 1.0, 2.0 * t], [0.0, 0.0, 0.0]]), np.zeros((1, 24))
        pose_from_polynomials(coefficient, 0, 3, 0.1, series, 3, 1, np.empty((3, 6)), put, 0)
        return put[0]

    change = (place(at + 1e-6) - place(at - 1e-6)) / 2e-6
    assert place(at)[12:15] == pytest.approx(change[9:12], abs=1e-8)


@pytest.mark.parametrize("planar", [True, False])
def test_pressure(planar):
    scene, _ = blade()
    scene.pressure("blade", 200.0, name="air")
    model = compile_scene(scene)
    assert solve_conventional(model, {}, planar=planar).motion.x[1, 1] != 0.0


SQUARE = ((-6e-3, -6e-3), (6e-3, -5e-3), (5e-3, 6e-3), (-5e-3, 5e-3))
CONTACTS = {
    "polygon on disc": ("xy", lambda: ksd.shapes.disc(4e-3), lambda: ksd.shapes.polygon(SQUARE)),
    "ellipse on disc": ("xy", lambda: ksd.shapes.disc(4e-3), lambda: ksd.shapes.ellipse(8e-3, 5e-3)),
    "ellipse on wall": ("xy", ksd.shapes.wall, lambda: ksd.shapes.ellipse(8e-3, 5e-3)),
    "polygon on wall": ("xy", ksd.shapes.wall, lambda: ksd.shapes.polygon(SQUARE)),
    "ball on wall": (None, ksd.shapes.wall, lambda: ksd.shapes.ball(5e-3)),
}


def pressed(which):
    """A shape on the tip of a strip under one that is driven down, with friction."""
    plane, below, above = CONTACTS[which]
    scene = ksd.Mechanism("strip", plane=plane)
    tip, held = scene.links("tip", "held")
    section = ksd.rectangle(0.5e-3, 0.02)
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL)
    for along in "xy":
        scene.actuate(held, along=along, at=(0.1, 0.02, 0), name=along)
    for about in "z" if plane else "xyz":
        scene.support(held, about=about)
    if plane is None:
        scene.support(held, along="z", at=(0.1, 0.02, 0))
    a = scene.surface(tip, below(), at=(0.1, 0, 0), axis="y" if below is ksd.shapes.wall else None)
    b = scene.surface(held, above(), at=(0.1, 0.02, 0))
    scene.contact(a, b, friction=0.3, name="c")
    return scene


@pytest.mark.parametrize("which", CONTACTS)
def test_contact(which):
    """A shape on the tip of a strip under one that is driven down, with friction."""
    pose = ksd.solve(pressed(which), x=0.0, y=-0.017)
    assert sum(pair.N for pair in pose.contacts.values()) > 0.0


@pytest.mark.parametrize(("plane", "shape"), [(None, ("ball", 0.02)), ("xy", ("ellipse", 0.03, 0.02))])
def test_contact_along_a_leaf(plane, shape):
    scene = ksd.Mechanism("strip", plane=plane)
    tip, held = scene.links("tip", "held")
    section, at = ksd.rectangle(0.5e-3, 0.02), (0.06, 0.02025, 0)
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL, name="leaf")
    for along in "xy" if plane else "xyz":
        scene.actuate(held, along=along, at=at, name=along)
    for about in "z" if plane else "xyz":
        scene.support(held, about=about)
    scene.contact("leaf", scene.surface(held, getattr(ksd.shapes, shape[0])(*shape[1:]), at=at), name="c")
    pose = ksd.solve(scene, {"x": 0.0, "y": -0.005} | ({} if plane else {"z": 0.0}))
    assert pose.contacts["c"].N > 0.0


def test_sweeps_end_where_newton_does():
    """A start for problems that others do not solve, here on one that they do: the tip moved up into a polygon."""
    what = touching(model := compile_scene(pressed("polygon on wall"), one_sided=True))
    poses, count = (model.rest.x[what.nodes], model.rest.R[what.nodes]), len(what.pairs)
    e0, C, rho = np.array([2e-3, 0.018, 0.0]), np.diag([1e-3, 1e-3, 10.0]), np.full(count, 500.0)
    out, w, ends = np.zeros((count, WRENCH + 36)), np.zeros(3), []
    words = (
        what.pairs,
        what.data,
        what.bodies,
        np.where(what.nodes == 1, 0, -1),
        np.array([0, 1, 5]),
        *poses,
        *poses,
        e0,
        C,
    )
    for sweeps in (False, True):
        y = np.zeros(unknown_count(what.pairs, 3))
        if sweeps:
            moved = [np.empty_like(a) for a in poses]
            _sweep(*words, rho, y, out, *moved, w, np.zeros((count, 3)))
        else:
            assert solve_complementarity(*words, np.zeros(3), rho, 0.1, y, out, w)[0]
        ends.append(y)
    assert (ends[0][3:] > 1.0).any()
    assert ends[1] == pytest.approx(ends[0], rel=1e-4, abs=1e-7)


def test_a_stop_and_a_cable():
    scene, _ = blade(load=({"force": (0, 5.0, 0)},))
    scene.stop("tip", along="y", at=(0.1, 0, 0), high=2e-3, name="end")
    scene.cable("ground", "tip", start=(0.1, -0.05, 0), end=(0.1, 0, 0), length=0.0515, name="tie")
    pose = ksd.solve(scene)
    assert pose.cables["tie"].force > 0.0 == pose.stops["end.high"].force


def test_modal_bodies():
    for basis in (ModalBasis(elements=3), ModalBasis(coordinates="angle", derivatives="tied", elements=3)):
        _, model = blade(load=({"force": (0, 0.05, 0)},), chain=True)
        assert solve_conventional(with_modal_bodies(model, basis), {}, planar=False).converged


def test_solids():
    scene, _ = blade(thickness=0.01, load=({"force": (0, 20.0, 0)},))
    scene.support("tip", along="z", at=(0.1, 0, 0))
    scene.support("tip", about="x")
    scene.support("tip", about="y")
    solid = reduce_solid(block(STEEL, 0.1, 0.01, width=0.02, cells=(4, 1)), order=2)
    assert ksd.solve(scene, basis={"blade": solid}, strict=False).converged


def test_without_weight_or_inertia_nothing_happens():
    for skip in (
        skip_set_gravity, skip_add_weight, skip_planar_loads, skip_spatial_loads, skip_rotate_gravity, _skip_bodies,
        _skip_step_correction,
    ):  # fmt: skip
        words = len(inspect.signature(getattr(skip, "py_func", skip)).parameters)
        assert skip(*[None] * words) in (None, (0, 0.0, 0.0, 0))


def kernels():
    """Every kernel of the package: its file, its name, and the lines of it that can be run."""
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text()
        named = {
            node.name
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.FunctionDef)
            and any("kernel" in ast.unparse(d) for d in node.decorator_list)
        }
        for code in compile(text, str(path), "exec").co_consts:
            if isinstance(code, CodeType) and code.co_name in named:
                lines = {line for _, _, line in code.co_lines() if line and line > code.co_firstlineno}
                yield str(path), code.co_name, lines - {code.co_firstlineno}


@pytest.mark.skipif(not INTERPRETED, reason="compiled: set NUMBA_DISABLE_JIT=1")
def test_every_kernel_was_entered(capsys):
    """The last test: those before it leave none out, and few lines."""
    left, lines, missed = [], 0, {}
    for file, name, own in kernels():
        run, short = own & RUN.get(file, set()), str(Path(file).relative_to(PACKAGE))
        if own and not run:
            left.append(f"{short}: {name}")
        lines += len(own)
        missed[short] = missed.get(short, 0) + len(own - run)
    share = 1 - sum(missed.values()) / lines
    with capsys.disabled():
        most = sorted(missed.items(), key=lambda item: -item[1])[:5]
        print(f"\n{share:.1%} of {lines} lines of kernels were run; most are left in {dict(most)}")
    assert not left, "\n".join(left)
    assert share > 0.9
