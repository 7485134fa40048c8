"""Elements: the leaf springs, springs and masses, each with its equations compiled."""
