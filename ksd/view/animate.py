"""The stroke, or a mode, as an animation (GIF): one frame per configuration, axes that stand still; a mode as a picture."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.errors import SceneError
from ksd.files import check_target, write_file
from ksd.view.bodies import edge_lines
from ksd.view.camera import Camera, View, camera_of
from ksd.view.drawable import Drawable
from ksd.view.drawing import mechanism_plane, plot_mechanism
from ksd.view.figure import new_figure, without_math_text
from ksd.view.labels import separate_labels
from ksd.view.swing import Shapes, row_of, swing

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
    modes: Shapes | None = None,
    amplitude: float = 0.08,
    view: View | None = None,
    frames: int = 24,
    dpi: int = 80,
) -> Path:
    """Write one swing of a mode of a `Configuration` about its deformed state as an animated GIF.

    mode: its number, from 1, in the table that `modes` prints, or its name there ("intended", "parasitic_1", see
    `Modes.names`). modes: frequencies or critical load factors (``pose.buckling()``) of the pose; all frequencies with
    drives released when None. amplitude: largest displacement over the size of the mechanism, for the eye only. view: as in
    `plot_mechanism`, in space where a planar one leaves its plane. frames: of one swing; dpi: of the film. Returns the path.
    Raises SceneError as `animate_stroke`, and for a mode that is not there.
    """
    target = _gif_path(path)
    swing, view, title = _mode_swing(pose, mode, modes, amplitude, view)
    order = [swing(float(s)) for s in np.sin(2 * np.pi * np.arange(frames) / frames)]
    return _write_frames(order, target, view=view, fps=frames, dpi=dpi, title=title)


def plot_mode(
    pose: Drawable,
    *,
    mode: int | str = 1,
    modes: Shapes | None = None,
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
    pose: Drawable, mode: int | str, modes: Shapes | None, amplitude: float, view: View | None
) -> tuple[Callable[[float], Drawable], View | None, str]:
    """A function from the share of the swing of a mode to the pose, the view, and the title."""
    shapes = pose.frequencies(freed=pose.model.drive_names) if modes is None else modes
    row = row_of(shapes, mode)
    plane = mechanism_plane(pose)
    if plane is not None and view is None:
        across = "xyz".index(({*"xyz"} - {*plane}).pop())
        moved = np.abs(shapes.shape[row, :, :3])
        view = "3d" if moved.max(axis=0).argmax() == across else plane  # type: ignore[assignment]
    return swing(pose, shapes, row, amplitude), view, f"{shapes.caption(row)}, amplitude for the eye"


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
    frames: list[Any] = []
    offsets: list[Any] = []
    for c, shape in zip(order, shapes, strict=True):
        axes.clear()
        options: dict[str, Any] = {} if title is None else {"title": title, "labels": False}
        plot_mechanism(c, axes=axes, view=camera, **options)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        without_math_text(figure)
        if not frames:
            lines = len(axes.lines)
            driven = camera.flat(
                np.array([p for d in shape.driven for p in (d.rest, d.place)]).reshape(-1, 3)
            )
            separate_labels(axes, driven, camera.flat(np.concatenate([leaf.place for leaf in shape.leaves])))
            offsets = [text.get_position() for text in axes.texts]
            for leader in axes.lines[lines:]:
                leader.remove()
        # labels that are placed anew in every frame hop
        for text, offset in zip(axes.texts, offsets, strict=False):
            text.set_position(offset)
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
