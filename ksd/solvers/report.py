"""Tables of a configuration for the terminal: steps of the solve, drives, verdicts, joints, links, warnings.

They print numbers of `as_dict` only; its layout and units are in `ksd.solvers.answer`.
"""

from __future__ import annotations

from typing import Any

from ksd.answers.printing import empty_table as _table
from ksd.answers.printing import format_number, format_signed_percent
from ksd.answers.strength import LAW_ERROR_PER_STRAIN, WARNING_STRAIN
from ksd.model.newton import RTOL
from ksd.solvers.answer import as_dict
from ksd.solvers.estimated_result import EstimatedResult
from ksd.solvers.steps import FAST_METHODS, percent
from ksd.solvers.verdict import EFFECT_NAMES

_STOPS = {
    "converged": "within bound",
    "too_many": "iteration limit",
    "local_angle": "element turned over 60 deg",
    "singular": "singular stiffness",
    "diverged": "residual over eps_max",
    "not_finite": "numbers overflowed",
    "moving": "in motion",
    "jammed": "contact jams",
}
NEGLIGIBLE_CHANGE = 1e-3
"""Change [%] below which an effect counts as changing nothing."""
_UNITS = {
    "value_mm": "mm",
    "value_deg": "deg",
    "value": "",
    "force_N": "N",
    "moment_Nm": "Nm",
    "effort": "N, Nm",
}


def tables(configuration: EstimatedResult) -> list[Any]:
    """Rich renderables, no wider than WIDTH columns: head, steps, drives, stops, cables, contacts, verdicts, joints, links,
    warnings."""
    from rich.text import Text

    d = as_dict(configuration)
    parts = [_head(d), _steps(d), *([_drives(d)] if d["drives"] or d["supports"] else [])]
    one_sided = (configuration.stops, configuration.cables, configuration.contacts)
    parts += [Text(str(table)) for table in one_sided if table]
    parts += [Text(line, style="" if is_good else "bold red") for line, is_good in verdict_lines(d)]
    if d["joints"]:
        parts += _joints(d)
    if d["links"]:
        parts += _links(d)
    parts += [Text(f"Warning: {w}.", style="yellow") for w in d["warnings"]]
    return parts


def _title(words: str) -> Any:
    from rich.text import Text

    return Text(words, style="bold")


def _head(d: dict[str, Any]) -> Any:
    """Heading: the mechanism, whether it is solved and by which method, and its leaf model."""
    from rich.text import Text

    done = "solved by" if d["converged"] else "NOT SOLVED by"
    done = "" if d["steps"][-1]["stop"] == "moving" else f"{done} "
    text = Text(f"{d['mechanism']}: {done}{d['method']}", style="bold")
    return text.append(f", {d['leaf_model']}", style="not bold")


def _steps(d: dict[str, Any]) -> Any:
    """Table of the steps of the solve."""
    table = _table("step", "iterations", "time\n[us]", "residual\n/ bound", "<stopped\nbecause", "<note")
    for s in d["steps"]:
        why = _STOPS[s["stop"]]
        if s["stop"] == "converged":
            why = "loops closed" if s["gap_m"] is not None else "done" if s["iterations"] is None else why
            why = "rounding reached" if (s["residual_over_bound"] or 0.0) > 1.0 else why
        if s["name"] == "error estimate":
            why = "not iterated"
        count = "-" if s["iterations"] is None else str(s["iterations"])
        residual = format_number(s["residual_over_bound"], 2)
        table.add_row(s["name"], count, format_number(s["time_us"], 3), residual, why, s["note"])
    table.add_section()
    table.add_row("total", str(d["iterations"]), format_number(d["time_us"], 3), "", "", "")
    if d["kernel_time_us"]:
        seconds = f"{format_number(1e-6 * d['kernel_time_us'], 2)} s"
        table.add_row("first call: kernels", "-", seconds, "", "loaded", "not in the total")
    return table


def _drives(d: dict[str, Any]) -> Any:
    table = _table("drive", "value", "<", "force or moment", "<", "estimated error")
    for name, row in d["drives"].items():
        (at, value), (effort, force), (_, error) = row.items()
        # below the tolerance of the residual an error is not known
        tolerance = RTOL * abs(force)
        if error is None:
            error_cell = "-"
        elif error > tolerance or not force:
            error_cell = f"{format_number(error, 2)} {_UNITS[effort]}"
        else:
            error_cell = f"under {format_number(tolerance, 2)} {_UNITS[effort]}"
        table.add_row(
            name,
            format_number(value, 6, zero=1e-12),
            _UNITS[at],
            format_number(force, 6, zero=1e-12),
            _UNITS[effort],
            error_cell,
        )
    for name, row in d["supports"].items():
        ((effort, force),) = row.items()
        table.add_row(f"{name} (support)", "0", "", format_number(force, 6, zero=1e-12), _UNITS[effort], "-")
    return table


def verdict_lines(d: dict[str, Any]) -> list[tuple[str, bool]]:
    """Sentences about error, effects left out and verdicts, each with whether it is good news."""
    lines = [
        (headline(d), True),
        *((s, True) for s in (*_effects_left_out(d["left_out"]), *_basis_range(d["basis"]))),
    ]
    lines.append((f"State: {d['stability']}", d["stable"]))
    for prefix, name in (("Branch: ", "branch"), ("", "strength"), ("", "trusted")):
        verdict = d["trust"][name]
        line = prefix + verdict["sentence"]
        lines.append((line[0].upper() + line[1:], verdict["yes"]))
    return lines


def _effect_name(name: str) -> str:
    return EFFECT_NAMES.get(name, name.replace("_", " "))


def headline(d: dict[str, Any]) -> str:
    """The error in one sentence: that against the model, after a larger change by an effect that the model leaves out."""
    own, effect, share = error_sentence(d), d["uncertainty"]["effect"], d["uncertainty"]["percent"]
    if effect is None or share < NEGLIGIBLE_CHANGE:
        return own
    _, _, told = own.partition("rror: ")
    quantity = d["uncertainty"]["quantity"]
    return (
        f"Estimated error: {percent(0.01 * share)} %, the {quantity} by {_effect_name(effect)}, which is not in the model; "
        f"against the model: {told}"
    )


def error_sentence(d: dict[str, Any]) -> str:
    """The estimated error against the model in one sentence."""
    error = d["error"]
    if error is None and (
        d["converged"] or d["basis"] is not None or d["method"] in ("kinematic", "reduced", "modal")
    ):
        return "Error: not estimated"
    if error is None:
        return "Error: not known, it is not solved"
    if (
        error["relative_percent"] is None
        and error["mesh_percent"] is None
        and d["method"] not in FAST_METHODS
    ):
        return "Estimated error: not known, a finer mesh has no equilibrium next to this one"
    if error["relative_percent"] is None:
        return "Estimated error: not known, corrector steps grow; do not use this result"
    shift, turn = (format_number(error[k], 2, zero=1e-6) for k in ("displacement_um", "rotation_mrad"))
    off = percent(0.01 * error["relative_percent"])
    mesh = "that of its mesh is not known"
    if error["mesh_percent"] is not None:
        share = percent(0.01 * error["mesh_percent"])
        mesh = (
            f"of which mesh {share} %"
            if d["method"] in FAST_METHODS or d["basis"] is not None
            else "all of it of the mesh"
        )
    within = f" (links within {shift} um and {turn} mrad)" if error["relative_percent"] > 100 * RTOL else ""
    strain = (d["strength"] or {}).get("largest_strain_percent") or 0.0
    law_error = LAW_ERROR_PER_STRAIN * strain
    law = (
        f"; in addition, at this strain the force depends on the law of elasticity by about {law_error:.2g} %"
    )
    return f"Estimated error: {off} %, {mesh}{within}{law if strain > 100 * WARNING_STRAIN else ''}"


def _effects_left_out(left_out: dict[str, dict[str, float | None]]) -> list[str]:
    """A sentence about the effects that are not in the model, with the changes they would make; empty where there are
    none."""
    effects = []
    for name, changes in left_out.items():
        shares = [
            f"{what.removesuffix('_percent').replace('_', ' ')} {format_signed_percent(value)} %"
            for what, value in changes.items()
            if value is not None and abs(value) >= NEGLIGIBLE_CHANGE
        ]
        effects.append(f"{_effect_name(name)} ({', '.join(shares) or 'changes nothing here'})")
    return [f"Not in the model: {', '.join(effects)}"] if effects else []


def _basis_range(basis: dict[str, Any] | None) -> list[str]:
    """A sentence about the range of the basis of the reduced body that is bent furthest; empty without reduced bodies."""
    if basis is None:
        return []
    valid = "good about the trained configuration alone"
    if basis["within_percent"] is not None:
        limits = (
            f"{format_number(basis['most_stroke'], 2)} L and {format_number(basis['most_turn_deg'], 2)} deg"
        )
        valid = f"within {basis['within_percent']:g} % to {limits}"
    at = f"{format_number(basis['stroke'], 2)} L and {format_number(basis['turn_deg'], 2)} deg"
    size = f"{basis['coordinates']} coordinates, condition {format_number(basis['condition'], 2)}"
    return [f"Basis of '{basis['of']}', bent furthest, to {at}: {valid} ({size})"]


def _joints(d: dict[str, Any]) -> list[Any]:
    known = any(j["unintended_displacement_um"] is not None for j in d["joints"].values())
    off = ("x [um]", "y [um]", "z [um]", "rx [mrad]", "ry [mrad]", "rz [mrad]") if known else ()
    table = _table("joint", "intended", *off)
    for name, j in d["joints"].items():
        has_several = len(j["intended"]) > 1
        motions = []
        for key, value in j["intended"].items():
            motion, unit = key.rsplit("_", 1)
            motions.append(
                f"{motion.replace('_', ' ') + ' ' if has_several else ''}{format_number(value, 5, zero=1e-9)} {unit}"
            )
        row = [
            *(j["unintended_displacement_um"] or [None] * 3),
            *(j["unintended_rotation_mrad"] or [None] * 3),
        ]
        table.add_row(name, "\n".join(motions), *[format_number(v, 3, zero=1e-6) for v in row[: len(off)]])
    title = "Joints: intended motion" + (
        ", and unintended displacement and rotation of interface B" if known else ""
    )
    return [_title(title), table]


def _links(d: dict[str, Any]) -> list[Any]:
    """Title and table of the links."""
    columns = ("x [mm]", "y [mm]", "z [mm]", "rx [deg]", "ry [deg]", "rz [deg]")
    table = _table("link", *columns)
    for name, link in d["links"].items():
        table.add_row(
            name, *[format_number(v, 5, zero=1e-9) for v in (*link["displacement_mm"], *link["rotation_deg"])]
        )
    return [_title("Links: displacement of the reference point and rotation"), table]
