"""High-voltage amplifiers."""

__all__ = ["analog", "served_lines", "simulated"]
