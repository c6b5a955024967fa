"""What every room uses and no physics is in: errors, files and tables of a user, compiled code."""

__all__ = [
    "arrays",
    "cells",
    "compiled",
    "errors",
    "interpolation",
    "reading",
    "tables",
    "text",
    "toml",
    "units",
]
