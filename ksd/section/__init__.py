"""Cross-sections as numbers: closed forms, any polygon, or given directly. For axes and units see `Section`."""

from ksd.section.closed_forms import circle, rectangle, restrained_warping_factor, tube
from ksd.section.outline import polygon
from ksd.section.section import Section, numbers

__all__ = ["Section", "circle", "numbers", "polygon", "rectangle", "restrained_warping_factor", "tube"]
