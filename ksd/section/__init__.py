"""Cross-sections as numbers: closed forms, any polygon, or given directly. For axes and units see `Section`."""

from ksd.section.closed_forms import circle, rectangle, restrained_warping_factor, tube
from ksd.section.constants import Section, numbers
from ksd.section.outline import polygon

__all__ = ["Section", "circle", "numbers", "polygon", "rectangle", "restrained_warping_factor", "tube"]
