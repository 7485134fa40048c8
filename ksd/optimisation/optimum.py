"""`ksd.Optimum`: the result of `ksd.optimise`, with the active constraints, as text, pictures and an HTML page."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import name_hint
from ksd.errors import KsdError, SceneError
from ksd.files import check_target, write_file
from ksd.html import join_printed
from ksd.library.result_files import json_object
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.job import Job
from ksd.optimisation.local_search import StartResult
from ksd.optimisation.optimality import MESH_SHARE, NEIGHBOURS, STOPPED, Proof
from ksd.optimisation.optimum_page import optimum_page
from ksd.optimisation.scaled_problem import FEASIBLE_MARGIN, ScaledProblem
from ksd.solvers.configuration import Configuration
from ksd.solvers.solver import prepare
from ksd.study.table import OK, Table
from ksd.view import save_figure
from ksd.view.optimum_plot import plot_optimum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray
AGREEMENT = 1e-4
"""Relative difference of merits up to which starts end at the same optimum."""
NO_GRADIENT_TEXT = "What holds it is not known: there is no gradient at this design"


class TriedDesigns(NamedTuple):
    """Designs with answers, in the order of their evaluation.

    by (n,): label of the start; designs (n, P): parameters; merits (n,): worst target over its scale; exceeded (n,): the
    most by which a limit or rule is exceeded, in logarithms.
    """

    by: tuple[str, ...]
    designs: Array
    merits: Array
    exceeded: Array

    @property
    def met(self) -> Array:
        """Whether all limits and rules are met (n,)."""
        return self.exceeded <= FEASIBLE_MARGIN

    @property
    def searches(self) -> list[str]:
        """Labels of the searches; the neighbours of the optimum are not part of one."""
        return [name for name in dict.fromkeys(self.by) if name != NEIGHBOURS]


@dataclass(frozen=True, repr=False, eq=False)
class Optimum(PrintableAnswer):
    """The best design of `ksd.optimise`, and the active constraints there.

    job: with the limits that were applied; method: of the search; design: parameters by name, SI; merit: the worst target
    over its scale; answers: by name. held: the active targets, limits, rules and bounds by name, with their worth: percent
    by which the merit grows per percent that a limit or bound is moved (of targets the share that each has in the worst, of
    rules per percent of their range, of a bound at 0 per percent of the range of its parameter); empty where the design has
    no gradient. flat: a direction of parameters by name along which no active constraint changes; starts: result of each
    start; table: every design; seconds: CPU time. robust: number of standard deviations by which limits of `job` are moved
    in and targets lowered; margins: the amounts by answer, in units of its column. proof: what shows that it is an optimum.

    >>> job, _ = ksd.load_job("pivot_job", drives={"turn": "30deg"})
    >>> best = ksd.optimise(job)
    >>> print(f"{best.status}: {best.merit:.2f}")
    optimum: 0.50
    """

    job: Job
    method: str
    design: Mapping[str, float]
    merit: float
    answers: Mapping[str, float]
    held: Mapping[str, float]
    flat: Mapping[str, float]
    starts: tuple[StartResult, ...]
    table: Table
    seconds: float
    robust: float = 0.0
    margins: Mapping[str, float] = field(default_factory=dict)
    proof: Proof = field(default_factory=lambda: Proof(STOPPED))

    @property
    def status(self) -> str:
        """ "optimum", "no better neighbour found" or "stopped", see `Proof`."""
        return self.proof.status

    @property
    def mechanism(self) -> Any:
        """The mechanism at the optimum."""
        return self.job.function(**self.design)

    @property
    def evaluations(self) -> int:
        """Number of values computed in all starts."""
        return sum(s.values for s in self.starts)

    @property
    def gradients(self) -> int:
        """Number of gradients computed in all starts."""
        return sum(s.gradients for s in self.starts)

    @property
    def agreed(self) -> int:
        """Number of starts whose merit is within 1e-4 of the best."""
        good = [s.merit for s in self.starts if s.status == OK]
        return sum(abs(m - self.merit) <= AGREEMENT * abs(self.merit) for m in good)

    @property
    def worst(self) -> str:
        """Name of the answer that is the worst target."""
        merits = [(a.merit(self.answers[a.name]), a.name) for a in self.job.answers]
        return min((m for m in merits if np.isfinite(m[0])), default=merits[0])[1]

    def pose(self, answer: str | None = None) -> Configuration:
        """The optimum solved at the pose of one of its answers, by default of its worst target. Raises SceneError for an
        unknown answer, and what `ksd.solve` raises."""
        name = self.worst if answer is None else answer
        if name not in self.answers:
            raise SceneError(f"there is no answer '{name}'{name_hint(str(name), self.answers)}")
        job = self.job
        case, step = job.poses[job.answers[job.names.index(name)].pose or 0]
        solver = prepare(job.scene_at(self.design, case), mesh=job.mesh, extrapolate=job.extrapolate)
        return solver(step, method=job.method)

    @cached_property
    def few_modes(self) -> str:
        """Warning that the curvature modes of the mesh are too few at this design; empty where they suffice."""
        return self.job.few_modes(list(self.design.values()))

    @cached_property
    def tried(self) -> TriedDesigns:
        """All designs of the table that have answers."""
        rows = [row for row in self.table.rows() if row["status"] == OK]
        X = np.array([[row[n] for n in self.job.parameters] for row in rows])
        values = np.array([[row[n] for n in self.job.names] for row in rows])
        problem = ScaledProblem(self.job, DesignLog(self.job), "")
        pairs = zip(X, values, strict=True)
        exceeded = [problem.violation(problem.margins_from(v, problem.rules(x)[0])) for x, v in pairs]
        return TriedDesigns(
            tuple(row["by"] for row in rows), X, np.array([self.job.merit(v) for v in values]),
            np.array(exceeded),
        )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """Everything but the table, for JSON; numbers that are not finite become None."""
        return json_object({
            "method": self.method, "merit": self.merit, "design": self.design, "worst": self.worst,
            "answers": self.answers, "held": self.held, "flat": self.flat, "robust": self.robust,
            "margins": self.margins, "status": self.status,
            "proof": asdict(self.proof), "values": self.evaluations, "gradients": self.gradients,
            "seconds": self.seconds, "starts": [s._asdict() for s in self.starts],
        })  # fmt: skip

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Matplotlib figure of the convergence of every start, and of all designs as parallel coordinates; written to
        `path` if given."""
        figure = plot_optimum(self)
        return figure if path is None else save_figure(figure, path)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write an HTML page that needs no network: job, optimum, active constraints, worst pose, search and answers.
        Returns the path."""
        target, job = check_target(Path(path), what="report"), self.job
        numbers = (
            (job.merit_sign * self.merit, job.merit_name),
            (self.status, "status"),
            (f"{self.agreed} of {len(self.starts)}", "starts end here"),
            (f"{self.evaluations} + {self.gradients}", "values and gradients"),
            (f"{self.seconds:.3g} s", "CPU time"),
        )
        worst_pose: Figure | str
        try:
            worst_pose = self.pose().plot(color="stress")
        except KsdError as why:
            worst_pose = str(why)
        page = optimum_page(
            job, str(getattr(self.mechanism, "name", "") or "mechanism"), numbers, str(self), self.worst, worst_pose,
            self.starts, self.plot(), self.answers,
        )  # fmt: skip
        return write_file(target, page, what="report")

    def _line(self) -> str:
        design = self.job.design_text(list(self.design.values()))
        return f"{self.job.merit_spoken(self.merit, digits=7)} at {design}"

    def __str__(self) -> str:
        bounds = dict(zip(self.job.parameters, self.job.bounds.tolist(), strict=True))
        rows = [
            (n, self.job.in_units(n, v, digits=6), *(self.job.in_units(n, b, digits=4) for b in bounds[n]))
            for n, v in self.design.items()
        ]
        value = "value" if self.job.units else "value [SI]"
        head = (
            f"{self.status.capitalize()} by {self.method}: {self.job.merit_spoken(self.merit, digits=7)}; "
            f"{self.agreed} of {len(self.starts)} starts end here; {self.evaluations} values, {self.gradients} gradients, "
            f"{self.seconds:.2f} s"
        )
        held = [
            (n, format_number(self.answers[n], 6) if n in self.answers else "", format_number(w, 4))
            for n, w in self.held.items()
        ]
        parts = [format_table(("parameter", value, "least", "most"), rows, head)]
        parts.append(format_table(("held by", "value", "worth [%/%]"), held) if held else NO_GRADIENT_TEXT)
        parts.append(self._proof_text())
        parts += [f"Start {k + 1}: {s.note}" for k, s in enumerate(self.starts) if s.note]
        for name, side in self.job.bound_reasons:
            if f"{name} at its {side}" in self.held:
                parts.append(f"{name}: {self.job.bound_reasons[name, side]}")
        if self.robust:
            moved = [f"{n} by {format_number(by)}" for n, by in self.margins.items() if n in self.held]
            parts.append(f"For {self.robust:g} standard deviations: {', '.join(moved)}")
        if self.flat:
            direction = ", ".join(f"{n} {100 * v:+.3g} %" for n, v in self.flat.items())
            parts.append(
                f"Flat: nothing that holds it changes along {direction}; fix one of these parameters"
            )
        parts += filter(None, [self.job.method_note, self.few_modes])
        return join_printed(parts)

    def _proof_text(self) -> str:
        """What shows that it is an optimum, as text."""
        proof, said = self.proof, []
        if np.isfinite(proof.remainder):
            said += [
                f"shares of targets sum to {proof.target_share:.4f}",
                f"1 % of step would gain {proof.remainder:.2g} % to first order",
            ]
        if proof.neighbours:
            gain = proof.neighbour_gain
            best = (
                f"the best of them gains {100 * gain:+.2g} %"
                if np.isfinite(gain)
                else "none meets the limits"
            )
            said.append(f"{proof.neighbours} neighbours were solved, {best}")
        if np.isfinite(proof.mesh_change):
            finer = f"a finer mesh changes the worst target by {100 * proof.mesh_change:+.2g} %"
            exceeds = proof.mesh_violation > MESH_SHARE
            said.append(
                finer + (f" and exceeds a limit by {100 * proof.mesh_violation:.2g} %" if exceeds else "")
            )
        if proof.kinks:
            said.append(f"kinks, where a worth depends on the direction: {', '.join(proof.kinks)}")
        return f"{self.status.capitalize()}: {'; '.join(said) or 'nothing could be shown'}"
