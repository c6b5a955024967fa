"""What the model, the devices and the driver share: kinds of failure, and a cache for code. It
needs the standard library alone.
"""

__all__ = ["cache", "errors", "interpreter"]
