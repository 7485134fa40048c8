"""Small motions about a pose from chosen inputs to chosen sensors, in modal coordinates.

With modes phi_k of unit modal mass, an input of shape b and a sensor of gradient c,

    c.x = sum_k (c.phi_k) (phi_k.b) / (w_k^2 - w^2 + 2 i zeta_k w_k w) + rest
    rest = c.K+ b - sum_k (c.phi_k) (phi_k.b) / w_k^2

where the rest is the static response of the modes left out (residual flexibility; Craig and Kurdila, Fundamentals of
Structural Dynamics, 2006, 17.7) and K+ is without the motions that have no stiffness. b is the row of a drive, the wrench of
a load, or -M r for a base that is accelerated along r, with the motions x relative to it; an absolute sensor adds the base.
Dashpots are forces between further inputs and sensors, fed back exactly (Woodbury), at whatever damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ksd.answers.frequencies import Modes, frequencies
from ksd.answers.mass import base_load
from ksd.answers.material_damping import has_loss_factors
from ksd.answers.nonconservative import MAX_DAMPED_SKEW_SHARE
from ksd.answers.stiffness import DIRECTIONS, point_jacobian
from ksd.answers.tangent import row_gradients, row_numbers
from ksd.checks import name_hint, names_of, number, show, whole_number
from ksd.errors import KinematicsError, SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.scene.drive import GROUND, DriveTerm
from ksd.scene.sensor import KINDS

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Damping = float | Sequence[float] | Sequence[tuple[float, float]] | Literal["materials"]
BASE_INPUTS = tuple(f"base {d}" for d in DIRECTIONS)
"""Names of the inputs of a shaken base: along and about the global axes, through the origin."""
DEFAULT_RATIO = 0.01
"""Damping ratio of every mode where the scene says nothing about damping."""
DEFAULT_MODES = 12
"""Number of modes where neither it nor a frequency is given."""
MAX_MODES = 200
"""Largest number of modes that is chosen for the highest frequency asked for."""
ROUNDING_GAIN = 1e-12
"""Part of a gain in motions without stiffness, relative to that of all modes, up to which it is rounding."""
SETTLED = 0.02
"""Amplitude, relative to the first, at which a mode counts as settled."""
BAND_RATIO = 3.0
"""Lowest frequency left out over the highest asked for, where the number of modes is chosen."""


def vibration_inputs(scene: Any) -> tuple[str, ...]:
    """What may excite vibrations: drives, loads and the base."""
    return (*(d.name for d in scene.drives), *(load.name for load in scene.loads_on_links), *BASE_INPUTS)


@dataclass(frozen=True)
class Plant:
    """Modal model between inputs and outputs about a pose.

    inputs, outputs, input_units, output_units: their names and units; freed: drives and supports that are released.
    omega_squared [1/s^2], ratio (k,): of the modes, 0 for motions without stiffness; force (k, i), motion (o, k): work of
    unit inputs on, and readings of outputs in, modes of unit modal mass; rest (o, i): static response of modes left out;
    carried (o, i): reading of an absolute sensor per motion of the base; base_motion (o, i): the same of every sensor, as if
    all were absolute; derivatives (o,): time derivatives in each output. dashpots (d,): their damping; damper_force (k, d),
    damper_rest: the same between them and inputs (d, i), outputs (o, d) and one another (d, d). left_out_Hz: lowest
    frequency left out, inf where none is. damping_text: what the damping ratios are.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    omega_squared: Array
    ratio: Array
    force: Array
    motion: Array
    rest: Array
    carried: Array
    base_motion: Array
    derivatives: NDArray[np.intp]
    dashpots: Array
    damper_force: Array
    damper_rest: tuple[Array, Array, Array]
    left_out_Hz: float
    damping_text: str
    modes: Modes
    freed: tuple[str, ...]

    @property
    def held_text(self) -> str:
        """The drives that hold, as they change what is seen most: "; held: push"; empty where none does."""
        held = [d.name for d in self.modes.model.scene.drives if d.name not in self.freed]
        return f"; held: {', '.join(held)}" if held else ""

    @property
    def frequency_Hz(self) -> Array:
        """Frequencies (k,) [Hz] of the modes."""
        return self.modes.frequency_Hz[: len(self.omega_squared)]

    @property
    def dynamics(self) -> Array:
        """Matrix A (2k, 2k) of the modal amplitudes and their rates, x' = A x, dashpots included."""
        k = len(self.omega_squared)
        A = np.zeros((2 * k, 2 * k))
        A[:k, k:] = np.eye(k)
        A[k:, :k] = -np.diag(self.omega_squared)
        A[k:, k:] = -np.diag(2.0 * self.ratio * np.sqrt(np.abs(self.omega_squared)))
        A[k:, k:] -= (self.damper_force * self.dashpots) @ self.damper_force.T
        return A

    def settling_time(self) -> float:
        """Time [s] in which the motion of every mode decays to SETTLED; infinite where one does not."""
        slowest = float(-np.linalg.eigvals(self.dynamics).real.max(initial=-np.inf))
        return float(-np.log(SETTLED) / slowest) if slowest > 0.0 else float("inf")

    def _gain(self, w: Array) -> Any:
        """Complex amplitude (n, k) of every mode per unit force on it alone, at angular frequencies w (n, 1)."""
        own = self.omega_squared
        return 1.0 / (own - w**2 + 2j * self.ratio * np.sqrt(np.abs(own)) * w)

    def _dashpot_forces(self, gain: Any, w: Array) -> Any:
        """Forces (n, d, i) of the dashpots per unit input, from the compliance between them."""
        to_input, _, own = self.damper_rest
        seen = self.damper_force.T
        between = own + seen @ (gain[:, :, None] * self.damper_force)
        reached = to_input + seen @ (gain[:, :, None] * self.force)
        rate = 1j * w[:, :, None] * self.dashpots[:, None]
        return -np.linalg.solve(np.eye(len(self.dashpots)) + rate * between, rate * reached)

    def modal(self, frequency_Hz: Any) -> Complex:
        """Complex amplitudes (n, k, i) of the modes per unit input at frequencies (n,) [Hz], dashpots included."""
        w = 2.0 * np.pi * np.asarray(frequency_Hz, float)[:, None]
        gain = self._gain(w)
        found = gain[:, :, None] * self.force
        if len(self.dashpots):
            found = found + gain[:, :, None] * (self.damper_force @ self._dashpot_forces(gain, w))
        return np.asarray(found)

    def transfer(self, frequency_Hz: Any) -> Complex:
        """Complex response (n, outputs, inputs) at frequencies (n,) [Hz]: amplitude of an output per unit input."""
        f = np.atleast_1d(np.asarray(frequency_Hz, float))
        w = 2.0 * np.pi * f[:, None]
        response: Any = self.motion @ self.modal(f) + self.rest
        if len(self.dashpots):
            response = response + self.damper_rest[1] @ self._dashpot_forces(self._gain(w), w)
        rate: Any = 1j * w[:, :, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            base = np.where(self.carried == 0.0, 0.0, rate**-2.0 * self.carried)
        return np.asarray(rate ** self.derivatives[:, None] * (response + base))

    def per_base_motion(self) -> Plant:
        """The plant with the motion of the base as its input instead of its acceleration, and absolute readings.

        Raises SceneError for velocities, whose ratio to a motion is none.
        """
        for name, order in zip(self.outputs, self.derivatives.tolist(), strict=True):
            if order == 1:
                raise SceneError(
                    f"transmissibility: sensor '{name}' reads a velocity; give displacements or accelerations"
                )
        units = tuple("m" if u == "m/s^2" else "rad" for u in self.input_units)
        plain = tuple(u.removesuffix("/s^2") for u in self.output_units)
        still = np.full(len(self.derivatives), 2)
        # an acceleration per acceleration is a motion per motion
        return replace(
            self, input_units=units, output_units=plain, derivatives=still, carried=self.base_motion
        )

    def truncation_error(self, frequency_Hz: Any) -> Array:
        """Bound (n, outputs, inputs) of what the modes left out add to their static response at frequencies (n,) [Hz].

        A mode at f_left or above departs from it by (f/f_left)^2 / (1 - (f/f_left)^2) at most; inf from f_left on.
        """
        f = np.atleast_1d(np.asarray(frequency_Hz, float))
        ratio = (f / self.left_out_Hz) ** 2
        with np.errstate(divide="ignore"):
            share = np.where(ratio < 1.0, ratio / np.maximum(1.0 - ratio, 1e-300), np.inf)
        rate = (2.0 * np.pi * f)[:, None] ** self.derivatives
        bound = (share[:, None] * rate)[:, :, None] * np.abs(self.rest)
        return np.where(self.rest == 0.0, 0.0, bound)

    def static_gain(self) -> Array:
        """Gain (outputs, inputs) at zero frequency; infinite where an input moves an output without resistance."""
        rigid, still = self.omega_squared == 0.0, self.derivatives > 0
        elastic = self.motion[:, ~rigid] / self.omega_squared[~rigid] @ self.force[~rigid] + self.rest
        unbounded = self.motion[:, rigid] @ self.force[rigid]
        largest = np.abs(self.motion) @ np.abs(self.force)
        unbounded[np.abs(unbounded) <= ROUNDING_GAIN * largest] = 0.0
        gain = np.where(unbounded == 0.0, elastic, np.copysign(np.inf, unbounded))
        # an acceleration of a free motion, or of a base that takes the sensor along
        moved = np.where(self.derivatives[:, None] == 2, unbounded + self.carried, 0.0)
        return np.where(still[:, None], moved, gain)

    def state_space(self) -> tuple[Array, Array, Array, Array]:
        """Matrices A, B, C, D of x = (eta, eta'), the modal amplitudes and their rates.

        Outputs that are accelerations are without the rest, which has no such form: it grows with the square of the
        frequency. Raises SceneError for absolute displacements and velocities under a base acceleration.
        """
        k, A = len(self.omega_squared), self.dynamics
        B = np.vstack([np.zeros_like(self.force), self.force])
        C, D = np.zeros((len(self.outputs), 2 * k)), np.zeros(self.rest.shape)
        for row, order in enumerate(self.derivatives):
            if order < 2 and self.carried[row].any():
                raise SceneError(
                    f"sensor '{self.outputs[row]}' is absolute: a base that is given by its acceleration has a state of its "
                    "own then; observe the acceleration, or the motion relative to ground"
                )
            if order == 0:
                C[row, :k], D[row] = self.motion[row], self.rest[row]
            elif order == 1:
                C[row, k:] = self.motion[row]
            else:
                C[row], D[row] = self.motion[row] @ A[k:], self.motion[row] @ self.force + self.carried[row]
        return A, B, C, D


def term_gradient(model: Model, state: State, term: DriveTerm, size: int) -> Array:
    """Derivative (size,) of a component of motion with respect to the unknowns of `model` at `state`."""
    nodes = [model.node_names.index(name) for name in (term.link, term.base)]
    frame = np.eye(3) if term.base == GROUND else state.R[nodes[1]]
    along, found = frame @ np.asarray(term.direction), np.zeros(size)
    point = state.x[nodes[0]] + state.R[nodes[0]] @ (np.asarray(term.point) - model.rest.x[nodes[0]])
    for node, sign in zip(nodes, (1.0, -1.0), strict=True):
        start = int(model.arrays.start[node])
        if start < 0:
            continue
        if term.kind == "rotation":
            found[start + 3 : start + 6] += sign * term.coefficient * along
        else:
            moved = point_jacobian(point - state.x[node])[:3]
            found[start : start + 6] += sign * term.coefficient * (along @ moved)
    return found


def base_direction(name: str, model: Model) -> Array:
    """Unit motion (6,) of a base named "base y" or "base rz"; raises SceneError."""
    words = name.split()
    if len(words) != 2 or words[1] not in DIRECTIONS:
        raise SceneError(f"input {show(name)}: a base moves along or about an axis, 'base x' to 'base rz'")
    motion = np.eye(6)[DIRECTIONS.index(words[1])]
    plane = model.scene.plane
    if plane is not None:
        inside = [*plane, f"r{({'x', 'y', 'z'} - set(plane)).pop()}"]
        if words[1] not in inside:
            raise SceneError(
                f"input '{name}': the mechanism lives in the plane {plane}, which a base leaves along or about "
                f"{words[1].removeprefix('r')}; its base moves by {', '.join(f'base {d}' for d in inside)}"
            )
    if motion[3:].any() and model.scene.gravity is not None:
        raise SceneError(
            f"input '{name}': a base that turns in gravity would tilt the weights, which is left out here; shake it along "
            "x, y or z, or leave gravity out"
        )
    return motion


def _load_vector(model: Model, state: State, load: Any, size: int) -> Array:
    """Generalised forces (size,) of a load of the scene."""
    node = model.node_names.index(load.link)
    turn = state.R[node] if load.following else np.eye(3)
    arm = state.R[node] @ (np.asarray(load.at) - model.rest.x[node])
    found, start = np.zeros(size), int(model.arrays.start[node])
    wrench = np.concatenate([turn @ np.asarray(load.force), turn @ np.asarray(load.moment)])
    found[start : start + 6] = point_jacobian(arm).T @ wrench
    return found


def _choose_names(what: str, given: Any, default: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Names of inputs or outputs; all of `default` when None. Raises SceneError."""
    names = tuple(default) if given is None else names_of(given, what)
    if not names and given is None:
        raise SceneError(
            f"{what}: there is none; name some of {', '.join(known) or 'what the scene has none of'}"
        )
    for name in names:
        if name not in known and not (what == "inputs" and name.startswith("base")):
            raise SceneError(f"{what}: {show(name)} is unknown{name_hint(name, known)}")
    return names


def modal_ratios(modes: Modes, count: int, damping: Any) -> tuple[Array, str]:
    """Damping ratios (count,) of the first modes, and what they are, from the argument `damping` of `make_plant`.

    Raises SceneError.
    """
    f, damping = modes.frequency_Hz[:count], check_damping(damping)
    if damping is None:
        damping = "materials" if has_loss_factors(modes.model) else DEFAULT_RATIO
    if damping == "materials":
        return modes.damping[:count], "from the loss factors of the materials"
    if isinstance(damping, float):
        return np.where(f == 0.0, 0.0, damping), f"{damping:g} of critical in every mode"
    if damping and isinstance(damping[0], tuple):
        return _rayleigh(f, damping)
    if len(damping) < len(f):
        raise SceneError(
            f"damping = {show(damping)}: {len(damping)} ratios for {len(f)} modes; give one for each"
        )
    return np.array(damping[: len(f)]), "one ratio per mode"


def check_damping(damping: Any) -> Any:
    """A ratio, a tuple of ratios or of two pairs (frequency [Hz], ratio), "materials", or None. Raises SceneError."""
    if damping is None or (isinstance(damping, str) and damping == "materials"):
        return damping
    if isinstance(damping, str):
        raise SceneError(f"damping = {show(damping)}: give a ratio, ratios, pairs or 'materials'")
    if not isinstance(damping, list | tuple | np.ndarray):
        return _ratio(damping)
    if len(damping) and isinstance(damping[0], list | tuple | np.ndarray):
        if len(damping) != 2 or any(
            not isinstance(pair, list | tuple | np.ndarray) or len(pair) != 2 for pair in damping
        ):
            raise SceneError(
                f"damping = {show(damping)}: Rayleigh damping needs two pairs (frequency [Hz], ratio)"
            )
        return tuple((float(number(a, "frequency of a pair", unit="Hz")), _ratio(z)) for a, z in damping)
    return tuple(_ratio(z) for z in damping)


def _ratio(value: Any) -> float:
    """A damping ratio from 0 to below 1; raises SceneError."""
    ratio = number(value, "damping")
    if not 0.0 <= ratio < 1.0:
        raise SceneError(f"damping = {show(value)}: a ratio from 0 to below 1 is needed")
    return ratio


def _rayleigh(f: Array, pairs: Sequence[tuple[float, float]]) -> tuple[Array, str]:
    """Ratios a/(2 w) + b w/2 through two (frequency, ratio) pairs."""
    (f1, z1), (f2, z2) = pairs
    if not (f1 > 0.0 and f2 > 0.0 and f1 != f2):
        raise SceneError(f"damping: the two frequencies {f1:g} and {f2:g} Hz must be positive and different")
    w = 2.0 * np.pi * np.array([f1, f2])
    a, b = np.linalg.solve(np.column_stack([0.5 / w, 0.5 * w]), [z1, z2])
    own = 2.0 * np.pi * np.abs(f)
    ratios = np.divide(0.5 * a, own, out=np.zeros_like(own), where=own > 0.0) + 0.5 * b * own
    if ratios.min(initial=0.0) < 0.0:
        worst = int(np.argmin(ratios))
        raise SceneError(
            f"damping: through {z1:g} at {f1:g} Hz and {z2:g} at {f2:g} Hz Rayleigh damping is negative at {f[worst]:.4g} "
            "Hz; choose pairs that enclose the modes"
        )
    return ratios, f"Rayleigh through {z1:g} at {f1:g} Hz and {z2:g} at {f2:g} Hz"


def _enough_modes(
    model: Model,
    motion: State,
    count: int | None,
    freed: tuple[str, ...],
    up_to_Hz: float | None,
    load_factor: float,
) -> tuple[Modes, int]:
    """Modes, with one more than those kept where there is one, and how many are kept."""
    kept = DEFAULT_MODES if count is None else whole_number(count, "modes")
    while True:
        modes = frequencies(model, motion, count=kept + 1, freed=freed, load_factor=load_factor)
        if len(modes) <= kept:
            return modes, len(modes)
        enough = up_to_Hz is None or modes.frequency_Hz[kept] >= BAND_RATIO * up_to_Hz
        if count is not None or enough or kept >= MAX_MODES:
            return modes, kept
        kept = min(2 * kept, MAX_MODES)


def _is_translation(scene: Any, drive: str) -> bool:
    """Whether the value of a drive is a length."""
    return next(d.dimension for d in scene.drives if d.name == drive) == "length"


def _carried(model: Model, state: State, term: DriveTerm, base: Array) -> float:
    """Reading of an absolute sensor per unit motion of its base (6,), about the origin; 0 of one relative to a link."""
    if term.base != GROUND:
        return 0.0
    direction, node = np.asarray(term.direction), model.node_names.index(term.link)
    if term.kind == "rotation":
        return float(term.coefficient * direction @ base[3:])
    point = state.x[node] + state.R[node] @ (np.asarray(term.point) - model.rest.x[node])
    return float(term.coefficient * direction @ (base[:3] + np.cross(base[3:], point)))


def make_plant(
    model: Model,
    motion: State,
    *,
    inputs: Any = None,
    outputs: Any = None,
    damping: Any = None,
    modes: int | None = None,
    freed: Any = None,
    up_to_Hz: float | None = None,
    load_factor: float = 1.0,
) -> Plant:
    """The plant of a state.

    inputs: names of drives (a force beyond that at the pose [N or Nm]), of loads of the scene (1 adds that load once more),
    or "base x" ... "base rz" (acceleration of the base [m/s^2 or rad/s^2]); all drives when None. outputs: names of sensors
    and drives; all sensors when None, or all drives where there are none. damping: a ratio of all modes, ratios, two pairs
    (frequency [Hz], ratio), or "materials"; when None the loss factors of the materials where there are any, else
    DEFAULT_RATIO. Dashpots of the scene come on top. modes: number of modes, chosen by up_to_Hz [Hz] when None. freed:
    drives and supports released; those among inputs and outputs when None. Raises SceneError and what `frequencies` raises.
    """
    scene, drives = model.scene, model.drive_names
    sensors, loads = {s.name: s for s in scene.sensors}, {load.name: load for load in scene.loads_on_links}
    chosen = _choose_names("inputs", inputs, drives, vibration_inputs(scene))
    seen = _choose_names("outputs", outputs, tuple(sensors) or drives, (*sensors, *drives))
    both = next((name for name in seen if name in sensors and name in drives), None)
    if both is not None and outputs is not None:
        raise SceneError(f"outputs: '{both}' is a sensor and a drive; give the sensor another name")
    released = (
        tuple(d for d in drives if d in chosen or (d in seen and d not in sensors))
        if freed is None
        else names_of(freed, "freed")
    )
    row_numbers(model, released)
    for name in chosen:
        if name in drives and name not in released:
            raise SceneError(f"inputs: drive '{name}' is held, and its force moves nothing; name it in freed")
    found, kept = _enough_modes(model, motion, modes, released, up_to_Hz, load_factor)
    if not found.conservative and found.tangent.skew_share() > MAX_DAMPED_SKEW_SHARE:
        raise SceneError(
            "the loads follow their link or are moments fixed in space, and not conservative: modes are no basis of a "
            "linear model then; take those loads off, or put them on as forces that keep their direction"
        )
    if np.any(found.omega_squared < 0.0):
        raise KinematicsError(
            f"the pose is unstable with {', '.join(released) or 'nothing'} freed: small motions grow, and have no response; "
            "hold more drives, or take a stable pose"
        )
    left_out = float(found.frequency_Hz[kept]) if kept < len(found) else np.inf
    fine, state, size = found.model, found.motion, found.mass.size
    rows = row_gradients(fine.arrays, state, range(len(drives)))

    def drive_row(name: str) -> Array:
        return np.concatenate([rows[:, drives.index(name)], np.zeros(size - len(rows))])

    force, input_units, base_motion = [], [], []
    for name in chosen:
        direction = np.zeros(6)
        if name in drives:
            force.append(drive_row(name))
            input_units.append("N" if _is_translation(scene, name) else "Nm")
        elif name in loads:
            force.append(_load_vector(fine, state, loads[name], size))
            input_units.append("1")
        else:
            direction = base_direction(name, model)
            force.append(-base_load(found.mass, fine, state, direction))
            input_units.append("m/s^2" if direction[:3].any() else "rad/s^2")
        base_motion.append(direction)
    gradient, output_units, derivatives = [], [], []
    carried, along = np.zeros((2, len(seen), len(chosen)))
    for o, name in enumerate(seen):
        if name in sensors:
            sensor = sensors[name]
            gradient.append(term_gradient(fine, state, sensor.term, size))
            output_units.append(sensor.unit)
            derivatives.append(KINDS[sensor.kind])
            along[o] = [_carried(fine, state, sensor.term, r) for r in base_motion]
            if sensor.absolute:
                carried[o] = along[o]
        else:
            gradient.append(drive_row(name))
            output_units.append("m" if _is_translation(scene, name) else "rad")
            derivatives.append(0)
    dashpot = [term_gradient(fine, state, d.term, size) for d in scene.dampers]
    b, c, d = (np.array(part).reshape(-1, size) for part in (force, gradient, dashpot))
    phi, squared = found.vector[:kept], found.omega_squared[:kept]
    elastic = squared != 0.0
    soft = phi[elastic] / squared[elastic, None]
    static = found.static_response(np.concatenate([b, d]).T)
    to_b, to_d = np.split(static, [len(b)], axis=1)

    def rest(seen_by: Array, of: Array, response: Array) -> Array:
        left: Array = seen_by @ response - (seen_by @ phi[elastic].T) @ (soft @ of.T)
        return left

    ratio, text = modal_ratios(found, kept, damping)
    return Plant(
        chosen, seen, tuple(input_units), tuple(output_units), squared, ratio, phi @ b.T, c @ phi.T,
        rest(c, b, to_b), carried, along, np.array(derivatives, dtype=np.intp),
        np.array([damper.damping for damper in scene.dampers]), phi @ d.T,
        (rest(d, b, to_b), rest(c, d, to_d), rest(d, d, to_d)), left_out, text, found, released,
    )  # fmt: skip
