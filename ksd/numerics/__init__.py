"""Compiled linear algebra and rotations, reduction bases, and the compilation and caching of kernels."""
