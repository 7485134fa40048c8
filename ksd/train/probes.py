"""Whether a record agrees with the code that reads it: a few states kept inside are evaluated and solved again.

What counts is what comes out, so a record outlives any change of the sources that does not move its numbers.
"""

from __future__ import annotations

import numpy as np

from ksd.errors import RecordError
from ksd.library import Mesh, Probes, Record
from ksd.library.functions import Array
from ksd.library.record_files import training_hint
from ksd.train.designs import Design, without_mesh_choices
from ksd.train.fit import DIGITS
from ksd.train.sampling import Samples, SamplingPlan, sample_joint

STATES = 4
"""States kept with a record."""
ROUNDING = 1e-9
"""Difference of a function that the digits kept and another order of sums may make."""
SOLVED = 1e-8
"""Difference of a solve that does not count, as in the fit (`ksd.train.fit.EXACT`)."""


def probes_of(record: Record, places: Array, grid: Array) -> Probes:
    """Probes of a record from shapes at places (k, s) in [-1, 1] and motions (g, m) over their reach: both ends of
    the list of motions and states between, each at another shape while there are some.
    """
    ranges = record.parameters
    chosen = [places[i % len(places)] for i in range(STATES)]
    shapes = np.array([[p.value(float(x)) for p, x in zip(ranges, place, strict=True)] for place in chosen])
    at = np.linspace(0, len(grid) - 1, STATES).round().astype(int)
    motions = grid[at] * [motion.reach for motion in record.motions]
    values = np.concatenate(list(record.at(shapes, motions).values()), axis=1)
    return Probes(shapes, motions, np.round(values, DIGITS) + 0.0)


def check_probes(record: Record, design: Design | None = None) -> str:
    """How a record agrees with its probes, in words; without the design that draws its joint, nothing is solved.

    Raises RecordError where the record holds no probes, where its functions differ from those kept by more than ROUNDING,
    or where a probe solved again differs from them by more than the error on fresh shapes that the record tells;
    SceneError and ConvergenceError where a probe cannot be solved.
    """
    again = training_hint(record.family)
    if record.probes is None or len(record.probes.motions) == 0:
        raise RecordError(
            f"record '{record.family}' holds no probe states (an older version wrote it); {again}"
        )
    now = record.at(record.probes.shapes, record.probes.motions)
    ends = np.cumsum([values.shape[1] for values in now.values()])
    kept = dict(zip(now, np.split(record.probes.values, ends[:-1], axis=1), strict=True))
    most = 0.0
    for key, values in now.items():
        most = max(most, _furthest(record, key, values, kept[key], ROUNDING, "its functions"))
    said = f"{len(record.probes.motions)} probe states: functions as kept, within {most:.1g}"
    if design is None:
        return f"{said}; not solved again, as no family draws this joint (ksd.train.check_probes with its design does)"
    names = tuple(p.name for p in design.parameters)
    if record.shape_names != names:
        raise RecordError(
            f"record '{record.family}' is of the shape parameters {', '.join(record.shape_names) or 'none'}; the joint is "
            f"drawn by {', '.join(names) or 'none'}; {again}"
        )
    share = 0.0
    for i, samples in enumerate(_solved(record, design)):
        for key, solved in samples.items():
            if solved.size == 0:
                continue
            told = 1.01 * record.worst(*key) + SOLVED
            apart = _furthest(record, key, solved.reshape(1, -1), kept[key][i : i + 1], told, "the solver")
            share = max(share, apart / told)
    return f"{said}; solved again, within {share:.2g} times the errors told"


def _furthest(
    record: Record, key: tuple[Mesh, str], values: Array, kept: Array, limit: float, what: str
) -> float:
    """Largest difference of a group from what is kept. Raises RecordError above `limit`, or where it is no number."""
    apart = float(np.abs(values - kept).max(initial=0.0))
    if not apart <= limit:
        raise RecordError(
            f"record '{record.family}' does not agree with this version of ksd: {key[1]} of mesh {key[0]!r} by {what} "
            f"differ from the probe states kept by {apart:.2g}, with {limit:.2g} allowed; {training_hint(record.family)}"
        )
    return apart


def _solved(record: Record, design: Design) -> list[Samples]:
    """Every probe state, solved by the model of the joint itself."""
    assert record.probes is not None
    reach = [motion.reach for motion in record.motions]
    found = []
    for shape, motion in zip(record.probes.shapes, record.probes.motions, strict=True):
        # by name: the ranges of the design may be others than those of the record
        joint = without_mesh_choices(
            design.make(**dict(zip(record.shape_names, shape.tolist(), strict=True)))
        )
        point = tuple((float(x),) for x in motion / reach)
        plan = SamplingPlan(point, tuple(record.functions), record.orders)
        found.append(sample_joint(joint, plan))
    return found
