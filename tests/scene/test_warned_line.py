"""Warnings name the line of the user."""

import inspect

import numpy as np
import pytest
from scipy.optimize import approx_fprime

import ksd
from ksd.checks import warn_user


def test_a_warning_names_the_line_of_the_user_behind_a_library():
    """A library between the user and the package, here scipy, which calls a function of the package back."""
    with pytest.warns(ksd.SceneWarning) as caught:
        line = inspect.currentframe().f_lineno + 1
        approx_fprime(np.zeros(1), _warning_inside_the_package(), 1e-8)
    assert {(w.filename, w.lineno) for w in caught} == {(__file__, line)}


def _warning_inside_the_package():
    """A function of x that warns, and counts as one of the package."""
    source = "def doubt(x):\n    warn_user('doubtful', category)\n    return 0.0\n"
    room = {"warn_user": warn_user, "category": ksd.SceneWarning}
    exec(compile(source, inspect.getfile(warn_user), "exec"), room)
    return room["doubt"]
