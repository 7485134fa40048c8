"""Equilibria at slightly changed parameters: gradients of answers by parameters of a design, drives and loads.

At the equilibrium x0 of a pose, for a parameter p at p0 +- h: pack the arrays of the changed design with the effects, mesh
and orders of p0, take Newton steps from x0, evaluate the question there, and take the central difference.
One step N(x, p) = x - K^-1 R has dN/dp = -K^-1 dR/dp, the exact derivative of the equilibrium, inner unknowns and
multipliers included; a second one removes its rounding and the error left by the curvature of that path. The second side of
a parameter starts opposite to the first, where one step does both. No effect, mesh or order is chosen anew at p0 +- h, so
answers do not jump: a curved leaf that would take more modes on one side keeps those it has.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np

from ksd.answers.tangent import exact_tangent_arrays
from ksd.checks import name_hint, number, show, without_whole_checks
from ksd.errors import DESIGN_ERRORS, ConvergenceError, SceneError, reason_text
from ksd.model.arrays import State, make_workspace
from ksd.model.chosen_effects import apply_effects, with_conditions
from ksd.model.compile import Model, model_of_design
from ksd.model.mesh import Mesh, MixedMesh
from ksd.model.newton import take_newton_step
from ksd.model.scene_layout import split_scene
from ksd.model.template import Template, template_of
from ksd.scene.leaf import LeafCondition
from ksd.solvers.error import equilibrium_near
from ksd.solvers.result import Solved
from ksd.solvers.steps import FAST_METHODS

RELATIVE_STEP = 3e-5
"""Step of a parameter relative to its value, for central differences."""
FOURTH_ORDER_STEP = 3e-4
"""The same where differences at one and two steps are combined to fourth order: ten times less rounding."""
NEWTON_STEPS = 2
"""Newton steps to the equilibrium at a changed parameter. After one, even refined, stresses of a butterfly hinge are 2 % off
at a step of FOURTH_ORDER_STEP, stiffnesses .2 %; 3e-5 at RELATIVE_STEP."""
MAX_STEP_RATIO = 0.05
"""Largest size of the last Newton step relative to the first."""
AXES = "xyz"


@dataclass(frozen=True)
class GradientParameter:
    """A number that a pose depends on.

    scale: magnitude to which its steps are relative; scene: makes the scene at another value; None for the value of the
    drive `name`; is_central: whether the scenes of opposite steps are on both sides of the value.
    """

    name: str
    value: float
    scale: float
    scene: Callable[[float], Any] | None = None
    is_central: bool = True

    def one_sided(self, steps: Sequence[float]) -> GradientParameter:
        """The parameter, whose scenes are moved to one side where those at `steps` cannot all be built: differences are then
        those at twice the largest step from the value. Raises SceneError where neither side can be built."""
        make, reasons = self.scene, []
        if make is None:
            return self
        for shift in (0.0, 2.0 * min(steps) * self.scale, 2.0 * max(steps) * self.scale):
            try:
                for step in steps:
                    make(self.value + step * self.scale + shift)
            except SceneError as reason:
                reasons.append(reason)
                continue
            return (
                replace(self, scene=partial(_moved_scene, make, shift), is_central=False) if shift else self
            )
        raise reasons[0]

    def targets_at(self, targets: Mapping[str, float], value: float) -> dict[str, float]:
        """Drive values where the parameter has this value."""
        return {**targets, self.name: value} if self.scene is None else dict(targets)


@dataclass(frozen=True)
class _FixedOrdersMesh(Mesh):
    """A mesh whose orders and points no leaf raises."""

    def modes(self, orders: tuple[int, int, int], points: int) -> tuple[tuple[int, int, int], int]:
        """The orders and points of the mesh, independent of the leaf."""
        return self.orders, self.points


def parameters_of(
    scene: Any,
    targets: Mapping[str, float],
    *,
    size: float,
    design: Callable[..., Any] | None = None,
    at_design: Mapping[str, Any] | None = None,
    by: Iterable[str] | str | None = None,
    sizes: Mapping[str, float] | None = None,
) -> tuple[GradientParameter, ...]:
    """The parameters named in `by`: of `at_design`, drives, and components of loads ("payload_force_z", "payload_moment_x").

    Without `by` all numbers of the design, without a design all drives. scene, targets: at which gradients are taken; size
    [m]: of the mechanism, the scale of a design number or displacement of zero that `sizes` does not name. Raises
    SceneError for unknown names.
    """
    found: dict[str, GradientParameter] = {}
    given = {} if at_design is None else dict(at_design)
    if given and design is None:
        raise SceneError(
            "at_design = ... needs the function of these parameters that returns the mechanism: design=..."
        )
    sizes = {} if sizes is None else dict(sizes)

    def add(name: str, value: float, default: float, scene_at: Callable[[float], Any] | None) -> None:
        scale = abs(number(sizes[name], f"sizes: {name}")) if name in sizes else abs(value) or default
        found[name] = GradientParameter(name, value, scale or default, scene_at)

    # counts are varied only where they are named
    counts = [n for n, v in given.items() if isinstance(v, int | np.integer)]
    numbers = {n: float(v) for n, v in given.items() if _is_number(v)}
    for name, value in numbers.items():
        assert design is not None
        add(name, value, size, partial(_design_scene, design, given, scene, name))
    drives = [d.name for d in scene.drives]
    for name in drives:
        if name not in found:
            add(name, float(targets[name]), size if _is_displacement(scene, name) else 1.0, None)
    loads = []
    for k, load in enumerate(scene.loads):
        for kind in ("force", "moment"):
            for axis, letter in enumerate(AXES):
                value = getattr(load, kind)[axis]
                magnitude = math.hypot(*getattr(load, kind)) or 1.0
                loads.append(f"{load.name}_{kind}_{letter}")
                add(loads[-1], value, magnitude, partial(_load_scene, scene, k, kind, axis))
    for k, line in enumerate(scene.line_loads):
        for kind in ["force"] * line.has_force + ["moment"] * line.has_moment:
            first, last = getattr(line, kind), getattr(line, f"end_{kind}")
            for axis, letter in enumerate(AXES):
                loads.append(f"{line.name}_{kind}_{letter}")
                magnitude = math.hypot(*first, *last) or 1.0
                add(loads[-1], first[axis], magnitude, partial(_line_load_scene, scene, k, kind, axis))
    for k, press in enumerate(scene.pressures):
        loads.append(press.name)
        add(press.name, press.pressure, abs(press.pressure) or 1.0, partial(_pressure_scene, scene, k))
    names = (by,) if isinstance(by, str) else by
    if names is None:
        names = [n for n in numbers if n not in counts] or drives
    known, names = [*numbers, *drives, *loads], list(names)
    if not names:
        raise SceneError(
            f"there is nothing to take a gradient by: name it, by=(...), of {', '.join(known) or 'no parameters'}"
        )
    for name in (*names, *sizes):
        if name in given and name not in numbers:
            raise SceneError(
                f"parameter '{name}' = {show(given[name])} is no number, so nothing has a gradient by it"
            )
        if name not in found:
            raise SceneError(
                f"there is no gradient by '{name}'; parameters are {', '.join(known) or 'none'}{name_hint(str(name), known)}"
            )
    return tuple(found[n] for n in names)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _is_displacement(scene: Any, drive: str) -> bool:
    """Whether a drive prescribes a displacement."""
    return any(t.kind == "translation" for d in scene.drives if d.name == drive for t in d.terms)


def _design_scene(
    design: Callable[..., Any], given: Mapping[str, Any], loaded: Any, name: str, value: float
) -> Any:
    """The scene of the design with another value of a parameter, with the loads that the scene `loaded` has in addition."""
    try:
        with without_whole_checks():
            drawn = design(**{**given, name: value})
            scene = drawn.scene() if hasattr(drawn, "scene") else drawn
            if not hasattr(scene, "fingerprint"):
                raise SceneError(f"{show(drawn)} is no mechanism")
    except DESIGN_ERRORS as reason:
        raise SceneError(
            f"there is no gradient by '{name}': the design cannot be built at {value:.9g}, next to the given value: "
            f"{reason_text(reason)}"
        ) from reason
    # load cases come after the loads of the design itself
    extra = loaded.loads[len(scene.loads) :]
    return replace(scene, loads=(*scene.loads, *extra)) if extra else scene


def _moved_scene(make: Callable[[float], Any], shift: float, value: float) -> Any:
    """The scene that `make` returns at a value moved by `shift`."""
    return make(value + shift)


def _load_scene(scene: Any, k: int, kind: str, axis: int, value: float) -> Any:
    """The scene with another value of one component of load k."""
    vector = list(getattr(scene.loads[k], kind))
    vector[axis] = value
    load = replace(scene.loads[k], **{kind: tuple(vector)})
    return replace(scene, loads=(*scene.loads[:k], load, *scene.loads[k + 1 :]))


def _line_load_scene(scene: Any, k: int, kind: str, axis: int, value: float) -> Any:
    """The scene with another value of one component of the force or moment of line load k, at both ends by as much."""
    line, keys = scene.line_loads[k], {"force": ("force", "to"), "moment": ("moment", "to_moment")}[kind]
    ends: dict[str, Any] = {key: getattr(line, key) for key in keys}
    change = value - ends[kind][axis]
    for key, vector in ends.items():
        if vector is not None:
            ends[key] = (*vector[:axis], vector[axis] + change, *vector[axis + 1 :])
    changed = replace(line, **ends)
    return replace(scene, line_loads=(*scene.line_loads[:k], changed, *scene.line_loads[k + 1 :]))


def _pressure_scene(scene: Any, k: int, value: float) -> Any:
    """The scene with another value of pressure k."""
    changed = replace(scene.pressures[k], pressure=value)
    return replace(scene, pressures=(*scene.pressures[:k], changed, *scene.pressures[k + 1 :]))


class PerturbedEquilibria:
    """Equilibria of one scene with each parameter at value + step * scale, for every one of the relative `steps`."""

    def __init__(self, steps: Sequence[float] = (RELATIVE_STEP, -RELATIVE_STEP)) -> None:
        self.steps = tuple(steps)
        self._cached_models: tuple[Model, list[list[Model]]] | None = None
        self._one_sided: dict[str, GradientParameter] = {}

    def __call__(
        self, pose: Solved, parameters: Sequence[GradientParameter]
    ) -> tuple[Solved, list[list[Solved]]]:
        """The equilibrium of a pose, and the perturbed ones by parameter and step.

        Only values of drives may differ from those of the previous call. Raises ConvergenceError where there is no
        equilibrium, SceneError for poses of reduced bodies and for parameters that change more than numbers.
        """
        if not pose.converged or pose.model.bodies:
            why = "holds reduced bodies" if pose.converged else "did not converge"
            raise SceneError(f"this pose {why}: gradients are those of equilibria of leaf springs")
        if self._cached_models is None or self._cached_models[0] is not pose.model:
            self._one_sided = {}
            try:
                found = self._models(pose.model, parameters)
            except SceneError:
                # some design next to this one cannot be built
                own = [p.one_sided(self.steps) for p in parameters]
                self._one_sided = {p.name: p for p in own if not p.is_central}
                if not self._one_sided:
                    raise
                found = self._models(pose.model, own)
            self._cached_models = pose.model, found
        parameters = [self._one_sided.get(p.name, p) for p in parameters]
        start = equilibrium_near(pose) if pose.method in FAST_METHODS else pose.motion
        here, _ = self._equilibrium(pose, pose.model, start, pose.targets)
        return here, self._sides(here, parameters, self._cached_models[1])

    def _sides(
        self, here: Solved, parameters: Sequence[GradientParameter], models: Sequence[Sequence[Model]]
    ) -> list[list[Solved]]:
        """The equilibria next to `here` of models by parameter and step."""
        sides = []
        for parameter, own_models in zip(parameters, models, strict=True):
            own: list[Solved] = []
            first = 0.0
            for step, model in zip(self.steps, own_models, strict=True):
                values = parameter.targets_at(here.targets, parameter.value + step * parameter.scale)
                # steps come in pairs of opposite sign: the second one starts opposite to the first, a Newton step closer
                opposite = len(own) % 2 == 1 and model.has_strain_leaves_only and parameter.is_central
                start = _opposite_state(here.motion, own[-1].motion) if opposite else here.motion
                found, first = self._equilibrium(here, model, start, values, parameter.name, first * opposite)
                own.append(found)
            sides.append(own)
        return sides

    def _models(self, model: Model, parameters: Sequence[GradientParameter]) -> list[list[Model]]:
        """The models with changed parameters, by parameter and step."""
        scenes = [
            p.scene(p.value + s * p.scale) for p in parameters if p.scene is not None for s in self.steps
        ]
        perturbed = iter(perturbed_models(model, scenes))
        return [[model if p.scene is None else next(perturbed) for _ in self.steps] for p in parameters]

    def _equilibrium(
        self,
        pose: Solved,
        model: Model,
        start: State,
        targets: Mapping[str, float],
        name: str = "",
        first: float = 0.0,
    ) -> tuple[Solved, float]:
        """The equilibrium of a model after Newton steps from a state, and the size of the first one.

        name: of the changed parameter; first: size of the first step to the opposite side, which replaces the one here.
        """
        arrays, motion, target = exact_tangent_arrays(model), start.copy(), model.targets(targets)
        work = make_workspace(arrays)
        sizes = [first] if first > 0.0 else []
        while len(sizes) < NEWTON_STEPS:
            sizes.append(take_newton_step(arrays, motion, target, pose.load_factor, work))
        # a hundredth of the negligible size is rounding
        if not sizes[-1] <= MAX_STEP_RATIO * sizes[0] + 0.01:
            where = f"next to this pose, at another '{name}'" if name else "of this pose"
            raise ConvergenceError(
                f"no gradient: Newton steps do not reach the equilibrium {where}; it is near the end of its branch"
            )
        found = type(pose)(
            model, motion, "conventional", dict(targets), pose.steps, negatives=pose.negatives,
            expected_negatives=pose.expected_negatives, load_factor=pose.load_factor,
            joints_near_intended=pose.joints_near_intended,
        )  # fmt: skip
        return found, sizes[0]


def _opposite_state(here: State, side: State) -> State:
    """The state of strain-mode leaf springs as far from `here` as `side`, on the opposite side."""
    R = here.R @ side.R.swapaxes(1, 2) @ here.R
    # all but the rotation matrices are vectors
    return State(*(2 * own - other for own, other in zip(here, side, strict=True)))._replace(R=R)


def perturbed_models(model: Model, scenes: Sequence[Any]) -> list[Model]:
    """Models of changed scenes with the effects, mesh and orders of a model, packed together where possible.

    Raises SceneError for a scene that differs in more than numbers.
    """
    found = _compile_scenes(model, model.mesh, scenes)
    if all(_same_layout(model, other) for other in found):
        return found
    found = _compile_scenes(model, _fixed_orders_mesh(model), scenes)
    if not all(_same_layout(model, other) for other in found):
        raise SceneError(
            "no gradient: a small change of a parameter changes what the mechanism consists of (links, leaf springs, drives "
            "or orders of its leaf springs), not only its numbers"
        )
    return found


def _compile_scenes(model: Model, mesh: Mesh, scenes: Sequence[Any]) -> list[Model]:
    """Models of scenes with the effects of `model`; those of one template are packed together."""
    groups: dict[Template, list[tuple[int, Any, list[float]]]] = {}
    for k, scene in enumerate(scenes):
        plain = scene if model.choice is None else apply_effects(scene, mesh, model.choice)[0]
        if mesh.plate and not model.has_strain_leaves_only:
            plain = _with_secants(plain, model)
        drawing = split_scene(plain, mesh)
        groups.setdefault(template_of(drawing.layout, mesh), []).append((k, plain, drawing.numbers))
    found: dict[int, Model] = {}
    for template, members in groups.items():
        numbers = template.numbers([row for _, _, row in members])
        filled = template(numbers)
        for d, (k, plain, _) in enumerate(members):
            found[k] = model_of_design(
                plain, template, filled, numbers, d, original_scene=scenes[k], choice=model.choice
            )
    return [found[k] for k in range(len(scenes))]


def _with_secants(scene: Any, model: Model) -> Any:
    """The scene with the secants of plate stiffening that the chains of a model have."""
    known, leaves = model.scene.leaf_names(), scene.leaf_names()
    secants = {
        n: replace(leaves[n].condition or LeafCondition(), plate=leaf.condition.plate)
        for n, leaf in known.items()
        if n in leaves and leaf.condition is not None and leaf.condition.plate is not None
    }
    return with_conditions(scene, secants)


def _same_layout(one: Model, other: Model) -> bool:
    """Whether two models have the same parts and unknowns."""
    a, b = one.arrays, other.arrays
    if a.ints is b.ints and one.node_names is other.node_names:
        # of the same template
        return True
    pairs = ((a.members.number, b.members.number), (a.members.inner_at, b.members.inner_at),
             (a.members.kind, b.members.kind), (a.members.node, b.members.node), (a.start, b.start),
             (a.terms.node, b.terms.node), (a.terms.kind, b.terms.kind), (a.loads.node, b.loads.node))  # fmt: skip
    names = (
        one.node_names == other.node_names
        and one.member_names == other.member_names
        and one.drive_names == other.drive_names
        and one.support_names == other.support_names
        and one.spring_names == other.spring_names
    )
    return names and all(np.array_equal(x, y) for x, y in pairs)


def _fixed_orders_mesh(model: Model) -> Mesh:
    """The mesh of a model with the orders that its leaf springs have at present."""
    options = {f.name: getattr(model.mesh, f.name) for f in fields(Mesh)}
    members = model.arrays.members
    names: dict[tuple[int, ...], list[str]] = {}
    for i in model.strain_leaves:
        names.setdefault(tuple(members.number[i].tolist()), []).append(model.member_names[i])
    fixed = tuple(
        (_FixedOrdersMesh(**{**options, "orders": own[:3], "points": own[3]}), tuple(of))
        for own, of in names.items()
    )
    return MixedMesh(**options, others=(*fixed, *getattr(model.mesh, "others", ())))


def answer_derivatives(
    pose: Solved,
    question: Callable[[Solved], Any],
    parameters: Sequence[GradientParameter],
) -> dict[str, Any]:
    """Derivatives of question(pose) (number, array, or mapping of them; in the same shape), by name of the parameter."""
    _, sides = PerturbedEquilibria()(pose, parameters)
    return {
        p.name: difference_quotient(question(own[0]), question(own[1]), 2 * RELATIVE_STEP * p.scale)
        for p, own in zip(parameters, sides, strict=True)
    }


def difference_quotient(plus: Any, minus: Any, width: float) -> Any:
    """Difference quotient of two answers (numbers, arrays, or mappings of them) at parameters `width` apart."""
    if isinstance(plus, Mapping):
        return {k: difference_quotient(v, minus[k], width) for k, v in plus.items()}
    found = (np.asarray(plus, float) - np.asarray(minus, float)) / width
    return float(found) if found.ndim == 0 else found
