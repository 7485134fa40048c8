"""The benchmark: time and error of every method on the same scenes in one run.

`suite` holds the scenes and the methods with their leaf models, `measure` times them in turns and makes the table, `compare`
is `ksd.compare` for a scene of one's own. Required figures, other engines, the picture and the tables of the README are in
`benchmarks/bench.py` of the source tree.
"""

from ksd.bench.measure import CaseResult, Measurement, measure
from ksd.bench.suite import SUITE, Case

__all__ = ["SUITE", "Case", "CaseResult", "Measurement", "measure"]
