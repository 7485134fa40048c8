"""The record of a joint family, and its contraction to the polynomials of one design.

Every function of a family is a sum over M product terms c_i prod_j (theta_j / range_j)^p_ij prod_k P_q_ik(s_k): monomials
of the intended motions theta over the largest trained magnitude, and Legendre polynomials P of the shape parameters s,
mapped to [-1, 1]. Contraction at a design evaluates the latter and leaves polynomials of the motions. Paper 1, sections 2.2
and 3.2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ksd.checks import name_hint, number, show
from ksd.errors import RangeError, SceneError
from ksd.library.chains import extend_chain
from ksd.library.functions import Array, Functions, JointFunctions, Mesh, legendre_products

RANGE_TOLERANCE = 1e-9
"""Distance outside a trained range, over half its width, that counts as rounding."""


@dataclass(frozen=True)
class Stroke:
    """A trained intended motion: name, kind "rotation" [rad] or "translation" [over joint length], range low to high."""

    name: str
    kind: str
    low: float
    high: float

    @property
    def max_magnitude(self) -> float:
        """The largest trained magnitude, by which the motion is divided in the monomials."""
        return max(abs(self.low), abs(self.high))

    @property
    def range_text(self) -> str:
        """The range in degrees or joint lengths."""
        factor, unit = (np.rad2deg(1.0), "deg") if self.kind == "rotation" else (1.0, "joint lengths")
        return f"{self.low * factor:.4g} to {self.high * factor:.4g} {unit}"


@dataclass(frozen=True)
class Parameter:
    """A shape parameter: name, range `low` to `high` (SI), and the scale, "linear" or "log", of its map to [-1, 1].

    Raises SceneError for low > high (equal values are allowed), and a range that is not positive on a log scale.

    >>> thickness = ksd.Parameter("thickness", 0.1 * mm, 1 * mm, scale="log")
    >>> thickness.name, thickness.low, thickness.high
    ('thickness', 0.0001, 0.001)
    """

    name: str
    low: float
    high: float
    scale: str = "linear"

    def __post_init__(self) -> None:
        owner = f"Parameter {show(self.name)}"
        for end in ("low", "high"):
            object.__setattr__(self, end, number(getattr(self, end), end, owner=owner))
        known = isinstance(self.name, str) and self.scale in ("linear", "log")
        if not known or self.low > self.high or (self.scale == "log" and self.low <= 0.0):
            raise SceneError(
                f"{owner}: range {self.low:g} to {self.high:g} ({show(self.scale)}) must rise, be positive on a log scale, "
                'and have a name and a scale "linear" or "log".'
            )

    def place(self, value: float) -> float:
        """The position of `value` in the trained range, in [-1, 1]; a range of one value extends by 1e-6 of it."""
        if self.high == self.low:
            return (value - self.low) / (1e-6 * abs(self.low) + 1e-300)
        if self.scale == "log":
            return 2 * math.log(value / self.low) / math.log(self.high / self.low) - 1
        return 2 * (value - self.low) / (self.high - self.low) - 1

    def value(self, place: float) -> float:
        """The value at `place` in [-1, 1]; inverse of `place`."""
        if self.scale == "log":
            return float(self.low * (self.high / self.low) ** (0.5 * (place + 1)))
        return self.low + 0.5 * (place + 1) * (self.high - self.low)


@dataclass(frozen=True)
class Residual:
    """Fit errors of a group of one mesh: largest and rms error on the fitted shapes and on fresh ones.

    Units: interface, chords in joint lengths and rotations in rad; rotations, rad; amplitudes and wrench, dimensionless.
    """

    mesh: Mesh
    group: str
    fit_max: float
    fit_rms: float
    fresh_max: float
    fresh_rms: float


@dataclass(frozen=True)
class Evidence:
    """Largest changes of the functions of the joint in the middle of the shapes when one input changes.

    parameter: the input; change: its change as text ("0.5 times"); interface: of interface B and the blocks, in rad and
    joint lengths; rotations: of elements and nodes, in rad.
    """

    parameter: str
    change: str
    interface: float
    rotations: float


@dataclass(frozen=True)
class Probes:
    """Values of the fitted functions at k states, by which a record is checked later.

    shapes (k, s): shape parameters, SI. motions (k, m): intended motions, rad or stroke over joint length. values (k, rows):
    all functions side by side, in the order of `Record.at`.
    """

    shapes: Array
    motions: Array
    values: Array


@dataclass(frozen=True, repr=False)
class Record:
    """The trained functions of one joint family; see the module docstring for their form.

    family: its name; motions, parameters: its intended motions and shape parameters. powers (M, motions + parameters):
    exponents of the motions, then Legendre degrees of the parameters. functions: coefficients by mesh. leaves, blocks: names
    in the order of the arrays. residuals: fit errors; evidence: effects of changes of other inputs. orders: numbers of
    curvature modes (nx, ny, nz) of a leaf. design: the trained joint, SI numbers by name; samples: numbers of shapes, fitted
    and fresh. trained: date given to the trainer, ISO; version: of the trainer; history: one sentence per event; probes:
    states by which `ksd.train.check_probes` checks that the record agrees with this code, None in files of format 1.

    >>> record = ksd.find_record("crossed_pivot")
    >>> [motion.name for motion in record.motions], [p.name for p in record.parameters]
    (['angle'], ['angle', 'ratio'])
    """

    family: str
    motions: tuple[Stroke, ...]
    parameters: tuple[Parameter, ...]
    leaves: tuple[str, ...]
    blocks: tuple[str, ...]
    orders: tuple[int, int, int]
    powers: NDArray[np.int64]
    functions: Mapping[Mesh, Functions]
    residuals: tuple[Residual, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    design: Mapping[str, float] = field(default_factory=dict)
    samples: tuple[int, int] = (0, 0)
    trained: str = ""
    version: str = ""
    history: tuple[str, ...] = ()
    probes: Probes | None = None

    def __repr__(self) -> str:
        motions = ", ".join(f"{m.name} {m.range_text}" for m in self.motions)
        names = ", ".join(p.name for p in self.parameters)
        shape = f"shape by {names}" if names else "one shape"
        return f"<Record of {self.family}: {motions}; {shape}; {len(self.powers)} polynomials>"

    @property
    def motion_range(self) -> Array:
        """Trained ranges (m, 2) of the intended motions, rad or stroke over joint length."""
        return np.array([[m.low, m.high] for m in self.motions])

    @property
    def shape_names(self) -> tuple[str, ...]:
        """Names of the shape parameters."""
        return tuple(p.name for p in self.parameters)

    def worst(self, mesh: Mesh, group: str = "interface") -> float:
        """Largest error of a group on fresh shapes; nan if there is none."""
        errors = [r.fresh_max for r in self.residuals if (r.mesh, r.group) == (mesh, group)]
        return errors[0] if errors else math.nan

    def at(self, shapes: Array, motions: Array) -> dict[tuple[Mesh, str], Array]:
        """Values (k, size of the group) of all functions by (mesh, group), at shapes (k, s) (SI) and motions (k, m)."""
        values_by_group: dict[tuple[Mesh, str], Array] = {}
        for mesh in sorted(self.functions, key=str):
            joints = [self.contract(dict(zip(self.shape_names, s, strict=True)), mesh) for s in shapes]
            for group in sorted(self.functions[mesh].groups()):
                values = [joint.at(m, group).ravel() for joint, m in zip(joints, motions, strict=True)]
                values_by_group[mesh, group] = np.array(values)
        return values_by_group

    def contract(
        self, shape: Mapping[str, float], mesh: Mesh, *, extrapolate: bool = False
    ) -> JointFunctions:
        """The polynomials of the design with shape parameters `shape` (SI), for mesh "strain" or n elements per leaf.

        For more elements than were trained the orientations are integrated from the strain amplitudes. Raises SceneError for
        an unknown or missing parameter and an impossible mesh, RangeError outside the trained range unless `extrapolate`.
        """
        places, outside = self.places(shape, extrapolate=extrapolate)
        if mesh in self.functions:
            return self._contract(places, mesh, outside)
        if isinstance(mesh, bool) or not isinstance(mesh, int) or mesh < 1 or "strain" not in self.functions:
            raise SceneError(
                f"The record of {self.family} has no mesh {mesh!r}; it has {', '.join(map(str, self.functions))}."
            )
        longest = max((n for n in self.functions if isinstance(n, int)), default=0)
        known = self._contract(places, longest, outside) if 1 < longest < mesh else None
        return extend_chain(self._contract(places, "strain", outside), mesh, known=known)

    def places(
        self, shape: Mapping[str, float], *, extrapolate: bool = False
    ) -> tuple[Array, tuple[str, ...]]:
        """Shape parameters mapped to [-1, 1], in the order of `parameters`, and the names of those out of range.

        Raises as `contract`.
        """
        for name in shape:
            if name not in self.shape_names:
                hint = name_hint(name, self.shape_names)
                raise SceneError(f"The record of {self.family} has no shape parameter {name!r}{hint}")
        places, outside = [], []
        for p in self.parameters:
            if p.name not in shape:
                raise SceneError(
                    f"Shape parameter {p.name!r} of {self.family} is missing; give {p.low:g} to {p.high:g}."
                )
            value = float(shape[p.name])
            is_valid = math.isfinite(value) and (p.scale != "log" or value > 0)
            if not is_valid or not abs(p.place(value)) <= 1 + RANGE_TOLERANCE:
                if not (extrapolate and is_valid):
                    raise RangeError(
                        f"Shape parameter {p.name} = {value:.6g} of {self.family} is outside "
                        f"its trained range {p.low:.6g} to {p.high:.6g} (SI, angles in rad); change it, "
                        "train a wider record, or accept extrapolation with extrapolate=True (--extrapolate)."
                    )
                outside.append(p.name)
            places.append(p.place(value))
        return np.array(places), tuple(outside)

    def _contract(self, places: Array, mesh: Mesh, outside: tuple[str, ...]) -> JointFunctions:
        """Polynomials of the motions for one shape.

        places (s,): its parameters mapped to [-1, 1]; outside: names of those that are extrapolated.
        """
        m = len(self.motions)
        largest = np.array([motion.max_magnitude for motion in self.motions])
        shape = legendre_products(self.powers[:, m:], places[None])[0]
        weight = shape * np.prod(largest ** -self.powers[:, :m], axis=1)
        powers, merged = np.unique(self.powers[:, :m], axis=0, return_inverse=True)
        matrix = np.zeros((len(self.powers), len(powers)))
        matrix[np.arange(len(merged)), merged.ravel()] = weight
        groups = {name: array @ matrix for name, array in self.functions[mesh].groups().items()}
        return JointFunctions(mesh, powers, self.motion_range, Functions(**groups), self.orders, outside)
