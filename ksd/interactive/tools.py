"""The tools of drawing on a page: tool bar, links, grid, undo, typed coordinates and keys, text beside, saving."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ksd.interactive.drawing import LIBRARY, NEW_LINK, Drawing
from ksd.interactive.hand import TOOLS, Hand
from ksd.interactive.page import Viewer
from ksd.interactive.plane_view import Box, fitted_box, plane_svg
from ksd.interactive.session import Update
from ksd.scene.drive import GROUND
from ksd.scene.toml_table import quantity
from ksd.units import mm

ICONS = {
    "move": "near_me", "leaf": "horizontal_rule", "joint": "hub", "pin": "radio_button_unchecked", "slider": "swap_horiz",
    "support": "change_history", "drive": "arrow_right_alt", "load": "south", "spring": "waves", "distance": "straighten",
}  # fmt: skip
"""Icons of the tools."""
ZOOM = 1.0015
"""Factor by which the view grows per unit of the wheel."""


class DrawingTools:
    """The tools of one viewer on the drawing of its session; contact objects and time will have their place here."""

    def __init__(self, drawing: Drawing, viewer: Viewer) -> None:
        self.drawing, self.viewer, self.ui = drawing, viewer, viewer.ui
        self.hand = Hand(drawing, viewer.session)
        self.box: Box = fitted_box(drawing)
        self.fitted, self.keys_of = False, ""
        viewer.plane = self._picture
        viewer.on_let_go.append(self._slider_let_go)
        viewer.after.append(self._after)
        on, guarded = viewer.view.on, viewer.guarded
        on("pointer", guarded(self._pointer))
        on("zoom", guarded(self._zoom))
        viewer.ui.keyboard(on_key=guarded(self._key), ignore=["input", "textarea", "select"])
        self._lay_out()

    def _lay_out(self) -> None:
        ui, viewer, hand = self.ui, self.viewer, self.hand
        viewer.button("undo", "undo (Ctrl-Z)", self._undo)
        viewer.button("redo", "redo (Ctrl-Y)", self._redo)
        viewer.button("save", "save the scene file (Ctrl-S)", self._save)
        with viewer.left:
            with ui.row().classes("gap-0 w-full"):
                self.tools = {}
                for tool, what in TOOLS.items():
                    choose = functools.partial(self._choose, tool)
                    made = ui.button(icon=ICONS[tool], on_click=viewer.guarded(choose)).props(
                        "flat dense padding=6px"
                    )
                    self.tools[tool] = made.tooltip(f"{tool}: {what}").mark(f"tool {tool}")
            self.hint = ui.label("").classes("text-caption text-grey-7")
            with ui.row().classes("w-full no-wrap gap-2"):
                self.ends = [self._link_select("from", "start"), self._link_select("to", "end")]
            with ui.row().classes("w-full no-wrap gap-2 items-end"):
                self.family = ui.select(list(LIBRARY), value=hand.family, label="joint").props(
                    "dense options-dense"
                )
                self.family.classes("flex-grow").on_value_change(viewer.guarded(self._set_family))
                self.grid = ui.input("grid", value="5 mm").props("dense").style("width:72px").mark("grid")
                self.grid.on("keydown.enter", viewer.guarded(self._set_grid)).on(
                    "blur", viewer.guarded(self._set_grid)
                )
            with ui.row().classes("gap-0"):
                viewer.button("delete", "delete what is selected (Delete)", self._delete)
                viewer.button("content_copy", "copy what is selected", self._copy)
                viewer.button("flip", "mirror what is selected about x = 0", self._mirror)
                viewer.button("fit_screen", "show all of it", self._fit)
            self.keys = ui.column().classes("w-full gap-0")
        with viewer.right, ui.expansion("scene file").classes("w-full").props("dense"):
            self.text = (
                ui.textarea()
                .props("outlined dense autogrow input-style=font:11px/1.4_monospace")
                .classes("w-full")
            )
            self.text.props('input-style="font:11px/1.4 monospace"').mark("text of the scene file")
            viewer.button("check", "take this text", self._take_text)
        with viewer.right, ui.expansion("Python").classes("w-full").props("dense"):
            self.python = ui.code("", language="python").classes("w-full text-xs")
        self._choose("move")
        self._written()

    def _link_select(self, label: str, which: str) -> Any:
        made = self.ui.select([GROUND, NEW_LINK], value=getattr(self.hand, which), label=label)
        made.props("dense options-dense").style("flex:1;min-width:0").mark(f"link {label}")
        made.on_value_change(self.viewer.guarded(functools.partial(self._set_link, which, made)))
        return made

    # choices

    def _choose(self, tool: str) -> None:
        self.hand.tool = tool
        for name, button in self.tools.items():
            button.props(f"color={'primary' if name == tool else 'grey-7'}")
        self.hint.text = TOOLS[tool]
        if tool != "move" and self.viewer.mode.value != "plane":
            self.viewer.mode.value = "plane"

    def _set_link(self, which: str, made: Any) -> None:
        setattr(self.hand, which, made.value)

    def _set_family(self) -> None:
        self.hand.family = self.family.value

    def _set_grid(self, event: Any) -> None:
        typed = self.grid.value
        try:
            self.hand.grid = float(typed) * mm
        except ValueError:
            self.hand.grid = quantity(typed, "length", "grid")
        self.viewer.resend()

    # the mouse and the keyboard

    def _pointer(self, event: Any) -> None:
        given = event.args
        at, shift = (given["x"] * mm, -given["y"] * mm), bool(given["shift"])
        kind = given["kind"]
        try:
            if kind == "pointerdown":
                self.hand.press(at, given["name"], shift=shift)
            elif kind == "pointermove":
                self.hand.move(at, shift=shift)
            elif kind == "pointerup":
                self.hand.release(at, shift=shift)
        except Exception:
            self.hand.cancel()
            raise
        finally:
            if kind != "pointermove":
                self._written()
            # the page sends the next move when this one is shown
            if self.viewer.session.idle:
                self.viewer.resend()

    def _zoom(self, event: Any) -> None:
        left, top, wide, tall = self.box
        factor = ZOOM ** max(-300.0, min(300.0, event.args["by"]))
        x, y = event.args["x"], event.args["y"]
        self.box = x + (left - x) * factor, y + (top - y) * factor, wide * factor, tall * factor
        self.viewer.resend()

    def _key(self, event: Any) -> None:
        if not event.action.keydown:
            return
        key, control = event.key.name, event.modifiers.ctrl or event.modifiers.meta
        actions: dict[tuple[str, bool], Callable[[], None]] = {
            ("Escape", False): self._escape, ("Delete", False): self._delete, ("z", True): self._undo,
            ("y", True): self._redo, ("s", True): self._save,
        }  # fmt: skip
        if (key, bool(control)) in actions:
            actions[key, bool(control)]()

    def _escape(self) -> None:
        self.hand.cancel()
        self._choose("move")
        self.viewer.resend()

    # actions

    def _undo(self) -> None:
        self.drawing.undo()
        self._written()

    def _redo(self) -> None:
        self.drawing.redo()
        self._written()

    def _delete(self) -> None:
        self.drawing.delete()
        self._written()

    def _copy(self) -> None:
        step = 4 * (self.hand.grid or 5 * mm)
        self.drawing.copy((step, 0.0))
        self._written()

    def _mirror(self) -> None:
        self.drawing.mirror()
        self._written()

    def _fit(self) -> None:
        self.box = fitted_box(self.drawing, self.viewer.session.latest.asked)
        self.viewer.resend()

    def _save(self) -> None:
        file = self.drawing.save()
        self.viewer.say(f"{file} is written.", kind="positive")

    def _take_text(self) -> None:
        self.drawing.set_text(self.text.value)
        self._written()

    def _slider_let_go(self, name: str) -> None:
        slider = self.viewer.session.sliders[name]
        if slider.kind == "drive":
            self.drawing.set_drive(name, slider.value, slider.unit)
        elif slider.kind == "load":
            self.drawing.set_load(name.removesuffix(" (load)"), slider.value)
        self._written()

    # what is shown

    def _picture(self) -> dict[str, Any]:
        """What the plane view is sent."""
        update, hand = self.viewer.session.latest, self.hand
        if not self.fitted:
            self.fitted, self.box = True, fitted_box(self.drawing, update.asked)
        hand.within = 9 * self.box[2] / 900 * mm
        svg = plane_svg(
            self.drawing, update.asked, self.box, grid=hand.grid, refused=bool(update.refused), line=hand.line
        )
        return {"svg": svg, "box": list(self.box)}

    def _after(self, update: Update) -> None:
        links = [GROUND, *self.drawing.tables.get("links", ())]
        for made in self.ends:
            options = [*links, NEW_LINK]
            if made.options != options:
                made.set_options(options, value=made.value if made.value in options else options[-1])

    def _written(self) -> None:
        """Show text, Python, and the keys of what is selected."""
        text = self.drawing.text
        if self.text.value != text:
            self.text.value = text
        self.python.set_content(self.drawing.python)
        self._show_keys()

    def _show_keys(self) -> None:
        """Inputs for all keys of what is selected."""
        try:
            kind, _, table = self.drawing.chosen()
        except Exception:
            kind, table = "", {}
        self.keys.clear()
        with self.keys:
            if kind:
                self.ui.label(f"[[{kind}]]").classes("text-caption")
            for key, value in table.items():
                if isinstance(value, dict) or key == "terms":
                    continue
                shown = value if isinstance(value, str) else _typed(value)
                made = self.ui.input(key, value=shown).props("dense").classes("w-full").mark(f"key {key}")
                change = self.viewer.guarded(functools.partial(self._set_key, key, made))
                made.on("keydown.enter", change).on("blur", change)

    def _set_key(self, key: str, made: Any, event: Any) -> None:
        _, _, table = self.drawing.chosen()
        old = table.get(key)
        if made.value != (old if isinstance(old, str) else _typed(old)):
            self.drawing.set_key(key, made.value)
            self._written()


def _typed(value: Any) -> str:
    """A value as it is typed in a scene file."""
    if isinstance(value, list):
        return f"[{', '.join(_typed(v) if not isinstance(v, str) else chr(34) + v + chr(34) for v in value)}]"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def drawing_tools(file: Path, session: Any) -> tuple[Drawing, Callable[[Viewer], None]]:
    """The drawing of a file for a session that follows it, and the function that adds its tools to a viewer's page."""
    import copy

    def follow(drawing: Drawing) -> None:
        session.draw(copy.deepcopy(drawing.tables), drawing.file)

    drawing = Drawing(file, follow)
    follow(drawing)

    def build(viewer: Viewer) -> None:
        DrawingTools(drawing, viewer)

    return drawing, build
