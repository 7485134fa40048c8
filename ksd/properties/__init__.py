"""Answers asked of a configuration: stiffness, modes, buckling, stress, energy."""
