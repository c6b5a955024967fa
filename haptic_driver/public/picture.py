"""Pictures that a notebook shows and a script saves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory


class Picture:
    """A picture that is drawn when it is asked for: shown by notebooks, or saved to a file.

    `draw` writes it to a path, in the format of its ending.
    """

    def __init__(self, draw: Callable[[Path], object], ending: str = ".png") -> None:
        self._draw = draw
        self._ending = ending

    def save(self, path: Path | str) -> Path:
        """Save the picture, and return where. BadInputError for an ending that it cannot have."""
        self._draw(Path(path))
        return Path(path)

    def _repr_mimebundle_(self, **_: object) -> dict[str, bytes | str]:
        with TemporaryDirectory() as folder:
            content = self.save(Path(folder) / f"picture{self._ending}").read_bytes()
        if self._ending == ".svg":
            return {"image/svg+xml": content.decode()}
        return {"image/png": content}
