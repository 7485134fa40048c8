"""Pictures of a configuration: plots in two and three dimensions (matplotlib) and files for ParaView; of a sweep:
answers over the stroke, and the stroke as an animation; of a mode: its shape.

What is drawn comes from `Configuration.shape` and from the table of a sweep; nothing here computes mechanics, and
matplotlib is imported on first use. Figures are made without pyplot, so they need no display.
"""

from ksd.view.animate import animate_mode, animate_stroke, plot_mode
from ksd.view.drawing import plot_mechanism
from ksd.view.figure import save_figure
from ksd.view.page import write_page
from ksd.view.stroke_plot import plot_stroke
from ksd.view.vtk import write_pvd, write_vtu
from ksd.view.window import show_mechanism

__all__ = [
    "animate_mode",
    "animate_stroke",
    "plot_mechanism",
    "plot_mode",
    "plot_stroke",
    "save_figure",
    "show_mechanism",
    "write_page",
    "write_pvd",
    "write_vtu",
]
