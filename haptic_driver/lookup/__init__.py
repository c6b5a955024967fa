"""What the controller looks up: a model solved over frequency, voltage and load, and its file."""

__all__ = ["build", "file", "labelled", "models", "operating_point", "worst_case"]
