"""Functions of time: rates against differences, jumps where one-sided rates differ, files, and what is refused."""

import math

import numpy as np
import pytest

import ksd
from ksd.errors import SceneError
from ksd.scene.functions_of_time import as_function_of_time, function_of_table, table_of_function

FUNCTIONS = {
    "ramp": ksd.Ramp("20 ms", delay=0.003),
    "straight": ksd.Ramp(0.02, straight=True, start=2.0, end=-1.0),
    "cycloid": ksd.Cycloid("5 mm", duration="50 ms", start="1 mm", delay="10 ms"),
    "trapezoid": ksd.Trapezoid(0.005, duration=0.05, rise="10 ms"),
    "triangle": ksd.Trapezoid(0.005, duration=0.05, rise=0.025),
    "half_sine": ksd.HalfSine(50.0, duration="11 ms", delay=0.002),
    "sine": ksd.Sine("1 mm", frequency_Hz="20 Hz", phase="30 deg", offset="2 mm"),
    "table": ksd.TimeTable([("0 s", 0), ("10 ms", 1), ("15 ms", 0.5)]),
    "unheld": ksd.TimeTable([(0.002, 1.0), (0.01, 2.0)], held=False),
    "smooth": ksd.TimeTable([(0, 0), (0.01, 1), (0.015, 0.5), (0.04, 3.0)], smooth=True),
    "step": ksd.Step(3.0, start=1.0, delay=0.01),
    "formula": as_function_of_time("1 - exp(-t / 5 ms)", "load"),
    "sum": ksd.Cycloid(1.0, duration=0.05) + ksd.Cycloid(-1.0, duration=0.05, delay=0.06),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_rates_are_derivatives(name):
    f, h = FUNCTIONS[name], 1e-6
    for t in (0.0047, 0.0131, 0.0317, 0.0688):
        rates = f.rates(t)
        assert rates[0] == pytest.approx((f(t + h) - f(t - h)) / (2 * h), rel=1e-6, abs=1e-8)
        for k in (1, 2):
            differences = (f.rates(t + h)[k - 1] - f.rates(t - h)[k - 1]) / (2 * h)
            size = max(abs(rates[k]), abs(f.rates(t)[k - 1]) / 1e-3)
            assert rates[k] == pytest.approx(
                differences, abs=(1e-3 * size + 0.5) if name == "formula" else 1e-6 * size + 1e-12
            )
    assert np.allclose(f(np.linspace(0, 0.1, 7)), [f(float(t)) for t in np.linspace(0, 0.1, 7)], atol=0)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_jumps_are_where_a_derivative_jumps(name):
    f, h = FUNCTIONS[name], 1e-7
    scale = max(abs(f(t)) for t in np.linspace(0, 0.1, 50))
    for at, order in f.jumps:
        before, after = [(f(at + s * h), *f.rates(at + s * h)) for s in (-1, 1)]
        change = np.abs(np.subtract(after, before)) / (scale * 1e2 ** np.arange(4))
        assert change[order] > 1e-3 and (change[:order] < 1e-4).all()
    grid = np.linspace(1e-4, 0.1, 733)
    away = [t for t in grid if all(abs(t - at) > 2e-4 for at, _ in f.jumps)]
    jumped = [abs(f.rates(t + h)[0] - f.rates(t - h)[0]) / (scale * 1e2) for t in away]
    assert max(jumped) < 1e-3


def test_values_at_ends_and_before_a_step():
    assert FUNCTIONS["cycloid"](0.0) == 1e-3 and FUNCTIONS["cycloid"](0.1) == pytest.approx(5e-3)
    assert FUNCTIONS["step"](0.01) == 3.0 and FUNCTIONS["step"].before(0.01) == 1.0
    assert ksd.Step().before(0.0) == 0.0 and ksd.Ramp(1.0).before(0.0) == 0.0
    assert ksd.Ramp(0.02)(0.01) == pytest.approx(0.5) and ksd.Ramp(0.02, straight=True)(0.005) == 0.25
    assert ksd.Trapezoid(3.0, duration=3.0)(1.5) == pytest.approx(1.5)
    assert ksd.Trapezoid(3.0, duration=3.0).rates(1.5)[0] == pytest.approx(1.5)
    assert as_function_of_time("1 - exp(-t / 5 ms)", "load")(0.005) == pytest.approx(1 - math.exp(-1))
    assert FUNCTIONS["cycloid"].dimension == "length" and FUNCTIONS["ramp"].dimension is None
    # a spline at rest at both ends, of steady acceleration
    smooth = FUNCTIONS["smooth"]
    assert smooth.rates(0.0)[0] == 0.0 and smooth.rates(0.04 - 1e-12)[0] == pytest.approx(0, abs=1e-6)
    for knot in (0.01, 0.015):
        assert smooth.rates(knot)[1] == pytest.approx(smooth.rates(knot - 1e-10)[1], rel=1e-5)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_files(name):
    f = FUNCTIONS[name]
    again = function_of_table(table_of_function(f, "load"), "load")
    t = np.linspace(0, 0.1, 57)
    assert np.array_equal(again(t), f(t)) and again.jumps == f.jumps


def noisy(t, calls=[]):  # noqa: B006
    calls.append(t)
    return len(calls)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: ksd.Ramp("20 mm"), "a time is expected"),
        (lambda: ksd.Ramp(0.0), "must be positive"),
        (lambda: ksd.Ramp(1.0, delay=-1.0), "zero or positive"),
        (lambda: ksd.Cycloid("5 mm"), "duration"),
        (lambda: ksd.Cycloid("5 mm", duration=1.0, start="3 deg"), "different dimensions"),
        (lambda: ksd.Trapezoid(1.0, duration=1.0, rise=0.6), "more than half"),
        (lambda: ksd.Sine(1.0, frequency_Hz="-3 Hz"), "must be positive"),
        (lambda: ksd.TimeTable([(0, 0)]), "two points or more"),
        (lambda: ksd.TimeTable([(0, 0), (0, 1)]), "times that rise"),
        (lambda: ksd.TimeTable([(0, 0, 0), (0, 1, 0)]), "must be points"),
        (lambda: as_function_of_time(noisy, "load 'p'"), "another value each time"),
        (lambda: as_function_of_time(lambda t: 1 / t, "load 'p'"), "raises ZeroDivisionError at t = 0 s"),
        (lambda: as_function_of_time(lambda t: "one", "load 'p'"), "not a number"),
        (lambda: as_function_of_time(lambda t: np.ones(2), "load 'p'"), "not a number"),
        (lambda: as_function_of_time(lambda t: math.nan, "load 'p'"), "not finite"),
        (lambda: as_function_of_time("1 - exp(-x)", "load 'p'"), "there is no x"),
        (lambda: as_function_of_time(None, "load 'p'"), "give a function of time"),
        (lambda: as_function_of_time(True, "load 'p'"), "give a function of time"),
        (lambda: ksd.Ramp(1.0) + 3, "cannot be added"),
        (lambda: function_of_table({"ramp": 1, "cycloid": 2}, "load 'p'"), "write one of"),
        (lambda: function_of_table({"ramp": 1, "ending": 2}, "load 'p'"), "ending"),
        (lambda: function_of_table({"formula": "t", "delay": 2}, "load 'p'"), "does not belong"),
        (lambda: function_of_table(3, "load 'p'"), "write a table"),
        (
            lambda: table_of_function(as_function_of_time(math.sin, "load 'p'"), "load 'p'"),
            "cannot be written",
        ),
    ],
)
def test_refused(made, words):
    with pytest.raises(SceneError) as caught:
        made()
    assert words in str(caught.value) and "\n" not in str(caught.value)
