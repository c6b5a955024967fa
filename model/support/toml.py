"""Values as TOML, where a file is laid out by hand: `tomllib` reads back what was given."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping
from typing import Any


def toml_lines(content: Mapping[str, Any]) -> str:
    """A line for each entry; tables stand inline. Of a value that is None there is no line."""
    entries = ((name, value) for name, value in content.items() if value is not None)
    return "".join(f"{name} = {toml_value(value)}\n" for name, value in entries)


def toml_value(value: Any) -> str:
    """A text, number, date, list or inline table; bytes of a text that are no UTF-8 become `?`.

    A text's escapes are those that JSON and TOML share; DEL is the one that only TOML wants.
    """
    match value:
        case str():
            clean = value.encode("utf-8", "replace").decode("utf-8")
            return json.dumps(clean, ensure_ascii=False).replace("\x7f", "\\u007f")
        case bool() | int():
            return json.dumps(value)
        case datetime.date():
            return value.isoformat()
        case Mapping():
            inside = (f"{name} = {toml_value(one)}" for name, one in value.items())
            return f"{{ {', '.join(inside)} }}"
        case list() | tuple():
            return f"[{', '.join(map(toml_value, value))}]"
    return repr(float(value))
