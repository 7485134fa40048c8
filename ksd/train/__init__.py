"""Offline training: the joint's own finite element model, swept over stroke and shape, fitted into a record.

`ksd.train(...)` is the function `train`, whether or not this package has been imported before.
"""

import sys
from types import ModuleType
from typing import Any

from ksd.train.designs import Design, design_of, known_designs
from ksd.train.probes import check_probes
from ksd.train.run import train, up_to_date

__all__ = ["Design", "check_probes", "design_of", "known_designs", "train", "up_to_date"]


class _Callable(ModuleType):
    """The package hides the function of its name once imported, so calling the one calls the other."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        return train(*args, **options)


sys.modules[__name__].__class__ = _Callable
