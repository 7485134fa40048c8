"""Optimisation of designs: jobs with targets and limits, local search, proof of optima, trade-offs and tolerances."""
