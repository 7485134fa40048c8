"""Where the ends of members are, compiled."""

from __future__ import annotations

from ksd.numerics.kernel import kernel


@kernel
def member_pose(node, offset, frame, x, R, i, pose, Q):
    """Pose of member i, whose ends are as node, offset, frame (m, ..) of `Members` say: pose (18,) = end frame p (9,
    row-major), w, s, d (global); Q (3, 3) = relative orientation, in frame p."""
    a, b = node[i, 0], node[i, 1]
    for r in range(3):
        sp, sq = 0.0, 0.0
        for c in range(3):
            sp += R[a, r, c] * offset[i, 0, c]
            sq += R[b, r, c] * offset[i, 1, c]
        pose[9 + r] = x[b, r] - x[a, r] + sq
        pose[12 + r] = sq
        pose[15 + r] = x[b, r] - x[a, r] + sq - sp
        for c in range(3):
            pose[3 * r + c] = (
                R[a, r, 0] * frame[i, 0, 0, c]
                + R[a, r, 1] * frame[i, 0, 1, c]
                + R[a, r, 2] * frame[i, 0, 2, c]
            )
    for c in range(3):
        f0, f1, f2 = frame[i, 1, 0, c], frame[i, 1, 1, c], frame[i, 1, 2, c]
        t0 = R[b, 0, 0] * f0 + R[b, 0, 1] * f1 + R[b, 0, 2] * f2
        t1 = R[b, 1, 0] * f0 + R[b, 1, 1] * f1 + R[b, 1, 2] * f2
        t2 = R[b, 2, 0] * f0 + R[b, 2, 1] * f1 + R[b, 2, 2] * f2
        for r in range(3):
            Q[r, c] = pose[r] * t0 + pose[3 + r] * t1 + pose[6 + r] * t2
