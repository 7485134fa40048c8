"""The printed form of a scene: a table of its parts with their lengths and units."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ksd.html import PrintedText


def printed_scene(scene: Any) -> PrintedText:
    """The parts of a scene, one per line."""
    rows = list(_rows(scene))
    plane = "" if scene.plane is None else f"in the plane {scene.plane}, "
    head = f"{scene.name}: {plane}links {', '.join(scene.links[1:]) or 'none'}"
    widths = [max((len(row[k]) for row in rows), default=0) for k in range(3)]
    lines = [
        "  ".join(cell.ljust(n) for cell, n in zip(row, (*widths, 0), strict=True)).rstrip() for row in rows
    ]
    return PrintedText("\n".join([head, *lines]), [head, rows])


def _rows(scene: Any) -> Iterable[tuple[str, str, str, str]]:
    """Kind, name, location and description of every part."""
    for j in scene.joints:
        yield (
            "joint",
            j.name,
            f"{j.a} to {j.b}",
            f"{j.joint.family.replace('_', ' ')}, {1e3 * j.joint.length:.4g} mm",
        )
    for f in scene.leaves:
        yield "leaf spring", f.name, f"{f.a} to {f.b}", f"{1e3 * f.leaf.length:.4g} mm"
    for point in scene.points:
        yield "point", point.name, point.leaf, f"s = {1e3 * point.s:.4g} mm"
    for h in scene.hinges:
        yield h.kind, h.name, f"{h.a} to {h.b}", f"at {in_millimetres(h.at)}"
    for kind, drives in (("drive", scene.drives), ("support", scene.supports)):
        for d in drives:
            yield kind, d.name, d.terms[0].link, " + ".join(map(_term, d.terms))
    for p in scene.loads:
        force = [f"force {vector_text(p.force)} N"] * any(p.force)
        moment = [f"moment {vector_text(p.moment)} Nm"] * any(p.moment)
        yield "load", p.name, p.link, ", ".join(force + moment) + ", following" * p.following
    for line in scene.line_loads:
        to = "" if line.to is None else f" to {vector_text(line.to)}"
        to_moment = "" if line.to_moment is None else f" to {vector_text(line.to_moment)}"
        force = [f"{vector_text(line.force)}{to} N/m"] * line.has_force
        moment = [f"moment {vector_text(line.moment)}{to_moment} Nm/m"] * line.has_moment
        yield "line load", line.name, line.leaf, ", ".join([*force, *moment, _span(line)])
    for push in scene.pressures:
        yield "pressure", push.name, push.leaf, f"{push.pressure:.4g} Pa along {push.side}, {_span(push)}"
    for m in scene.masses:
        yield "mass", "", m.link, f"{m.mass:.4g} kg at {in_millimetres(m.at)}"
    for s in scene.springs:
        unit = "Nm/rad" if hasattr(s, "axis") else "N/m"
        yield "spring", s.name, f"{s.a} to {s.b}", f"{s.stiffness:.4g} {unit}"
    for d in scene.dampers:
        unit = "N s/m" if d.term.kind == "translation" else "Nm s/rad"
        yield "damper", d.name, f"{d.term.base} to {d.term.link}", f"{d.damping:.4g} {unit}, {_term(d.term)}"
    for s in scene.stops:
        limits = ", ".join(f"{name.rpartition('.')[2]} {value:.4g}" for name, value in s.limits.items())
        yield "stop", s.name, s.terms[0].link, f"{limits}: {' + '.join(map(_term, s.terms))}"
    for c in scene.cables:
        stretch = "" if c.stiffness is None else f", {c.stiffness:.4g} N/m"
        yield (
            "cable",
            c.name,
            " to ".join(link for link, _ in c.points),
            f"{1e3 * c.free_length:.4g} mm{stretch}",
        )
    for s in scene.surfaces:
        yield "surface", s.name, s.link, f"{s.shape.kind} at {in_millimetres(s.at)}"
    for c in scene.contacts:
        yield "contact", c.name, f"{c.a} and {c.b}", f"friction {c.friction:.4g}"
    for s in scene.sensors:
        what = f"{s.kind}{', absolute' * s.absolute}"
        yield "sensor", s.name, s.term.link, f"{what}: {_term(s.term)}"
    if scene.gravity is not None:
        yield "gravity", "", "", f"{vector_text(scene.gravity)} m/s\N{SUPERSCRIPT TWO}"
    for c in scene.compliances:
        yield "flexible", "", c.link, "link"
    for kind, parts in (("heat", scene.heats), ("assembly error", scene.fits)):
        if parts:
            yield kind, "", "", f"{len(parts)} sentence{'s' * (len(parts) > 1)}"


def _span(load: Any) -> str:
    """The part of a leaf that a load covers, as text."""
    end = "its end" if load.end is None else f"{1e3 * load.end:.4g} mm"
    return (
        "all along" if load.start == 0.0 and load.end is None else f"from {1e3 * load.start:.4g} mm to {end}"
    )


def _term(term: Any) -> str:
    """A drive term as text."""
    factor = "" if term.coefficient == 1.0 else f"{term.coefficient:g} \N{MULTIPLICATION SIGN} "
    component = (
        f"{term.kind} {'along' if term.kind == 'translation' else 'about'} {vector_text(term.direction)}"
    )
    return factor + component + ("" if term.base == "ground" else f" relative to {term.base}")


def in_millimetres(position: Any) -> str:
    """A position (3,) [m] as text in mm."""
    return f"{vector_text(position, 1e3)} mm"


def vector_text(values: Any, scale: float = 1.0) -> str:
    """A vector times `scale` as text."""
    return f"({', '.join(f'{scale * v + 0.0:.4g}' for v in values)})"
