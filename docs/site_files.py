"""Hook of MkDocs: files outside `docs/` that a page links to are published beside it.

On the pages a link such as `../configs/rigs/paper.toml` works as it stands in the repository; in
the site the same file lies in `configs/`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

OUTSIDE = ("configs", "examples")


def on_files(files: Files, config: Any) -> Files:
    """Add what lies outside."""
    root = Path(config["docs_dir"]).parent
    for path in sorted(path for name in OUTSIDE for path in (root / name).rglob("*.*")):
        if path.is_file() and path.suffix != ".pyc":
            files.append(
                File.generated(config, path.relative_to(root).as_posix(), abs_src_path=str(path))
            )
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Point links to where the files lie in the site."""
    return re.sub(rf"\]\(\.\./({'|'.join(map(re.escape, OUTSIDE))})", r"](\1", markdown)
