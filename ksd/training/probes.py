"""Check that a record agrees with the code that reads it: a few states stored in it are evaluated and solved again.

Only results are compared, so a record stays valid through any change of the sources that does not change its numbers.
"""

from __future__ import annotations

import numpy as np

from ksd.errors import RecordError
from ksd.library import Mesh, Probes, Record
from ksd.library.functions import Array
from ksd.library.record_files import training_hint
from ksd.training.designs import Design, without_mesh_choices
from ksd.training.fit import DECIMALS, REFUSED_MISS, missed_errors
from ksd.training.sampling import Samples, SamplingPlan, sample_joint

PROBE_STATES = 4
"""Number of states stored with a record."""
FUNCTION_TOLERANCE = 1e-9
"""Difference of a function that the stored decimals and a different order of summation may cause."""
SOLVE_TOLERANCE = 1e-8
"""Difference between solves that counts as none, as in the fit (`ksd.training.fit.ZERO_TOLERANCE`)."""


def probes_of(record: Record, places: Array, grid: Array) -> Probes:
    """Probes of a record: some of the motions `grid`, the first and the last among them, each at another shape.

    places (k, s): shapes in [-1, 1], used in turn; grid (g, m): motions over their largest magnitudes.
    """
    ranges = record.parameters
    chosen_places = [places[i % len(places)] for i in range(PROBE_STATES)]
    shapes = np.array(
        [[p.value(float(x)) for p, x in zip(ranges, place, strict=True)] for place in chosen_places]
    )
    at = np.linspace(0, len(grid) - 1, PROBE_STATES).round().astype(int)
    motions = grid[at] * [motion.max_magnitude for motion in record.motions]
    values = np.concatenate(list(record.at(shapes, motions).values()), axis=1)
    return Probes(shapes, motions, np.round(values, DECIMALS) + 0.0)


def check_probes(record: Record, design: Design | None = None) -> str:
    """Agreement of a record with its probes, in words; without the design that draws its joint, nothing is solved.

    Raises RecordError where the record holds no probes, where its functions are as far from its joint as `train` refuses
    to write, where they differ from the stored values by more than
    FUNCTION_TOLERANCE, or where a probe solved again differs from them by more than the recorded error on fresh shapes;
    SceneError and ConvergenceError where a probe cannot be solved.
    """
    again = training_hint(record.family)
    if record.probes is None or len(record.probes.motions) == 0:
        raise RecordError(
            f"record '{record.family}' holds no probe states (an older version wrote it); {again}"
        )
    fitted, missed = missed_errors(record.residuals, 1.0 if design is None else design.tolerance_factor)
    if missed > REFUSED_MISS:
        raise RecordError(
            f"record '{record.family}' misses its joint by {missed:.2g} times the wanted errors, as where leaf "
            f"springs buckle in the stroke; do not use it, and train it with a smaller range of "
            f"{'motion' if fitted > REFUSED_MISS else 'the shape'}"
        )
    now = record.at(record.probes.shapes, record.probes.motions)
    ends = np.cumsum([values.shape[1] for values in now.values()])
    stored = dict(zip(now, np.split(record.probes.values, ends[:-1], axis=1), strict=True))
    largest = 0.0
    for key, values in now.items():
        largest = max(
            largest,
            _largest_difference(record, key, values, stored[key], FUNCTION_TOLERANCE, "its functions"),
        )
    summary = f"{len(record.probes.motions)} probe states: functions as kept, within {largest:.1g}"
    if design is None:
        return f"{summary}; not solved again, as no family draws this joint (ksd.train.check_probes with its design does)"
    names = tuple(p.name for p in design.parameters)
    if record.shape_names != names:
        raise RecordError(
            f"record '{record.family}' is of the shape parameters {', '.join(record.shape_names) or 'none'}; the joint is "
            f"drawn by {', '.join(names) or 'none'}; {again}"
        )
    share = 0.0
    for i, samples in enumerate(_solve_probes(record, design)):
        for key, solved in samples.items():
            if solved.size == 0:
                continue
            allowed = 1.01 * record.worst(*key) + SOLVE_TOLERANCE
            difference = _largest_difference(
                record, key, solved.reshape(1, -1), stored[key][i : i + 1], allowed, "the solver"
            )
            share = max(share, difference / allowed)
    return f"{summary}; solved again, within {share:.2g} times the errors of the record"


def _largest_difference(
    record: Record, key: tuple[Mesh, str], values: Array, stored: Array, limit: float, what: str
) -> float:
    """Largest difference of a group from its stored values. Raises RecordError above `limit`, or where it is not a
    number."""
    difference = float(np.abs(values - stored).max(initial=0.0))
    if not difference <= limit:
        raise RecordError(
            f"record '{record.family}' does not agree with this version of ksd: {key[1]} of mesh {key[0]!r} by {what} "
            f"differ from the probe states kept by {difference:.2g}, with {limit:.2g} allowed; "
            f"{training_hint(record.family)}"
        )
    return difference


def _solve_probes(record: Record, design: Design) -> list[Samples]:
    """Samples of every probe state, solved with the finite element model of the joint."""
    assert record.probes is not None
    reach = [motion.max_magnitude for motion in record.motions]
    samples = []
    for shape, motion in zip(record.probes.shapes, record.probes.motions, strict=True):
        # by name, since the ranges of the design may differ from those of the record
        joint = without_mesh_choices(
            design.make(**dict(zip(record.shape_names, shape.tolist(), strict=True)))
        )
        point = tuple((float(x),) for x in motion / reach)
        plan = SamplingPlan(point, tuple(record.functions), record.orders)
        samples.append(sample_joint(joint, plan))
    return samples
