"""A folder of modules that anybody may have left: each says that it was imported."""

from __future__ import annotations

import sys
from pathlib import Path

OTHERS = ("hw", "model", "haptic_driver", "numpy", "scipy", "numba", "h5py", "pydantic", "serial")
SPRUNG = "sprung.txt"


def set_traps(folder: Path) -> None:
    """One for each module of the standard library, and for those of others and of our own."""
    trap = f"open({str(folder / SPRUNG)!r}, 'a').write(__name__ + '\\n')\n"
    for name in {*sys.stdlib_module_names, *OTHERS}:
        (folder / f"{name}.py").write_text(trap)


def sprung(folder: Path) -> list[str]:
    """What was imported from there."""
    said = folder / SPRUNG
    return said.read_text().split() if said.exists() else []
