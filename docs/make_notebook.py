"""Writes docs/notebook.ipynb, executed: a fourbar from its drawing to stiffness and frequencies, as a notebook shows it.

pip install nbformat nbclient ipykernel
python docs/make_notebook.py [FILE]
"""

from __future__ import annotations

import sys
from pathlib import Path

CELLS = (
    "# A fourbar in a notebook\n\nFour cross flexures, drawn in steel. In a notebook scenes, poses and tables are "
    "shown as tables, and figures as pictures.",
    "import ksd\nfrom ksd.units import GPa, deg, mm\n\n"
    "steel = ksd.Material(E=200 * GPa, G=76.9 * GPa, density=7800)\n"
    "cross = ksd.CrossFlexure(steel, length=100 * mm, angle=45 * deg, thickness=1 * mm, widths=(40 * mm, 20 * mm))\n\n"
    'fourbar = ksd.Mechanism("fourbar")\n'
    'left, top, right = (fourbar.link(name) for name in ("left", "top", "right"))\n'
    "for x, side in ((-200 * mm, left), (200 * mm, right)):\n"
    '    fourbar.join(fourbar.ground, side, cross, at=(x, 0, 0), axis="z", toward="y")\n'
    '    fourbar.join(side, top, cross, at=(x, 300 * mm, 0), axis="z", toward="y")\n'
    'fourbar.actuate(top, along="x", at=(0, 300 * mm + cross.length_AB, 0))\n'
    "fourbar",
    "The top link is moved 200 mm.",
    "pose = ksd.solve(fourbar, top=200 * mm)\npose",
    'pose.plot(color="stress")',
    "From the side, in space:",
    'pose.plot(view="3d")',
    "Stiffness and frequencies of the top link in this pose:",
    'pose.stiffness("top")',
    "pose.frequencies()",
    "Force, support stiffness and stress over the stroke:",
    "stroke = ksd.sweep(\n"
    '    fourbar, questions=("force", "support_stiffness", "stress"), top=[d * mm for d in range(0, 301, 30)]\n'
    ")\nstroke",
    "stroke.plot()",
)
"""Text and code in turn, as they look."""


def is_code(cell: str) -> bool:
    """Whether a cell is Python: it compiles."""
    try:
        compile(cell, "cell", "exec")
    except SyntaxError:
        return False
    return True


def main(path: Path) -> None:
    """Execute the cells in a fresh kernel and write the notebook."""
    import nbformat
    from nbclient import NotebookClient
    from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

    made = [new_code_cell(cell) if is_code(cell) else new_markdown_cell(cell) for cell in CELLS]
    for k, cell in enumerate(made):
        cell["id"] = f"cell-{k}"
    notebook = new_notebook(cells=made)
    NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    for cell in notebook.cells:
        # when a cell ran says nothing to a reader
        cell.metadata.pop("execution", None)
    notebook.metadata["language_info"] = {"name": "python"}
    nbformat.validate(notebook)
    path.write_text(nbformat.writes(notebook) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent / "notebook.ipynb")
