"""Eigenpairs by inverse iteration and counted pivots, against dense solutions of the same matrices."""

import numpy as np
import pytest
import scipy.linalg
from scenes import fourbar

import ksd
from ksd.properties.buckling import outer_of_both_signs
from ksd.properties.followed import LeafPencil, Pencil, followed
from ksd.properties.frequencies import frequencies

NODES, LEAFS, MODES = 9, 5, 4


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def made(rng, *, signed):
    """A pencil of leafs between two nodes of four unknowns and ground, one constraint row behind them; and K, M dense."""
    size = NODES + LEAFS * MODES
    stiff = rng.normal(size=(NODES - 1, NODES - 1))
    K = np.zeros((NODES, NODES))
    K[:-1, :-1] = stiff @ stiff.T + np.eye(NODES - 1)
    K[-1, :-1] = K[:-1, -1] = rng.normal(size=NODES - 1)
    at = np.full((LEAFS, 12), -1)
    at[:, :4], at[1:, 6:10] = np.arange(4), np.arange(4, 8)
    inner = NODES + np.arange(LEAFS * MODES).reshape(LEAFS, MODES)
    soft = rng.normal(size=(LEAFS, MODES, MODES - 1))
    Z = soft @ soft.swapaxes(1, 2)
    root = rng.normal(size=(size + 5, size))
    root[:, NODES - 1] = 0.0
    full = root.T @ (rng.normal(size=(size + 5, 1)) * root if signed else root)
    full = 0.5 * (full + full.T)
    M, dense_K = np.zeros((size, size)), np.zeros((size, size))
    M[:NODES, :NODES], dense_K[:NODES, :NODES] = full[:NODES, :NODES], K
    own, both = np.zeros((LEAFS, MODES, MODES)), np.zeros((LEAFS, MODES, 12))
    for k in range(LEAFS):
        here, there = inner[k], at[k][at[k] >= 0]
        own[k] = M[np.ix_(here, here)] = full[np.ix_(here, here)]
        both[k][:, at[k] >= 0] = M[np.ix_(here, there)] = full[np.ix_(here, there)]
        M[np.ix_(there, here)] = full[np.ix_(there, here)]
    # soft in three directions of four: in the others nothing moves
    G = scipy.linalg.block_diag(np.eye(NODES), *[Z[k] for k in range(LEAFS)])
    flexible = scipy.linalg.block_diag(np.linalg.inv(K), *[np.eye(MODES)] * LEAFS) @ G
    pencil = Pencil(K, M[:NODES, :NODES], [LeafPencil(at, inner, Z, own, both)])
    values = np.linalg.eigvals(flexible @ M)
    real = values[np.abs(values.imag) < 1e-9].real
    return pencil, np.sort(1.0 / real[np.abs(real) > 1e-9 * np.abs(real).max()]), M


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("start", ["random", "far off", "one of many"])
def test_no_pair_is_missed(rng, signed, start):
    pencil, expected, M = made(rng, signed=signed)
    wanted = (lambda s: outer_of_both_signs(1 / s, 4)) if signed else (lambda s: np.argsort(s)[:4])
    forces = None
    if start != "random":
        forces = pencil.forces(M @ rng.normal(size=(len(M), 6 if start == "far off" else 1)))
    reach = 1e3 if signed else 0.0
    s, X, chosen = followed(pencil, forces, wanted, most=6, rows=1, reach=reach)
    s, X = s[chosen], X[chosen]
    best = expected[outer_of_both_signs(1 / expected, 4)] if signed else expected[:4]
    assert np.sort(s) == pytest.approx(np.sort(best), rel=1e-9)
    v = pencil.vectors(X, len(M))
    # K x = s M x on what moves
    assert pencil.forces(M @ v) == pytest.approx(pencil.times(X), rel=1e-9, abs=1e-9)


def test_pivots_count_the_pairs_below_a_shift(rng):
    pencil, expected, _ = made(rng, signed=True)
    middle = 0.5 * (expected[1:] + expected[:-1])
    count = [np.sum((expected / m > 0) & (expected / m < 1)) for m in middle]
    assert (pencil.negatives(middle) - 1).tolist() == count


def test_what_the_neighbour_was_makes_no_difference():
    """Frequencies of a pose, started from near, from far, and from nothing, and by the other routes."""
    solver = ksd.prepare(fourbar())
    poses = [solver(top=d, method="full") for d in (0.05, 0.06, 0.25)]
    model, motion = poses[1].unreduced
    near = [p.frequencies(count=6, freed="top") for p in (poses[0], poses[2])]
    found = [frequencies(model, motion, count=6, freed="top", near=n) for n in (None, *near)]
    other = frequencies(model, motion, count=6, freed="top", dense=False)
    for modes in found:
        assert modes.frequency_Hz == pytest.approx(other.frequency_Hz, rel=1e-8)
        assert np.diag(modes.assurance(other))[:4] == pytest.approx(np.ones(4), abs=1e-6)
