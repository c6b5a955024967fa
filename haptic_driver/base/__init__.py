"""What the model, the devices and the driver share: kinds of failure, and a cache for code.

Numbers are here as people read them, and as JSON holds them. It needs the standard library alone.
"""

__all__ = ["cache", "errors", "interpreter", "strict_json", "units"]
