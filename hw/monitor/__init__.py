"""What reads the electrode's own voltage and current."""

__all__ = ["contract", "lines", "scpi_line", "simulated"]
