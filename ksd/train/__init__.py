"""Offline training: the finite element model of a joint, sampled over stroke and shape and fitted into a record.

The package can be called: `ksd.train(...)` is the function `train`.
"""

from ksd.packages import make_callable
from ksd.train.catalogue import design_of, known_designs
from ksd.train.designs import Design
from ksd.train.probes import check_probes
from ksd.train.run import train, up_to_date

__all__ = ["Design", "check_probes", "design_of", "known_designs", "train", "up_to_date"]

make_callable(__name__, "ksd.train.run")
