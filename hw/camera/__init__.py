"""Cameras that see the fingerpad through the screen."""
