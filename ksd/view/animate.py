"""The stroke, or a mode, as an animation (GIF): one frame per configuration, axes that stand still; a mode as a picture."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ksd.answers.frequencies import Modes
from ksd.errors import SceneError
from ksd.files import check_target, write_file
from ksd.view.bodies import edge_lines
from ksd.view.camera import Camera, View, camera_of
from ksd.view.drawable import Drawable
from ksd.view.drawing import mechanism_plane, plot_mechanism
from ksd.view.figure import new_figure, without_math_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def animate_stroke(
    configurations: Sequence[Drawable],
    path: str | os.PathLike[str],
    *,
    view: View | None = None,
    frames_per_second: int = 12,
    back: bool = True,
    dpi: int = 80,
) -> Path:
    """Write the `configurations` of one mechanism as an animated GIF, forth and (with `back`) back again.

    view: as in `plot_mechanism`. frames_per_second, dpi: of the
    film. Returns the path. Raises SceneError for no configurations, another
    file type than .gif, or a folder that does not exist.
    """
    target = _gif_path(path)
    if not configurations:
        raise SceneError(f"animation '{target}': there are no configurations to show")
    order = [*configurations, *(configurations[-2:0:-1] if back else ())]
    return _write_frames(order, target, view=view, fps=frames_per_second, dpi=dpi)


def animate_mode(
    pose: Drawable,
    path: str | os.PathLike[str],
    *,
    mode: int | str = 1,
    modes: Modes | None = None,
    amplitude: float = 0.08,
    view: View | None = None,
    frames: int = 24,
    dpi: int = 80,
) -> Path:
    """Write one swing of a mode of a `Configuration` about its deformed state as an animated GIF.

    mode: its number, from 1, in the table that `modes` prints (`pose.frequencies()` with all drives released when None), or
    its name there ("intended", "parasitic_1", see `Modes.names`). amplitude: largest displacement over the size of the
    mechanism, for the eye only. view: as in `plot_mechanism`, in space where a planar one leaves its plane. frames: of one
    swing; dpi: of the film. Returns the path. Raises SceneError as `animate_stroke`, and for a mode that is not there.
    """
    target = _gif_path(path)
    swing, view, title = _mode_swing(pose, mode, modes, amplitude, view)
    order = [swing(float(s)) for s in np.sin(2 * np.pi * np.arange(frames) / frames)]
    return _write_frames(order, target, view=view, fps=frames, dpi=dpi, title=title)


def plot_mode(
    pose: Drawable,
    *,
    mode: int | str = 1,
    modes: Modes | None = None,
    amplitude: float = 0.08,
    axes: Axes | None = None,
    view: View | None = None,
) -> Figure:
    """Matplotlib figure of a `Configuration` at the end of one swing of a mode, over the undeformed mechanism.

    mode, modes, amplitude: as in `animate_mode`. axes, view: as in `plot_mechanism`, in space where a planar mechanism
    leaves its plane. Raises SceneError for a mode that is not there, and for another view.
    """
    swing, view, title = _mode_swing(pose, mode, modes, amplitude, view)
    return plot_mechanism(swing(1.0), axes=axes, view=view, labels=False, title=title)


def _mode_swing(
    pose: Drawable, mode: int | str, modes: Modes | None, amplitude: float, view: View | None
) -> tuple[Callable[[float], Drawable], View | None, str]:
    """A function from the share of the swing of a mode to the pose, the view, and the title."""
    modes_found = pose.frequencies(freed=pose.model.drive_names) if modes is None else modes
    row = _mode_row(modes_found, mode)
    moved = np.abs(modes_found.shape[row, :, :3])
    unit = (
        amplitude * float(modes_found.model.arrays.size) / max(modes_found.largest_displacement(row), 1e-300)
    )
    plane = mechanism_plane(pose)
    if plane is not None:
        across = "xyz".index(({*"xyz"} - {*plane}).pop())
        view = view or ("3d" if moved.max(axis=0).argmax() == across else plane)  # type: ignore[assignment]
    still = replace(cast(Any, pose), model=modes_found.model, method_was_chosen=False)

    def swing(share: float) -> Drawable:
        """The pose displaced by `share` (-1 to 1) of the amplitude of the mode."""
        return replace(still, motion=modes_found.moved(row, unit * share))

    title = f"mode {row + 1}, {modes_found.names[row]}: {modes_found.frequency_Hz[row]:.4g} Hz, amplitude for the eye"
    return swing, view, title


def _mode_row(modes: Any, mode: int | str) -> int:
    """Row of a mode given by its number in the table, from 1, or by its name. Raises SceneError."""
    if mode in modes.names:
        return int(modes.names.index(mode))
    if isinstance(mode, bool) or not isinstance(mode, int | np.integer) or not 1 <= mode <= len(modes):
        raise SceneError(
            f"mode = {mode!r}: give the number of a mode as the table of frequencies counts them, 1 to {len(modes)}, or one "
            f"of the names {', '.join(modes.names)}"
        )
    return int(mode) - 1


def _gif_path(path: str | os.PathLike[str]) -> Path:
    """The path of an animation; raises SceneError where it is not a .gif or cannot be written."""
    target = Path(path)
    if target.suffix.lower() != ".gif":
        raise SceneError(f"animation '{target}': write it as .gif")
    check_target(target, what="animation")
    return target


def _write_frames(
    order: Sequence[Any],
    target: Path,
    *,
    view: View | None,
    fps: int,
    dpi: int,
    title: str | None = None,
) -> Path:
    """Write one frame per configuration, all in the same window, to a GIF."""
    from PIL import Image

    shapes = [c.shape() for c in order]
    # the same viewing direction in all frames
    camera = camera_of(shapes[len(shapes) // 2], view, plane=mechanism_plane(order[0]))
    low, high = _common_window(shapes, camera)
    wide, tall = high - low
    figure = new_figure(7.0, float(np.clip(6.2 * tall / wide + 0.9, 2.8, 7.0)), dpi=dpi)
    axes = figure.add_subplot()
    canvas: Any = figure.canvas  # that of `new_figure`, which has a buffer
    frames = []
    for c in order:
        axes.clear()
        options: dict[str, Any] = {} if title is None else {"title": title, "labels": False}
        plot_mechanism(c, axes=axes, view=camera, **options)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        without_math_text(figure)
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    content = io.BytesIO()
    words = {"save_all": True, "append_images": frames[1:], "duration": int(1000 / fps), "loop": 0}
    frames[0].save(content, format="GIF", **words)
    return write_file(target, content.getvalue(), what="animation")


def _common_window(shapes: Sequence[Any], camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner [mm] of a window that holds every frame, with room for the labels."""
    every = [p for s in shapes for b in s.blocks for p in (b.rest, b.place)]
    every += [p for s in shapes for leaf in s.leaves for p in edge_lines(leaf.place, leaf.axes, leaf.width)]
    points = camera.flat(np.concatenate(every))
    low, high = points.min(axis=0), points.max(axis=0)
    room = np.maximum(0.14 * (high - low), 0.05 * float((high - low).max()))
    return low - room, high + room * np.array([2.2, 1.0])
