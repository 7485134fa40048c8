"""A session: a mechanism that is solved again at every wish, in a thread of its own; the newest wish wins.

It knows no page. Viewers subscribe and are told every `Update`, from the thread that made it. What takes longer than the
time between two pictures is answered by a second thread with a solver of its own, when no wish has come for a while.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ksd.answers.doctor import doctor
from ksd.errors import KsdError, SceneError
from ksd.interactive.numbers import PARTS, Asked, Row, ask, parts_in_time, sentence_of, watched
from ksd.interactive.sliders import Slider, design_sliders, scene_sliders, with_loads
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.orders import mesh_for_accuracy
from ksd.scene.mechanism import Mechanism
from ksd.scene.obstacle import refuse_contacts
from ksd.scene.rules import check_scene
from ksd.scene.scene import Scene
from ksd.scene.toml_file import scene_from_tables
from ksd.solvers.configuration import Configuration
from ksd.solvers.solver import MAX_RISES, Solver, checked_accuracy, prepare, solve_on_adequate_mesh
from ksd.solvers.verdict import with_mesh_check
from ksd.study.design_scene import build_scene

_LOG = logging.getLogger("ksd")
REST = 0.15
"""Time [s] without a wish after which the hand is taken to rest."""
STATIONS, FEW_STATIONS, MANY_LEAVES = 17, 9, 60
"""Stations per leaf that are drawn, and of mechanisms with many leaf springs."""
BISECTIONS = 8
"""Solves by which the end of the reachable part of a slider is found after a refusal."""
AVERAGED = 0.3
"""Weight of the newest time in the running means of times."""


@dataclass(frozen=True)
class Update:
    """What viewers show after a wish.

    number: counts updates; values: of all sliders [SI] by name; asked: the last pose that solved, None before the first;
    rows: numbers by part, `old` those of an earlier pose; refused: why the present values do not solve, empty where they do;
    times: of the parts of this update [s]; scene: what is drawn, also where it does not solve.
    """

    number: int
    values: Mapping[str, float]
    asked: Asked | None = None
    rows: Mapping[str, list[Row]] = field(default_factory=dict)
    old: frozenset[str] = frozenset()
    refused: str = ""
    times: Mapping[str, float] = field(default_factory=dict)


class SceneSolver:
    """Solvers of one scene, as `ksd.solve` would choose their meshes and by its options."""

    def __init__(self, scene: Scene, options: Mapping[str, Any]) -> None:
        words = dict(options)
        self.how = {
            "method": words.pop("method", None),
            "relinearisations": words.pop("relinearisations", 0),
            "estimate": True,
        }
        accuracy, mesh = words.pop("accuracy", None), words.pop("mesh", None)
        self.accuracy = checked_accuracy(accuracy)
        self.mesh = mesh or (DEFAULT_MESH if accuracy is None else mesh_for_accuracy(self.accuracy))
        self.rises = MAX_RISES if mesh is None else 0
        words.pop("side", None)
        self.scene, self.words, self.solvers = scene, words, dict[Mesh, Solver]()

    def _solver(self, mesh: Mesh) -> Solver:
        if mesh not in self.solvers:
            self.solvers[mesh] = prepare(self.scene, mesh=mesh, **self.words)
        return self.solvers[mesh]

    def __call__(self, targets: Mapping[str, float]) -> Configuration:
        """The pose at drive values, unstable ones too, as `ksd.solve(..., strict=False)` has it."""
        found = solve_on_adequate_mesh(
            self._solver, self.mesh, targets, accuracy=self.accuracy, rises=self.rises, **self.how
        )
        return with_mesh_check(found, self.accuracy)


class Session:
    """A mechanism that follows sliders and drawing, for any number of viewers.

    mechanism: a mechanism or scene, a function of the parameters in `ranges` that returns one, or None for tables of a scene
    file that `draw` gives. targets: drive values [SI]; options: of `ksd.solve`. Close it to end its threads.
    """

    def __init__(
        self,
        mechanism: Mechanism | Scene | Callable[..., Any] | None = None,
        targets: Mapping[str, float] | None = None,
        *,
        ranges: Mapping[str, Any] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        self.options, self.design = dict(options or {}), mechanism if callable(mechanism) else None
        if ranges and self.design is None:
            raise SceneError(
                "live: ranges belong to a function of these parameters that returns a mechanism."
            )
        self.targets = dict(targets or {})
        self.link: str | None = None
        self.sliders: dict[str, Slider] = {}
        if self.design is not None:
            self.sliders = {s.name: s for s in design_sliders(self.design, ranges or {})}
            self.scene = build_scene(self.design, {n: s.value for n, s in self.sliders.items()})
        else:
            self.scene = (
                Scene("nothing yet", ("ground",)) if mechanism is None else build_scene(mechanism, {})
            )
        self._changed, self._wish = threading.Condition(), 0
        self._wished: dict[str, float] = {}
        self._take_scene(self.scene, self.targets)
        self._loaded: tuple[Scene, dict[str, float], Scene] = self.scene, {}, self.scene
        self._parameters: dict[str, float] = {}
        self.latest = Update(0, self.values)
        self.cost: dict[str, float] = {}
        self._viewers: list[Callable[[Update], None]] = []
        self._tables: tuple[dict[str, Any], Path] | None = None
        self._solver: SceneSolver | None = None
        self._last_good: dict[str, float] = {}
        self._closed, self._rest = False, 0
        self._questions: list[tuple[Callable[[Configuration], Any], Future[Any]]] = []
        self._threads = [
            threading.Thread(target=self._follow, name="ksd live", daemon=True),
            threading.Thread(target=self._answer_at_rest, name="ksd live, at rest", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    # wishes, from any thread

    @property
    def values(self) -> dict[str, float]:
        """Values of all sliders [SI] by name."""
        return {n: s.value for n, s in self.sliders.items()}

    @property
    def idle(self) -> bool:
        """Whether the newest wish is solved."""
        return self.latest.number >= self._wish

    def wish(self, name: str, value: float) -> None:
        """Move a slider to `value` [SI]; returns at once. Raises SceneError for an unknown name."""
        with self._changed:
            if name not in self.sliders:
                raise SceneError(f"there is no slider '{name}'.")
            self.sliders[name].moved(value)
            self._wished[name] = value
        self.refresh()

    def watch(self, link: str | None) -> None:
        """Ask for the stiffness of this link."""
        self.link = link
        self.refresh()

    def draw(self, tables: dict[str, Any], file: Path) -> None:
        """Take the mechanism from the tables of a scene file, whose folder other files are in; returns at once."""
        with self._changed:
            self._tables = tables, file
            self._wished.clear()
        self.refresh()

    def refresh(self) -> None:
        """Solve again; returns at once."""
        with self._changed:
            self._wish += 1
            self._changed.notify_all()

    def subscribe(self, viewer: Callable[[Update], None]) -> Callable[[], None]:
        """Tell `viewer` of every update; returns a function that ends it."""
        self._viewers.append(viewer)
        return lambda: self._viewers.remove(viewer) if viewer in self._viewers else None

    def question(self, ask: Callable[[Configuration], Any]) -> Future[Any]:
        """The answer to ``ask(pose)`` at the present pose, by the thread that answers at rest."""
        future: Future[Any] = Future()
        with self._changed:
            self._questions.append((ask, future))
            self._changed.notify_all()
        return future

    def settle(self, timeout: float = 60.0) -> Update:
        """Wait until the newest wish is solved; the update of it. For tests and scripts."""
        with self._changed:
            wish = self._wish
            if not self._changed.wait_for(lambda: self._closed or self.latest.number >= wish, timeout):
                raise TimeoutError("the session does not answer")
        return self.latest

    def close(self) -> None:
        """End the threads."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(10.0)

    # the thread that follows

    def _follow(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._wish > self.latest.number)
                if self._closed:
                    return
                number, tables = self._wish, self._tables
                self._tables = None
            update = self._update(number, tables)
            with self._changed:
                self.latest = update
                self._changed.notify_all()
            self._tell(update)

    def _tell(self, update: Update) -> None:
        for viewer in list(self._viewers):
            try:
                viewer(update)
            except Exception as reason:  # a viewer that fails must not end the session
                _LOG.warning(f"ksd live: a viewer failed: {sentence_of(reason)}")

    def _update(self, number: int, tables: tuple[dict[str, Any], Path] | None) -> Update:
        """Solve the present wish. Whatever goes wrong becomes a sentence, with the last good pose."""
        last, clock = self.latest, time.thread_time
        values, times = self.values, dict[str, float]()
        try:
            start = clock()
            scene = self._present_scene(tables)
            values = self.values
            if self._solver is None or self._solver.scene is not scene:
                self._solver = SceneSolver(scene, self.options)
            times["model"] = clock() - start
            pose = self._solver({d.name: values.get(d.name, 0.0) for d in scene.drives})
            times["solve"] = clock() - start - times["model"]
            asked = Asked(
                pose,
                pose.shape(points=self.stations(pose)),
                *watched(pose, self.link if self.link in scene.links else None),
            )
            times["shape"] = clock() - start - sum(times.values())
            rows, parts = dict(last.rows), parts_in_time(self.cost, sum(times.values()))
            for part in parts:
                before = clock()
                rows[part] = ask(part, asked)
                times[part] = clock() - before
            self._judge(True, values)
            old = frozenset(PARTS) - set(parts)
            self._learn(times)
            return Update(number, values, asked, rows, old & rows.keys(), "", times)
        except Exception as reason:
            self._judge(False, values)
            sentence = sentence_of(reason)
            return replace(
                last, number=number, values=values, refused=sentence, old=frozenset(last.rows), times=times
            )

    @staticmethod
    def stations(pose: Configuration) -> int:
        """Stations per leaf that are drawn."""
        return FEW_STATIONS if len(pose.model.member_names) > MANY_LEAVES else STATIONS

    def _learn(self, times: Mapping[str, float]) -> None:
        """Running means of what every part costs; a first time, which also loads kernels, does not count."""
        for part, time_ in times.items():
            mean = self.cost.get(part)
            self.cost[part] = 0.0 if mean is None else time_ if not mean else mean + AVERAGED * (time_ - mean)

    def _present_scene(self, tables: tuple[dict[str, Any], Path] | None) -> Scene:
        """The scene of the present wish; the same object while nothing but drives has changed. Raises SceneError."""
        if tables is not None:
            mechanism, targets, _ = scene_from_tables(*tables, whole=False)
            self._take_scene(mechanism.draft(), targets)
            check_scene(self.scene)
        elif self.design is not None:
            parameters = {n: s.value for n, s in self.sliders.items() if s.kind == "design"}
            if parameters != self._parameters:
                self._take_scene(build_scene(self.design, parameters), self.targets)
                self._parameters = parameters
        sizes = {n: s.value for n, s in self.sliders.items() if s.kind == "load"}
        own, known, _ = self._loaded
        if own is not self.scene or known != sizes:
            self._loaded = self.scene, sizes, with_loads(self.scene, sizes)
        return self._loaded[2]

    def _take_scene(self, scene: Scene, targets: Mapping[str, float]) -> None:
        """Take a scene and make its sliders; those that are there keep range and value. Raises SceneError for contacts."""
        refuse_contacts(scene)
        fresh = {s.name: s for s in self.sliders.values() if s.kind == "design"}
        for slider in scene_sliders(scene, targets):
            known = self.sliders.get(slider.name)
            if known is not None and (known.kind, known.dimension) == (slider.kind, slider.dimension):
                # what is drawn says all values; a design keeps those that were moved
                value = known.value if self.design is not None else slider.value
                slider = replace(known, value=value, low=min(known.low, value), high=max(known.high, value))
            fresh[slider.name] = slider
        with self._changed:
            # what was wished while the tables were read is newer than they are
            for name in fresh.keys() & self._wished.keys():
                fresh[name].moved(self._wished[name])
            self.scene, self.sliders = scene, fresh

    def _judge(self, solved: bool, values: Mapping[str, float]) -> None:
        """Mark the reachable part of the slider that moved since the last good pose."""
        moved = [n for n, v in values.items() if v != self._last_good.get(n, v)]
        if len(moved) == 1 and moved[0] in self.sliders:
            self.sliders[moved[0]].judged(solved, self._last_good[moved[0]])
        if solved:
            if len(moved) > 1:
                for slider in self.sliders.values():
                    slider.reached = (-np.inf, np.inf)
            self._last_good = dict(values)

    # the thread that answers when the hand rests

    def _answer_at_rest(self) -> None:
        solver: SceneSolver | None = None
        while (update := self._rested()) is not None:
            if update.asked is None:
                self._refuse_questions(update.refused)
                self._explain(update)
                continue
            scene = update.asked.pose.model.original_scene
            if solver is None or solver.scene is not scene:
                solver = SceneSolver(scene, self.options)
            try:
                pose = solver(update.asked.pose.targets)
            except Exception as reason:
                sentence = sentence_of(reason)
                self._refuse_questions(sentence)
                self._publish_part(update.number, "trust", [("", sentence, False)], update.asked)
                continue
            self._answer_questions(pose)
            if update.refused:
                self._find_end(update, solver)
                self._explain(update)
                continue
            asked = replace(update.asked, pose=pose)
            for part in [p for p in PARTS if p in update.old or p not in update.rows]:
                if self._is_newer_than(update.number):
                    break
                self._publish_part(update.number, part, ask(part, asked), asked)

    def _rested(self) -> Update | None:
        """Wait for a question, or for an update after which no wish comes for a while; None when the session closes."""
        with self._changed:
            while True:
                self._changed.wait_for(
                    lambda: self._closed or self._questions or self.latest.number > self._rest
                )
                if self._closed:
                    return None
                if not self._questions:
                    number = self.latest.number
                    self._changed.wait_for(partial(self._is_newer_than, number), REST)
                    if not self._closed and not self._questions and self._wish > number:
                        self._changed.wait_for(lambda: self._closed or self._wish == self.latest.number)
                        continue
                self._rest = self.latest.number
                return None if self._closed else self.latest

    def _is_newer_than(self, number: int) -> bool:
        return self._closed or self._wish > number or bool(self._questions)

    def _publish_part(self, number: int, part: str, rows: list[Row], asked: Asked) -> None:
        """Add the rows of a part to the update `number`, if that is still the newest."""
        with self._changed:
            now = self.latest
            if now.number != number or now.asked is None:
                return
            now.asked.found.update(asked.found)
            if now.asked.stress is None:
                now.asked.stress = asked.stress
            self.latest = update = replace(now, rows={**now.rows, part: rows}, old=now.old - {part})
        self._tell(update)

    def _answer_questions(self, pose: Configuration) -> None:
        while self._questions:
            function, future = self._questions.pop(0)
            try:
                future.set_result(function(pose))
            except Exception as reason:
                future.set_exception(SceneError(sentence_of(reason)))

    def _refuse_questions(self, sentence: str) -> None:
        while self._questions:
            self._questions.pop(0)[1].set_exception(SceneError(sentence or "there is no pose yet."))

    def _find_end(self, update: Update, solver: SceneSolver) -> None:
        """Find the end of the reachable part of the drive that is refused, between its last good value and that refused."""
        good = dict(self._last_good)
        moved = [n for n, v in update.values.items() if n in good and v != good[n]]
        if len(moved) != 1 or self.sliders[moved[0]].kind != "drive":
            return
        slider, reached, refused = self.sliders[moved[0]], good[moved[0]], update.values[moved[0]]
        upward = refused > reached
        for _ in range(BISECTIONS):
            if self._is_newer_than(update.number):
                return
            middle = 0.5 * (reached + refused)
            try:
                solver({d.name: middle if d.name == moved[0] else good[d.name] for d in solver.scene.drives})
                reached = middle
            except KsdError:
                refused = middle
        slider.reached = (slider.reached[0], reached) if upward else (reached, slider.reached[1])

    def _explain(self, update: Update) -> None:
        """Add what `doctor` says of motions that nothing holds to the sentence of a refusal."""
        try:
            free = [f.sentence for f in doctor(self.scene).free] if len(self.scene.links) > 1 else []
        except Exception:
            return
        with self._changed:
            if self.latest is not update or not free:
                return
            told = f"Free: {'; '.join(free)}. {update.refused}"
            self.latest = update = replace(update, refused=told)
        self._tell(update)
