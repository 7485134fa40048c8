"""Elements: leaf springs, springs, linear and modal bodies and the weight of leaf springs, each with compiled
equations."""
