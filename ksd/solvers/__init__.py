"""Solvers are functions: model and drive values in, `Configuration` out."""
