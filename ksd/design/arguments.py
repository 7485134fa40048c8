"""Checks of what `sweep` and `batch` are given, before any solve: each raises SceneError with one sentence."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from typing import Any

import numpy as np

from ksd.checks import (
    MAX_MAGNITUDE,
    boolean,
    name_hint,
    python_unit_hint,
    show,
    similar_name_hint,
    whole_number,
)
from ksd.errors import SceneError
from ksd.model.mesh import Mesh
from ksd.scene import Scene
from ksd.solve.solver import checked_accuracy, given_values


def drive_value_arrays(
    targets: Any, drives: Mapping[str, Any], call: Callable[..., Any]
) -> dict[str, np.ndarray]:
    """Drive values [m or rad] by name as arrays (N,); call: `sweep` or `batch`, for which a name may have been meant."""
    return {n: _row(n, v, call) for n, v in given_values(targets, drives).items()}


def _row(name: str, given: Any, call: Callable[..., Any]) -> np.ndarray:
    """Drive values (n,) as given to a call; raises SceneError."""
    try:
        found = np.atleast_1d(np.asarray(given))
    except ValueError:
        # rows of several lengths
        found = np.empty((0, 0))
    usual = found.dtype.kind in "iuf" and found.ndim == 1 and found.size > 0
    if not usual or not np.all(np.abs(found.astype(float)) <= MAX_MAGNITUDE):
        meant = python_unit_hint(given)
        hint = f"; {meant}" if meant else similar_name_hint(name, _words_of(call), cutoff=0.8)
        raise SceneError(
            f"drive values {name} = {show(given)}: give finite numbers in a row [m or rad]{hint}"
        )
    return found.astype(float)


def check_drives(scene: Scene, names: Sequence[str], call: Callable[..., Any]) -> None:
    """SceneError where a value has no drive, or a drive no value."""
    known = [d.name for d in scene.drives]
    for n in names:
        if n not in known:
            raise SceneError(
                f"'{n}' is not a drive of '{scene.name}', whose drives are {', '.join(known) or 'none'}"
                f"{similar_name_hint(n, [*known, *_words_of(call)])}"
            )
    for n in known:
        if n not in names:
            raise SceneError(f"drive '{n}' of '{scene.name}' has no value; give one, for example {n}=0.0.")


def _words_of(function: Callable[..., Any]) -> list[str]:
    """Names of the parameters that are given by name."""
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [p.name for p in inspect.signature(function).parameters.values() if p.kind in kinds]


def check_design_parameters(
    mechanism: Callable[..., Any], designs: Sequence[Any], word: str = "designs"
) -> None:
    """SceneError where a set of parameters, of this word of a call, does not fit the function that draws the mechanism."""
    try:
        signature = inspect.signature(mechanism)
    except ValueError:
        # functions written in C do not tell
        return
    takes_all = any(p.kind is p.VAR_KEYWORD for p in signature.parameters.values())
    name = getattr(mechanism, "__name__", "the function")
    needed = [
        p.name
        for p in signature.parameters.values()
        if p.default is p.empty and p.name in _words_of(mechanism)
    ]
    known = set(_words_of(mechanism))
    for design in designs:
        if not isinstance(design, Mapping) or not all(isinstance(n, str) for n in design):
            raise SceneError(
                f"designs: {show(design)} is not a set of parameters by name, such as {{'thickness': 1e-3}}"
            )
        for said in design:
            if said not in known and not takes_all:
                raise SceneError(f"{word}: {name} has no parameter '{said}'{name_hint(said, known)}")
        for said in needed:
            if said not in design:
                raise SceneError(f"{word}: parameter '{said}' of {name} has no value in {show(dict(design))}")


def check_executor(executor: Any) -> None:
    """SceneError for what is no executor, nor None."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise SceneError(f"executor = {show(executor)}: give a concurrent.futures.Executor, or None")


def submit_task(executor: Executor, function: Callable[..., Any], *said: Any) -> Future[Any]:
    """function(*said) in a worker. SceneError where processes cannot be sent what it takes: the pool would tell as an error
    of pickle, when its answer is asked for."""
    if isinstance(executor, ProcessPoolExecutor):
        try:
            pickle.dumps(said)
        except (pickle.PicklingError, AttributeError, TypeError) as reason:
            raise SceneError(
                f"worker processes cannot be sent what they are to work on ({reason}): define design functions and rules by "
                "name at the top level of a file that can be imported, or give a ThreadPoolExecutor"
            ) from reason
    return executor.submit(function, *said)


def check_solve_options(
    *,
    mesh: Any,
    relinearisations: Any,
    accuracy: float | None = None,
    method: Any = None,
    methods: Sequence[str] = (),
    **truths: Any,
) -> None:
    """SceneError for a mesh, number of passes, accuracy, method or truth value that is none."""
    if method is not None and method not in methods:
        raise SceneError(
            f"method = {show(method)}: choose one of {', '.join(methods)}{similar_name_hint(method, methods)}"
        )
    if mesh is not None and not isinstance(mesh, Mesh):
        raise SceneError(
            f"mesh = {show(mesh)}: give a ksd.Mesh, for example ksd.Mesh('corotational', elements=5)."
        )
    if whole_number(relinearisations, "relinearisations", least=0) > 50:
        raise SceneError(
            f"relinearisations = {relinearisations}: between 0 and 50 relinearisation steps are possible"
        )
    checked_accuracy(accuracy)
    for what, value in truths.items():
        boolean(value, what)
