"""One prepared solver called from several threads."""

import sys
import threading

import numpy as np
import pytest
from scenes import fourbar, slider

import ksd

CALLS = 600


@pytest.mark.parametrize("scene", [fourbar(), slider()], ids=["plane", "space"])
def test_answers_are_those_of_one_thread(scene):
    solver = ksd.prepare(scene, planar=scene.name == "fourbar")
    one = "top" if scene.name == "fourbar" else "turn"
    others = {} if scene.name == "fourbar" else {"stroke": 1e-3}
    values = np.linspace(0.02, 0.1, CALLS)

    def forces(some):
        return [solver({one: float(v)} | others, method="reduced").forces[one] for v in some]

    expected = forces(values)
    found = {}
    # as often as can be, so that few calls show it
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        both = [
            threading.Thread(target=lambda k=k: found.update({k: forces(values[k::2])})) for k in range(2)
        ]
        for thread in both:
            thread.start()
        for thread in both:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    wrong = sum(found[k][i] != expected[2 * i + k] for k in range(2) for i in range(CALLS // 2))
    assert wrong == 0


def test_a_second_thread_waits_until_the_first_has_its_answer(monkeypatch):
    solver = ksd.prepare(fourbar())
    solver(top=0.1)
    inside, go_on, count = threading.Event(), threading.Event(), []
    once = solver._solve

    def slow(*words, **ways):
        count.append(threading.get_ident())
        inside.set()
        assert go_on.wait(60)
        return once(*words, **ways)

    monkeypatch.setattr(solver, "_solve", slow)
    first = threading.Thread(target=lambda: solver(top=0.1))
    second = threading.Thread(target=lambda: solver(top=0.05))
    first.start()
    assert inside.wait(60)
    second.start()
    second.join(0.2)
    waiting = second.is_alive() and len(count) == 1
    go_on.set()
    first.join(60)
    second.join(60)
    assert waiting and len(count) == 2
