"""Cameras that see the fingerpad through the screen."""

__all__ = ["contract", "fingerprint", "genicam", "simulated"]
