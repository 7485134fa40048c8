"""What is played in the view, modes, shapes of buckling and the stroke; and answers over the stroke as a plot."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.interactive.page import Viewer
from ksd.interactive.session import SceneSolver, Session, Update
from ksd.pages.report_page import report_page
from ksd.solvers.configuration import Configuration
from ksd.study.sweep import sweep
from ksd.study.table import OK, STATUS, Table, label_and_unit
from ksd.view.sheets import sheets_pose, station_stress
from ksd.view.swing import Shapes, swing

FRAMES, SECONDS, SWING = 24, 1.6, 0.06
"""Frames and duration [s] of a swing, and its amplitude over the size of the mechanism."""
POSES, PLAYED = 25, 3.0
"""Poses over the stroke, and the duration [s] of the stroke played forth and back."""


def swing_frames(pose: Configuration, shapes: Shapes, row: int, points: int) -> list[dict[str, Any]]:
    """What the view is sent for one swing of a pose in a mode or shape of buckling."""
    moved = swing(pose, shapes, row, SWING)
    frames = []
    for share in np.sin(2 * np.pi * np.arange(FRAMES) / FRAMES):
        one = moved(float(share))
        frames.append(sheets_pose(one, one.shape(points=points), None))
    return frames


class Stroke:
    """Poses and answers of a drive over the range of its slider, the other sliders where they are.

    table: answers; frames: what the view is sent for every pose that solves, on one scale of stress.
    """

    def __init__(self, session: Session, pose: Configuration, drive: str, points: int) -> None:
        slider, scene = session.sliders[drive], pose.model.original_scene
        low, high = max(slider.low, slider.reached[0]), min(slider.high, slider.reached[1])
        values = {n: v for n, v in pose.targets.items() if n != drive}
        options = {k: v for k, v in session.options.items() if v is not None}
        self.drive, self.pose, self.factor, self.unit = drive, pose, slider.factor, slider.unit
        self.path = np.linspace(low, high, POSES)
        self.table: Table = sweep(scene, {**values, drive: self.path}, progress=False, **options)
        solver, poses = SceneSolver(scene, session.options), []
        for value, status in zip(self.path.tolist(), self.table[STATUS], strict=True):
            if status == OK:
                poses.append(solver({**values, drive: value}))
        shapes = [one.shape(points=points) for one in poses]
        stresses = [station_stress(*each)[0] for each in zip(poses, shapes, strict=True)]
        most = max((float(s.max(initial=0.0)) for s in stresses), default=0.0)
        self.frames = [sheets_pose(*each, most=most) for each in zip(poses, shapes, stresses, strict=True)]

    @property
    def columns(self) -> list[str]:
        """Columns that vary over the stroke."""
        names = [n for n in self.table.columns if n not in (*self.table.labels, STATUS)]
        return [n for n in names if _varies(np.asarray(self.table[n]))]

    def chart(self, column: str, at: float) -> dict[str, Any]:
        """Options of the chart of a column over the drive, with a mark at the value `at` [SI]; gaps where nothing solves."""
        label, unit = label_and_unit(column)
        across = self.path / self.factor
        points = [[float(x), float(y) if np.isfinite(y) else None]
                  for x, y in zip(across, self.table[column], strict=True)]  # fmt: skip
        return {
            "animation": False,
            "grid": {"left": 8, "right": 16, "top": 30, "bottom": 24, "containLabel": True},
            "tooltip": {"trigger": "axis"},
            "xAxis": {"type": "value", "name": self.unit, "min": "dataMin", "max": "dataMax"},
            "yAxis": {"type": "value", "name": f"{label} [{unit}]" if unit else label, "scale": True,
                      "nameTextStyle": {"align": "left"}},
            "series": [{"type": "line", "showSymbol": False, "data": points, "markLine": self.mark(at)}],
        }  # fmt: skip

    def mark(self, at: float) -> dict[str, Any]:
        """The mark at a value of the drive [SI]."""
        return {"symbol": "none", "silent": True, "animation": False, "label": {"show": False},
                "data": [{"xAxis": at / self.factor}]}  # fmt: skip

    def report(self) -> str:
        """The report of the pose and its stroke as HTML text."""
        return report_page(self.pose, self.table, ())


def _varies(values: Any) -> bool:
    if values.dtype.kind not in "fi":
        return False
    finite = values[np.isfinite(values)]
    return len(finite) > 1 and bool(np.ptp(finite) > 1e-9 * np.abs(finite).max())


class PlayedPanel:
    """The parts of one viewer's page for modes, shapes of buckling, and the stroke."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer, self.ui, self.session = viewer, viewer.ui, viewer.session
        self.stroke: Stroke | None = None
        self.chart: Any = None
        self.shapes: dict[str, tuple[Shapes, int]] = {}
        ui, guarded = self.ui, viewer.guarded
        with viewer.right:
            self.swung = ui.select({"": "at rest"}, value="", label="swing in").props("dense options-dense")
            self.swung.classes("w-full").on_value_change(guarded(self._swing)).mark("swing in")
            with ui.expansion("over the stroke").classes("w-full").props("dense"):
                with ui.row().classes("w-full no-wrap gap-1 items-center"):
                    self.drive = (
                        ui.select([], label="drive").props("dense options-dense").style("flex:1;min-width:0")
                    )
                    viewer.button("show_chart", "solve the stroke", self._solve_stroke)
                    viewer.button("play_arrow", "play the stroke", self._play)
                    viewer.button("table_view", "save its table (CSV)", self._save_table)
                    viewer.button("summarize", "save the report (HTML)", self._save_report)
                self.column = ui.select([], label="answer").props("dense options-dense").classes("w-full")
                self.column.on_value_change(guarded(self._draw))
                self.place = ui.element("div").classes("w-full")
        viewer.after.append(self._after)

    # modes

    async def _swing(self) -> None:
        if self.swung.value not in self.shapes:
            self.viewer.resend()
            return
        shapes, row = self.shapes[self.swung.value]
        frames = await self._asked(lambda pose: swing_frames(pose, shapes, row, self.session.stations(pose)))
        self.viewer.view.run_method("play", frames, SECONDS)

    # the stroke

    async def _solve_stroke(self) -> None:
        if not self.drive.value:
            raise SceneError("there is no drive to move.")
        drive = self.drive.value
        stroke = await self._asked(
            lambda pose: Stroke(self.session, pose, drive, self.session.stations(pose))
        )
        self.stroke = stroke
        names = {n: label_and_unit(n)[0] for n in stroke.columns}
        if not names:
            raise SceneError(f"no answer changes over the stroke of '{drive}'.")
        with self.viewer.client:
            self.column.set_options(names, value=next(iter(names)))
        self._draw()

    def _draw(self) -> None:
        if self.stroke is None or not self.column.value:
            return
        options = self.stroke.chart(self.column.value, self._value())
        with self.viewer.client, self.place:
            if self.chart is None:
                self.chart = self.ui.echart(options).classes("w-full").style("height:210px")
            else:
                self.chart.options.clear()
                self.chart.options.update(options)
                self.chart.update()

    def _value(self) -> float:
        stroke, sliders = self.stroke, self.session.sliders
        return sliders[stroke.drive].value if stroke is not None and stroke.drive in sliders else 0.0

    def _play(self) -> None:
        frames = self._solved().frames
        self.viewer.view.run_method("play", [*frames, *frames[-2:0:-1]], PLAYED)

    def _save_table(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            text = self._solved().table.to_csv(Path(folder, "stroke.csv")).read_text("utf-8")
        with self.viewer.client:
            self.ui.download.content(text, f"{self.session.scene.name}.csv")

    async def _save_report(self) -> None:
        stroke = self._solved()
        text = await self._asked(lambda _: stroke.report())
        with self.viewer.client:
            self.ui.download.content(text, f"{self.session.scene.name}.html")

    def _solved(self) -> Stroke:
        if self.stroke is None:
            raise SceneError("solve the stroke first.")
        return self.stroke

    async def _asked(self, function: Any) -> Any:
        """What a function of the present pose returns, from the thread that answers at rest."""
        return await asyncio.wrap_future(self.session.question(function))

    # updates

    def _after(self, update: Update) -> None:
        drives = [n for n, s in self.session.sliders.items() if s.kind == "drive"]
        if self.drive.options != drives:
            self.drive.set_options(
                drives, value=self.drive.value if self.drive.value in drives else next(iter(drives), None)
            )
        if update.asked is not None:
            self._offer(update.asked.found)
        if self.chart is not None and self.stroke is not None:
            mark = self.stroke.mark(self._value())
            self.chart.run_chart_method("setOption", {"series": [{"markLine": mark}]})

    def _offer(self, found: dict[str, Any]) -> None:
        """Offer the modes and shapes of buckling that were found; what was chosen belongs to another pose."""
        shapes = {
            each.names[k]: (each, k) for each in (found.get("frequencies"), found.get("buckling")) if each is not None
            for k in range(len(each.names))
        }  # fmt: skip
        if shapes.keys() == self.shapes.keys() and all(shapes[n][0] is self.shapes[n][0] for n in shapes):
            return
        self.shapes = shapes
        options = {"": "at rest"} | {name: each.caption(row) for name, (each, row) in shapes.items()}
        self.swung.set_options(options, value="")
