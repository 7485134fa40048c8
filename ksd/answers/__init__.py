"""Questions to a configuration: stiffness, frequencies, buckling, forces, stress, energy, verification."""
