"""Oscilloscopes, which sample what a card cannot."""

__all__ = ["infiniivision"]
