"""Solvers are functions: model and drive values in, `Configuration` out.

`ksd.solve(...)` is the function `ksd.solve.solver.solve`, whether or not this package has been imported before.
"""

from ksd.packages import make_callable

make_callable(__name__, "ksd.solve.solver")
