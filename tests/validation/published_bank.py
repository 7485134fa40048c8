"""All published and independent numbers."""

from published import Number
from published_beams import ROWS as BEAMS
from published_joints import ROWS as JOINTS
from published_planar import ROWS as PLANAR

ROWS: list[Number] = [*JOINTS, *BEAMS, *PLANAR]

__all__ = ["ROWS", "Number"]
