"""Checks of the arguments of sweeps, batches, gradients and jobs before any solve; each raises SceneError."""

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
from ksd.solvers.solver import checked_accuracy, given_values


def drive_value_arrays(
    targets: Any, drives: Mapping[str, Any], call: Callable[..., Any]
) -> dict[str, np.ndarray]:
    """Drive values [m or rad] by name as arrays (n,), from a mapping and from keywords.

    call: the public function, whose parameter names are suggested where a keyword is misspelt. Raises SceneError.
    """
    return {n: _drive_value_array(n, v, call) for n, v in given_values(targets, drives).items()}


def _drive_value_array(name: str, given: Any, call: Callable[..., Any]) -> np.ndarray:
    """The values (n,) of one drive. Raises SceneError."""
    try:
        values = np.atleast_1d(np.asarray(given))
    except ValueError:
        # nested sequences of different lengths
        values = np.empty((0, 0))
    numeric = values.dtype.kind in "iuf" and values.ndim == 1 and values.size > 0
    if not numeric or not np.all(np.abs(values.astype(float)) <= MAX_MAGNITUDE):
        meant = python_unit_hint(given)
        hint = f"; {meant}" if meant else similar_name_hint(name, _keyword_names(call), cutoff=0.8)
        raise SceneError(
            f"drive values {name} = {show(given)}: give finite numbers in a row [m or rad]{hint}"
        )
    return values.astype(float)


def check_drives(scene: Scene, names: Sequence[str], call: Callable[..., Any]) -> None:
    """Raise SceneError for a value without a drive and for a drive without a value."""
    known = [d.name for d in scene.drives]
    for n in names:
        if n not in known:
            raise SceneError(
                f"'{n}' is not a drive of '{scene.name}', whose drives are {', '.join(known) or 'none'}"
                f"{similar_name_hint(n, [*known, *_keyword_names(call)])}"
            )
    for n in known:
        if n not in names:
            raise SceneError(f"drive '{n}' of '{scene.name}' has no value; give one, for example {n}=0.0.")


def _keyword_names(function: Callable[..., Any]) -> list[str]:
    """Names of the parameters of a function that can be given as keywords."""
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [p.name for p in inspect.signature(function).parameters.values() if p.kind in kinds]


def check_design_parameters(
    mechanism: Callable[..., Any], designs: Sequence[Any], argument: str = "designs"
) -> None:
    """Raise SceneError where a set of parameters does not fit the function that returns the mechanism.

    argument: name of the argument that holds the sets, for the message.
    """
    try:
        signature = inspect.signature(mechanism)
    except ValueError:
        # functions written in C have no signature
        return
    takes_all = any(p.kind is p.VAR_KEYWORD for p in signature.parameters.values())
    name = getattr(mechanism, "__name__", "the function")
    known = set(_keyword_names(mechanism))
    needed = [n for n, p in signature.parameters.items() if p.default is p.empty and n in known]
    for design in designs:
        if not isinstance(design, Mapping) or not all(isinstance(n, str) for n in design):
            raise SceneError(
                f"{argument}: {show(design)} is not a set of parameters by name, such as {{'thickness': 1e-3}}"
            )
        for given in design:
            if given not in known and not takes_all:
                raise SceneError(f"{argument}: {name} has no parameter '{given}'{name_hint(given, known)}")
        for parameter in needed:
            if parameter not in design:
                raise SceneError(
                    f"{argument}: parameter '{parameter}' of {name} has no value in {show(dict(design))}"
                )


def check_executor(executor: Any) -> None:
    """Raise SceneError for what is neither an executor nor None."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise SceneError(f"executor = {show(executor)}: give a concurrent.futures.Executor, or None")


def submit_task(executor: Executor, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
    """Submit function(*arguments) to an executor.

    Raises SceneError where worker processes cannot receive the arguments; the pool itself would raise an error of pickle
    only when the result is read.
    """
    if isinstance(executor, ProcessPoolExecutor):
        try:
            pickle.dumps(arguments)
        except (pickle.PicklingError, AttributeError, TypeError) as reason:
            raise SceneError(
                f"worker processes cannot be sent what they are to work on ({reason}): define design functions and rules by "
                "name at the top level of a file that can be imported, or give a ThreadPoolExecutor"
            ) from reason
    return executor.submit(function, *arguments)


def check_solve_options(
    *,
    mesh: Any,
    relinearisations: Any,
    accuracy: float | None = None,
    method: Any = None,
    methods: Sequence[str] = (),
    **flags: Any,
) -> None:
    """Raise SceneError for a wrong mesh, number of relinearisation steps, accuracy, method or flag.

    methods: the methods to choose from; flags: values by name that must be true or false.
    """
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
    for name, value in flags.items():
        boolean(value, name)
