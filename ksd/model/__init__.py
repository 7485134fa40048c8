"""From a scene to the arrays the solvers work on: numbering, packing, loads, effects."""
