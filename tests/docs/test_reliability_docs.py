"""What docs/reliability.md names is there."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("", "tests/haptic_driver", "haptic_driver")
PAGE = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")


def test_every_test_that_the_page_names_is_there():
    path, seen = None, 0
    for file, name in re.findall(r"`([\w/]+\.py)?(?:::(test_\w+))?`", PAGE):
        if file:
            path = next((p for folder in FOLDERS if (p := ROOT / folder / file).is_file()), None)
            assert path is not None, f"{file} is gone"
        if name:
            seen += 1
            assert f"def {name}(" in path.read_text(encoding="utf-8"), f"{path} has no {name}"
    assert seen > 50
