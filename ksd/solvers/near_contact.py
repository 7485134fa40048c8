"""The equilibrium with contact that another model of a scene has next to a pose: on a finer mesh, or with another effect."""

from __future__ import annotations

import math

import numpy as np

from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import RTOL
from ksd.solvers.contact_newton import ContactNewton
from ksd.solvers.contact_state import Touched
from ksd.solvers.result import Result
from ksd.solvers.steps import MAX_TURN_PER_STEP, Stop

MAX_ITERATIONS = 20
"""Newton iterations from the pose, at most; three or four are usual."""


def equilibrium_in_contact(pose: Result, model: Model, state: State) -> tuple[Model, State, Touched] | None:
    """Model with the contact forces as loads, state and contacts of the equilibrium next to a pose in contact, None where
    there is none. model: of the same nodes; state: of it near the pose, overwritten.

    It is that of the last step to the pose: slip is measured from where the pose measures it.
    """
    touched = pose.touched
    assert touched is not None
    newton = ContactNewton(touched.what, model, lambda model: model.arrays.copy())
    newton.begin(touched.forces)
    newton.cut(model, state)
    values = np.array([*model.targets(pose.targets), *touched.values.values()])
    words = RTOL, MAX_ITERATIONS, MAX_TURN_PER_STEP, math.inf
    reason, *_ = newton.newton(state, values, pose.load_factor, *words, before=touched.before)
    if reason != Stop.CONVERGED:
        return None
    model, touched = newton.found(touched.values)
    return model, state, touched
