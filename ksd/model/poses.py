"""Compiled pose of the ends of members."""

from __future__ import annotations

from ksd.numerics.kernel import kernel


@kernel
def member_pose(node, n, offset, o, frame, f, x, R, pose, Q):
    """Pose of a member whose nodes, offsets and frames (`Members`) start at node[n], offset[o] and frame[f].

    Writes pose (18,) = end frame p (9, row-major), lever w of q about node p, lever s of q about its node, vector d from p
    to q, all global, and Q (3, 3) = orientation of q in frame p.
    """
    a, b = node[n], node[n + 1]
    for r in range(3):
        sp, sq = 0.0, 0.0
        for c in range(3):
            sp += R[a, r, c] * offset[o + c]
            sq += R[b, r, c] * offset[o + 3 + c]
            s = 0.0
            for k in range(3):
                s += R[a, r, k] * frame[f + 3 * k + c]
            pose[3 * r + c] = s
        w = x[b, r] - x[a, r] + sq
        pose[9 + r], pose[12 + r], pose[15 + r] = w, sq, w - sp
    for c in range(3):
        for r in range(3):
            Q[r, c] = 0.0
        for k in range(3):
            t = 0.0
            for l in range(3):
                t += R[b, k, l] * frame[f + 9 + 3 * l + c]
            for r in range(3):
                Q[r, c] += pose[3 * k + r] * t
