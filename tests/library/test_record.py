"""Contraction against direct evaluation, ranges, and chains longer than any trained."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.legendre import legval
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ksd.errors import RangeError, RecordError, SceneError
from ksd.library.chains import chain_rotations, extend_chain, rotation_vectors
from ksd.library.functions import Functions, JointFunctions
from ksd.library.record import Parameter


def direct(record, table, shape, motion):
    """The sum of the module docstring, written out."""
    places = [
        2 * (shape["angle"] - 0.5) / 0.5 - 1,
        2 * math.log(shape["ratio"] / 0.25) / math.log(16) - 1,
    ]
    total = np.zeros(table.shape[:-1])
    for i, (p, a, b) in enumerate(record.powers):
        factor = (motion / 1.2) ** p
        for degree, place in zip((a, b), places, strict=True):
            factor *= legval(place, np.eye(degree + 1)[degree])
        total += table[..., i] * factor
    return total


def test_a_record_names_its_range_in_degrees_and_its_shape(record):
    assert repr(record).startswith("<Record of toy: angle -68.75 to 68.75 deg; shape by angle, ratio; ")
    assert "deg; one shape; " in repr(replace(record, parameters=()))


@pytest.mark.parametrize("mesh", ["strain", 2])
def test_contraction_equals_direct_evaluation(record, mesh):
    shape = {"angle": 0.63, "ratio": 1.7}
    functions = record.contract(shape, mesh)
    assert functions.powers.shape == (5, 1)
    for group, table in record.functions[mesh].groups().items():
        for motion in (-1.1, 0.0, 0.3, 1.2):
            np.testing.assert_allclose(
                functions.at([motion], group), direct(record, table, shape, motion), atol=1e-14
            )
    np.testing.assert_array_equal(functions.motion_range, [[-1.2, 1.2]])


def test_outside_the_range_names_parameter_value_range_and_switch(record):
    with pytest.raises(RangeError, match=r"ratio = 5 .*0\.25 to 4 .*extrapolate=True"):
        record.contract({"angle": 0.6, "ratio": 5.0}, "strain")
    with pytest.raises(RangeError, match=r"angle = 0\.4 "):
        record.contract({"angle": 0.4, "ratio": 1.0}, "strain")
    assert record.contract({"angle": 0.6, "ratio": 5.0}, "strain", extrapolate=True).extrapolated == (
        "ratio",
    )
    assert record.contract({"angle": 0.6, "ratio": 4.0}, "strain").extrapolated == ()


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_numbers_no_extrapolation_can_use(record, value):
    with pytest.raises(RangeError, match="ratio"):
        record.contract({"angle": 0.6, "ratio": value}, "strain", extrapolate=True)


def test_wrong_words_are_named(record):
    with pytest.raises(SceneError, match="'angel'; did you mean \"angle\""):
        record.contract({"angel": 0.6, "ratio": 1.0}, "strain")
    with pytest.raises(SceneError, match="'ratio' of toy is missing"):
        record.contract({"angle": 0.6}, "strain")
    for mesh in (0, -1, "beam", True):
        with pytest.raises(SceneError, match="has no mesh"):
            record.contract({"angle": 0.6, "ratio": 1.0}, mesh)
    with pytest.raises(RecordError, match="hold no amplitudes"):
        _ = record.contract({"angle": 0.6, "ratio": 1.0}, 2).amplitudes


def test_parameter_maps_are_inverse():
    for parameter in (Parameter("a", 0.5, 1.0), Parameter("b", 0.25, 4.0, "log")):
        for value in np.linspace(parameter.low, parameter.high, 7):
            assert parameter.value(parameter.place(value)) == pytest.approx(value, rel=1e-14)
    alone = Parameter("c", 0.7, 0.7)
    assert alone.place(0.7) == 0.0 and abs(alone.place(0.7001)) > 1


@pytest.mark.parametrize(
    "words, said",
    [
        (("width", 0.02, 0.01), "Parameter 'width': range 0.02 to 0.01 ('linear') must rise"),
        (("width", -0.02, 0.01, "log"), "be positive on a log scale"),
        (("width", 0.02, 0.03, "lin"), '"linear" or "log"'),
        (("width", math.nan, 0.01), "low = nan is not finite"),
        (("width", 0.01, "0.02"), "high = '0.02' is not a number"),
        ((3, 0.01, 0.02), "have a name"),
    ],
)
def test_what_is_no_range_is_refused_where_it_is_said(words, said):
    with pytest.raises(SceneError, match=re.escape(said)):
        Parameter(*words)


def test_rotation_vectors_invert_the_exponential():
    v = np.random.default_rng(2).uniform(-1.5, 1.5, (50, 3))
    v[0], v[1] = 0.0, 1e-9
    np.testing.assert_allclose(rotation_vectors(Rotation.from_rotvec(v).as_matrix()), v, atol=1e-13)


def test_chain_of_a_circular_arc():
    amplitudes = np.zeros(12)
    amplitudes[7] = 1.2
    found = chain_rotations(amplitudes, (4, 3, 5), 3)
    np.testing.assert_allclose(found[:, 2], [0.2, 0.6, 1.0, 0.4, 0.8], atol=1e-13)
    np.testing.assert_allclose(found[:, :2], 0.0, atol=1e-14)


def test_chain_of_a_helix():
    amplitudes = np.zeros(12)
    amplitudes[[0, 4, 7]] = 0.5, 0.3, 0.8
    found = chain_rotations(amplitudes, (4, 3, 5), 4)
    np.testing.assert_allclose(
        found[4:], [[0.125, 0.075, 0.2], [0.25, 0.15, 0.4], [0.375, 0.225, 0.6]], atol=1e-12
    )


def test_longer_chain_takes_integrals_and_the_known_difference():
    powers = np.arange(5)[:, None]
    amplitudes = np.zeros((1, 12, 5))
    amplitudes[0, 7, 1] = 1.0
    base = {"powers": powers, "motion_range": np.array([[-1.0, 1.0]]), "orders": (4, 3, 5)}
    interface = np.zeros((6, 5))
    strain = JointFunctions(
        "strain", functions=Functions(interface, np.zeros((0, 6, 5)), amplitudes=amplitudes), **base
    )
    long = extend_chain(strain, 10)
    np.testing.assert_allclose(long.at([0.8], "rotations")[0, 10:, 2], 0.08 * np.arange(1, 10), atol=1e-12)
    # a trained chain of 2 elements off by a known amount: a quarter of it remains with 4 elements
    rotations = np.zeros((1, 3, 3, 5))
    rotations[0, :, 2, 1] = 0.25, 0.75, 0.5
    rotations[0, 2, 2, 3] = 0.04
    other = interface.copy()
    other[3, 2] = 0.02
    known = JointFunctions(2, functions=Functions(other, np.zeros((0, 6, 5)), rotations=rotations), **base)
    corrected = extend_chain(strain, 4, known=known)
    assert corrected.at([1.0])[3] == pytest.approx(0.005)
    np.testing.assert_allclose(
        corrected.at([1.0], "rotations")[0, 4:, 2], [0.25 + 0.0075, 0.5 + 0.01, 0.75 + 0.0075], atol=1e-12
    )
    assert corrected.mesh == 4


def test_a_record_serves_chains_longer_than_its_longest(record):
    functions = record.contract({"angle": 0.6, "ratio": 1.0}, 12)
    assert functions.rotations.shape == (2, 23, 3, 5) and functions.blocks.shape == (1, 6, 5)


def test_chain_of_a_rod_bent_and_twisted_unevenly():
    """Curvatures that do not commute, against R' = R [curvature]x integrated in small steps."""
    orders = (3, 2, 4)
    amplitudes = np.array([0.5, -0.8, 0.3, 0.4, 0.9, 0.6, -1.1, 0.7, 0.2])

    def slope(s, R):
        k = [legval(2 * s - 1, a) for a in np.split(amplitudes, [3, 5])]
        spin = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        return (R.reshape(3, 3) @ spin).ravel()

    stops = np.arange(1, 4) / 4
    exact = solve_ivp(slope, (0, 1), np.eye(3).ravel(), t_eval=stops, rtol=1e-12, atol=1e-13).y.T
    wanted = Rotation.from_matrix(exact.reshape(3, 3, 3)).as_rotvec()
    np.testing.assert_allclose(chain_rotations(amplitudes, orders, 4)[4:], wanted, atol=2e-6)
