"""Checks over the stroke of a joint that it can be represented: B stays in its plane, leaf springs do not collide, and
no other motion becomes as soft as the intended one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ksd.answers.stiffness import point_stiffness
from ksd.errors import SceneError
from ksd.library.functions import Array
from ksd.model.compile import Model
from ksd.scene import Joint, Leaf
from ksd.scene.clearance import (
    BOX_COUNT,
    DEFORMED_OVERLAP_TOLERANCE,
    FINE_BOX_COUNT,
    LeafBoxes,
    boxes_along_line,
    overlapping_leaves,
)
from ksd.section.section import thickness_and_width
from ksd.solvers.configuration import Configuration
from ksd.training.block_poses import block_poses
from ksd.training.softness import (
    MAX_STIFFNESS_RATIO,
    describe_soft_motion,
    largest_intended_stiffness,
    listed_values,
    scaling,
    shape_phrase,
)

MAX_WINDOW_SHARE = 0.25
"""Largest share of a leaf's area that windows may take.

Windows are left out of the model, so they have to be small; crossed pivots need 0.15 at most, the 3x-infinity hinge
0.19 (`tests/training/test_windows.py`).
"""


def state_phrase(joint: Joint, values: Mapping[str, float]) -> str:
    """Phrase naming the motions of a state and the shape of the joint."""
    motion, shape = listed_values(values), listed_values(joint.shape())
    return motion + (f" (shape {shape})" if shape else "")


def _plane_normal(joint: Joint) -> Array | None:
    """Normal (3,) of the plane a joint with one motion stays in; None without one.

    The axis of a rotation, or the common width axis of all leaf springs, normal to a translation.
    """
    if len(joint.motions) != 1:
        return None
    motion = joint.motions[0]
    if motion.kind == "rotation":
        return np.asarray(motion.axis)
    widths = np.array([leaf.width_axis for leaf in joint.leaves()])
    normal = widths[0]
    deviation = np.linalg.norm(np.cross(widths, normal), axis=1).max()
    return normal if max(deviation, abs(normal @ motion.axis)) < 1e-9 else None


def check_plane(joint: Joint, model: Model, states: list[Configuration], max_distance: float) -> None:
    """Raise SceneError where B of a joint with one motion leaves its plane by more than `max_distance` (rad, joint
    lengths)."""
    axis = _plane_normal(joint)
    if axis is None:
        return
    poses = block_poses(model, [s.motion for s in states], 1, np.asarray(joint.pose_B, float), joint.length)
    rotation = poses[:, :3] - np.outer(poses[:, :3] @ axis, axis)
    rest = np.asarray(joint.pose_B, float) / joint.length
    shift = (poses[:, 3:] - rest) @ axis
    worst = float(max(np.abs(rotation).max(), np.abs(shift).max()))
    if worst > max_distance:
        load = "moment" if joint.motions[0].kind == "rotation" else "force"
        raise SceneError(
            f"{joint.family}: interface B leaves its plane by {worst:.2g} (rad or joint lengths) "
            f"under a pure {load}; place its leaf springs symmetrically about that plane."
        )


def check_clear(joint: Joint, states: list[Configuration]) -> None:
    """Raise SceneError where leaf springs collide in any of the states, except for small windows where the joint has
    them."""
    if joint.windows:
        leaf, share, others = largest_window(window_shares(joint, states))
        if share > MAX_WINDOW_SHARE:
            raise SceneError(
                f"{joint.family}: the windows of leaf '{leaf}' for {others} would take {share:.0%} of its area over the "
                f"stroke{shape_phrase(joint)}, at most {MAX_WINDOW_SHARE:.0%} may be left out of the model; reduce the "
                "range of motion or of the shape, or let narrower leaf springs pass."
            )
        return
    for state in states:
        for (one, two), _ in overlapping_leaves(
            _leaf_boxes(joint, state, BOX_COUNT), tolerance=DEFORMED_OVERLAP_TOLERANCE
        ):
            raise SceneError(
                f"{joint.family}: leaf springs '{one}' and '{two}' run into each other at "
                f"{state_phrase(joint, state.targets)}; reduce the range of "
                "motion or of the shape, or say windows=True where one passes through a window of the other."
            )


def _leaf_boxes(joint: Joint, state: Configuration, count: int) -> list[LeafBoxes]:
    """The leaf springs as `count` boxes each."""
    leaves = {f"joint/{leaf.name}": leaf for leaf in joint.leaves()}
    bodies = []
    for line in state.shape(points=count + 1).leaves:
        leaf = leaves[line.name]
        width = 0.5 * (line.axes[1:, :, 2] + line.axes[:-1, :, 2])
        bodies.append(
            boxes_along_line(leaf.name, (leaf.start_block, leaf.end_block), line.place, leaf, width=width)
        )
    return bodies


def window_shares(joint: Joint, states: list[Configuration]) -> dict[tuple[str, str], float]:
    """Windows needed where leaf springs overlap in any of the states: share of the area of a leaf, by its name and that of
    the leaf that passes.

    The wider of two has the window; a leaf of the same width passes as a tongue of half its width. Raises SceneError where
    a leaf sticks out at an edge of the other, so that no window is possible.
    """
    leaves = {leaf.name: leaf for leaf in joint.leaves()}
    boxes_of_pair: dict[tuple[str, str], set[int]] = {}
    for state in states:
        for (one, two), stations in overlapping_leaves(
            _leaf_boxes(joint, state, FINE_BOX_COUNT), tolerance=DEFORMED_OVERLAP_TOLERANCE
        ):
            for k, pair in enumerate(((one, two), (two, one))):
                boxes_of_pair.setdefault(pair, set()).update(
                    (FINE_BOX_COUNT * stations[:, k]).astype(int).tolist()
                )
            wide, narrow = sorted((leaves[one], leaves[two]), key=lambda leaf: -_width(leaf))
            if not _is_between_edges(narrow, wide):
                raise SceneError(
                    f"{joint.family}: leaves '{one}' and '{two}' run into each other at an edge, where no window makes "
                    f"way, at {state_phrase(joint, state.targets)}; move them apart."
                )
    shares: dict[tuple[str, str], float] = {}
    for (one, two), boxes in boxes_of_pair.items():
        ratio = _width(leaves[two]) / _width(leaves[one])
        if ratio < 1 - 1e-9 or (ratio < 1 + 1e-9 and (two, one) not in shares):
            shares[one, two] = _share_of_length(boxes) * min(ratio, 0.5)
    return shares


def largest_window(shares: Mapping[tuple[str, str], float]) -> tuple[str, float, str]:
    """The leaf with the largest windows, their share of its area, and the leaf springs that pass, in words; shares: as of
    `window_shares`."""
    if not shares:
        return "", 0.0, ""
    totals: dict[str, float] = {}
    for (leaf, _), share in shares.items():
        totals[leaf] = totals.get(leaf, 0.0) + share
    widest = max(totals, key=lambda name: totals[name])
    return widest, totals[widest], ", ".join(f"'{two}'" for one, two in shares if one == widest)


def _share_of_length(boxes: set[int]) -> float:
    """Share of a leaf from the first to the last of its boxes, since the crossing moves between states."""
    return (max(boxes) - min(boxes) + 1) / FINE_BOX_COUNT


def _width(leaf: Leaf) -> float:
    """Width [m] of a leaf."""
    return thickness_and_width(leaf.section)[1]


def _is_between_edges(narrow: Leaf, wide: Leaf) -> bool:
    """Whether a leaf at rest lies between the edges of another, seen along its width."""
    axis = np.asarray(wide.axes[:, 2])
    ends = np.array([narrow.start, narrow.end]) - np.asarray(wide.start)
    half_extent = np.abs(ends @ axis).max() + 0.5 * _width(narrow) * abs(float(narrow.axes[:, 2] @ axis))
    return bool(half_extent <= 0.5 * _width(wide) * (1 + 1e-9))


def check_stays_soft(joint: Joint, model: Model, states: list[Configuration]) -> None:
    """Raise SceneError where another motion becomes softer over the stroke than the intended ones are at rest."""
    if joint.held_by_others:
        return
    own = largest_intended_stiffness(joint)
    scale = scaling(joint)
    for state in states:
        tip_stiffness = point_stiffness(model, state.motion, "B", at=joint.pose_B, axes="link")
        values, vectors = np.linalg.eigh(tip_stiffness.compliance / np.outer(scale, scale))
        if own > MAX_STIFFNESS_RATIO / values[-1]:
            motion = describe_soft_motion(joint, vectors[:, -1], 1.0 / values[-1])
            raise SceneError(
                f"{joint.family}: at {state_phrase(joint, state.targets)} {motion} is as soft as the intended motion, "
                f"{1.0 / values[-1] / own:.2g} times its stiffness at rest; reduce the range of motion."
            )
