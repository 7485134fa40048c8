"""Questions over strokes, load cases and designs: sweeps into tables, modes followed by name, frequencies from three
configurations, state-space models, and the HTML report."""

from ksd.study.batch import Batch, batch
from ksd.study.frequency_curve import FrequencyCurve, frequency_curve
from ksd.study.state_space import StateSpace, state_space
from ksd.study.sweep import SweepInterrupted, sweep
from ksd.study.table import Table

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
