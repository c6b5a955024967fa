"""A texture is friction over position; this room reads texture files and prepares them for render.

In go files of many kinds: the library's TOML, pictures, HJIF. Out come tables and waves that the
render stage evaluates at any position, as coefficients of friction. A scene is a list of objects,
each with a texture (`scene.py`).

Two modules say what of a texture arrives. `reach.py` gives the share within reach of a surface,
`bands.py` the friction in nine bands of frequency.

One rule holds: files are read here, never in a tick.
"""

__all__ = [
    "bands",
    "description",
    "formulas",
    "library",
    "objects",
    "process",
    "reach",
    "ripple",
    "scene",
    "spectrum",
    "tile",
]
