"""What is written from the program itself: `python docs/reference.py`.

The tables of `configuration.md` come from the records that read the files, those of `api.md` from
the daemon's OpenAPI, the names and examples of `python.md` from
`haptic_driver` and `examples/`, and one table of
`investigation.md` from the effects. The comments of `configs/rigs/template.toml` are the
descriptions of its keys. What stands between is written by hand. A test fails when something is out
of date. Needs a checkout, not only the package.
"""

from __future__ import annotations

import ast
import inspect
import json
import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, cast

import errors
from pydantic import TypeAdapter

import haptic_driver
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.verbs import methods
from haptic_driver.daemon.web.api import create_app
from haptic_driver.lab.findings import Diagnosis
from haptic_driver.lab.measuring.plan import PlanFile
from haptic_driver.lab.psychophysics.description import ExperimentFile
from haptic_driver.lab.studies import StudyPlan
from haptic_driver.processes.started import MEMORY, PROCESSES, THREADS, Part
from haptic_driver.public.connection import Rig
from haptic_driver.public.picture import Picture
from haptic_driver.public.predictions import Predictions
from haptic_driver.public.rigs import SimulatedRig, SlideResult
from haptic_driver.public.surfaces import Surface
from haptic_driver.rig.config import RigConfig
from haptic_driver.textures.description import Description
from model.effects import CATALOGUE, EffectParameter
from model.effects.interventions import INTERVENTIONS, removed
from model.parameters import SPECIFICATION

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
TEMPLATE = ROOT / "configs" / "rigs" / "template.toml"
COMMENT_COLUMN = 38
WIDTH = 120

Schema = dict[str, Any]

# By how a name ends; longer endings first, for `_v_per_s` is not `_s`.
UNITS = {
    "_hz_per_mm_s": "Hz/(mm/s)",
    "_v_per_v": "V/V",
    "_v_per_a": "V/A",
    "_v_per_s": "V/s",
    "_per_n_m": "1/(N m)",
    "_n_per_m": "N/m",
    "_per_n": "1/N",
    "_per_s": "1/s",
    "_current_a_rms": "Hz, A",
    "_m_s2": "m/s²",
    "_mm_s": "mm/s",
    "_m_s": "m/s",
    "_ohm": "Ω",
    "_m2": "m²",
    "_deg": "°",
    "_hz": "Hz",
    "_mm": "mm",
    "_v": "V",
    "_a": "A",
    "_f": "F",
    "_n": "N",
    "_m": "m",
    "_s": "s",
}


def texts() -> dict[Path, str]:
    """What every file with generated parts should hold."""
    parts = {
        "configuration.md": configuration(),
        "api.md": api(),
        "python.md": {"names": public_names(), "examples": examples()},
        "investigation.md": {"interventions": interventions()},
        "processes.md": processes(),
        "errors.md": {"codes": errors.table()},
    }
    found = {DOCS / name: filled((DOCS / name).read_text("utf-8"), p) for name, p in parts.items()}
    return found | {TEMPLATE: commented(TEMPLATE.read_text("utf-8"), RigConfig.model_json_schema())}


def filled(page: str, parts: dict[str, str]) -> str:
    """A page with its generated parts as they should be; ValueError where it has no place for
    one.
    """
    for name, text in parts.items():
        begin, end = f"<!-- {name}: by `python docs/reference.py` -->", f"<!-- end of {name} -->"
        before, found, rest = page.partition(begin)
        _, ended, after = rest.partition(end)
        if not (found and ended):
            raise ValueError(f"no place for {name}: {begin} ... {end}")
        page = f"{before}{begin}\n\n{text}\n\n{end}{after}"
    return page


def configuration() -> dict[str, str]:
    """What every file of `configs/` may say."""
    found = {
        "rigs": sections(RigConfig.model_json_schema()),
        "models": _model_tables(),
        "textures": _variants(TypeAdapter(Description).json_schema()),
        "plans": sections(PlanFile.model_json_schema()),
        "experiments": sections(ExperimentFile.model_json_schema()),
        "populations": sections(StudyPlan.model_json_schema()),
    }
    return {name: "\n\n".join(filter(None, parts)) for name, parts in found.items()}


def commented(template: str, schema: Schema) -> str:
    """A TOML file with the description of each key as its comment; sections have blank lines
    between them. A key with a default that is not there is added, commented out.
    """
    sections = template.strip().split("\n\n")
    return "\n\n".join("\n".join(_commented(text, schema)) for text in sections) + "\n"


def _commented(section: str, schema: Schema) -> Iterator[str]:
    header = re.search(r"^\[+([\w.]+)\]", section, re.MULTILINE)
    kind = re.search(r'^kind = "(\w+)"', section, re.MULTILINE)
    keys = _keys(schema, header[1].split(".") if header else [], kind and kind[1])
    for line in section.splitlines():
        said = re.match(r"((?:# )?(\w+) = .*?)(?:\s+#.*)?$", line)
        entry = keys.pop(said[2], {}) if said else {}
        if said and "description" in entry:
            yield from _line(said[1], entry["description"])
        elif not re.match(r"\s+#", line):  # the rest of a comment
            yield line
    for name, entry in keys.items():
        if "default" in entry and "description" in entry:
            default = "..." if entry["default"] is None else json.dumps(entry["default"])
            yield from _line(f"# {name} = {default}", entry["description"])


def _line(key: str, description: str) -> list[str]:
    """A key with its comment, which goes on below where it is long."""
    first, more = f"{key}  ".ljust(COMMENT_COLUMN) + "# ", " " * COMMENT_COLUMN + "# "
    wrapper = textwrap.TextWrapper(WIDTH, first, more, break_on_hyphens=False)
    return wrapper.wrap(description)


def _keys(schema: Schema, path: list[str], kind: str | None) -> Schema:
    """The keys of the section at a path."""
    definitions, found = schema.get("$defs", {}), schema
    for name in path:
        tables = _tables_in(found["properties"][name], definitions)
        found = next((t for t in tables if _kind(t) == kind), tables[0])
    return {
        name: entry
        for name, entry in found["properties"].items()
        if not _tables_in(entry, definitions)
    }


def _kind(table: Schema) -> str | None:
    return cast("str | None", table["properties"].get("kind", {}).get("const"))


def sections(schema: Schema, path: str = "") -> Iterator[str]:
    """A table of the keys of a file or section, then the sections inside it."""
    definitions = schema.get("$defs", {})
    yield _said(schema.get("description", ""))
    yield _table(schema, definitions, path)
    for name, entry in schema["properties"].items():
        inner = f"{path}{name}"
        for found in _tables_in(entry, definitions):
            table = f"[[{inner}]]" if entry.get("type") == "array" else f"[{inner}]"
            kind = _kind(found)
            yield f"### `{table}`" + (f' with `kind = "{kind}"`' if kind else "")
            yield from sections({**found, "$defs": definitions}, f"{inner}.")


def _variants(schema: Schema) -> Iterator[str]:
    """A table for each kind of a union."""
    definitions = schema["$defs"]
    for branch in schema["anyOf"]:
        found = definitions[branch["$ref"].rpartition("/")[2]]
        yield f'### `kind = "{_kind(found)}"`'
        yield from sections({**found, "$defs": definitions})


def _tables_in(entry: Schema, definitions: Schema) -> list[Schema]:
    """The sections that may stand at one key, more than one where `kind` chooses."""
    if "properties" in entry:
        return [entry]
    if "$ref" in entry:
        found = definitions[entry["$ref"].rpartition("/")[2]]
        return [found] if "properties" in found else []
    inside = [*entry.get("anyOf", []), *entry.get("oneOf", [])]
    if entry.get("type") == "array" and entry["items"].keys() & {
        "$ref",
        "oneOf",
        "anyOf",
        "properties",
    }:
        inside.append(entry["items"])
    return [found for branch in inside for found in _tables_in(branch, definitions)]


def _table(schema: Schema, definitions: Schema, path: str) -> str:
    """One row per key; KeyError where nothing says what a key means."""
    needed = schema.get("required", [])
    rows = ["| key | type and range | unit | default | meaning |", "|---|---|---|---|---|"]
    for name, entry in schema["properties"].items():
        if name == "kind" or _tables_in(entry, definitions):
            continue
        if "description" not in entry:
            raise KeyError(f"{path}{name}: give its field a description")
        rows.append(_row(name, entry, "required" if name in needed else ""))
    return "\n".join(rows) if len(rows) > 2 else "No keys of its own." if path else ""


def _row(name: str, entry: Schema, needed: str, null: str = "") -> str:
    default = needed or _value(entry.get("default"))
    about = _cell(entry.get("description", ""))
    return f"| `{name}` | {_type(entry)}{null} | {_unit(name)} | {default} | {about} |"


def _type(entry: Schema) -> str:
    """A type with its range, in words."""
    branches = [
        b for b in [*entry.get("anyOf", []), *entry.get("oneOf", [])] if b.get("type") != "null"
    ]
    if branches:
        return " or ".join(_type(branch) for branch in branches)
    if "$ref" in entry:
        return f"[{_name(entry)}](#{_name(entry).lower()})"
    if "enum" in entry or "const" in entry:
        return " or ".join(
            f"`{json.dumps(value)}`" for value in entry.get("enum", [entry.get("const")])
        )
    if entry.get("type") == "array":
        return f"list of {_length(entry)}{_type(entry['items'])}"
    if entry.get("type") == "object":
        inner = entry.get("additionalProperties")
        return f"table of {_type(inner)}" if isinstance(inner, dict) and inner else "table"
    return {
        "number": "number",
        "integer": "whole number",
        "boolean": "`true` or `false`",
        "string": "text",
    }.get(entry.get("type", ""), "any") + _range(entry)


def _name(entry: Schema) -> str:
    return str(entry["$ref"].rpartition("/")[2])


def _length(entry: Schema) -> str:
    low, high = entry.get("minItems", 0), entry.get("maxItems")
    if low == high:
        return f"{low} × "
    return f"at least {low} × " if low else ""


def _range(entry: Schema) -> str:
    if entry.get("format") == "date":
        return ", a date"
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    said = [f"{sign} {_value(entry[key])}" for key, sign in signs.items() if key in entry]
    if "maxLength" in entry:
        said.append(f"{entry.get('minLength', 0)} to {entry['maxLength']} characters")
    return f", {', '.join(said)}" if said else ""


def _value(value: Any) -> str:
    """A value as TOML and JSON write it."""
    if value is None:
        return "none"
    if isinstance(value, bool | str):
        return f"`{json.dumps(value)}`"
    if isinstance(value, int | float):
        return f"{value:g}" if abs(value) < 2**31 or isinstance(value, float) else f"{value:.3g}"
    if isinstance(value, dict):
        return ", ".join(f"`{key}` {_value(inner)}" for key, inner in value.items()) or "empty"
    return f"[{', '.join(_value(inner) for inner in value)}]"


def _unit(name: str) -> str:
    return next((unit for ending, unit in UNITS.items() if f"_{name}".endswith(ending)), "")


def _model_tables() -> Iterator[str]:
    """The parameters of a touch and of every effect."""
    rows = ["| key of `[parameters]` | range | unit | meaning |", "|---|---|---|---|"]
    for name, said in SPECIFICATION.items():
        rows.append(
            f"| `{name}` | {said['low']:g} to {said['high']:g} | {said['unit']} |"
            f" {_cell(said['about'])} |"
        )
    yield "\n".join(rows)
    head = ["`[effects.…]`", "key", "range", "prior", "unit", "off at", "effect"]
    rows = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for effect in CATALOGUE:
        for p in effect.parameters():
            range_and_prior = f"{p.low:g} to {p.high:g} | {_prior(p)}"
            about = f"{p.unit} | {p.off:g} | {_cell(effect.physics)}"
            rows.append(f"| `{effect.name}` | `{p.name}` | {range_and_prior} | {about} |")
    yield "\n".join(rows)


def _prior(parameter: EffectParameter) -> str:
    """Median, and one standard deviation: a factor where the logarithm is normal."""
    if parameter.scale == "log":
        return f"{parameter.median:g}, × {math.exp(parameter.std):.3g}"
    return f"{parameter.median:g} ± {parameter.std:g}"


def interventions() -> str:
    """What somebody may do at a rig, and what it takes away."""
    rows = ["| intervention | what to do | what is gone then |", "|---|---|---|"]
    for known in INTERVENTIONS:
        gone = ", ".join(f"`{name}`" for name in removed(known.name))
        rows.append(f"| `{known.name}` | {_cell(known.todo)} | {gone} |")
    return "\n".join(rows)


def processes() -> dict[str, str]:
    """Figure and tables of processes, threads and memory."""
    rows = ["| memory | its only writer | in | what |", "|---|---|---|---|"]
    rows += [f"| `{m.name}` | {m.writer} | `{m.file}` | {m.content} |" for m in MEMORY]
    return {
        "figure": _processes_figure(),
        "processes": _parts_table("process", "child of", PROCESSES),
        "threads": _parts_table("thread", "in", THREADS),
        "memory": "\n".join(rows),
    }


def _parts_table(kind: str, place: str, parts: Sequence[Part]) -> str:
    rows = [f"| {kind} | {place} | started by | what for |", "|---|---|---|---|"]
    rows += [f"| `{p.name}` | {p.within} | `{p.owner}` | {_cell(p.purpose)} |" for p in parts]
    return "\n".join(rows)


def _processes_figure() -> str:
    """The tree of processes, the threads in each, and the memory that each alone writes."""
    lines = []
    for process in PROCESSES:
        is_child = process.within in {other.name for other in PROCESSES}
        parent = "" if is_child else f"  <-  {process.within.replace('`', '')}"
        branch, inside = ("  +-- ", "  |     ") if is_child else ("", "  |   ")
        lines.append(f"{branch}{process.name}{parent}")
        for what, names in (
            ("threads", [thread.name for thread in THREADS if thread.within == process.name]),
            ("writes ", [memory.name for memory in MEMORY if memory.writer == process.name]),
        ):
            shown = wrap(", ".join(names), 70)
            lines += [f"{inside}{what if n == 0 else ' ' * 7}  {s}" for n, s in enumerate(shown)]
    return "\n".join(["```text", *lines, "```"])


def api() -> dict[str, str]:
    """What the daemon's HTTP API takes and answers."""
    # Only the description is wanted: nothing calls the daemon behind it.
    described = create_app(cast(Daemon, None)).openapi()
    requests: list[str] = []
    names = {f"{verb.method} {verb.path}": name for name, verb in methods().items()}
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            title = f"{method.upper()} {path}"
            requests += _operation(title, names[title], operation)
    records: list[str] = []
    for name, schema in sorted(described["components"]["schemas"].items()):
        records += [f"### {name}", _said(schema.get("description", "")), _fields(schema)]
    parts = {"requests": requests, "records": records}
    return {name: "\n\n".join(filter(None, texts)) for name, texts in parts.items()}


def _operation(title: str, name: str, operation: Schema) -> Iterator[str]:
    yield f"### `{title}`"
    yield _said(operation.get("description", ""))
    lines = [
        f"- {'header' if p['in'] == 'header' else 'query'} `{p['name']}`: {_type(p['schema'])},"
        f" default {_value(p['schema'].get('default'))}. {p.get('description', '')}".rstrip()
        for p in operation.get("parameters", [])
    ]
    if "requestBody" in operation:
        lines.append(f"- body: {_type(_json(operation['requestBody']))}")
    lines.append(f"- answer: {_type(_json(operation['responses']['200']))}")
    lines.append(f"- in Python, and on `/commands`: `{name}`")
    yield "\n".join(lines)


def _json(message: Schema) -> Schema:
    return cast(Schema, message["content"]["application/json"]["schema"])


def _fields(schema: Schema) -> str:
    if "properties" not in schema:
        return f"Type: {_type(schema)}."
    needed = schema.get("required", [])
    rows = ["| field | type and range | unit | default | meaning |", "|---|---|---|---|---|"]
    for name, entry in schema["properties"].items():
        null = " or `null`" if {"type": "null"} in entry.get("anyOf", []) else ""
        rows.append(_row(name, entry, "always there" if name in needed else "", null))
    return "\n".join(rows)


def examples() -> str:
    """The numbered examples, each with the words at its top."""
    parts = []
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        source = path.read_text(encoding="utf-8")
        said = ast.get_docstring(ast.parse(source)) or ""
        title, _, text = said.partition("\n\n")
        code = source.split('"""', 2)[2].strip()
        name = f"`examples/{path.name}`"
        parts += [f"## {title.rstrip('.')}", name, text, f"```python\n{code}\n```"]
    return "\n\n".join(filter(None, parts))


def public_names() -> str:
    """Every name of `haptic_driver.__all__` with its signature, and what its answers offer."""
    parts = ["## Names"]
    for name in sorted(haptic_driver.__all__, key=str.lower):
        thing = getattr(haptic_driver, name)
        parts.append(_entry(f"hd.{name}", thing))
    parts.append("## What they answer")
    for kind in (Rig, Predictions, Surface, SimulatedRig, SlideResult, Diagnosis, Picture):
        parts.append(f"**`{kind.__name__}`** {_said(inspect.getdoc(kind) or '')}")
        members = [n for n in vars(kind) if not n.startswith("_") and callable(getattr(kind, n))]
        parts.append("\n".join(f"- {_entry(f'.{n}', getattr(kind, n))}" for n in members))
    return "\n\n".join(parts)


def _entry(name: str, thing: Any) -> str:
    """A signature and the first paragraph of what it says."""
    words = "" if isinstance(thing, type) else str(inspect.signature(thing))
    words = re.sub(r"(: |-> )'([^']*)'", r"\1\2", words)
    words = words.replace("(self, ", "(").replace("(self)", "()")
    return f"`{name}{words}`: {_said(inspect.getdoc(thing) or '')}"


def _said(text: str) -> str:
    """A docstring as Markdown: lines joined, paragraphs kept."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def main() -> None:
    for path, text in texts().items():
        path.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
