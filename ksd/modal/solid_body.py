"""A reduced solid as a body: its constants, and the full displacements, middle line and energy at a state of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ksd.beam.modal_jets import JET
from ksd.beam.polynomial import face_jets
from ksd.modal.solid import Solid


@dataclass(frozen=True, repr=False)
class SolidBasis:
    """A reduced solid: displacement = patterns (size, nb) (b - b0) + inner (size, m) eta, in the frame `frame`.

    b (nb,): the entries `chosen` of the pose values of `ksd.beam.polynomial.face_jets`; b0 theirs at rest; value, number:
    the constants of that kernel. condition: of the inner columns.
    """

    solid: Solid
    frame: str
    chosen: tuple[int, ...]
    b0: np.ndarray
    patterns: np.ndarray
    inner: np.ndarray
    value: np.ndarray
    number: np.ndarray
    condition: float

    def __repr__(self) -> str:
        # told apart by identity: solvers are kept by what their basis prints
        return f"<SolidBasis of {self.unknowns} coordinates, {self.frame} frame, at {id(self):#x}>"

    @property
    def unknowns(self) -> int:
        """Coordinates in which the energy is a polynomial."""
        return int(self.number[1] + self.number[2])


def displaced(body: SolidBasis, d: np.ndarray, R: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Displacements u (size,) m of the full model at a state of the reduced one: face B at d (3,) m, turned by R (3, 3)."""
    solid, jets = body.solid, np.empty((19, JET))
    face_jets(int(body.frame == "chord"), d, R, jets)
    u = body.patterns @ (jets[list(body.chosen), 0] - body.b0) + body.inner @ eta
    if body.frame == "node":
        return np.asarray(u)
    # turned from the frame of the chord into that of face A
    turn, found = jets[1:10, 0].reshape(3, 3), np.empty_like(u)
    dim = 2 if solid.flat else 3
    at = [np.flatnonzero(solid.component == c) for c in range(dim)]
    at = [a[np.lexsort(solid.place[a].T)] for a in at]
    spots = np.zeros((3, len(at[0])))
    for c in range(dim):
        spots[c] = solid.place[at[c], c] + u[at[c]]
    spots = turn @ spots
    for c in range(dim):
        found[at[c]] = spots[c] - solid.place[at[c], c]
    return found


def middle_line(
    body: SolidBasis, d: np.ndarray, R: np.ndarray, eta: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stations (k,) m, positions (k, 3) m and axes (k, 3, 3) along the middle of a solid, in the frame of face A.

    The middle of a section is the mean of what is on it at rest; its axes follow the line and the width.
    """
    solid, u = body.solid, displaced(body, d, R, eta)
    dim = 2 if solid.flat else 3
    grain = 1e-9 * solid.length
    ends = solid.place[:, 0]
    s, section = np.unique(np.round(ends / grain), return_inverse=True)
    s, count = grain * s, len(s)
    place = np.zeros((count, 3))
    place[:, 0] = s
    for c in range(dim):
        mine = solid.component == c
        place[:, c] += np.bincount(section[mine], u[mine], count) / np.bincount(section[mine], None, count)
    along: np.ndarray = np.asarray(np.gradient(place, s, axis=0))
    along[0], along[-1] = (1.0, 0.0, 0.0), R[:, 0]
    # the width of face B, turned back along the line by the share of the way
    wide = (1 - s / s[-1])[:, None] * np.array([0.0, 0.0, 1.0]) + (s / s[-1])[:, None] * R[:, 2]
    e1 = along / np.linalg.norm(along, axis=1)[:, None]
    e2 = np.cross(wide, e1)
    e2 /= np.linalg.norm(e2, axis=1)[:, None]
    return s, place, np.stack([e1, e2, np.cross(e1, e2)], axis=2)


__all__ = ["SolidBasis", "displaced", "middle_line"]
