"""A configuration as plain numbers with units in the keys: what the tables print and the JSON file holds.

Layout of `as_dict` (every key is explained in SCHEMA): the head states which mechanism was solved how, and whether the
result can be trusted; "steps" is the record of the solve; "drives", "supports", "stops", "cables", "contacts", "links",
"joints" and "leaves" are tables by name. A key ends with the unit of its number: mm, deg, um, mrad, N, Nm, us, percent.
Vectors are lists of three in global axes unless stated otherwise. Numbers that are not finite are null, so the file is
strict JSON.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.library.result_files import json_object
from ksd.solvers.estimated_result import EstimatedResult
from ksd.solvers.steps import Stop
from ksd.solvers.validity import basis_use
from ksd.solvers.verdict import stability_sentence, trust_verdicts, uncertainty

FORMAT = 1
SCHEMA: dict[str, str] = {
    "format": "version of this layout",
    "mechanism": "name of the scene",
    "method": "kinematic, reduced, full, conventional or modal",
    "leaf_model": "leaf model and its fineness, in words",
    "converged": "whether the last step reached its bound",
    "stable": "whether the state is a minimum of energy under the held drives",
    "stability": "the same in words",
    "trust.*.yes": "verdicts stable, branch (the one that leads here from rest), strength (a linear elastic beam can be in "
    "this state) and trusted (all three, and converged)",
    "trust.*.sentence": "the reason of the verdict",
    "doubts[]": "what speaks against the branch and was not cleared up",
    "negative_pivots": "negative pivots of the last factorisation",
    "expected_negative_pivots": "those that the drives and supports explain",
    "iterations": "factorisations of all steps together",
    "time_us": "thread time of all steps together",
    "kernel_time_us": "thread time in which a first solve of the process loaded or compiled kernels, apart from the steps",
    "load_factor": "fraction of the external loads applied",
    "steps[].name": "step of the method",
    "steps[].iterations": "factorisations of the step; null where nothing is iterated",
    "steps[].time_us": "thread time of the step",
    "steps[].residual_over_bound": "largest residual over the bound it had to meet; null where there is none",
    "steps[].gap_m": "largest loop gap left by step 1; null in other steps",
    "steps[].stop": "stop reason, one word",
    "steps[].reason": "stop reason, a sentence",
    "steps[].note": "remark of the step; of the last one also why its method was chosen, where none was named",
    "drives.*.value_mm": "prescribed displacement",
    "drives.*.value_deg": "prescribed rotation",
    "drives.*.value": "prescribed sum of displacements [m] and rotations [rad]",
    "drives.*.force_N": "force the drive exerts on its link, positive along the drive",
    "drives.*.moment_Nm": "moment the drive exerts on its link",
    "drives.*.effort": "force [N] or moment [Nm] of a drive that is a sum of both kinds",
    "drives.*.force_error_N": "estimated error of the force; null where it is not known",
    "drives.*.moment_error_Nm": "estimated error of the moment; null where it is not known",
    "drives.*.effort_error": "estimated error of the effort; null where it is not known",
    "supports.*.force_N": "force the support exerts",
    "supports.*.moment_Nm": "moment the support exerts",
    "supports.*.effort": "force [N] or moment [Nm] of a support that is a sum of both kinds",
    "stops.*.effort": "force [N] or moment [Nm] with which an end stop pushes, 0 where it is open",
    "stops.*.gap": "to closing [m or rad]",
    "stops.*.limit": "where it closes [m or rad]",
    "cables.*.tension_N": "tension, 0 where it is slack",
    "cables.*.slack_mm": "slack; negative by what it stretches",
    "cables.*.length_mm": "length without tension",
    "contacts.*.state": "open, closed, stick or slip",
    "contacts.*.gap_mm": "gap of the surfaces",
    "contacts.*.place_mm": "where they touch, or come closest",
    "contacts.*.force_N": "force on the second surface; on the first it is the reverse",
    "contacts.*.normal_N": "force that parts them",
    "contacts.*.friction_N": "magnitude of the friction force",
    "contacts.*.reserve_N": "largest friction less that",
    "error": "against the truth, that of the mesh included; null where no estimate was asked for, or nothing converged",
    "error.relative_percent": "larger of force error over force and displacement error over displacement; null: not known",
    "error.mesh_percent": "the same of the mesh alone; null where it is not known",
    "error.displacement_um": "estimated error of the worst link position",
    "error.rotation_mrad": "estimated error of the worst link rotation",
    "uncertainty.percent": "the larger of the error and of the changes of force and displacement in left_out",
    "uncertainty.effect": "the effect left out that is the larger one; null where the error is",
    "uncertainty.quantity": "what that effect changes most, force or displacement; null where the error is larger",
    "basis": "of the reduced body bent furthest, a leaf or a solid; null where nothing is reduced",
    "basis.of": "its name",
    "basis.coordinates": "independent coordinates of its basis (rank)",
    "basis.condition": "condition number of their columns",
    "basis.stroke": "displacement of its end over its length in this state",
    "basis.turn_deg": "its largest rotation against its chord, of a solid that of its face B",
    "basis.within_percent": "the basis is within this error; null for one about a trained state, good about that alone",
    "basis.most_stroke": "... up to this stroke",
    "basis.most_turn_deg": "... and this rotation",
    "strength": "shares of the limits of the materials; null where leaf springs are reduced solids",
    "strength.largest_strain_percent": "largest principal strain of all leaf springs",
    "strength.strain_leaf": "the leaf it is in",
    "strength.largest_stress_MPa": "largest von Mises stress of all leaf springs",
    "strength.stress_leaf": "the leaf it is in",
    "strength.stress_s_mm": "station along that leaf",
    "strength.stress_point": "point of its section",
    "strength.yield_percent": "largest stress over the yield stress of its material; null where no material says it",
    "strength.yield_leaf": "the leaf where that is; null where no material says it",
    "strength.fatigue_percent": "largest stress over the fatigue limit of its material; null where no material says it",
    "strength.fatigue_leaf": "the leaf where that is; null where no material says it",
    "links.*.displacement_mm": "displacement of the link's reference point, the mean of the points connected to it",
    "links.*.reference_mm": "that reference point at rest",
    "links.*.rotation_deg": "rotation vector of the link from rest",
    "joints.*.intended.*_deg": "intended rotation, by name of the motion",
    "joints.*.intended.*_mm": "intended translation, by name of the motion",
    "joints.*.unintended_displacement_um": "interface B off its intended place, joint axes; null if unknown",
    "joints.*.unintended_rotation_mrad": "interface B off its intended orientation; null if unknown",
    "leaves.*.start_force_N": "section forces N, Vy, Vz at the start, axes of the section there",
    "leaves.*.start_moment_Nm": "section moments T, My, Mz at the start of the leaf",
    "leaves.*.end_force_N": "section forces N, Vy, Vz at the end of the leaf",
    "leaves.*.end_moment_Nm": "section moments T, My, Mz at the end of the leaf",
    "left_out.*.force_percent": "change of the drive forces, over the largest, if this effect were in the model",
    "left_out.*.displacement_percent": "the same of the largest link displacement",
    "left_out.*.support_stiffness_percent": "the same of the softest support stiffness of the first driven link",
    "warnings[]": "what the user should know",
}
"""Every key of `as_dict` with its meaning; * stands for a name, [] for the entries of a list."""


def as_dict(configuration: EstimatedResult) -> dict[str, Any]:
    """All numbers of a configuration, ready for `json.dumps`; keys and units as in SCHEMA."""
    c = configuration
    return json_object(
        {
            "format": FORMAT,
            "mechanism": c.model.scene.name,
            "method": c.method,
            "leaf_model": c.model.leaf_models,
            "converged": c.converged,
            "stable": c.stable,
            "stability": stability_sentence(c),
            "trust": _trust(c),
            "doubts": list(c.doubts),
            "negative_pivots": int(c.negatives),
            "expected_negative_pivots": int(c.expected_negatives),
            "iterations": c.iterations,
            "time_us": 1e6 * c.time,
            "kernel_time_us": 1e6 * c.kernel_time,
            "load_factor": c.load_factor,
            "steps": [_step(s) for s in c.steps],
            "drives": _drives(c),
            "supports": _supports(c),
            **_one_sided(c),
            "error": _error(c),
            "uncertainty": _uncertainty(c),
            "basis": _basis(c),
            "strength": _strength(c),
            "links": _links(c),
            "joints": _joints(c),
            "leaves": _leaves(c),
            "left_out": _left_out(c),
            "warnings": list(c.warnings),
        }
    )


def _one_sided(c: EstimatedResult) -> dict[str, Any]:
    """Tables of stops, cables and contacts; none where the scene has none."""
    found: dict[str, dict[str, Any]] = {
        "stops": {n: {"effort": s.force, "gap": s.gap, "limit": s.value} for n, s in c.stops.items()},
        "cables": {
            name: {"tension_N": cable.force, "slack_mm": 1e3 * cable.gap, "length_mm": 1e3 * cable.value}
            for name, cable in c.cables.items()
        },
        "contacts": {
            name: {
                "state": pair.state, "gap_mm": 1e3 * pair.gap, "place_mm": (1e3 * pair.place).tolist(),
                "force_N": pair.force.tolist(), "normal_N": pair.N, "friction_N": float(np.linalg.norm(pair.T)),
                "reserve_N": pair.reserve,
            }
            for name, pair in c.contacts.items()
        },
    }  # fmt: skip
    return {kind: rows for kind, rows in found.items() if rows}


def _trust(c: EstimatedResult) -> dict[str, dict[str, Any]]:
    trust = trust_verdicts(c)
    return {name: {"yes": bool(v.yes), "sentence": v.sentence} for name, v in vars(trust).items()}


_EFFORT = {"length": "force_N", "angle": "moment_Nm", "number": "effort"}
_EFFORT_ERROR = {"length": "force_error_N", "angle": "moment_error_Nm", "number": "effort_error"}
_VALUE = {"length": ("value_mm", 1e3), "angle": ("value_deg", 180 / math.pi), "number": ("value", 1.0)}


def _step(step: Any) -> dict[str, Any]:
    stop = Stop(step.stop)
    closing = step.name.startswith("1 ")
    # steps 2 and 4 have no iteration and no residual
    direct = step.iterations == 0 and step.residual == 0.0
    return {
        "name": step.name,
        "iterations": None if direct else int(step.iterations),
        "time_us": 1e6 * step.time,
        "residual_over_bound": None if direct or closing else step.residual,
        "gap_m": step.residual if closing else None,
        "stop": stop.name.lower(),
        "reason": step.reason,
        "note": "; ".join(filter(None, [step.note, step.chosen])),
    }


def _drives(c: EstimatedResult) -> dict[str, dict[str, float | None]]:
    drives, forces = {}, c.forces
    for i, drive in enumerate(c.model.scene.drives):
        key, factor = _VALUE[drive.dimension]
        error = None if c.error is None else c.error.force[i]
        drives[drive.name] = {
            key: factor * c.targets[drive.name],
            _EFFORT[drive.dimension]: forces[drive.name],
            _EFFORT_ERROR[drive.dimension]: error,
        }
    return drives


def _supports(c: EstimatedResult) -> dict[str, dict[str, float | None]]:
    reactions = c.reactions
    return {
        s.name: {_EFFORT[s.dimension]: reactions[s.name]}
        for s in c.model.scene.supports
        if s.name in reactions
    }


def _error(c: EstimatedResult) -> dict[str, float | None] | None:
    if c.error is None:
        return None
    return {
        "relative_percent": 100 * c.error.relative,
        "mesh_percent": 100 * c.error.mesh,
        "displacement_um": 1e6 * c.error.displacement,
        "rotation_mrad": 1e3 * c.error.rotation,
    }


def _uncertainty(c: EstimatedResult) -> dict[str, Any]:
    found = uncertainty(c)
    return {
        "percent": 100 * found.relative,
        "effect": found.effect or None,
        "quantity": found.quantity or None,
    }


def _left_out(c: EstimatedResult) -> dict[str, dict[str, float | None]]:
    return {
        name: {f"{what}_percent": 100 * change for what, change in changes.items()}
        for name, changes in c.left_out.items()
    }


def _basis(c: EstimatedResult) -> dict[str, Any] | None:
    use = basis_use(c.model, c.motion)
    if use is None:
        return None
    return {
        "of": use.name,
        "coordinates": use.coordinates,
        "condition": use.condition,
        "stroke": use.stroke,
        "turn_deg": 180 / math.pi * use.turn,
        "within_percent": 100 * use.error,
        "most_stroke": use.most_stroke,
        "most_turn_deg": 180 / math.pi * use.most_turn,
    }


def _strength(c: EstimatedResult) -> dict[str, Any] | None:
    strength = c.strength
    if strength is None:
        return None
    shares = {
        "yield": (strength.yield_share, strength.yield_leaf),
        "fatigue": (strength.fatigue_share, strength.fatigue_leaf),
    }
    limits: dict[str, Any] = {}
    for key, (share, leaf) in shares.items():
        limits |= {
            f"{key}_percent": None if share is None else 100 * share,
            f"{key}_leaf": leaf or None,
        }
    return {
        "largest_strain_percent": 100 * strength.strain,
        "strain_leaf": strength.strain_leaf,
        "largest_stress_MPa": 1e-6 * strength.stress_Pa,
        "stress_leaf": strength.stress_leaf,
        "stress_s_mm": 1e3 * strength.s,
        "stress_point": strength.point,
        **limits,
    }


def _links(c: EstimatedResult) -> dict[str, dict[str, Any]]:
    links = {}
    for i, (name, (displacement, _)) in enumerate(c.links.items()):
        if i > 0:
            links[name] = {
                "displacement_mm": 1e3 * displacement,
                "reference_mm": 1e3 * c.model.rest.x[i],
                "rotation_deg": 180 / math.pi * c.rotation(name),
            }
    return links


def _joints(c: EstimatedResult) -> dict[str, dict[str, Any]]:
    joints = {}
    for placed in c.model.scene.joints:
        intended = {}
        for motion, value in zip(placed.joint.motions, _intended(c, placed), strict=True):
            unit, factor = ("mm", 1e3) if motion.kind == "translation" else ("deg", 180 / math.pi)
            intended[f"{motion.name}_{unit}"] = factor * value
        off = c.unintended.get(placed.name)
        joints[placed.name] = {
            "intended": intended,
            "unintended_displacement_um": None if off is None else 1e6 * off[:3],
            "unintended_rotation_mrad": None if off is None else 1e3 * off[3:],
        }
    return joints


def _intended(c: EstimatedResult, placed: Any) -> list[float]:
    """Intended motions [rad or m] of a joint: those of the solve, or from the relative pose of its links."""
    motions = placed.joint.motions
    names = [placed.name if len(motions) == 1 else f"{placed.name}.{m.name}" for m in motions]
    if all(n in c.motions for n in names):
        return [c.motions[n] for n in names]
    axes = np.asarray(placed.rotation, float)
    a, b = (c.model.scene.links.index(link) for link in (placed.a, placed.b))
    x, R, rest = c.motion.x, c.motion.R, c.model.rest.x
    start, end = placed.place((0, 0, 0)), placed.place(placed.joint.pose_B)
    span = x[b] + R[b] @ (end - rest[b]) - x[a] - R[a] @ (start - rest[a])
    shift = axes.T @ R[a].T @ span - np.asarray(placed.joint.pose_B)
    turn = Rotation.from_matrix(axes.T @ R[a].T @ R[b] @ axes).as_rotvec()
    return [float(np.asarray(m.axis) @ (shift if m.kind == "translation" else turn)) for m in motions]


def _leaves(c: EstimatedResult) -> dict[str, dict[str, Any]]:
    return {
        name: {
            "start_force_N": f.start[:3],
            "start_moment_Nm": f.start[3:],
            "end_force_N": f.end[:3],
            "end_moment_Nm": f.end[3:],
        }
        for name, f in c.section_forces(points=2).items()
    }
