"""Designs of one topology refilled in place: the arrays of a prepared design take the numbers of another.

`drawing` reads the numbers off many scenes, `scales` says how the constants of leafs depend on them, `polynomials`
contracts the joint records, `space` and `plane` compute all arrays of many designs at once, `refill` writes them into the
storage of a prepared design. What is not refillable (curved or tapered leafs, free leafs, springs, gravity, ...) is
prepared afresh, as is a design that differs in more than numbers.
"""

from ksd.design.refill.drawing import Drawing, drawing
from ksd.design.refill.refill import Refill

__all__ = ["Drawing", "Refill", "drawing"]
