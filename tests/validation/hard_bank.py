"""The whole bank of hard cases: those the checks were made with, and classics that were not looked at before."""

from hard_cases import CASES as OWN
from hard_cases import FINE, Case
from hard_classics import CLASSICS

CASES: list[Case] = [*OWN, *CLASSICS]

__all__ = ["CASES", "CLASSICS", "FINE", "Case"]
