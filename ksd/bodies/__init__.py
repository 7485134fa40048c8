"""Ways to stand for a joint: kinematic poses (allow), condensed stiffness (resist), internal nodes (inside)."""
