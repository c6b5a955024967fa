"""High-voltage amplifiers."""
