"""A walk: equilibria in order along a path of drive values, on which friction depends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import clear_argument_errors, show, whole_number
from ksd.errors import ConvergenceError, SceneError
from ksd.scene.mechanism import Mechanism
from ksd.scene.scene import Scene
from ksd.solvers.configuration import Configuration
from ksd.solvers.contact_solve import solve_with_contact, split_values
from ksd.solvers.solver import Solver
from ksd.units import mm


@dataclass(frozen=True, repr=False)
class Walk(PrintableAnswer):
    """Equilibria along a path: values by name, one mapping for each pose, and the poses in order.

    stop: why it ended before the end of its program, empty where it did not. `along` asks every pose a question.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> found = ksd.walk(guide, [{"table": 1e-3}, {"table": 2e-3}])
    >>> print(found.along(lambda pose: pose.forces["table"]).round(3))
    [1.    2.002]
    """

    values: tuple[Mapping[str, float], ...]
    poses: tuple[Configuration, ...]
    stop: str = ""

    def __len__(self) -> int:
        return len(self.poses)

    def __iter__(self) -> Iterator[Configuration]:
        return iter(self.poses)

    def __getitem__(self, k: int) -> Configuration:
        return self.poses[k]

    def along(self, question: Any) -> NDArray[np.float64]:
        """The numbers question(pose) of all poses, (k,) or (k, ...)."""
        return np.array([question(pose) for pose in self.poses])

    def _line(self) -> str:
        names = self.poses[0].contacts if self.poses else ()
        never = [name for name in names if not any(pose.contacts[name].N for pose in self.poses)]
        remark = f"; never touched: {', '.join(never)}" if never else ""
        return f"{len(self)} poses" + remark + (f"; {self.stop}" if self.stop else "")

    def __str__(self) -> str:
        first = self.poses[0]
        turning = {d.name for d in first.model.scene.drives if d.terms[0].kind == "rotation"}
        turning |= {s.name for s in first.model.original_scene.stops if s.terms[0].kind == "rotation"}
        # values of a stop have its name and that of its limit
        turns = {n: n in turning or n.rpartition(".")[0] in turning for n in self.values[0]}
        rows = [
            (
                *(format_number(math.degrees(v[n]) if turns[n] else v[n] / mm, zero=1e-12) for n in turns),
                *(f"{p.contacts[c].state} {format_number(p.contacts[c].N)}" for c in first.contacts),
                *(format_number(p.stops[s].force) for s in first.stops),
                *(format_number(p.cables[c].force) for c in first.cables),
            )
            for v, p in zip(self.values, self.poses, strict=True)
        ]  # fmt: skip
        heads = [f"{n} [{'deg' if turns[n] else 'mm'}]" for n in turns]
        heads += [f"<{c}, N [N]" for c in first.contacts]
        heads += [f"{s} [{'Nm' if s.rpartition('.')[0] in turning else 'N'}]" for s in first.stops]
        heads += [f"{c} [N]" for c in first.cables]
        return format_table(heads, rows, self._line())


@clear_argument_errors
def walk(
    mechanism: Mechanism | Scene | Solver,
    program: Iterable[Mapping[str, float]],
    *,
    steps: int = 1,
    strict: bool = True,
) -> Walk:
    """Walk through drive values in order, so that friction knows where surfaces have slipped; loads act from the start.

    program: values by name [m or rad] of drives, limits of stops and cables, one mapping for each waypoint; a name that is
    left out keeps its value. The walk starts at rest, with all drives at zero. steps: equal steps to every waypoint; slip
    has the direction of the whole step, so its error falls with them. strict: raise ConvergenceError where the walk
    stops, with the `Walk` so far as its result; False returns that. Raises SceneError for a program without values.

    >>> jaw = ksd.Mechanism("jaw", plane="xy")
    >>> finger, ball = jaw.links("finger", "object")
    >>> steel = ksd.Material(E=200e9, nu=0.3)
    >>> blade = ksd.rectangle(3e-4, 0.01)
    >>> for y in (0, -0.02):
    ...     _ = jaw.leaf("ground", finger, start=(0, y, 0), end=(0.06, y, 0), section=blade, material=steel)
    >>> for along in "xy":
    ...     _ = jaw.actuate(ball, along=along, at=(0.07, 0.02, 0), name=along)
    >>> _ = jaw.support(ball, about="z")
    >>> face = jaw.surface(finger, ksd.shapes.wall(), at=(0.07, 0.005, 0), axis="y")
    >>> disc = jaw.surface(ball, ksd.shapes.disc(0.015), at=(0.07, 0.02, 0))
    >>> grip = jaw.contact(face, disc, friction=0.3, name="grip")
    >>> found = ksd.walk(jaw, [{"x": 0, "y": -2e-3}, {"x": 1e-4}, {"x": -1e-4}])
    >>> [pose.contacts["grip"].state for pose in found]
    ['slip', 'slip', 'slip']
    """
    solver = mechanism if isinstance(mechanism, Solver) else Solver(mechanism)
    model, whole = solver.model, whole_number(steps, "steps")
    waypoints = list(program)
    if not waypoints or not all(isinstance(w, Mapping) for w in waypoints):
        raise SceneError(
            f"program = {show(program)}: give values by name for every waypoint, [{{'y': -1e-3}}, ...]."
        )
    now = dict.fromkeys(model.drive_names, 0.0)
    values: list[Mapping[str, float]] = []
    poses: list[Configuration] = []
    for waypoint in waypoints:
        drives, own = split_values(model, {**now, **waypoint})
        goal = {**drives, **own}
        begin = {name: now.get(name, value) for name, value in split_values(model, now)[1].items()} | now
        for k in range(1, whole + 1):
            at = {name: begin[name] + k / whole * (value - begin[name]) for name, value in goal.items()}
            drives, own = split_values(model, at)
            try:
                with solver.lock:
                    pose = solve_with_contact(
                        model,
                        drives,
                        own,
                        start=poses[-1] if poses else None,
                        planar=solver.planar,
                        storage=solver.storage,
                    )
            except ConvergenceError as error:
                stop = f"pose {len(poses) + 1} of {whole * len(waypoints)} was not reached: {error}"
                partial = Walk(tuple(values), tuple(poses), stop)
                if strict or not poses:
                    raise ConvergenceError(
                        stop, reached=len(poses) / (whole * len(waypoints)), result=partial
                    ) from None
                return partial
            values.append(at)
            poses.append(pose)
        now = goal
    return Walk(tuple(values), tuple(poses))
