"""What must hold for every scene, file and call that `strategies` can think of."""

import json
import math
import signal
import warnings
from contextlib import contextmanager

import numpy as np
from strategies import CALLS, _started

import ksd
from ksd.errors import KsdError, SceneWarning

HANG = 120
"""Seconds of a single example that count as hanging."""


@contextmanager
def strictly():
    """Warnings are errors, and an example that hangs is one."""

    def hung(*_):
        raise AssertionError(f"no answer in {HANG} s")

    previous = signal.signal(signal.SIGALRM, hung)
    signal.alarm(HANG)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)


def is_sentence(error):
    """One line that says something; of a scene file, one for each of its mistakes, all of them in the message."""
    for said in getattr(error, "mistakes", (str(error),)):
        assert len(said) > 15 and "\n" not in said, repr(said)


def check_answer(found):
    """Nothing that converged holds a number that is none."""
    assert found.converged
    for name in ("x", "R", "inner", "multiplier"):
        assert np.isfinite(getattr(found.motion, name)).all(), name
    assert all(math.isfinite(f) for f in found.forces.values())
    numbers = found.as_dict()
    json.dumps(numbers, allow_nan=False)
    for table in ("links", "leaves"):
        for row in numbers[table].values():
            assert all(v is not None for values in row.values() for v in values), (table, row)


def solved(scene, targets, **options):
    """The answer of a scene that holds together, or None where it is refused in a sentence."""
    with strictly():
        try:
            found = ksd.solve(scene, targets, **options)
        except KsdError as error:
            is_sentence(error)
            return None
        check_answer(found)
        return found


def called(name, words):
    """Whether a call with junk in it went well; else it is refused in a sentence."""
    with strictly():
        started = _started()
        try:
            CALLS[name](started, words)
            started[0].scene()
        except KsdError as error:
            is_sentence(error)
            return False
        return True


def loaded(content, path):
    """Whether a scene file was accepted; else it is refused in a sentence that names the file."""
    path.write_bytes(content)
    with strictly():
        # random numbers are rarely those of a flexure
        warnings.simplefilter("ignore", SceneWarning)
        try:
            mechanism, _, _ = ksd.load_scene(path)
            mechanism.scene()
        except KsdError as error:
            is_sentence(error)
            return False
        return True
