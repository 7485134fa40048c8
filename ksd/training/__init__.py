"""Offline training: the finite element model of a joint, sampled over stroke and shape and fitted into a record."""

from ksd.training.catalogue import design_of, known_designs
from ksd.training.designs import Design
from ksd.training.probes import check_probes
from ksd.training.run import train, up_to_date

__all__ = ["Design", "check_probes", "design_of", "known_designs", "train", "up_to_date"]
