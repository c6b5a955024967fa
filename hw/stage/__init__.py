"""Linear stages."""
