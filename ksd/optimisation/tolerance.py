"""`ksd.tolerance`: scatter of the answers of a design with its parameters, to first order and by samples."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import clear_argument_errors, name_hint, number, show, whole_number
from ksd.errors import KsdError, SceneError
from ksd.numerics.threads import small_matrices
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.job import Job, check_job
from ksd.study.table import OK, Table

Array = np.ndarray
MAX_PRINTED_ANSWERS = 12
"""Number of printed answers: those nearest to their limits, in standard deviations, and the worst targets."""


@dataclass(frozen=True, repr=False, eq=False)
class Tolerance(PrintableAnswer):
    """Answers of a design whose parameters scatter independently, normally, by `spread` (standard deviations, SI).

    names: of the answers; nominal (answers,): values at the design; first_order, sampled (answers,): standard deviations to
    first order and of the samples, in units of their columns. blame (answers, parameters): share of each parameter in the
    first-order variance. yield_fraction: share of the samples that meet every limit; sds_to_limit (answers,): standard
    deviations to the nearest limit. merits (samples,): worst target over its scale, nan for samples that failed and for
    jobs without targets;
    sign: -1 where targets are minimised, so that merits are minus the worst. table: all samples.

    >>> job, _ = ksd.load_job("pivot_job", drives={"turn": "30deg"})
    >>> found = ksd.tolerance(job, job.point(None), spread={"joint.cross.thickness": 4e-6}, samples=20)
    >>> print(f"{found.yield_fraction:.0%} of the samples are within the limits")
    5% of the samples are within the limits
    """

    names: tuple[str, ...]
    spread: Mapping[str, float]
    nominal: Array
    first_order: Array
    sampled: Array
    blame: Array
    yield_fraction: float
    merits: Array
    sds_to_limit: Array
    table: Table
    sign: float

    def to_blame(self, name: str) -> dict[str, float]:
        """Share of every parameter in the first-order variance of an answer, the largest first. Raises SceneError for
        an unknown name."""
        if name not in self.names:
            raise SceneError(f"there is no answer '{name}'{name_hint(name, self.names)}")
        shares = dict(zip(self.spread, self.blame[self.names.index(name)].tolist(), strict=True))
        return dict(sorted(shares.items(), key=lambda pair: -pair[1]))

    def _line(self) -> str:
        merits = self.merits[np.isfinite(self.merits)]
        worst = (
            f", worst target {format_number(self.sign * float(merits.mean()))} +- {format_number(float(merits.std()))}"
            if len(merits)
            else ""
        )
        failed = len(self.table.failures)
        failures = f", {failed} have no answers" if failed else ""
        return f"{100 * self.yield_fraction:.3g} % of {len(self.merits)} samples hold every limit{failures}{worst}"

    def __str__(self) -> str:
        rows = []
        for k in np.argsort(self.sds_to_limit)[:MAX_PRINTED_ANSWERS].tolist():
            name, share = next(iter(self.to_blame(self.names[k]).items()))
            numbers = (self.nominal[k], self.first_order[k], self.sampled[k])
            blamed = f"{name} {100 * share:.0f} %" if share else ""
            rows.append((self.names[k], *(format_number(float(v)) for v in numbers), blamed))
        return format_table(
            ("answer", "nominal", "sd, first order", "sd, sampled", "<to blame"), rows, self._line()
        )


@clear_argument_errors
@small_matrices
def tolerance(
    job: Job,
    design: Any,
    *,
    spread: Mapping[str, float],
    samples: int = 1000,
    seed: int = 0,
    executor: Executor | None = None,
    resume: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Tolerance:
    """Compute how the answers of a job scatter with the parameters of a design; returns a `Tolerance`.

    job: with or without a target; its limits decide the yield. design: an optimum of `ksd.optimise`, or parameters by name
    or in order. spread: standard deviations of parameters by name, SI; other parameters are exact. samples: number of Monte
    Carlo samples by `seed`; they need not be within bounds, rules and trained ranges, which do not hold for manufactured
    parts. executor, resume, progress: as in `ksd.optimise`, Ctrl-C too. Raises SceneError for wrong arguments, KsdError
    where the design itself has no answers.

    >>> job, _ = ksd.load_job("pivot_job", drives={"turn": "30deg"})
    >>> found = ksd.tolerance(job, job.point(None), spread={"joint.cross.thickness": 4e-6}, samples=20)
    >>> print(f"{found.first_order[0] / 1e3:.1f} N/mm")
    11.3 N/mm
    """
    check_job(job, target=False)
    x, sd = job.point(getattr(design, "design", design)), check_spread(job, spread)
    count = whole_number(samples, "samples", least=2)
    log = DesignLog(job, resume=resume, executor=executor, progress=progress)
    # parts that scatter out of a trained range are solved as the others
    log.job = job.beyond_ranges()
    X = x + sd * np.random.default_rng(whole_number(seed, "seed", least=0)).normal(size=(count, len(x)))
    with log.interruptible():
        nominal, slopes = log.slopes(x, by="tolerance")
        values, status = log.batch(X, by="tolerance")
    parts, first = (slopes * sd) ** 2, first_order(slopes, sd)
    good = np.array([s == OK for s in status]) & np.isfinite(values).any(axis=1)
    if not good.any():
        raise KsdError(f"none of {count} samples could be solved; the first: {status[0]}")
    within_limits = [ok and bool((job.margins(v) >= 0.0).all()) for ok, v in zip(good, values, strict=True)]
    merits = np.array([job.merit(v) if ok else np.nan for ok, v in zip(good, values, strict=True)])
    scattered = [k for k, name in enumerate(job.parameters) if name in spread]
    with np.errstate(divide="ignore", invalid="ignore"):
        blame = np.where(first[:, None] > 0.0, parts / first[:, None] ** 2, 0.0)[:, scattered]
    finite = np.where(np.isinf(values), np.nan, values)
    return Tolerance(
        job.names, {job.parameters[k]: float(sd[k]) for k in scattered}, nominal, first,
        np.array([np.nanstd(v[good], ddof=1) if np.isfinite(v[good]).sum() > 1 else 0.0 for v in finite.T]), blame,
        float(np.mean(within_limits)), merits, _distances_to_limits(job, nominal, first), log.table(), job.merit_sign,
    )  # fmt: skip


def first_order(slopes: Array, sd: Array) -> Array:
    """Standard deviations (answers,) to first order; slopes (answers, P); sd (P,): those of the parameters."""
    return np.asarray(np.sqrt(((slopes * sd) ** 2).sum(axis=1)))


def check_spread(job: Job, spread: Any) -> Array:
    """Standard deviations (P,) of the parameters of a job, 0 where none is given. Raises SceneError."""
    if not isinstance(spread, Mapping) or not spread:
        raise SceneError("spread: give standard deviations by parameter, such as spread={'thickness': 4e-6}")
    for name, value in spread.items():
        if name not in job.parameters:
            raise SceneError(f"spread: '{name}' is not varied{name_hint(name, job.parameters)}")
        if number(value, f"spread: {name}") <= 0.0:
            raise SceneError(f"spread: {name} = {show(value)}: a standard deviation must be positive")
    return np.array([float(spread.get(n, 0.0)) for n in job.parameters])


def _distances_to_limits(job: Job, nominal: Array, sd: Array) -> Array:
    """Standard deviations (answers,) to the nearest limit; of targets, to the value at which they would be the worst."""
    distances = np.full(len(nominal), np.inf)
    merit = job.merit(nominal)
    for k, (a, v, s) in enumerate(zip(job.answers, nominal.tolist(), sd.tolist(), strict=True)):
        if s > 0.0 and np.isfinite(v):
            gap = (
                min(v - a.low, a.high - v)
                if a.role == "limit"
                else abs(abs(v) / a.scale - abs(merit)) * a.scale
            )
            distances[k] = gap / s
    return distances
