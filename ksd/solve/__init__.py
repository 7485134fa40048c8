"""Solvers are functions: model and drive values in, `Configuration` out.

Called, `ksd.solve(...)`, it is the function `ksd.solve.solver.solve`.
"""

from ksd.packages import make_callable

make_callable(__name__, "ksd.solve.solver")
