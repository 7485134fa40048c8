"""Questions over strokes, load cases and designs: sweeps into tables, modes followed by name, frequencies from three
configurations, state-space models, and the HTML report."""

from ksd.design.batch import Batch, batch
from ksd.design.frequency_curve import FrequencyCurve, frequency_curve
from ksd.design.state_space import StateSpace, state_space
from ksd.design.sweep import SweepInterrupted, sweep
from ksd.design.table import Table

__all__ = [
    "Batch",
    "FrequencyCurve",
    "StateSpace",
    "SweepInterrupted",
    "Table",
    "batch",
    "frequency_curve",
    "state_space",
    "sweep",
]
