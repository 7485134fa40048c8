"""Paper 3: a planar gripper of rigid bodies on circular-arc flexures, by constant flexure matrices and by exact ones.

The dimensions are ours (`ksd/scenes/gripper.toml`), as none survive in the paper's text. "linear": wrenches balanced on the
undeformed lever; "partial": on the present one, which makes it the gradient of an energy (`method="constant"`); "exact":
strain-mode leaves. Crank torques up to 5 mNm; then the inverse problem, and times.

    python benchmarks/paper3.py [--quick] [--out FOLDER]

Writes paper3.json and paper3.png.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import figure_grid, label_axes, machine, parse_options, save_picture, time_in_turns, write_json

import ksd
from ksd.view.figure import LINE_COLORS

R, ANGLE, JAW = 4e-3, 1.5 * math.pi, np.array([0.07, 0.045])
CORNERS = ((0.0, 0.0), (0.0, 0.03), (0.04, 0.03), (0.04, 0.0))
ENDS = (90.0, 0.0, -90.0, 90.0)
"""Direction of end B of every arc from its corner [deg]; it runs counterclockwise from A, 270 degrees before."""
BODIES = ((None, 0), (0, 1), (1, 2), (None, 2))
"""Body at A and at B of every arc: crank, jaw, rocker, None for ground."""
PLASTIC, SECTION = ksd.Material(E=2.5e9, nu=0.3), ksd.rectangle(0.4e-3, 6e-3)
S = np.array([[0.0, -1.0], [1.0, 0.0]])


def rotation_matrix(angle: float) -> np.ndarray:
    """Rotation matrix (2, 2)."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def arc_ends(k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends A and B (2,) [m] of arc k, and the frame at B: x along the tangent away from the arc, y to the centre."""
    phi = math.radians(ENDS[k])
    corner = np.array(CORNERS[k])
    at = [corner + R * rotation_matrix(angle)[:, 0] for angle in (phi - ANGLE, phi)]
    return at[0], at[1], rotation_matrix(phi + 0.5 * math.pi)


def gripper(
    torque: float = 0.0,
    force: tuple[float, float] = (0.0, 0.0),
    *,
    section: ksd.Section = SECTION,
    driven: bool = False,
) -> ksd.Mechanism:
    """The gripper of free leaf springs: torque [Nm] on the crank, force [N] on the jaw at JAW."""
    scene = ksd.Mechanism("gripper", plane="xy")
    bodies = scene.links("crank", "jaw", "rocker")
    for k, (a, b) in enumerate(BODIES):
        start, end, _ = arc_ends(k)
        scene.leaf(
            "ground" if a is None else bodies[a], bodies[b], start=(*start, 0), end=(*end, 0), name=f"arc {k}",
            curve=ksd.Arc(radius=R, angle=ANGLE), section=section, material=PLASTIC,
        )  # fmt: skip
    if torque:
        scene.load("crank", moment=(0, 0, torque))
    if any(force):
        scene.load("jaw", force=(*force, 0), at=(*JAW, 0))
    if driven:
        scene.actuate("crank", about="z", name="crank")
    return scene


def arc_stiffness(section: ksd.Section = SECTION) -> np.ndarray:
    """K (3, 3) of the arcs at end B, in closed form, in the frame at B."""
    E, G = PLASTIC.E, PLASTIC.G
    C = ksd.Arc(radius=R, angle=ANGLE).compliance(
        E * section.Iz, EA=E * section.A, GA=section.ky * G * section.A
    )
    return np.linalg.inv(C)


def flexure(
    k: int, K: np.ndarray, q: np.ndarray, *, linear: bool
) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Force (n,) of arc k on its bodies, its tangent (n, n), and the indices of their unknowns.

    q (9,): displacement of the origin of every body and its angle. Section 2 of the note on paper 3: the wrench K d, d the
    end B seen from the body at A, balanced on the present lever e, or linear: on the undeformed one.
    """
    a, b = BODIES[k]
    A, B, frame = arc_ends(k)
    xi, ti = (np.zeros(2), 0.0) if a is None else (q[3 * a : 3 * a + 2], q[3 * a + 2])
    xj, tj = q[3 * b : 3 * b + 2], q[3 * b + 2]
    Ri, ra, rb = rotation_matrix(ti), rotation_matrix(ti) @ A, rotation_matrix(tj) @ B
    e, Q, rest = xj + rb - xi - ra, Ri @ frame, Ri @ (B - A)
    w = K @ np.append(frame.T @ (Ri.T @ e - (B - A)), tj - ti)
    f, arm = Q @ w[:2], rest if linear else e
    # unknowns e, turn of i, turn of j
    J = np.zeros((3, 4))
    J[:2, :2], J[:2, 2], J[2, 2], J[2, 3] = Q.T, -Q.T @ S @ e, -1.0, 1.0
    left = J.copy()
    left[:2, 2] = -Q.T @ S @ arm
    H = left.T @ K @ J
    H[:2, 2] += S @ f
    # the undeformed lever turns with body i, as the wrench does
    if not linear:
        H[2, :2] += S @ f
        H[2, 2] -= f @ e
    M = np.zeros((4, 6))
    M[:2, :2], M[:2, 2], M[:2, 3:5], M[:2, 5] = -np.eye(2), -S @ ra, np.eye(2), S @ rb
    M[2, 2] = M[3, 5] = 1.0
    H = M.T @ H @ M
    H[2, 2] += f @ ra
    H[5, 5] -= f @ rb
    g = M.T @ (left.T @ w)
    kept = [*([] if a is None else range(3)), 3, 4, 5]
    to = [*([] if a is None else range(3 * a, 3 * a + 3)), *range(3 * b, 3 * b + 3)]
    return g[kept], H[np.ix_(kept, kept)], to


def residual(
    q: np.ndarray, K: np.ndarray, torque: float, force: np.ndarray, *, linear: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Residual of equilibrium (9,), and its derivative (9, 9)."""
    g, H = np.zeros(9), np.zeros((9, 9))
    for k in range(4):
        own, tangent, to = flexure(k, K, q, linear=linear)
        g[to] += own
        H[np.ix_(to, to)] += tangent
    arm = rotation_matrix(q[5]) @ JAW
    g[2] -= torque
    g[3:5] -= force
    g[5] -= (S @ arm) @ force
    H[5, 5] += arm @ force
    return g, H


def solve_constant(
    torque: float, force: Any = (0.0, 0.0), *, section: ksd.Section = SECTION, linear: bool
) -> np.ndarray:
    """Equilibrium (9,) by Newton's method on constant matrices."""
    q, K = np.zeros(9), arc_stiffness(section)
    for _ in range(50):
        g, H = residual(q, K, torque, np.asarray(force, float), linear=linear)
        step = np.linalg.solve(H, g)
        q -= step
        if np.abs(step).max() < 1e-13:
            return q
    raise ArithmeticError("no equilibrium")


def configuration_answers(q: np.ndarray) -> tuple[float, float, float, float]:
    """Crank and rocker angle [rad], and displacement of the jaw [mm]."""
    x, y = 1e3 * (q[3:5] + rotation_matrix(q[5]) @ JAW - JAW)
    return q[2], q[8], x, y


def answers(pose: Any) -> tuple[float, float, float, float]:
    """The same of a configuration."""
    x, y, _ = 1e3 * pose.displacement("jaw", (*JAW, 0))
    return pose.rotation("crank")[2], pose.rotation("rocker")[2], x, y


def curves(torques: np.ndarray) -> dict[str, np.ndarray]:
    """Answers (n, 4) at every torque, by model."""
    ways: dict[str, Callable[[float], Any]] = {
        "linear": lambda t: configuration_answers(solve_constant(t, linear=True)),
        "partial": lambda t: answers(ksd.solve(gripper(t), method="constant", estimate=False)),
        "exact": lambda t: answers(ksd.solve(gripper(t))),
    }
    return {name: np.array([way(float(t)) for t in torques]) for name, way in ways.items()}


STYLES = {"linear": ":", "partial": "--", "exact": "-"}


def picture(found: Mapping[str, Any], path: Path) -> None:
    """Crank angle over torque, its error, and the gripper at the last torque."""
    torques, exact = 1e3 * np.array(found["torque"]), np.array(found["exact"])[:, 0]
    title = "Gripper of paper 3: by constant flexure matrices, balanced undeformed (linear) or as it is (partial), and exact"
    figure, ((left, middle, right),) = figure_grid(1, 3, size=(4.2, 3.2), title=title)
    for color, (name, style) in zip(LINE_COLORS, STYLES.items(), strict=False):
        angle = np.array(found[name])[:, 0]
        left.plot(torques, np.degrees(angle), style, color=color, label=name)
        if name != "exact":
            middle.plot(torques, 100 * (angle / exact - 1), style, color=color, label=name)
    label_axes(left, x="crank torque [mNm]", y="crank angle [deg]")
    label_axes(middle, x="crank torque [mNm]", y="error of the crank angle [%]")
    last = found["torque"][-1]
    ksd.solve(gripper(last)).plot(axes=right, labels=False, title=f"exact, at {1e3 * last:g} mNm")
    save_picture(figure, path)


def inverse_problem() -> dict[str, Any]:
    """Crank torque [Nm] and opening [mm] at 15 degrees, with the error told; median thread times [us] of prepared
    calls, in turns."""
    solver, loaded, found = ksd.prepare(gripper(driven=True)), ksd.prepare(gripper(5e-3)), {}
    for method in ("constant", "conventional"):
        pose = solver(crank=math.radians(15), method=method)  # type: ignore[arg-type]
        error = math.nan if pose.error is None else pose.error.relative
        found[method] = {"torque": pose.forces["crank"], "opening": -answers(pose)[2], "error": error}
    pose = solver(crank=math.radians(15), method="constant")
    wanted = {name: where for name, where in pose.links.items() if name != "ground"}
    places, turns = (np.array([where[k] for where in wanted.values()]) for k in (0, 1))
    calls: dict[str, Callable[[], Any]] = {
        "direct, constant": lambda: loaded(method="constant", estimate=False, strict=False),
        "direct, exact": lambda: loaded(method="conventional", strict=False),
        "inverse, constant": lambda: solver.required_forces(places, rotation=turns),
        "inverse by names, constant": lambda: ksd.required_loads(solver, wanted, method="constant"),
    }
    return found | {"microseconds": {n: t.median for n, t in time_in_turns(calls, repeats=200).items()}}


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Print, write and draw the comparison."""
    chosen = parse_options(__doc__ or "", argv)
    torques = np.linspace(0.0, 5e-3, 4 if chosen.quick else 11)[1:]
    found = curves(torques)
    print("crank torque [mNm]; crank angle [deg] linear, partial, exact; error of the first two [%]")
    for k, torque in enumerate(torques):
        angles = [math.degrees(found[n][k, 0]) for n in STYLES]
        off = [100 * (a / angles[2] - 1) for a in angles[:2]]
        print(f"{1e3 * torque:6.2f}", *(f"{a:9.4f}" for a in angles), *(f"{e:+7.2f}" for e in off))
    made = {"machine": machine(), "torque": torques.tolist(), **found, "inverse": inverse_problem()}
    print(f"crank at 15 degrees, and thread times [us] of prepared calls: {made['inverse']}")
    write_json(made, chosen.out / "paper3.json")
    picture(made, chosen.out / "paper3.png")
    return made


if __name__ == "__main__":
    main()
