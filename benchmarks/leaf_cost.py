"""Cost of one leaf per iteration: strain-mode leaf, chains of Appendix A elements, and the strain-mode leaf in its plane.

Condensing to the end frames and recovering the inner unknowns, one
leaf again and again, in turns with all other cases; thread time. Target: the default orders at no more than four
elements. Run: python benchmarks/leaf_cost.py
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from common import machine, parse_options, time_in_turns, write_json

from ksd.elements import corotational, corotational_values, planar_leaf, strain
from ksd.elements.strain_values import DEFAULT_ORDERS, DEFAULT_POINTS, strain_sizes, strain_values
from ksd.numerics.kernel import kernel

LENGTH = 0.1
SECTION = corotational_values.ElementSection(E=200e9, G=76.9e9, A=4e-5, J=1.3e-11, Iy=5.33e-9, Iz=3.33e-12)
"""A leaf of 40 by 1 mm."""
DEFAULT = (*DEFAULT_ORDERS, DEFAULT_POINTS)
ORDERS = ((4, 2, 4, 6), (4, 3, 5, 7), DEFAULT, (5, 3, 6, 8))
ELEMENTS = (2, 4, 10)
CALLS = 2000


@kernel
def _strain(value, number, inner, store, d, Q, lam, K, xi, calls):
    f = strain.allocate_leaf_fields_compiled(number[0] + number[1] + number[2], number[3])
    for _ in range(calls):
        strain.strain_condense(value, number, inner, store, f, d, Q, lam, K)
        strain.strain_recover(value, number, inner, store, xi, 1e-12, f.moment[0])


@kernel
def _chain(value, number, inner, store, d, Q, lam, K, xi, calls):
    for _ in range(calls):
        corotational.condense(value, number, inner, store, d, Q, lam, K)
        corotational.recover(value, number, inner, store, xi, 1e-12)


@kernel
def _planar(value, number, inner, store, d, Q, lam, K, xi, calls):
    for _ in range(calls):
        planar_leaf.condense(value, number, inner, store, d, Q, lam, K)
        planar_leaf.recover(value, number, inner, store, xi, 1e-12)


def _case(
    call: Any, value: np.ndarray, number: np.ndarray, inner: np.ndarray, store: int
) -> Callable[[], None]:
    """`CALLS` iterations of one leaf."""
    number = np.array([*number, *[0] * 7][:7], np.int64)
    store_array = np.zeros(store)
    d, Q = np.array([0.99 * LENGTH, 0.003, 1e-4]), np.eye(3)
    K, xi, lam = np.zeros((6, 6)), np.full(6, 1e-3), np.zeros(12)

    def run() -> None:
        call(value, number, inner, store_array, d, Q, lam, K, xi, CALLS)
        if not np.isfinite(K).all():
            raise RuntimeError("the leaf did not condense")

    return run


def _constants(orders: tuple[int, int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    s = SECTION
    return strain_values(
        length=LENGTH,
        rigidity=np.array([s.G * s.J, s.E * s.Iy, s.E * s.Iz]),
        compliance=1.0 / np.array([s.E * s.A, s.ky * s.G * s.A, s.kz * s.G * s.A]),
        orders=orders[:3],
        points=orders[3],
    )


def _modes(orders: tuple[int, int, int, int]) -> Callable[[], None]:
    """A strain-mode leaf bent about all three axes."""
    value, number = _constants(orders)
    state, store = strain_sizes(number)
    inner = np.random.default_rng(1).normal(size=state)
    return _case(_strain, value, number, inner, store)


def _elements(count: int) -> Callable[[], None]:
    value, number = corotational_values.chain_values(SECTION, LENGTH, count), np.array([count, 1])
    inner = corotational_values.undeformed_inner(value, number)
    return _case(_chain, value, number, inner, corotational_values.sizes(count).store)


def _planar_modes(orders: tuple[int, int, int, int]) -> Callable[[], None]:
    """A strain-mode leaf that bends in its plane."""
    value, number = _constants(orders)
    inner = np.random.default_rng(1).normal(size=strain_sizes(number)[0])
    value, number = planar_leaf.planar_values(value, number)
    return _case(_planar, value, number, inner, planar_leaf.store_size(orders[2]))


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Print and store times [us] of all leaf springs, and their ratio to four elements."""
    chosen = parse_options(__doc__, argv)
    cases = {f"space: strain modes {o[:3]}, {o[3]} points": _modes(o) for o in ORDERS}
    cases |= {f"space: {n} elements": _elements(n) for n in ELEMENTS}
    cases |= {f"plane: {o[2]} strain modes, {o[3]} points": _planar_modes(o) for o in ORDERS[:3]}
    times = time_in_turns(cases, repeats=10 if chosen.quick else 200)
    found: dict[str, Any] = {"machine": machine(), "us": {}, "ratio_to_four_elements": {}}
    for name, spent in times.items():
        us = spent.median / CALLS
        ratio = spent.median / times["space: 4 elements"].median
        found["us"][name], found["ratio_to_four_elements"][name] = us, ratio
        print(f"{name:44s}{us:8.3f} us{ratio:8.2f} times four elements")
    write_json(found, chosen.out / "leaf_cost.json")
    return found


if __name__ == "__main__":
    main()
