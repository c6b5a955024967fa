"""Oscilloscopes, which sample what a card cannot."""
