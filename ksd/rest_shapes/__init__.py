"""Undeformed shapes of mechanisms that take a wanted shape when they are loaded."""
