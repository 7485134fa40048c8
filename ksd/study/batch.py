"""`ksd.batch`: forces, poses and answers of very many configurations and designs by the fast methods, in threads.

Questions and columns are those of `ksd.sweep`, the answers are arrays. Designs whose scenes differ in numbers only share a
template (`ksd.model.template`), and all poses of each design are solved in the same storage, designs in parallel threads.
Every configuration has a status; none fails silently.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.plant import Damping
from ksd.answers.printing import PrintableAnswer
from ksd.checks import boolean, clear_argument_errors, similar_name_hint, whole_number
from ksd.errors import SceneError
from ksd.model.mesh import Mesh
from ksd.numerics.threads import small_matrices
from ksd.scene.link import Link
from ksd.scene.obstacle import has_contacts
from ksd.solvers.pose_batch import REFUSED, UNANSWERED
from ksd.solvers.random_vibration import Spectrum
from ksd.study.arguments import check_drives, check_executor, check_solve_options, drive_value_arrays
from ksd.study.batch_solver import BatchSolver, scene_factories
from ksd.study.design_scene import (
    CANNOT_BE_BUILT,
    DesignsLike,
    MechanismLike,
    build_scene,
    design_parameters,
    scene_or_reason,
)
from ksd.study.prepared_design import DesignResult, status_sentence
from ksd.study.questions import Row, parse_questions
from ksd.study.sweep_path import Recipe, SweepPath, adequate_mesh

NOT_BUILT = 20
"""Status of all poses of a design that could not be prepared."""
DIFFERENT_LAYOUT = (
    "it has other links, drives or joints than the first design, or in another order: "
    "ksd.sweep takes such designs"
)
"""Why a design is not solved together with the others."""


@dataclass(frozen=True, repr=False)
class Batch(PrintableAnswer):
    """Results of D designs at N poses.

    forces: drive force or moment by drive name (D, N) [N, Nm]; positions (D, N, links, 3) [m] and rotations (D, N, links,
    3, 3) of the links' reference points, in the order of `links`; motions: intended motion by joint (D, N) [rad, m]; status
    (D, N): 0 where solved, else see `failures`; numbers are nan where it is not 0 (with strict=False, refused poses have
    theirs). errors (D,): interpolation error of tabulated joints, nan without. reasons: by design number for designs that
    could not be prepared, by design and pose for poses that `ksd.solve` would refuse (its sentence), or with a question
    that was not answered. answers: of the questions, by column as in `ksd.sweep`, (D, N) each; text where the column is
    one. compliance (D, N, 6, 6): motion [m, rad] of the point of the questions per unit force and moment [N, Nm] on it,
    global axes (`PointStiffness`); None without the question "support_stiffness".

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> pivot = ksd.Mechanism.of_joint(ksd.CrossedPivot(
    ...     steel, length=50 * mm, angle=45 * deg, thickness=0.3 * mm, width=15 * mm
    ... ))
    >>> found = ksd.batch(pivot, angle=[10 * deg, 20 * deg])
    >>> found.status, found.forces["angle"].round(4)
    (array([[0, 0]]), array([[0.0474, 0.0961]]))
    """

    links: tuple[str, ...]
    forces: dict[str, np.ndarray]
    positions: np.ndarray
    rotations: np.ndarray
    motions: dict[str, np.ndarray]
    status: np.ndarray
    errors: np.ndarray
    reasons: dict[int | tuple[int, int], str]
    answers: dict[str, np.ndarray]
    compliance: np.ndarray | None = None

    def __getitem__(self, column: str) -> np.ndarray:
        """One column of the answers (D, N). SceneError names those there are."""
        if column not in self.answers:
            none = "none: ask with questions=(...)" if self.solved else "none, as nothing was solved"
            known = ", ".join(self.answers) or none
            raise SceneError(
                f"there is no answer '{column}'; there are {known}{similar_name_hint(column, self.answers)}"
            )
        return self.answers[column]

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
        return self.reasons.get((int(design), int(pose))) or status_sentence(code)

    def _line(self) -> str:
        designs, poses = self.status.shape
        return f"designs: {designs}, poses: {poses}, solved: {self.solved} of {self.status.size}"

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


@clear_argument_errors
@small_matrices
def batch(
    mechanism: MechanismLike,
    targets: Mapping[str, ArrayLike] | None = None,
    *,
    designs: DesignsLike | None = None,
    method: Literal["reduced", "full"] | None = None,
    relinearisations: int = 0,
    tabulated: bool = False,
    questions: str | Iterable[str] = (),
    link: Link | str | None = None,
    at: ArrayLike | None = None,
    along: ArrayLike | str | None = None,
    freed: str | Iterable[str] | None = None,
    modes: int = 3,
    psd: Mapping[str, Spectrum] | None = None,
    damping: Damping | None = None,
    mesh: Mesh | None = None,
    extrapolate: bool = False,
    strict: bool = True,
    threads: int | None = None,
    executor: Executor | None = None,
    **drives: ArrayLike,
) -> Batch:
    """Solve every design at every pose by `method`, without error estimates; returns a `Batch`.

    mechanism: a Mechanism or Scene, or, with `designs` (parameters by name, as in `ksd.sweep`), a function of those
    parameters that returns one. Drive values [m or rad] by name, numbers or arrays of one length. method: "reduced" or
    "full"; when None "reduced", but with stops, cables or contacts every pose as by `ksd.prepare` without a method, and
    where only these differ between designs that follow each other, from one preparation. tabulated: take the
    condensed joints from tables over their stroke, made once per design; it pays from some hundred poses on. questions,
    link, at, along, freed, modes, psd, damping: as in `ksd.sweep`, answered in `Batch.answers`; with "reduced" they are
    answered at the equilibrium near the reduced state, as for a pose of `ksd.solve`; modes are numbered at every pose
    from the lowest. mesh: when None the default one, with the curvature modes that are enough for the first design at
    its farthest pose. A pose that `ksd.solve(..., estimate=False)` would refuse has no answers, and its sentence for a
    reason; strict=False answers it all the same (of tabulated joints the insides are not known, and not checked).
    relinearisations, extrapolate: as in `ksd.solve`. targets: drive values as a mapping. threads: cores when None.
    executor: any concurrent.futures executor instead of threads; with processes, where Python works in parallel too,
    `mechanism` must be a function they can import. Raises SceneError for bad input; designs, poses and questions that
    fail are in the result.

    >>> guide = ksd.Mechanism.of_joint(ksd.ParallelGuide(
    ...     ksd.Material(E=200 * GPa, nu=0.3), length=60 * mm, thickness=0.3 * mm,
    ...     width=20 * mm, spacing=60 * mm,
    ... ))
    >>> found = ksd.batch(guide, stroke=[2.5 * mm, 5 * mm], questions="stress")
    >>> found.forces["stroke"].round(3), found.answers["stress_MPa"].round(1)
    (array([[2.504, 5.036]]), array([[125.1, 250.7]]))
    """
    check_solve_options(
        mesh=mesh, relinearisations=relinearisations, method=method, methods=("reduced", "full"),
        tabulated=tabulated, extrapolate=extrapolate,
    )  # fmt: skip
    if tabulated and (method == "full" or relinearisations):
        raise SceneError(
            "tabulated = True: tabulated joints serve method='reduced' without relinearisation steps"
        )
    parsed = parse_questions(questions, link, at, freed, along=along, modes=modes, psd=psd, damping=damping)
    if tabulated and parsed.names:
        raise SceneError(
            "tabulated = True: tables know nothing of the insides of joints, so they answer no questions"
        )
    check_executor(executor)
    workers = (os.cpu_count() or 1) if threads is None else whole_number(threads, "threads")
    values = _equal_lengths(drive_value_arrays(targets, drives, batch))
    options: dict[str, Any] = {
        "method": method,
        "relinearisations": relinearisations,
        "tabulated": tabulated,
        "questions": parsed,
        "strict": boolean(strict, "strict"),
    }
    points = design_parameters(mechanism, designs)
    if designs is None:
        check_drives(build_scene(mechanism, {}), tuple(values), batch)
    if mesh is None:
        path = _farthest_pose(mechanism, points[0], values)
        used = (
            None
            if method is None and path.scene is not None and has_contacts(path.scene)
            else method or "reduced"
        )
        recipe = Recipe(parsed, method=used, relinearisations=relinearisations, extrapolate=extrapolate)
        mesh = adequate_mesh([path], recipe)
    solver = BatchSolver(values, options, mesh, extrapolate)
    if executor is None or designs is None:
        results = solver.solve(scene_factories(mechanism, points), workers)
    else:
        results = solver.solve_in(executor, mechanism, points)
    return _combine(
        results, len(next(iter(values.values()))), kept=(0, UNANSWERED, *(() if strict else (REFUSED,)))
    )


def _equal_lengths(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Drive values as arrays of one length, single numbers repeated. Raises SceneError."""
    if not arrays:
        raise SceneError("a batch needs drive values, for example top=np.linspace(0, 0.3, 31)")
    size = max(len(v) for v in arrays.values())
    for n, v in arrays.items():
        if len(v) not in (1, size):
            raise SceneError(f"drive values {n}: give one number or {size} of them in a row, not {len(v)}")
    return {n: np.broadcast_to(v, size) for n, v in arrays.items()}


def _farthest_pose(
    mechanism: MechanismLike, point: Mapping[str, Any], values: Mapping[str, np.ndarray]
) -> SweepPath:
    """The design with these parameters at the largest drive values, as a path of one pose."""
    scene, failure = scene_or_reason(mechanism, point)
    far = int(np.argmax(sum(v * v for v in values.values())))
    return SweepPath(0, {}, scene, ({n: float(v[far]) for n, v in values.items()},), failure)


def _combine(results: list[Any], count: int, kept: tuple[int, ...]) -> Batch:
    """The batch of all designs at `count` poses; results: a `DesignResult` each, or the error that prevented it.

    Numbers are nan where a design or a pose has a status that is not in `kept`. Raises SceneError where no design was
    solved.
    """
    first = next((r for r in results if isinstance(r, DesignResult)), None)
    if first is None:
        reason = str(results[0]).removesuffix(".")
        # a sweep cannot help where the scene itself is missing
        other = "" if reason.startswith(CANNOT_BE_BUILT) else "; ksd.sweep takes every mechanism"
        raise SceneError(f"no design could be prepared; the first: {reason}{other}")
    designs: list[DesignResult | None] = []
    reasons: dict[Any, str] = {}
    for d, result in enumerate(results):
        solved = isinstance(result, DesignResult) and result.names == first.names
        designs.append(result if solved else None)
        if not solved:
            reasons[d] = DIFFERENT_LAYOUT if isinstance(result, DesignResult) else str(result)
    for d, design in enumerate(designs):
        if design is not None:
            reasons |= {(d, n): why for n, why in (*design.reasons.items(), *design.refused.items())}
    status = np.array([np.full(count, NOT_BUILT) if design is None else design.status for design in designs])
    fields = ("force", "x", "R", "motion", *(("compliance",) if first.compliance is not None else ()))
    arrays: dict[str, np.ndarray] = {}
    for field in fields:
        blank = np.full(getattr(first, field).shape, np.nan)
        parts = [blank if design is None else getattr(design, field) for design in designs]
        arrays[field] = np.array(parts, float)
        arrays[field][~np.isin(status, kept)] = np.nan
    force, motion = arrays["force"], arrays["motion"]
    return Batch(
        first.links,
        {n: force[:, :, k] for k, n in enumerate(first.drives)},
        arrays["x"],
        arrays["R"],
        {n: motion[:, :, k] for k, n in enumerate(first.joints)},
        status,
        np.array([np.nan if design is None else design.error for design in designs]),
        reasons,
        _columns([[] if design is None else design.rows for design in designs], count),
        arrays.get("compliance"),
    )


def _columns(rows: list[list[Row]], count: int) -> dict[str, np.ndarray]:
    """Answers (D, N) by column, from the rows of D designs, [] for one without; nan or "" where there is no answer."""
    examples = {column: value for own in rows for row in own for column, value in row.items()}
    columns: dict[str, np.ndarray] = {}
    for column, value in examples.items():
        blank: Any = "" if isinstance(value, str) else np.nan
        values = [[row.get(column, blank) for row in own] or [blank] * count for own in rows]
        columns[column] = np.array(values, object if blank == "" else float)
    return columns
