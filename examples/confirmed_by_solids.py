"""Do solids of another program agree with leaf springs as beams, and what explains the rest?

A guide is solved by ksd, written for CalculiX (.inp), and solved there with bricks. Without Poisson's ratio both are equal
to a few parts in 100,000. With it a sheet is stiffer where it is clamped, which is the effect `plate`.
"""

import tempfile
from pathlib import Path

import ksd
from ksd.export import confirm
from ksd.export.calculix import Mesh
from ksd.units import GPa, mm


def guide(nu):
    """A table on two leaf springs."""
    steel = ksd.Material(E=200 * GPa, nu=nu)
    leaf = ksd.rectangle(thickness=0.3 * mm, width=20 * mm)
    scene = ksd.Mechanism("guide")
    table = scene.link("table")
    for x in (-30 * mm, 30 * mm):
        words = {"section": leaf, "material": steel, "width_axis": "z"}
        scene.leaf(scene.ground, table, start=(x, 0, 0), end=(x, 60 * mm, 0), **words)
    scene.actuate(table, along="x", at=(0, 30 * mm, 0), name="push")
    return scene


def compare(nu):
    """The pose, and the force of the solids over that of ksd, less 1; None where ccx is not installed."""
    pose = ksd.solve(guide(nu), push=0.1 * mm, method="conventional")
    try:
        # coarse, for seconds; by default the mesh is finer towards ends and edges
        return pose, confirm(pose, mesh=Mesh(along=6, across=1, end=5.0)).relative_force("push")
    except ksd.SceneError as reason:
        print(reason)
        return pose, None


plain, without = compare(0.0)
stiffer, with_nu = compare(0.3)
force = plain.forces["push"]
explained = stiffer.left_out["plate"]["force"]
with tempfile.TemporaryDirectory() as folder:
    lines = len(Path(plain.export(Path(folder) / "guide.inp")).read_text().splitlines())
print(f"force {force:.5f} N; the input of CalculiX has {lines} lines")
if without is not None and with_nu is not None:
    print(f"nu = 0: solids {1e2 * without:+.4f} %")
    print(f"nu = 0.3: solids {1e2 * with_nu:+.2f} %, explained by plate {1e2 * explained:+.2f} %")


def picture(path=None):
    """The pose that both programs solve."""
    return plain.plot(path)


if __name__ == "__main__":
    picture("confirmed_by_solids.png")
