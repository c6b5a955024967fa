"""What the model, the devices and the driver share: kinds of failure, numbers as people read them
and as JSON holds them, and a cache for code. It needs the standard library alone.
"""

__all__ = ["cache", "errors", "interpreter", "strict_json", "units"]
