"""Pictures of a configuration: plots in two and three dimensions (matplotlib) and files for ParaView.

What is drawn comes from `Configuration.shape`; nothing here computes mechanics, and matplotlib is imported
on first use. Figures are made without pyplot, so they need no display.
"""

from ksd.view.figure import save_figure
from ksd.view.flat import plot_mechanism
from ksd.view.solid import plot_mechanism_3d
from ksd.view.vtk import write_vtu

__all__ = ["plot_mechanism", "plot_mechanism_3d", "save_figure", "write_vtu"]
