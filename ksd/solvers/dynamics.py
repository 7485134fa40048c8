"""Motion of a scene in time: its start, the size of its steps by accuracy, in the plane or in space."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from ksd.answers.frequencies import frequencies
from ksd.answers.printing import progress_bar
from ksd.errors import ConvergenceError, KinematicsError, SceneError
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model, compile_scene
from ksd.model.leaves import mass_density
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.newton import assemble
from ksd.model.plane import Plane
from ksd.numerics.kernel import announce_compiling
from ksd.scene.simulation import DEFAULT_ACCURACY, Simulation
from ksd.solvers.configuration import Configuration
from ksd.solvers.mass_at_ends import lowest_frequency_change, with_mass_at_ends
from ksd.solvers.motion import Motion, dense_matrix
from ksd.solvers.motion_record import trace_of_run
from ksd.solvers.motion_run import Marcher, Run, segments
from ksd.solvers.moving_model import HEAVY_LEAVES, MovingModel, moving_model, refuse_what_does_not_move
from ksd.solvers.solver import solve
from ksd.solvers.time_steps import SCALARS, Step, generalised_alpha
from ksd.solvers.trace import Trace, state_of_row, with_load_factors

STEPS_PER_RAMP, STEPS_PER_PERIOD = 20.0, 100.0
"""Steps in the shortest part of a function of time, and in the longest period, of the first pair of runs."""
SINGULAR_SIZE = 1e-14
"""Smallest singular value of the scaled tangent of a step below which something moves freely and without mass."""
MAX_PAIRS = 4
"""How often the step is made smaller for the accuracy."""
FINE_ORDERS = (5, 4, 8)
"""Orders of leaf springs that carry little but themselves."""


def trace_motion(scene: Any, words: Simulation, *, mesh: Mesh | None = None, progress: bool = True) -> Trace:
    """The motion of a frozen scene; words: checked; mesh: of the leaf springs, chosen when None.

    Raises SceneError for what cannot move in time.
    """
    marcher, dt, freed, notes = begin_motion(scene, words, mesh)
    run, error = _runs(marcher, dt, progress)
    if run.stop is not None and not run.at_event:
        still = Motion(marcher.moving, words, marcher.start, marcher.values)
        _refuse_free_motions(still, generalised_alpha(dt, words.rho))
    if _leaves_plane(marcher, run, freed):
        moving = _moving(marcher.moving.model, freed, words, spatial=True)
        marcher = Marcher(moving, words, marcher.start, marcher.values, freed)
        run, error = _runs(marcher, dt, progress)
    marcher.notes += notes
    return trace_of_run(marcher, run, error)


def begin_motion(
    scene: Any, words: Simulation, mesh: Mesh | None = None
) -> tuple[Marcher, float, tuple[str, ...], tuple[str, ...]]:
    """What marches from the start of a motion, the step [s] to begin with, the drives that are let go, and notes."""
    announce_compiling(
        "ksd.solvers.time_steps", "march", "the kernels of motion for this machine (once; one or two minutes)"
    )
    freed = tuple(n for n, f in words.drives.items() if f is None)
    grid, whole = DEFAULT_MESH if mesh is None else mesh, scene
    if words.mass_at_ends:
        scene = with_mass_at_ends(scene)
    if mesh is None and leaf_share(compile_scene(scene, mesh=grid)) > HEAVY_LEAVES:
        grid = replace(grid, orders=FINE_ORDERS, points=FINE_ORDERS[2] + 1)
    try:
        model, start, values, notes = _start(scene, words, grid)
    except ConvergenceError:
        model = compile_scene(scene, mesh=grid)
        still = Motion(_moving(model, freed, words), words, model.rest, dict.fromkeys(model.drive_names, 0.0))
        _refuse_free_motions(still, generalised_alpha(words.until, words.rho))
        raise
    moving = _moving(model, freed, words)
    if words.mass_at_ends:
        change = lowest_frequency_change(model, compile_scene(whole, mesh=model.mesh), start, freed)
        if abs(change) > (words.accuracy or DEFAULT_ACCURACY):
            notes += (
                f"with the mass of leaf springs at their ends the lowest frequency is {100.0 * change:+.2g} % off at the "
                "start; simulate without mass_at_ends where that counts",
            )
    if _starts_out_of_plane(moving, start, words):
        moving = _moving(model, freed, words, spatial=True)
    dt = words.dt or _first_step(moving, start, words, freed)
    marcher = Marcher(moving, words, start, values, freed)
    return marcher, dt, freed, notes


def _start(
    scene: Any, words: Simulation, mesh: Mesh
) -> tuple[Model, State, dict[str, float], tuple[str, ...]]:
    """Model, state and drive values at the start of a motion, and notes."""
    names = [d.name for d in scene.drives]
    values = {n: 0.0 if words.drives.get(n) is None else float(words.drives[n](0.0)) for n in names}
    if isinstance(words.start, Configuration):
        pose = words.start
        own = getattr(pose, "moving", None) or pose.model
        refuse_what_does_not_move(own)
        if list(own.drive_names) != names or own.original_scene.links != scene.links:
            raise SceneError(
                "simulate: start is a pose of another mechanism, with other links or drives; give one of this mechanism"
            )
        values |= {n: pose.targets[n] for n in names if words.drives.get(n) is None}
        if words.mass_at_ends:
            own = compile_scene(with_mass_at_ends(own.original_scene), mesh=own.mesh)
        return own, pose.motion, values, ()
    model = compile_scene(scene, mesh=mesh)
    if words.start == "undeformed":
        return model, model.rest, values, ()
    still = with_load_factors(scene, {name: f.before(0.0) for name, f in words.loads.items()})
    moved = tuple(load for load in still.loads if any(load.force) or any(load.moment))
    still = replace(still, loads=moved)
    is_pushed = moved or any(
        any((*line.force, *line.end_force, *line.moment, *line.end_moment)) for line in still.line_loads
    )
    if not any(values.values()) and not is_pushed and (scene.gravity is None or not any(scene.gravity)):
        work = make_workspace(model.arrays)
        if assemble(model.arrays, model.rest.copy(), model.targets(values), 0.0, work)[0] <= 1.0:
            return model, model.rest, values, ()
    found = solve(still, values, method="conventional", mesh=mesh, estimate=False, strict=False)
    notes = () if found.stable else ("it starts from an equilibrium that is not stable",)
    return model, found.motion, values, notes


def _first_step(moving: MovingModel, start: State, words: Simulation, freed: Iterable[str]) -> float:
    """The step [s] of the finer of the first pair of runs."""
    ramp = words.shortest / STEPS_PER_RAMP
    try:
        found = frequencies(moving.model, start, count=3, freed=tuple(freed)).frequency_Hz
    except (SceneError, KinematicsError):
        found = np.zeros(0)
    longest = float((1.0 / found[found > 0.0]).max(initial=0.0)) or math.inf
    return min(ramp, longest / STEPS_PER_PERIOD, words.until / STEPS_PER_PERIOD)


def leaf_share(model: Model) -> float:
    """Share of the leaf springs in the mass that moves."""
    own = sum(
        float(mass_density(leaf)) * leaf.section.A * leaf.length for leaf in model.scene.leaf_names().values()
    )
    rigid = sum(m.mass for m in model.scene.masses if m.link != model.scene.links[0])
    return own / (own + rigid) if own > 0.0 else 0.0


def _moving(model: Model, freed: Iterable[str], words: Simulation, *, spatial: bool = False) -> MovingModel:
    released = words.release is not None
    return moving_model(
        model, tuple(freed), damping_at=words.damping_at, is_released=released, spatial=spatial
    )


def _refuse_free_motions(motion: Motion, step: Step) -> None:
    """Raise SceneError where a link can move with neither mass nor stiffness against it, under the loads before t = 0."""
    arrays = motion.arrays
    factors = motion.load_factors(np.zeros(1), before=True)[0, : len(motion.loads[0]), None]
    arrays.loads.force[:], arrays.loads.moment[:] = (factors * part for part in motion.loads)
    motion.assemble(step.c0, step.c1)
    matrix = dense_matrix(arrays.plan, motion.work.matrix)
    scale = 1.0 / np.sqrt(np.linalg.norm(matrix, axis=1).clip(1e-300))
    _, sizes, motions = np.linalg.svd(scale[:, None] * matrix * scale)
    if sizes[-1] > SINGULAR_SIZE:
        return
    free = scale * motions[-1]
    found = (0.0, "", "")
    for k, name in enumerate(motion.moving.model.node_names):
        for r, dof in enumerate(arrays.active_dofs.tolist() if arrays.start[k] >= 0 else ()):
            size = abs(free[arrays.start[k] + r]) * (1.0 if dof < 3 else arrays.size)
            found = max(found, (size, name, f"{'along' if dof < 3 else 'about'} {'xyz'[dof % 3]}"))
    raise SceneError(
        f"simulate: link '{found[1]}' is free to move {found[2]} and has no mass against it: give it a mass and an inertia, "
        "or hold it by a support, a drive or a spring"
    )


def _runs(marcher: Marcher, dt: float, progress: bool) -> tuple[Run, float]:
    """The run of the step that was given, or of one small enough for the accuracy, and its estimated error."""
    moving, words = marcher.moving, marcher.words
    steps = sum(n for _, _, n in segments(words, marcher.kicks, dt))
    numbers = sum(f.size for f in moving.rest) + 24 * len(moving.rest.x) + SCALARS
    words.check_memory(steps, numbers=numbers)
    links = np.array(list(range(1, moving.model.links)) or [0])
    with progress_bar(progress) as bar:
        task = bar.add_task("motion", total=steps if words.dt else 1.5 * steps)

        def advance(done: float) -> None:
            bar.advance(task, done)

        if words.dt is not None:
            return marcher.run(words.dt, 1, advance), math.nan
        # the step of the coarser run of a pair, divided by whole numbers, so that instants agree
        whole, finer = 2.0 * dt, 1
        run, error, made = marcher.run(whole, 1, advance), math.inf, 1
        expected = 0.5 * steps
        for _ in range(MAX_PAIRS):
            if run.stop is not None and not run.at_event:
                finer = 2 * made
            elif made > 1 and error <= words.accuracy:
                break
            else:
                wanted = 2 if made == 1 else math.ceil(math.sqrt(error / (0.8 * words.accuracy)))
                finer = made * min(max(wanted, 2), 8)
            try:
                words.check_memory(finer * steps // 2, numbers=numbers)
            except SceneError as reason:
                marcher.notes.append(str(reason))
                break
            expected += 0.5 * finer * steps
            bar.update(task, total=expected)
            other = marcher.run(whole, finer, advance)
            if run.stop is not None and run.stop.startswith("interrupted"):
                break
            error = _difference(other, run, (finer / made) ** 2, links)
            run, made = other, finer
            if run.stop is not None and run.stop.startswith("interrupted"):
                break
        if error > words.accuracy:
            marcher.notes.append(
                f"the estimated error of {error:.2g} of the largest stroke is above the accuracy of {words.accuracy:g}; "
                "motion that is chaotic is not followed for long with any step"
            )
        return run, error


def _difference(fine: Run, coarse: Run, ratio: float, links: NDArray[np.int64]) -> float:
    """Estimated error of the places of `links` in the finer of two runs, relative to the largest stroke.

    ratio: of the errors of both runs, where they follow the motion.
    """
    rows, others = fine.all, coarse.all
    t, own, other = np.intersect1d(np.round(rows.t, 12), np.round(others.t, 12), return_indices=True)
    places = [r.states[:, : 3 * (links[-1] + 1)].reshape(len(r.t), -1, 3)[:, links] for r in (rows, others)]
    stroke = np.linalg.norm(places[0] - places[0][:1], axis=2).max(initial=0.0)
    if stroke == 0.0 or len(t) < 2:
        return 0.0
    off = places[0][own] - places[1][other]
    off = error_of_finer(off.reshape(len(t), -1), t, ratio).reshape(off.shape)
    return float(np.linalg.norm(off, axis=2).max() / stroke)


def error_of_finer(off: NDArray[np.float64], t: NDArray[np.float64], ratio: float) -> NDArray[np.float64]:
    """Errors (k, c) of the finer of two runs at even instants, by differences (k, c) from the coarser at instants t (k,).

    ratio: of both errors, where both follow the motion; 1/(ratio - 1) of the difference is then left in the finer run.
    Steps h make a vibration late by a phase of w t (w h)^2/12, of which the mean over the run is taken. Where that of the
    coarser is half a turn and more, the difference tells the size of the vibration alone, and all of it may be left.
    """
    count, span = len(t), float(t[-1] - t[0])
    even = np.linspace(t[0], t[-1], count)
    parts = dct(np.column_stack([np.interp(even, t, one) for one in off.T]), axis=0, norm="ortho")
    w = np.pi * np.arange(count).clip(1) / span
    late = 0.5 * span * w * (w * span / (count - 1)) ** 2 / 12.0
    left = _apart(late / ratio) / _apart(late * (1.0 - 1.0 / ratio))
    return np.asarray(idct(parts * left[:, None], axis=0, norm="ortho"))


def _apart(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest difference of two vibrations of size 1 that are apart by up to a phase."""
    return 2.0 * np.sin(0.5 * phase.clip(max=np.pi))


def _starts_out_of_plane(moving: MovingModel, start: State, words: Simulation) -> bool:
    """Whether the start, its speeds or the base are not in the plane of a planar model."""
    if moving.plane is None:
        return False
    k = moving.plane.normal
    speeds = [np.asarray(v, float) for v in words.speeds.values()]
    across = [v[:3] @ k for v in speeds] + [v[3:] @ k * k - v[3:] for v in speeds]
    if words.base is not None:
        across.append(np.asarray(words.base.along) @ k)
    return not moving.plane.contains(start) or any(np.any(np.abs(a) > 0.0) for a in across)


def _leaves_plane(marcher: Marcher, run: Run, freed: tuple[str, ...]) -> bool:
    """Whether forces out of the plane do not balance at some instants of a planar motion, found by the residual in space."""
    flat, rows = marcher.moving, run.all
    plane = flat.plane
    if plane is None or len(rows.t) < 2:
        return False
    moving = _moving(flat.model, freed, marcher.words, spatial=True)
    space = Plane(moving.arrays, moving.rest, plane.axis, plane.rows)
    nodes = len(moving.rest.x)
    strongest = int(np.argmax(np.abs(rows.accelerations[1:, :]).max(axis=1))) + 1
    for i in sorted({1, strongest, len(rows.t) - 1}):
        other = Motion(moving, marcher.words, flat.model.rest, marcher.values)
        state = state_of_row(rows.states[i], flat.rest)
        static = State(state.x, state.R, state.inner[flat.inner], state.multiplier[: len(flat.model.arrays.terms.start)],
                       flat.model.rest.angle)  # fmt: skip
        other.state.assign(moving.moving_state(static))
        for m in np.flatnonzero(moving.modes[:, 1]).tolist():
            own = moving.arrays.members.inner_at[m] + int(moving.arrays.members.number[m, :3].sum()) + 6
            at = flat.arrays.members.inner_at[m] + int(flat.arrays.members.number[m, 3]) + 6
            count = 3 * int(flat.modes[m, 0])
            other.state.inner[own : own + count] = state.inner[at : at + count]
        q = np.empty_like(other.q)
        other.read_places(q)
        gravity = other.gravities(rows.t[i : i + 1])[0]
        for m in np.flatnonzero(moving.modes[:, 1]).tolist():
            own = moving.arrays.members.inner_at[m] + int(moving.arrays.members.number[m, :3].sum()) + 6
            size = 3 * int(moving.modes[m, 1])
            at = 12 * nodes + 3 * int(moving.modes[:m, 1].sum())
            other.state.inner[own + size : own + 2 * size] = (
                q[at : at + size] + other.state.inner[own : own + size]
            )
        other.arrays.known[:] = (q[: 12 * nodes] - rows.accelerations[i]).reshape(nodes, 12)
        other.arrays.known[:, :3] += gravity
        factors = other.load_factors(rows.t[i : i + 1])[0, : len(other.loads[0]), None]
        other.arrays.loads.force[:], other.arrays.loads.moment[:] = (factors * part for part in other.loads)
        other.assemble()
        if space.imbalance(other.work)[0] > 1.0:
            return True
    return False
