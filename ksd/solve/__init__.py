"""Solvers are functions: model and drive values in, `Configuration` out.

The package itself can be called: `ksd.solve(...)` is the function `ksd.solve.solver.solve`.
"""

from ksd.packages import make_callable

make_callable(__name__, "ksd.solve.solver")
