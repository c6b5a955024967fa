"""Where configuration files are found: folders of rigs, models, textures, plans, populations, and the names in them.

Apart from what reads them, so that a list of names is there at once.
"""

from __future__ import annotations

import os
from pathlib import Path

from haptic_driver.errors import BadInputError
from model.support.errors import nearest


def config_dirs() -> list[Path]:
    """Folders searched for `rigs/`, `models/`, `textures/`: `HAPTIC_CONFIGS`, `./configs`, the program's own.

    The program's own lie inside the package where it was installed from a wheel, else beside it.
    """
    named = os.environ.get("HAPTIC_CONFIGS")
    package = Path(__file__).resolve().parent
    installed = package / "configs"
    own = installed if installed.is_dir() else package.parent / "configs"
    return [*([Path(named)] if named else []), Path("configs"), own]


def texture_dirs() -> list[Path]:
    """Folders searched for textures by name."""
    return [folder / "textures" for folder in config_dirs()]


def find_config(name_or_path: str, kind: str) -> Path:
    """The file of that name in a folder `kind` (rigs, models, ...) of the config folders, or the path itself."""
    given, what = Path(name_or_path), kind[:-1]
    names = config_names(kind)
    if given.suffix == ".toml" or os.sep in name_or_path:
        if os.path.isfile(given):
            return given
        said = "is a folder, not a file" if os.path.isdir(given) else "there is no such file"
        hint = f"Give the path of a file, or the name of a {what}. {nearest(given.stem, names)}"
        raise BadInputError("file_not_found", f"{name_or_path}: {said}", hint)
    for folder in config_dirs():
        path = folder / kind / f"{name_or_path}.toml"
        if os.path.isfile(path):  # False too for a name that no file system takes
            return path
    own = f"The name of a {what} file of your own must end in .toml. " if os.path.isfile(given) else ""
    hint = own + nearest(name_or_path, names)
    raise BadInputError(f"unknown_{what}", f"there is no {what} named '{name_or_path}'", hint)


def config_names(kind: str) -> list[str]:
    """The names that `find_config` knows in folders `kind`, sorted."""
    return sorted({path.stem for folder in config_dirs() for path in (folder / kind).glob("*.toml")})
