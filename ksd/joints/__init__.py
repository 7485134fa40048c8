"""Joints as bodies: kinematics of their intended motions, condensed stiffness, and the states of their internal blocks."""
