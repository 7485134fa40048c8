"""Questions over strokes, load cases and designs: sweeps into tables, modes followed by name, reports, state space."""

from ksd.design.sweep import SweepInterrupted, sweep
from ksd.design.table import Table

__all__ = ["SweepInterrupted", "Table", "sweep"]
