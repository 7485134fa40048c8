"""`ksd.batch`: forces and poses of very many configurations and designs by the fast methods, in threads.

What `ksd.sweep` answers with every question, this does with numbers alone: one compiled call for all poses of a design, the
interpreter released, designs in parallel threads. Nothing fails silently: every configuration has a status.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.errors import KsdError, SceneError
from ksd.model.mesh import Mesh
from ksd.model.plane import Plane, plane_of
from ksd.solve.choose import Solver
from ksd.solve.driving import CAP, RTOL
from ksd.solve.five import FiveSteps
from ksd.solve.many import SPOKEN, planar_many, space_many, tabulated_many
from ksd.solve.planar_steps import GAP, PlanarSteps
from ksd.solve.space_steps import FULL, REDUCED
from ksd.solve.stops import Stop
from ksd.solve.tables import joint_tables

NOT_BUILT = 20
"""Status of all poses of a design that could not be prepared."""
_WAYS = np.array([RTOL, CAP, GAP])


@dataclass(frozen=True)
class Batch:
    """D designs at N poses: what was found, and what was not.

    forces: drive force or moment by drive name (D, N) [N, Nm]; positions (D, N, links, 3) [m] and rotations (D, N, links,
    3, 3) of the links' reference points, in the order of `links`; motions: intended motion by joint (D, N) [rad, m];
    status (D, N): 0 where solved, else see `failures`; nan stands where it is not 0. errors (D,): interpolation error of
    tabulated joints, nan without. reasons: of designs that could not be prepared, by number.
    """

    links: tuple[str, ...]
    forces: dict[str, np.ndarray]
    positions: np.ndarray
    rotations: np.ndarray
    motions: dict[str, np.ndarray]
    status: np.ndarray
    errors: np.ndarray
    reasons: dict[int, str]

    @property
    def solved(self) -> int:
        """How many configurations were solved."""
        return int(np.sum(self.status == 0))

    @property
    def failures(self) -> list[tuple[int, int, str]]:
        """(design, pose, why) of every configuration that was not solved."""
        return [(int(d), int(n), self.why(d, n)) for d, n in np.argwhere(self.status != 0)]

    def why(self, design: int, pose: int) -> str:
        """The status of one configuration in words."""
        code = int(self.status[design, pose])
        if code == NOT_BUILT:
            return self.reasons[int(design)]
        return SPOKEN[code] if code in SPOKEN else Stop(code).sentence

    def __str__(self) -> str:
        total = self.status.size
        lines = [f"{self.solved} of {total} configurations solved"]
        codes, first, counts = np.unique(self.status, return_index=True, return_counts=True)
        for code, at, count in zip(codes, first, counts, strict=True):
            if code != 0:
                design, pose = divmod(int(at), self.status.shape[1])
                lines.append(
                    f"{count} not, the first at design {design}, pose {pose}: {self.why(design, pose)}"
                )
        return "\n".join(lines)


def batch(
    mechanism: Any,
    targets: Mapping[str, Any] | None = None,
    *,
    designs: Sequence[Mapping[str, Any]] | None = None,
    method: str = "reduced",
    passes: int = 0,
    tabulated: bool = False,
    mesh: Mesh | None = None,
    extrapolate: bool = False,
    planar: bool = True,
    threads: int | None = None,
    **drives: Any,
) -> Batch:
    """Solve every design at every pose by `method` "reduced" or "full", without error estimates; returns a `Batch`.

    mechanism: a Mechanism or Scene, or, with `designs` (a list of parameters by name), a function of those parameters that
    returns one. Drive values [m or rad] by name, numbers or arrays of one length. tabulated: take the condensed joints
    from tables over their stroke, made once per design; it pays from some hundred poses on. planar: False solves in
    space. threads: cores when None. In the plane stability is that in the plane. Raises SceneError for bad input; designs
    and poses that fail are in the result.
    """
    if method not in ("reduced", "full"):
        raise SceneError(f"method = {method!r}: a batch is solved by 'reduced' or 'full'")
    if tabulated and (method != "reduced" or passes):
        raise SceneError("tabulated = True: tabulated joints serve method='reduced' without passes")
    values = _poses({**(targets or {}), **drives})
    ways: dict[str, Any] = {
        "method": FULL if method == "full" else REDUCED,
        "passes": passes,
        "tabulated": tabulated,
    }
    more: dict[str, Any] = {"mesh": mesh, "extrapolate": extrapolate, "planar": planar and not tabulated}
    makers = _makers(mechanism, designs)

    def solve(maker: Callable[[], Any]) -> Any:
        try:
            return Prepared(Solver(maker(), **more), **ways)(values)
        except KsdError as reason:
            return reason

    # the first one alone, so that kernels are compiled once
    found = [solve(makers[0])]
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        found += pool.map(solve, makers[1:])
    return _together(found, len(next(iter(values.values()))))


def _poses(values: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Drive values as arrays of one length."""
    found = {n: np.atleast_1d(np.asarray(v, float)) for n, v in values.items()}
    if not found:
        raise SceneError("a batch needs drive values, for example top=np.linspace(0, 0.3, 31)")
    size = max(len(v) for v in found.values())
    for n, v in found.items():
        if v.ndim != 1 or len(v) not in (1, size) or not np.isfinite(v).all():
            raise SceneError(f"drive values {n}: give one finite number or {size} of them in a row")
    return {n: np.broadcast_to(v, size) for n, v in found.items()}


def _makers(mechanism: Any, designs: Any) -> list[Callable[[], Any]]:
    if designs is None:
        return [lambda: mechanism]
    if not callable(mechanism):
        raise SceneError("designs: mechanism must be a function of the parameters that returns a Mechanism")
    if not len(designs):
        raise SceneError("designs: give at least one set of parameters")
    return [lambda d=d: mechanism(**d) for d in designs]  # type: ignore[misc]


@dataclass
class _Found:
    """Numbers of one design."""

    links: tuple[str, ...]
    drives: tuple[str, ...]
    joints: tuple[str, ...]
    force: np.ndarray
    x: np.ndarray
    R: np.ndarray
    motion: np.ndarray
    status: np.ndarray
    error: float = np.nan


class Prepared:
    """One design prepared for batches: call it with drive values, arrays of one length by name."""

    def __init__(
        self, solver: Solver, *, method: int = REDUCED, passes: int = 0, tabulated: bool = False
    ) -> None:
        self.solver, self.five = solver, solver.five_steps
        self.method, self.passes = method, passes
        self.tables = joint_tables(self.five.bench.held, self.five.bench.bodies) if tabulated else None
        b = self.five.bench
        limits = np.column_stack([b.lowest, b.highest])
        self._limits = limits + (np.array([-np.inf, np.inf]) if solver.extrapolate else 0.0)

    def __call__(self, values: Mapping[str, np.ndarray]) -> _Found:
        """All poses, from rest each."""
        model, b = self.solver.model, self.five.bench
        model.targets({n: float(v[0]) for n, v in values.items()})
        count, rows = len(next(iter(values.values()))), len(model.drive_names) + len(model.support_names)
        targets = np.zeros((count, rows))
        for k, name in enumerate(model.drive_names):
            targets[:, k] = values[name]
        motion, status = np.zeros((count, len(b.theta))), np.zeros(count, np.int64)
        flat = None if self.tables else _balanced(self.five, values, targets)
        if flat is not None:
            ways = (self.method, self.passes, self._limits)
            force, x, R = _in_plane(self.five, flat, targets, ways, (motion, status))
        else:
            force, x, R = self._in_space(targets, motion, status)
        names = (model.scene.links, model.drive_names, b.bodies.motion_names)
        error = self.tables.error if self.tables else np.nan
        return _Found(*names, force, x, R, motion * b.bodies.motion_scale, status, error)

    def _in_space(
        self, targets: np.ndarray, motion: np.ndarray, status: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Forces (N, rows), positions and rotations of the links."""
        b, (count, rows) = self.five.bench, targets.shape
        links = len(self.solver.model.scene.links)
        force, x, R = np.zeros((count, rows)), np.zeros((count, links, 3)), np.zeros((count, links, 3, 3))
        put = (force, x, R, motion, status)
        if self.tables is None:
            space_many(b.held, targets, rows, self.method, self.passes, _WAYS, self._limits, *put)
        else:
            t = self.tables
            limits = np.column_stack([self._limits, t.limits])
            tabulated_many(b.held, t.cubic, t.which, targets, rows, _WAYS, limits, *put)
        return force, x, R


def _balanced(five: FiveSteps, values: Mapping[str, np.ndarray], targets: np.ndarray) -> PlanarSteps | None:
    """The planar five steps, if one pose shows that leafs and loads balance across the plane."""
    widest = int(np.argmax(np.abs(targets).sum(axis=1)))
    if isinstance(five.flat, PlanarSteps):
        with contextlib.suppress(KsdError):
            at = {n: float(v[widest]) for n, v in values.items()}
            five(at, targets[widest], method="reduced", passes=0, estimate=False)
    flat = five.flat
    return flat if isinstance(flat, PlanarSteps) and isinstance(plane_of(five.model), Plane) else None


def _in_plane(
    five: FiveSteps, flat: PlanarSteps, targets: np.ndarray, ways: tuple, put: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces (N, rows), positions and rotations of the links, from the planar solves."""
    method, passes, limits = ways
    lifting = plane_of(five.model).lifting  # type: ignore[union-attr]
    count, links = len(targets), len(five.model.scene.links)
    inside = np.ascontiguousarray(targets[:, lifting.row])
    force, pose = np.zeros((count, len(lifting.row))), np.zeros((count, links, 3))
    planar_many(flat.held, inside, len(lifting.row), method, passes, _WAYS, limits, force, pose, *put)
    all_rows = np.zeros(targets.shape)
    all_rows[:, lifting.row] = force
    i, j, k = lifting.axes.T
    x = pose[..., :1] * i + pose[..., 1:2] * j + lifting.height[:links, None] * k
    c, s = np.cos(pose[..., 2])[..., None, None], np.sin(pose[..., 2])[..., None, None]
    R = c * (np.outer(i, i) + np.outer(j, j)) + s * (np.outer(j, i) - np.outer(i, j)) + np.outer(k, k)
    return all_rows, x, R


def _together(found: list[Any], count: int) -> Batch:
    """One result of all designs; those that failed are nan."""
    good = [f for f in found if isinstance(f, _Found)]
    reasons = {d: str(f) for d, f in enumerate(found) if not isinstance(f, _Found)}
    if not good:
        raise SceneError(f"no design could be prepared; the first: {reasons[0]}")
    like = good[0]

    def stacked(field: str) -> np.ndarray:
        blank = np.full(getattr(like, field).shape, np.nan)
        parts = [getattr(f, field) if isinstance(f, _Found) else blank for f in found]
        return np.array(parts, float)

    status = np.array([f.status if isinstance(f, _Found) else np.full(count, NOT_BUILT) for f in found])
    numbers = {field: stacked(field) for field in ("force", "x", "R", "motion")}
    for array in numbers.values():
        array[status != 0] = np.nan
    force, motion = numbers["force"], numbers["motion"]
    return Batch(
        like.links,
        {n: force[:, :, k] for k, n in enumerate(like.drives)},
        numbers["x"],
        numbers["R"],
        {n: motion[:, :, k] for k, n in enumerate(like.joints)},
        status,
        np.array([f.error if isinstance(f, _Found) else np.nan for f in found]),
        reasons,
    )
