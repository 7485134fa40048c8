"""`ksd.live`: a mechanism in the browser."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from ksd.checks import clear_argument_errors
from ksd.extras import live_package
from ksd.interactive.page import PORT, Viewer, serve
from ksd.interactive.played import PlayedPanel
from ksd.interactive.session import Session
from ksd.interactive.tools import drawing_tools
from ksd.scene.mechanism import Mechanism
from ksd.scene.scene import Scene
from ksd.solvers.solver import Method


@clear_argument_errors
def live(
    mechanism: Mechanism | Scene | Callable[..., Any],
    ranges: Mapping[str, Any] | None = None,
    *,
    targets: Mapping[str, float] | None = None,
    host: str = "127.0.0.1",
    port: int = PORT,
    show: bool = True,
    shared: bool = False,
    method: Method | None = None,
    accuracy: float | None = None,
    effects: str | Iterable[str] = "auto",
) -> None:
    """Show a mechanism in the browser, with sliders that it follows, until Ctrl-C.

    mechanism: a mechanism or scene, or a function of parameters that returns one; ranges: lowest and highest value of these,
    in SI or as texts with a unit, {"length": (50 * mm, 100 * mm)}. targets: drive values [m or rad] to begin with. host,
    port: address; other machines reach only a `shared` page. show: open the browser. method, accuracy, effects: as in
    `ksd.solve`. Raises SceneError, also without the extra `live`. From the command line: `ksd live SCENE.toml`.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> ksd.live(guide, targets=stroke)  # doctest: +SKIP
    """
    live_package("nicegui")
    options = {"method": method, "accuracy": accuracy, "effects": effects}
    session = Session(mechanism, targets, ranges=ranges, options=options)
    session.refresh()
    serve(session, PlayedPanel, host=host, port=port, show=show, shared=shared)


def serve_file(
    file: Path, values: Mapping[str, float], *, options: Mapping[str, Any], **address: Any
) -> None:
    """Serve the page of a scene file until Ctrl-C, with drive values [SI] to begin with."""
    session = Session(None, options=options)
    _, build = drawing_tools(file, session)
    session.settle(600.0)
    for name, value in values.items():
        session.wish(name, value)

    def add_both(viewer: Viewer) -> None:
        build(viewer)
        PlayedPanel(viewer)

    serve(session, add_both, **address)
