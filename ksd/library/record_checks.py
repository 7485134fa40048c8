"""Consistency check of a record read from a file: types, ranges and array shapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ksd.library.functions import Mesh
from ksd.library.record import Record, Stroke

MAX_TERMS, MAX_DEGREE, MAX_ELEMENTS = 8192, 64, 1000
"""Limits of the product terms of a function, of degrees, and of elements per leaf: several times those of training."""


def check_record(record: Record) -> None:
    """Raise ValueError with the first inconsistency of a record."""
    texts: dict[str, tuple[str, ...]] = {
        "family": (record.family,),
        "trained": (record.trained,),
        "version": (record.version,),
    }
    texts |= {"leaves": record.leaves, "blocks": record.blocks, "history": record.history}
    for name, values in texts.items():
        _require(all(isinstance(v, str) for v in values), f"{name} are no texts")
    _require(bool(record.leaves), "it has no leaf springs")
    for what, given in (("orders", record.orders), ("samples", record.samples)):
        are_valid = all(isinstance(n, int) and 0 <= n <= 10**6 for n in given)
        _require(are_valid and len(given) == (3 if what == "orders" else 2), f"{what} = {given}")
    _require(
        isinstance(record.design, dict) and _all_numbers(record.design.values()), "design holds no numbers"
    )
    _require(bool(record.motions), "it has no motion")
    for stroke in record.motions:
        _check_stroke(stroke)
    for names in ([m.name for m in record.motions], [p.name for p in record.parameters]):
        _require(len(set(names)) == len(names), f"a name is given twice in {names}")
    _check_powers(record)
    _require(bool(record.functions), "it has no functions")
    for mesh in record.functions:
        _check_functions(record, mesh)
    _check_residuals_and_evidence(record)
    _check_probes(record)


def _require(condition: bool, message: str) -> None:
    """Raise ValueError unless the condition holds."""
    if not condition:
        raise ValueError(message)


def _all_numbers(values: Any) -> bool:
    """Whether all values are numbers; nan and infinity stand for numbers that were not measured."""
    return all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)


def _check_stroke(stroke: Stroke) -> None:
    """Name, kind and range of an intended motion."""
    types_are_right = isinstance(stroke.name, str) and stroke.kind in ("rotation", "translation")
    is_valid = (
        types_are_right
        and _all_numbers((stroke.low, stroke.high))
        and -math.inf < stroke.low < stroke.high < math.inf
    )
    _require(is_valid, f"motion {stroke}")


def _check_powers(record: Record) -> None:
    """Shape and bounds of the exponents, and the scales of the monomials."""
    powers, m = record.powers, len(record.motions)
    _require(
        powers.ndim == 2 and powers.shape[1] == m + len(record.parameters) and 0 < len(powers) <= MAX_TERMS,
        f"powers {powers.shape} do not fit {m} motions and {len(record.parameters)} parameters",
    )
    _require(powers.min() >= 0 and powers.max() <= MAX_DEGREE, "degrees out of bounds")
    with np.errstate(all="ignore"):
        scale = np.prod(
            np.array([s.max_magnitude for s in record.motions]) ** -powers[:, :m].astype(float), axis=1
        )
    _require(bool(np.all(np.isfinite(scale))), "a stroke is too small for its degree")


def _check_functions(record: Record, mesh: Mesh) -> None:
    """Raise ValueError for coefficients of a mesh of wrong shape or that are not finite."""
    leaves, M = len(record.leaves), len(record.powers)
    shapes: dict[str, tuple[int, ...]] = {"interface": (6, M), "blocks": (len(record.blocks), 6, M)}
    if mesh == "strain":
        shapes |= {"amplitudes": (leaves, sum(record.orders), M), "wrench": (leaves, 6, M)}
    else:
        _require(isinstance(mesh, int) and 1 <= mesh <= MAX_ELEMENTS, f"mesh {mesh!r}")
        shapes |= {"rotations": (leaves, 2 * int(mesh) - 1, 3, M)}
    groups = record.functions[mesh].groups()
    _require(
        {name: table.shape for name, table in groups.items()} == shapes,
        f"functions of mesh {mesh} have shapes {[table.shape for table in groups.values()]}",
    )
    for name, table in groups.items():
        _require(bool(np.all(np.isfinite(table))), f"{name} of mesh {mesh} are not finite")


def _check_residuals_and_evidence(record: Record) -> None:
    """Types of residuals and evidence, which are printed."""
    for r in record.residuals:
        types_are_right = isinstance(r.group, str) and isinstance(r.mesh, (int, str))
        _require(
            types_are_right and _all_numbers((r.fit_max, r.fit_rms, r.fresh_max, r.fresh_rms)),
            f"residual {r}",
        )
    for e in record.evidence:
        types_are_right = isinstance(e.parameter, str) and isinstance(e.change, str)
        _require(types_are_right and _all_numbers((e.interface, e.rotations)), f"evidence {e}")


def _check_probes(record: Record) -> None:
    """Raise ValueError for probes of wrong shape or that are not finite."""
    probes = record.probes
    if probes is None:
        return
    tables = [table for functions in record.functions.values() for table in functions.groups().values()]
    rows = sum(table[..., 0].size for table in tables)
    for name, columns in (
        ("shapes", len(record.parameters)),
        ("motions", len(record.motions)),
        ("values", rows),
    ):
        table = getattr(probes, name)
        is_valid = table.shape == (len(probes.values), columns) and bool(np.all(np.isfinite(table)))
        _require(is_valid, f"probes: {name} of shape {table.shape}")
