"""The benchmark: every method on the same scenes in one run, time beside error.

`suite` holds the scenes as data, `ways` the methods and leaf models, `measure` runs them in turns, `report` makes
the table, the JSON numbers and the picture.
"""

from ksd.bench.measure import Measured, Row, measure
from ksd.bench.suite import SUITE, Case

__all__ = ["SUITE", "Case", "Measured", "Row", "measure"]
