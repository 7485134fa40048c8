"""All published and independent numbers."""

from published import Number
from published_beams import ROWS as BEAMS
from published_divergence import ROWS as DIVERGENCE
from published_effects import ROWS as EFFECTS
from published_joints import ROWS as JOINTS
from published_planar import ROWS as PLANAR
from published_vibrations import ROWS as VIBRATIONS

ROWS: list[Number] = [*JOINTS, *BEAMS, *DIVERGENCE, *EFFECTS, *VIBRATIONS, *PLANAR]

__all__ = ["ROWS", "Number"]
