"""`ksd live SCENE.toml`: the mechanism in the browser, moved and drawn by hand."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path
from typing import Any

from ksd.cli.solve import OPTIONS, drive_value, merged_options, solver_options
from ksd.errors import SceneError, SceneFileError
from ksd.extras import live_package
from ksd.interactive.live import serve_file
from ksd.scene.toml_file import load_scene


def run(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C. A file with mistakes opens with them."""
    live_package("nicegui")
    file = Path(options.scene)
    settings: dict[str, Any] = dict.fromkeys(OPTIONS)
    values: dict[str, float] = {}
    if file.exists():
        with contextlib.suppress(SceneFileError):
            mechanism, _, written = load_scene(file, option_names=tuple(OPTIONS))
            settings = merged_options(written, options)
            if options.set:
                scene = mechanism.scene()
                values = dict(drive_value(scene, text) for text in options.set)
    elif options.set:
        raise SceneError(f"--set: {file} is not there yet, so it has no drives.")
    serve_file(
        file,
        values,
        options=solver_options(settings),
        host=options.host,
        port=options.port,
        show=not options.no_browser,
        shared=options.shared,
    )
    return 0
