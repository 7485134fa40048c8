"""Four chains at a time are four chains one by one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ksd.beam import corotational
from ksd.beam.corotational_element import KEPT, TAIL
from ksd.beam.corotational_near import near_condense
from ksd.beam.corotational_values import ElementSection, chain_values, sizes
from ksd.numerics.fours import above, below_zero, four_matrix, fours, larger, root, vanishes
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import factors_of_any, rotation_exp_of_any, rotation_log_below

pytestmark = pytest.mark.filterwarnings("error")


@kernel
def decide(x, y, out, told):
    """All decisions, and numbers of fours, of flat arrays (4,)."""
    a, b = fours(x, 0, 1)[0], fours(y, 0, 1)[0]
    told[0], told[1], told[2], told[3] = above(a, b), above(a, 1.0), vanishes(a, b), below_zero(a)
    told[4], told[5], told[6], told[7] = (
        above(x[0], y[0]),
        above(x[0], 1.0),
        vanishes(x[0], y[0]),
        below_zero(x[0]),
    )
    found = fours(out, 0, 3)
    found[0], found[1], found[2] = root(b), larger(a, b), -a
    out[12], out[13] = root(y[0]), larger(x[0], y[0])


@pytest.mark.parametrize(
    ("x", "y", "told"),
    [
        ((1.0, 2.0, 3.0, 4.0), (5.0, 6.0, 7.0, 8.0), (0, 1, 1, 0, 0, 0, 1, 0)),
        ((1.0, 7.0, -3.0, -4.0), (0.5, 6.0, 2.0, 3.0), (1, 1, 0, 2, 1, 0, 0, 0)),
        ((-1.0, np.nan, -3.0, -4.0), (0.5, 6.0, 2.0, 3.0), (1, 1, 1, 3, 0, 0, 0, 1)),
    ],
)
def test_decisions_are_for_all_four(x, y, told):
    out, found = np.zeros(14), np.zeros(8, np.int64)
    x, y = np.array(x), np.array(y)
    decide(x, y, out, found)
    assert tuple(found) == told
    assert out[:4] == pytest.approx(np.sqrt(y), rel=1e-15)
    assert out[12] == out[0]
    assert out[4:8] == pytest.approx(np.where(y > x, y, x), nan_ok=True)
    assert out[13] == max(x[0], y[0])
    assert np.array_equal(out[8:12], -x, equal_nan=True)


@kernel
def there_and_back(v, R, back):
    """Rotations of four vectors (3, 4), and their vectors again."""
    rotation_exp_of_any(fours(v, 0, 3), four_matrix(R, 0, 3, 3))
    rotation_log_below(four_matrix(R, 0, 3, 3), fours(back, 0, 3))


@pytest.mark.parametrize("scale", [0.0, 1e-9, 0.05, 0.3, 1.0, 2.5])
def test_rotations_of_four(scale, rng):
    for _ in range(20):
        v = rng.normal(size=(3, 4))
        v *= scale * rng.uniform(size=4) / np.linalg.norm(v, axis=0)
        R, back = np.empty(36), np.empty(12)
        there_and_back(v.ravel(), R, back)
        theirs = Rotation.from_rotvec(v.T).as_matrix()
        assert np.abs(np.moveaxis(R.reshape(3, 3, 4), -1, 0) - theirs).max() < 8e-16
        assert np.abs(back.reshape(3, 4) - v).max() < 2e-15 * (1 + 4 * scale)


def test_factors_beyond_a_turn():
    t = np.array([4.0, 6.5, 9.0, 30.0])
    for k in range(4):
        a, b = factors_of_any(float(t[k] ** 2))
        assert a == pytest.approx(np.sin(t[k]) / t[k], abs=2e-14)
        assert b == pytest.approx((1 - np.cos(t[k])) / t[k] ** 2, abs=2e-14)
    assert all(np.isnan(f) for f in factors_of_any(np.nan))


@kernel
def near_of_four(value, number, inner, store, near, d, Q, lam, K, errors, told):
    """`near_condense` of four chains, arrays by numbers of all four."""
    n = number[0]
    found = near_condense(
        fours(value, 0, len(value) // 4), number, fours(inner, 0, len(inner) // 4), fours(store, 0, len(store) // 4),
        fours(near, 0, 3 * (2 * n - 1)), fours(d, 0, 3), four_matrix(Q, 0, 3, 3), fours(lam, 0, 12),
        four_matrix(K, 0, 6, 6),
    )  # fmt: skip
    kept = fours(errors, 0, 2)
    told[0], kept[0], kept[1], told[1] = found


@kernel
def move_four(value, number, inner, store, xi, scale):
    """`recover` of four chains."""
    corotational.recover(
        fours(value, 0, len(value) // 4), number, fours(inner, 0, len(inner) // 4), fours(store, 0, len(store) // 4),
        fours(xi, 0, 6), scale,
    )  # fmt: skip


def chains(rng, n, bend):
    """Four leafs of unlike sections near bent states."""
    for k in range(4):
        w = 0.02 + 0.01 * k
        section = ElementSection(
            E=200e9,
            G=77e9,
            A=w * 1e-3,
            J=w * 1e-9 / 3,
            Iy=w**3 * 1e-3 / 12,
            Iz=w * 1e-9 / 12,
            ky=5 / 6,
            kz=5 / 6,
        )
        value, number = chain_values(section, 0.1, n), np.array([n, 1])
        turn = bend * (0.5 + 0.2 * k) * np.array([0.05, 0.02, 1.0]) + 1e-3 * rng.normal(size=3)
        x, near = np.zeros(3), []
        for e in range(n):
            near.append(turn * (e + 0.5) / n)
            x = x + Rotation.from_rotvec(near[-1]).as_matrix()[:, 0] * 0.1 / n
        near += [turn * (e + 1) / n for e in range(n - 1)]
        Q = Rotation.from_rotvec(turn + 1e-3 * rng.normal(size=3)).as_matrix()
        yield (
            {"value": value, "near": np.ravel(near), "d": x + 1e-5 * rng.normal(size=3), "Q": Q.ravel()},
            number,
        )


@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize("bend", [0.0, 0.8, 2.2])
def test_near_states_of_four_are_those_of_each(n, bend, rng):
    given = list(chains(rng, n, min(bend, 0.8 * n)))
    number, size = given[0][1], sizes(n)
    together = {key: np.stack([g[0][key] for g in given], axis=1).ravel() for key in given[0][0]}
    lam, K, told, xi = np.zeros(48), np.zeros(144), np.zeros(2, np.int64), 1e-4 * rng.normal(size=(6, 4))
    inner, store, errors = np.zeros(4 * size.inner), np.zeros(4 * size.store), np.zeros(8)
    near_of_four(
        together["value"], number, inner, store, together["near"], together["d"], together["Q"], lam, K, errors, told
    )  # fmt: skip
    move_four(together["value"], number, inner, store, xi.ravel(), 0.7)
    assert size.store == KEPT * n + TAIL
    negatives = 0
    for k, (one, _) in enumerate(given):
        mine, kept, own, stiffness = (
            np.zeros(size.inner),
            np.zeros(size.store),
            np.zeros(12),
            np.zeros((6, 6)),
        )
        found = near_condense(
            one["value"], number, mine, kept, one["near"], one["d"], one["Q"].reshape(3, 3), own, stiffness
        )  # fmt: skip
        corotational.recover(one["value"], number, mine, kept, xi[:, k].copy(), 0.7)
        negatives += found[0]
        assert found[3] == 0
        assert lam[k::4][:6] == pytest.approx(own[:6], rel=1e-8, abs=1e-9 * np.abs(own[:6]).max())
        scale = np.sqrt(np.abs(np.outer(stiffness.diagonal(), stiffness.diagonal())))
        assert np.abs(K[k::4].reshape(6, 6) - stiffness).max() < 1e-6 * np.abs(stiffness).max()
        assert (np.abs(K[k::4].reshape(6, 6) - stiffness) / scale).max() < 1e-9
        assert errors.reshape(2, 4)[:, k] == pytest.approx(found[1:3], rel=1e-6, abs=1e-9)
        assert inner[k::4] == pytest.approx(mine, rel=1e-8, abs=1e-9 * np.abs(mine).max(initial=1e-3))
    assert tuple(told) == (negatives, 0)


def test_one_folded_leaf_is_told():
    rng = np.random.default_rng(1)
    given = list(chains(rng, 2, 0.5))
    given[2][0]["near"][3:6] = (0.0, 0.0, 2.5)
    together = {key: np.stack([g[0][key] for g in given], axis=1).ravel() for key in given[0][0]}
    size, told = sizes(2), np.zeros(2, np.int64)
    near_of_four(
        together["value"], given[0][1], np.zeros(4 * size.inner), np.zeros(4 * size.store), together["near"],
        together["d"], together["Q"], np.zeros(48), np.zeros(144), np.zeros(8), told,
    )  # fmt: skip
    assert told[1] == 1
