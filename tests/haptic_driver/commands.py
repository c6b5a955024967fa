"""What a command line leaves: JSON on stdout, and tables."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest

from haptic_driver.cli.main import main


def one_object(text: str) -> dict[str, Any]:
    """All of a text as one line of strict JSON; fails for anything before or after it."""
    (line,) = text.splitlines()
    content = json.loads(line, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    assert isinstance(content, dict)
    return content


def said_by(*arguments: object) -> dict[str, Any]:
    """What a command that succeeds says with `--json`; for fixtures that serve many tests."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        assert main([*map(str, arguments), "--json"]) == 0
    return one_object(said.getvalue())


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV table by the names of their columns."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
