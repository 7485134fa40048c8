"""The sentences by which a mechanism mentions effects beyond leaf springs, drives and loads; see `ksd.scene.effects`."""

from __future__ import annotations

import io
import math
import os
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.errors import SceneError
from ksd.files import LARGEST, named_file, read_file
from ksd.hdf5 import read_hdf5
from ksd.scene.contents import PlacedJoint, PlacedLeaf
from ksd.scene.effects import CONSIDERED, Compliance, Distance, Fit, Heat, LinkMatrix, Spring, TurnSpring
from ksd.scene.links import Link, Links
from ksd.scene.material import Material
from ksd.scene.placing import numbered
from ksd.section import Section
from ksd.section.checks import Axis, Vector, all_worded, as_given, nearest, show, vector, worded


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """The arrays `points` and `K` of a numpy file, where they are there; no array is larger than it unpacks to.

    Raises SceneError for what is no regular file, and whatever zipfile and numpy raise on contents that make no sense.
    """
    with zipfile.ZipFile(io.BytesIO(read_file(path, what="link matrix"))) as archive:
        names = {f"{key}.npy" for key in ("points", "K")} & set(archive.namelist())
        return {name.removesuffix(".npy"): _array(archive, name) for name in names}


def _array(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    """One array of a numpy file, its size compared with what it declares before anything is made of it."""
    if archive.getinfo(name).file_size > LARGEST:
        raise ValueError(f"{name} is larger than the {LARGEST >> 20} MiB that are read")
    with archive.open(name) as member:
        content = io.BytesIO(member.read(LARGEST + 1))
    version = np.lib.format.read_magic(content)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = header(content)
    if (
        kind.kind not in "fiu"
        or math.prod(shape) * kind.itemsize != content.getbuffer().nbytes - content.tell()
    ):
        raise ValueError(f"{name} is not the array of numbers it declares")
    content.seek(0)
    found: np.ndarray = np.load(content, allow_pickle=False)
    return found


READERS = {".npz": read_npz, ".h5": read_hdf5}
"""Who reads a link matrix, by the end of the file name."""


@worded
def link_matrix(path: str | os.PathLike[str]) -> LinkMatrix:
    """The stiffness of a flexible link from a file, `.npz` or `.h5`.

    Arrays: `points` (2, 3) [m], the interfaces, global at rest; `K` (12 + m, 12 + m), stiffness with the six
    displacements and rotations of each interface first (N/m, N, Nm) and m internal modes last, which statics condenses.
    Raises SceneError for a file that is missing, of another kind, damaged, or without these arrays.
    """
    file = named_file(path, "link matrix")
    read = READERS.get(file.suffix.lower())
    if read is None:
        raise SceneError(f"link matrix '{file}': a file of kind {' or '.join(READERS)} is needed.")
    try:
        arrays = read(file)
    except SceneError:
        raise
    except Exception as reason:
        # the readers of foreign formats do not say what they raise
        said = " ".join(str(reason).split()) or type(reason).__name__
        raise SceneError(
            f"link matrix '{file}' cannot be read: {said.rstrip('.')}; export it again, numpy or HDF5."
        ) from None
    for key in ("points", "K"):
        if key not in arrays:
            raise SceneError(
                f"link matrix '{file}': array '{key}' is missing; write K and points (see ksd.link_matrix)."
            )
    points, K = np.asarray(arrays["points"], float), np.asarray(arrays["K"], float)
    if points.ndim != 2 or points.shape[1] != 3 or K.ndim != 2 or K.shape[0] != K.shape[1] or len(K) < 12:
        raise SceneError(
            f"link matrix '{file}': points {points.shape} must be (2, 3), K {K.shape} square, 12 or more."
        )
    if not np.all(np.isfinite(K)):
        raise SceneError(f"link matrix '{file}': K holds numbers that are not finite; export it again.")
    edge = 6 * len(points)
    inner = K[edge:, edge:]
    if len(inner):
        try:
            K = K[:edge, :edge] - K[:edge, edge:] @ np.linalg.solve(inner, K[edge:, :edge])
        except np.linalg.LinAlgError:
            raise SceneError(
                f"link matrix '{file}': the stiffness of its internal modes is singular."
            ) from None
    return LinkMatrix(tuple(map(tuple, points.tolist())), tuple(map(tuple, K.tolist())))  # type: ignore[arg-type]


@all_worded
class Mentioned(Links):
    """Springs, flexible links, heat, assembly error and prestress of a mechanism, sentence by sentence."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._springs: list[Spring | TurnSpring] = []
        self._distances: list[Distance] = []
        self._compliances: dict[str, Compliance] = {}
        self._heats: list[Heat] = []
        self._fits: list[Fit] = []
        self._consider: tuple[str, ...] = ()
        self._gravity: Vector | None = None

    def _mentioned(self) -> dict[str, Any]:
        """The words of `Scene` for all of it."""
        return {
            "springs": tuple(self._springs),
            "distances": tuple(self._distances),
            "compliances": tuple(self._compliances.values()),
            "heats": tuple(self._heats),
            "fits": tuple(self._fits),
            "consider": self._consider,
            "gravity": self._gravity,
        }

    @property
    def gravity(self) -> Vector | None:
        """Acceleration (3,) [m/s^2], e.g. (0, -9.81, 0); None when the scene does not mention gravity.

        It pulls at the masses of links, and along every leaf whose material has a density.
        """
        return self._gravity

    @gravity.setter
    def gravity(self, value: ArrayLike | None) -> None:
        self._gravity = None if value is None else vector(value, "gravity", owner=self.name, unit="m/s^2")

    def _placed(self, joint: PlacedJoint | str) -> PlacedJoint:
        """The placed joint of this name; see `Mechanism`."""
        raise NotImplementedError

    def link(
        self,
        name: str,
        *,
        mass: float | None = None,
        inertia: ArrayLike | None = None,
        at: ArrayLike | None = None,
        section: Section | None = None,
        material: Material | None = None,
    ) -> Link:
        """A new link; mass [kg], inertia [kg m^2] and its centre `at` [m] as in `mass`.

        It is rigid unless section and material are given: then it is elastic as said in `compliance`.
        """
        added = super().link(name, mass=mass, inertia=inertia, at=at)
        if section is not None or material is not None:
            try:
                self.compliance(added, section=section, material=material)
            except SceneError:
                # a refused sentence leaves nothing behind
                del self._links[name]
                self._masses = [m for m in self._masses if m.link != name]
                raise
        return added

    def compliance(
        self,
        link: Link | str,
        *,
        section: Section | None = None,
        material: Material | None = None,
        hub: ArrayLike | None = None,
        width_axis: Axis | None = None,
        matrix: LinkMatrix | str | os.PathLike[str] | None = None,
    ) -> Compliance:
        """Make a link elastic: by section and material, or by a Craig-Bampton matrix (or the file of one).

        With a section it is a beam from its hub (3,) [m] (the mean of its attachments when left out) to every joint and
        leaf on it; loads, drives, masses and springs of the link act on the hub. width_axis: direction of the
        section's width, the axis of the first joint on it when left out. With a matrix (see `LinkMatrix`, `link_matrix`)
        the link has two interfaces; what is attached goes to the interface it sits at, loads, drives, masses and
        springs act on the first. Raises SceneError.
        """
        known = self._known(link, "compliance")
        if known == self.ground.name:
            raise SceneError("compliance: the ground cannot be elastic; put a link and leaf springs between.")
        if known in self._compliances:
            raise SceneError(f"compliance of link '{known}' is given twice; keep one.")
        if isinstance(matrix, str | os.PathLike):
            matrix = link_matrix(matrix)
        made = Compliance(known, section, material, as_given(hub), as_given(width_axis), matrix)
        self._compliances[known] = made
        return made

    def distance(
        self,
        a: Link | str,
        b: Link | str,
        *,
        start: ArrayLike,
        end: ArrayLike,
        along: Axis | None = None,
        name: str,
    ) -> Distance:
        """Ask for the distance of the point `end` (3,) [m] of link `b` from the point `start` of link `a`, such as the
        opening of a jaw: `pose.distance(name)`, and the column "distance_NAME_mm" of sweeps, jobs and gradients.

        along: its signed component along a direction, which turns with `a`; the whole distance when None. Raises SceneError.
        """
        owner = f"distance '{name}'"
        if name in {d.name for d in self._distances}:
            raise SceneError(f"{owner}: the name is used already; every distance needs its own.")
        first, second = self._pair(a, b, owner)
        axis = None if along is None else as_given(along)
        made = Distance(name, first, second, as_given(start), as_given(end), axis)
        self._distances.append(made)
        return made

    def spring(
        self,
        a: Link | str,
        b: Link | str,
        *,
        start: ArrayLike,
        end: ArrayLike,
        stiffness: float,
        free_length: float | None = None,
        name: str | None = None,
    ) -> Spring:
        """A coil spring from `start` (3,) [m] on link `a` to `end` on `b`, stiffness [N/m].

        free_length [m]: its length without force; the distance of its ends at rest when left out, 0 for the
        zero-free-length spring of static balancing. Raises SceneError.
        """
        label = self._spring_name(name, "spring")
        first, second = self._pair(a, b, f"spring '{label}'")
        ends = [
            vector(p, w, owner=f"spring '{label}'", unit="m") for p, w in ((start, "start"), (end, "end"))
        ]
        length = math.dist(*ends) if free_length is None else free_length
        made = Spring(label, first, second, ends[0], ends[1], stiffness, length)
        self._springs.append(made)
        return made

    def joint_spring(
        self,
        joint: PlacedJoint | str,
        *,
        stiffness: float,
        rest_angle: float = 0.0,
        motion: str | None = None,
        name: str | None = None,
    ) -> TurnSpring:
        """A torsion spring [Nm/rad] about the axis of a joint (of its motion `motion`, of several), between its links.

        rest_angle [rad]: rotation of b relative to a without moment, above 0 it pulls that way. Raises SceneError.
        """
        placed = self._placed(joint)
        turning = placed.joint.motion(motion)
        label = self._spring_name(name, f"{placed.name}.spring")
        if turning.kind != "rotation":
            raise SceneError(
                f"joint spring '{label}': motion '{turning.name}' of joint '{placed.name}' is a translation; "
                "put a coil spring (mechanism.spring) between its links."
            )
        axis = placed.turn(turning.axis)
        words: dict[str, Any] = {"stiffness": stiffness, "rest_angle": rest_angle, "name": label}
        return self.turn_spring(placed.a, placed.b, at=placed.origin, axis=axis, **words)

    def turn_spring(
        self,
        a: Link | str,
        b: Link | str,
        *,
        at: ArrayLike,
        axis: Axis,
        stiffness: float,
        rest_angle: float = 0.0,
        name: str | None = None,
    ) -> TurnSpring:
        """A torsion spring [Nm/rad] from link `a` to link `b` about `axis` through `at` (3,) [m]; see `joint_spring`."""
        label = self._spring_name(name, "torsion spring")
        first, second = self._pair(a, b, f"spring '{label}'")
        made = TurnSpring(label, first, second, as_given(at), as_given(axis), stiffness, rest_angle)
        self._springs.append(made)
        return made

    def _spring_name(self, name: str | None, default: str) -> str:
        used = {s.name for s in self._springs}
        if name is None:
            return numbered(default, used)
        if name in used:
            raise SceneError(f"the spring name '{name}' is used already; every spring needs its own name.")
        return name

    def heat(
        self, temperature: float = 0.0, *, through: float = 0.0, leaves: str | Sequence[str] | None = None
    ) -> Heat:
        """Warm leaf springs by `temperature` [K], and by `through` [K] more at their +e2 face than at their -e2 face.

        leaves: full names ("joint/leaf"), all of the mechanism when left out; their material needs its expansion.
        """
        names = (leaves,) if isinstance(leaves, str) else leaves
        if names is not None and not isinstance(names, list | tuple):
            raise SceneError(f"heat: leaves = {show(leaves)} must be names of leaf springs in a list.")
        self._heats.append(Heat(temperature, through, None if names is None else tuple(names)))
        return self._heats[-1]

    def fit(
        self,
        leaf: PlacedLeaf | str,
        *,
        natural_length: float | None = None,
        shift: ArrayLike = (0.0, 0.0, 0.0),
        turn: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Fit:
        """How a leaf is put in: prestress by natural_length [m], assembly error of its clamp by shift [m] and turn [rad].

        leaf: full name ("joint/leaf") or a free-form leaf; shift and turn (3,) lead from where end q is drawn to where
        it is clamped, in the axes of the leaf. Raises SceneError.
        """
        self._fits.append(
            Fit(str(getattr(leaf, "name", leaf)), natural_length, as_given(shift), as_given(turn))
        )
        return self._fits[-1]

    def consider(self, *effects: str) -> None:
        """Effects of the leaf material, "warping" and "plate", to be simulated.

        Without this sentence leaf springs are standard beams, as in the literature they are compared with.
        """
        for effect in effects:
            if effect not in CONSIDERED:
                raise SceneError(f"consider: {show(effect)} is unknown{nearest(effect, CONSIDERED)}")
        self._consider = tuple(sorted({*self._consider, *effects}))
