"""Compiled linear algebra, rotations and polynomials, and how kernels are compiled and kept."""
