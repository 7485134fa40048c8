"""`ksd confirm SCENE.toml`: a pose beside that of solids in CalculiX."""

from __future__ import annotations

import argparse

from ksd.answers.printing import format_signed_percent
from ksd.cli.output import console
from ksd.cli.solve import load_with_options, merged_options, solve_warm
from ksd.export.calculix_run import confirm, twist_text
from ksd.model.description import curved_bar_text


def run(options: argparse.Namespace) -> int:
    """Solve, solve again, print. Errors as in `ksd.solve`, `ksd.load_scene` and `ksd.export.confirm`."""
    scene, targets, written = load_with_options(options.scene, options.set)
    pose = solve_warm(scene, targets, merged_options(written, options))
    screen = console()

    def say(line: str) -> None:
        screen.print(line, soft_wrap=True)

    units = {d.name: {"length": " N", "angle": " Nm"}.get(d.dimension, "") for d in pose.model.scene.drives}
    found = [confirm(pose, refine=k) for k in ((1, 2) if options.refine else (1,))]
    for each in found:
        say(f"{scene.name}: ksd beside {each.elements} solids (C3D20R) of CalculiX")
        for drive, (ours, solids) in each.forces.items():
            percent = format_signed_percent(100.0 * each.relative_force(drive))
            say(
                f"force of {drive}: {ours:.6g}{units[drive]}, solids {solids:.6g}{units[drive]} ({percent} %)"
            )
        for link in each.displacements:
            off = each.distance(link)
            share = format_signed_percent(100.0 * off / each.stroke) if each.stroke else "0"
            say(f"position of {link}: {1e6 * off:.4g} um apart ({share} % of the stroke)")
    if len(found) > 1:
        for drive in found[0].forces:
            change = found[1].relative_force(drive) - found[0].relative_force(drive)
            say(f"force of {drive}: {format_signed_percent(100.0 * change)} points by the finer mesh")
    for effect, changes in pose.left_out.items():
        say(
            f"explained by {effect}, which is left out: force {format_signed_percent(100.0 * changes.get('force', 0.0))} %"
        )
    for text in filter(None, (curved_bar_text(scene), twist_text(pose))):
        say(f"not modelled: {text}")
    return 0
