"""Measurement plans run on a rig -> tidy data."""
