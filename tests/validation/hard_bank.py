"""The whole bank of hard cases: those the checks were made with, classics that were not looked at before, and arms of every
family, drives that hold together in space, thick and taut leaf springs."""

from hard_cases import CASES as OWN
from hard_cases import FINE, Case
from hard_classics import CLASSICS
from hard_families import FAMILIES

CASES: list[Case] = [*OWN, *CLASSICS, *FAMILIES]

__all__ = ["CASES", "CLASSICS", "FAMILIES", "FINE", "Case"]
