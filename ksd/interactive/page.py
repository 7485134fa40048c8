"""The page of a session: view, sliders, numbers and drawing, for every browser that opens it (nicegui).

Sessions run in threads of their own; what they say is handed to the event loop of the page. Every handler catches all,
shows the sentence and leaves the page as it is.
"""

from __future__ import annotations

import asyncio
import base64
import functools
import html
import inspect
import ipaddress
import logging
import socket
import time
from collections.abc import Callable
from typing import Any

from ksd.errors import SceneError
from ksd.extras import live_package
from ksd.html import html_table
from ksd.interactive.numbers import BETWEEN_PICTURES, PARTS, sentence_of
from ksd.interactive.session import Session, Update
from ksd.interactive.sliders import Slider
from ksd.view.page import SCRIPT, scene_bundle
from ksd.view.sheets import sheets_geometry, sheets_pose

PORT, PORTS_TRIED = 8160, 50
"""First port, and how many after it are tried where it is in use."""
_LOG = logging.getLogger("ksd")
STEPS = 500
"""Steps of a slider."""
MOVING = 0.6
"""Time [s] after its last move for which a slider is its viewer's own."""
STYLE = """
body{overflow:hidden} .nicegui-content{padding:0;gap:0;height:100vh}
.ksd-name{font:12px Roboto,sans-serif;padding:0 3px;background:#ffffffb0;border-radius:3px;white-space:nowrap;
max-width:220px;overflow:hidden;text-overflow:ellipsis}
.ksd-scale{position:absolute;right:12px;bottom:10px;font:12px Roboto,sans-serif;display:flex;gap:6px;align-items:center}
.ksd-scale i{width:130px;height:10px;display:inline-block;border-radius:2px}
.ksd-view svg:focus{outline:none}
.ksd-failed{position:absolute;inset:12px auto auto 12px;font-size:13px;color:#4b5563}
.ksd-refused{position:absolute;left:12px;right:12px;top:10px;z-index:5;background:#eef0f4;border:1px solid #b91c1c;
color:#b91c1c;padding:6px 10px;border-radius:6px;font-size:13px;white-space:pre-wrap;max-height:45%;overflow:auto}
.ksd-numbers{font-size:13px;line-height:1.35} .ksd-numbers td{overflow-wrap:anywhere;padding:2px 0;vertical-align:top}
.ksd-numbers td:first-child{padding-right:10px;min-width:104px} .ksd-numbers .old{color:#9aa3b2}
.ksd-numbers .bad{color:#b91c1c;font-weight:500}
.ksd-bar{height:4px;border-radius:2px;margin:-6px 0 2px 0}
"""


def serve(
    session: Session, build: Callable[[Viewer], Any] | None = None, *, host: str = "127.0.0.1", port: int = PORT,
    show: bool = True, shared: bool = False,
) -> None:  # fmt: skip
    """Serve the page of a session until Ctrl-C. build: adds the tools of drawing to each viewer's page. Raises SceneError
    without the extra `live`, for a host that others reach without `shared`, and where no port is free."""
    ui = live_package("nicegui").ui
    check_host(host, shared)
    free = free_port(host, port)
    if port and free != port:
        _LOG.warning(f"ksd live: port {port} is in use; this page is on {free}")
    seen = host if host not in ("0.0.0.0", "::") else socket.gethostname()
    others = " (everyone who reaches this machine can see and change it)" if shared else ""
    _LOG.warning(f"ksd live: http://{seen}:{free}{others}; end it with Ctrl-C")
    try:
        ui.run(
            lambda: Viewer(session, build), host=host, port=free, show=show, reload=False, title=f"{session.scene.name}",
            show_welcome_message=False, binding_refresh_interval=None, message_history_length=0, favicon=FAVICON,
            reconnect_timeout=2.0, storage_secret=None,
        )  # fmt: skip
    finally:
        session.close()


FAVICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><path d="M6 28V14C6 6 26 26 26 18V4" fill="none" '
    'stroke="#c2410c" stroke-width="4"/></svg>'
)


def check_host(host: str, shared: bool) -> None:
    """Raise SceneError for an address that other machines reach, unless `shared`."""
    try:
        local = ipaddress.ip_address(socket.gethostbyname(host)).is_loopback
    except OSError:
        raise SceneError(f"host '{host}' is not known; leave it out for this machine alone.") from None
    if not local and not shared:
        raise SceneError(
            f"host '{host}': other machines could then change this mechanism and write its file; add --shared (shared=True "
            "in Python) if that is meant."
        )


def free_port(host: str, port: int) -> int:
    """The first free port from `port` on, any free one for 0. Raises SceneError."""
    for tried in range(port, port + PORTS_TRIED) if port else (0,):
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as one:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                one.bind((host, tried))
            except (OSError, OverflowError):
                continue
            return int(one.getsockname()[1])
    raise SceneError(
        f"no port from {port} to {port + PORTS_TRIED - 1} is free on {host}; give another, --port 9000."
    )


@functools.cache
def sheets_class() -> Any:
    """The class of the component `sheets.js`, made at first use, as nicegui is needed for it."""
    element = live_package("nicegui").element.Element
    esm = {"nicegui-scene": str(scene_bundle().parent)}
    return type("Sheets", (element,), {"__module__": __name__}, component=SCRIPT, esm=esm)


class Viewer:
    """One browser tab: its view, sliders and numbers, and what it was sent last."""

    def __init__(self, session: Session, build: Callable[[Viewer], Any] | None = None) -> None:
        self.ui = live_package("nicegui").ui
        self.session, self.client = session, self.ui.context.client
        self.loop = asyncio.get_running_loop()
        self.shown: Update | None = None
        self.waiting: Update | None = None
        self.in_flight, self.ready, self.stressed = False, False, False
        self.model: tuple[Any, ...] | None = None
        self.moved: dict[str, float] = {}
        self.controls: dict[str, tuple[Any, Any, Any]] = {}
        self.ranges: list[tuple[Any, ...]] = []
        self.plane: Callable[[], dict[str, Any]] | None = None
        self.after: list[Callable[[Update], None]] = []
        # told the name of a slider that was let go, or typed into
        self.on_let_go: list[Callable[[str], None]] = []
        self.ui.add_css(STYLE)
        self.ui.colors(primary="#3b6ea5")
        self._lay_out(build)
        self._end = session.subscribe(self._hand_over)
        self.client.on_delete(lambda: self._end())
        self._receive(session.latest)

    def _hand_over(self, update: Update) -> None:
        """Give an update of the session's thread to the event loop."""
        self.loop.call_soon_threadsafe(self._receive, update)

    # helpers

    def guarded(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        """A handler that shows what goes wrong in it, and goes on."""
        if inspect.iscoroutinefunction(handler):

            @functools.wraps(handler)
            async def wait(*args: Any) -> Any:
                try:
                    return await handler(*args)
                except Exception as reason:
                    self.say(sentence_of(reason))

            wait.guards = True  # type: ignore[attr-defined]
            return wait

        @functools.wraps(handler)
        def run(*args: Any) -> Any:
            try:
                return handler(*args)
            except Exception as reason:
                self.say(sentence_of(reason))

        run.guards = True  # type: ignore[attr-defined]
        return run

    def say(self, sentence: str, *, kind: str = "negative") -> None:
        """Show a sentence for a while."""
        with self.client:
            self.ui.notify(sentence, type=kind, multi_line=True, close_button="x", timeout=8000)

    def button(self, icon: str, tip: str, handler: Callable[..., Any]) -> Any:
        """A small button of the tool bar."""
        made = self.ui.button(icon=icon, on_click=self.guarded(handler)).props("flat dense color=grey-8")
        return made.tooltip(tip)

    # layout

    def _lay_out(self, build: Callable[[Viewer], Any] | None) -> None:
        ui = self.ui
        with (
            ui.row()
            .classes("w-full items-center no-wrap gap-2 q-px-md")
            .style("height:44px;border-bottom:1px solid #eceff4")
        ):
            self.title = (
                ui.label(self.session.scene.name)
                .classes("text-weight-medium ellipsis")
                .style("max-width:320px")
            )
            self.bar = ui.row().classes("items-center gap-1 no-wrap")
            ui.space()
            self.mode = ui.toggle(
                {"space": "3D", "plane": "plane"}, value="space", on_change=self.guarded(self._change_mode)
            )
            self.mode.props("dense no-caps unelevated toggle-color=primary")
            for name, direction in (("xy", "xy"), ("xz", "xz"), ("yz", "yz"), ("3D", "")):
                turn = functools.partial(self._look_at, direction)
                ui.button(name, on_click=self.guarded(turn)).props("flat dense no-caps color=grey-8 size=sm")
        with ui.row().classes("w-full no-wrap gap-0").style("height:calc(100vh - 44px)"):
            with (
                ui.column().classes("gap-1 q-pa-md").style("width:280px;height:100%;overflow:auto;flex:none")
            ):
                self.left = ui.column().classes("w-full gap-1")
                self.slider_box = ui.column().classes("w-full gap-1")
            with ui.element("div").style(
                "position:relative;flex:1;height:100%;min-width:0;border:solid #eceff4;border-width:0 1px"
            ):
                self.view = sheets_class()().style("width:100%;height:100%;display:block")
                self.view._props["mode"] = "space"
                self.view.on("drawn", self.guarded(self._drawn))
                self.view.on("ready", self.guarded(self._start))
                self.refused = ui.label("").classes("ksd-refused")
                self.refused.set_visibility(False)
            with (
                ui.column().classes("gap-1 q-pa-md").style("width:340px;height:100%;overflow:auto;flex:none")
            ):
                self.link = ui.select([], label="stiffness of", on_change=self.guarded(self._watch)).props(
                    "dense options-dense"
                )
                self.link.classes("w-full")
                self.numbers = ui.html("", sanitize=False).classes("ksd-numbers w-full")
                self.right = ui.column().classes("w-full gap-1")
        with self.bar:
            self.button("photo_camera", "save a picture", self._save_picture)
            if build is not None:
                build(self)

    def _change_mode(self) -> None:
        self.view._props["mode"] = self.mode.value
        self.view.update()
        self.resend()

    def _look_at(self, direction: str) -> None:
        if self.mode.value != "space":
            self.mode.value = "space"
        self.view.run_method("lookAt", direction)

    def _watch(self) -> None:
        if self.link.value != (self.shown.asked.link if self.shown and self.shown.asked else None):
            self.session.watch(self.link.value)

    async def _save_picture(self) -> None:
        picture = await self.view.run_method("picture", timeout=5)
        if not picture:
            raise SceneError("this browser gives no picture of the view.")
        if picture.startswith("<svg"):
            self.ui.download.content(picture, f"{self.session.scene.name}.svg")
        else:
            self.ui.download.content(
                base64.b64decode(picture.partition(",")[2]), f"{self.session.scene.name}.png"
            )

    # sliders

    def _make_sliders(self) -> None:
        self.controls = {}
        self.slider_box.clear()
        with self.slider_box:
            if not self.session.sliders:
                self.ui.label("Nothing to move: there is no drive and no load yet.").classes(
                    "text-caption text-grey-7"
                )
            for slider in self.session.sliders.values():
                self._make_slider(slider)

    def _make_slider(self, slider: Slider) -> None:
        ui, name, factor = self.ui, slider.name, slider.factor
        with ui.row().classes("w-full items-center no-wrap gap-2").style("margin-bottom:-8px"):
            ui.label(name).classes("ellipsis").style("flex:1;font-size:13px").tooltip(f"{slider.kind} {name}")
            typed = ui.input(value="").props(
                f'dense borderless suffix="{slider.unit}" input-class="text-right"'
            )
            typed.style("width:104px").mark(f"value of {name}")
        low, high = slider.low / factor, slider.high / factor
        made = ui.slider(min=low, max=high, step=(high - low) / STEPS, value=slider.value / factor).classes(
            "w-full"
        )
        made.props("dense label").mark(name)
        bar = ui.element("div").classes("ksd-bar w-full")
        made.on("update:model-value", self.guarded(functools.partial(self._slide, name)), throttle=0)
        made.on("change", self.guarded(functools.partial(self._let_go, name)))
        for event in ("keydown.enter", "blur"):
            typed.on(event, self.guarded(functools.partial(self._type, name)))
        self.controls[name] = made, typed, bar

    def _slide(self, name: str, event: Any) -> None:
        self.moved[name] = time.monotonic()
        self.session.wish(name, float(event.args) * self.session.sliders[name].factor)

    def _let_go(self, name: str, event: Any) -> None:
        for handler in self.on_let_go:
            handler(name)

    def _type(self, name: str, event: Any) -> None:
        _, typed, _ = self.controls[name]
        slider = self.session.sliders[name]
        if typed.value == shown_number(slider):
            return
        try:
            self.session.wish(name, slider.read(typed.value))
        finally:
            typed.value = shown_number(slider)
        self.moved.pop(name, None)
        self._let_go(name, event)

    # updates

    def _receive(self, update: Update, *, again: bool = False) -> None:
        """Show the newest update, or keep it until the last one is drawn."""
        if self.in_flight or not self.ready:
            self.waiting = update
            return
        shown = self.shown
        try:
            if (
                shown is not None
                and shown.number == update.number
                and shown.asked is update.asked
                and not again
            ):
                self._show_numbers(update)
            else:
                self._show(update)
        except Exception as reason:
            self.in_flight = False
            self.say(sentence_of(reason))

    def _drawn(self, event: Any) -> None:
        self.in_flight = False
        if self.waiting is not None:
            update, self.waiting = self.waiting, None
            self._receive(update)

    def _start(self, event: Any) -> None:
        """The component is there, for the first time or again."""
        self.ready, self.in_flight, self.model = True, False, None
        self.resend()

    def resend(self) -> None:
        """Send the newest update (again)."""
        self._receive(self.session.latest, again=True)

    def _show(self, update: Update) -> None:
        with self.client:
            sent: dict[str, Any] = {"number": update.number, "refused": bool(update.refused)}
            asked = update.asked
            if asked is not None and self.mode.value == "space":
                model = asked.pose.model, len(asked.shape.leaves[0].s) if asked.shape.leaves else 0
                if model != self.model:
                    self.model, sent["geometry"] = model, sheets_geometry(asked.pose, asked.shape)
                if not update.refused or "geometry" in sent:
                    sent["pose"] = sheets_pose(asked.pose, asked.shape, asked.stress)
            if self.plane is not None and self.mode.value == "plane":
                sent |= self.plane()
            self.in_flight, self.shown = True, update
            self.stressed = asked is not None and asked.stress is not None
            self.view.run_method("update", sent)
            self._show_controls(update)
        self._show_numbers(update)

    def _show_numbers(self, update: Update) -> None:
        """What stands beside the view."""
        had_stress, self.shown = self.stressed, update
        with self.client:
            self.numbers.content = numbers_html(update)
            self.refused.text = update.refused
            self.refused.set_visibility(bool(update.refused))
            asked = update.asked
            self.stressed = asked is not None and asked.stress is not None
            if asked is not None and self.stressed and not had_stress:
                self.view.run_method("colour", sheets_pose(asked.pose, asked.shape, asked.stress))
            for handler in self.after:
                handler(update)

    def _show_controls(self, update: Update) -> None:
        sliders = self.session.sliders
        ranges = [(s.name, s.low, s.high, s.unit) for s in sliders.values()]
        if ranges != self.ranges or not self.controls:
            self.ranges = ranges
            self._make_sliders()
        now = time.monotonic()
        for name, (made, typed, bar) in self.controls.items():
            slider = sliders[name]
            value = slider.value / slider.factor
            if now - self.moved.get(name, 0.0) > MOVING and made.value != value:
                made.value = value
            if typed.value != shown_number(slider):
                typed.value = shown_number(slider)
            style = reachable_bar(slider)
            if getattr(bar, "ksd_style", None) != style:
                bar.ksd_style = style
                bar.style(replace=f"background:{style}")
        links = [n for n in self.session.scene.links if n != "ground"]
        chosen = update.asked.link if update.asked is not None else None
        if self.link.options != links or self.link.value != chosen:
            self.link.set_options(links, value=chosen if chosen in links else None)
        if self.title.text != self.session.scene.name:
            self.title.text = self.session.scene.name


def shown_number(slider: Slider) -> str:
    """The value of a slider as it is typed."""
    return f"{slider.value / slider.factor:.6g}"


def reachable_bar(slider: Slider) -> str:
    """CSS background that shows which part of a slider is known to be out of reach."""
    wide = slider.high - slider.low
    low, high = (100 * min(1.0, max(0.0, (end - slider.low) / wide)) for end in slider.reached)
    if low <= 0.0 and high >= 100.0:
        return "none"
    return f"linear-gradient(to right,#c3c9d4 {low:.4g}%,#6a9f58 {low:.4g}%,#6a9f58 {high:.4g}%,#c3c9d4 {high:.4g}%)"


def numbers_html(update: Update) -> str:
    """The table of all numbers, old ones in grey, and what share of an update every part took."""
    rows = []
    for part in PARTS:
        grey = " old" if part in update.old else ""
        for what, number, good in update.rows.get(part, ()):
            mark = f"{'' if good else ' bad'}{grey}"
            name, text = html.escape(what), html.escape(number)
            rows.append(
                f'<tr class="{mark}"><td>{name}</td><td style="text-align:right">{text}</td></tr>' if name
                else f'<tr class="{mark}"><td colspan="2">{text}</td></tr>'
            )  # fmt: skip
    total = sum(update.times.values())
    shares = [
        (p, f"{1e3 * t:.2f} ms", f"{100 * t / total:.0f} %") for p, t in update.times.items() if t > 0.0
    ]
    shares.append(("update", f"{1e3 * total:.2f} ms", f"of {1e3 * BETWEEN_PICTURES:.0f}"))
    cost = html_table(shares, (), (False, True, True))
    return f'<table class="w-full">{"".join(rows)}</table><details><summary>time of this update</summary>{cost}</details>'
