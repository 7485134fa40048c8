"""The benchmark: every method on the same scenes in one run, time beside error.

`suite` holds the scenes and the ways to them as data, `measure` runs them in turns and makes the table. What is asked of the
figures, other engines, the picture and the tables of the README are in `benchmarks/bench.py` of the source tree.
"""

from ksd.bench.measure import Measured, Row, measure
from ksd.bench.suite import SUITE, Case

__all__ = ["SUITE", "Case", "Measured", "Row", "measure"]
