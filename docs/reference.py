"""The reference pages of `docs/`, written from the program itself: `python docs/reference.py`.

`configuration.md` comes from the records that read the files, `api.md` from the daemon's OpenAPI,
`python.md` from `examples/`, one table of `investigation.md` from the effects, and figure and
tables of `processes.md` from `processes/started.py`. What a key means in words stands in the
comments of `configs/rigs/template.toml`, and in `docs/keys.toml` for what that file does not show.
A test fails when a page is out of date. Needs a checkout, not only the package.
"""

from __future__ import annotations

import ast
import json
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, cast

from pydantic import TypeAdapter

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.web.api import create_app
from haptic_driver.experiments.plan import PlanFile
from haptic_driver.experiments.psychophysics.description import ExperimentFile
from haptic_driver.experiments.study import StudyPlan
from haptic_driver.processes.started import MEMORY, PROCESSES, THREADS, Part
from haptic_driver.rig.config import RigConfig
from haptic_driver.textures.description import Description
from model.effects import CATALOGUE, EffectParameter
from model.effects.interventions import INTERVENTIONS, removed
from model.parameters import SPECIFICATION

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
GENERATED = "<!-- Written by `python docs/reference.py`. Change its source, not this page. -->"
GENERATED_TABLE = GENERATED.replace("page", "table")

Schema = dict[str, Any]

# By how a name ends; longer endings first, for `_v_per_s` is not `_s`.
UNITS = {
    "_hz_per_mm_s": "Hz/(mm/s)",
    "_v_per_v": "V/V",
    "_v_per_a": "V/A",
    "_v_per_s": "V/s",
    "_per_n_m": "1/(N m)",
    "_per_n": "1/N",
    "_current_a_rms": "Hz, A",
    "_m_s2": "m/s²",
    "_mm_s": "mm/s",
    "_m_s": "m/s",
    "_ohm": "Ω",
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


def pages() -> dict[str, str]:
    """The text of every generated page, by its name in `docs/`."""
    return {
        "configuration.md": configuration_page(),
        "api.md": api_page(),
        "python.md": python_page(),
        "investigation.md": investigation_page(),
        "processes.md": processes_page(),
    }


def configuration_page() -> str:
    """What every file of `configs/` may say."""
    words = _words()
    rig_words = {**_template_comments(ROOT / "configs" / "rigs" / "template.toml"), **words["rig"]}
    parts = [
        "# Configuration: every key of every file",
        GENERATED,
        words["introduction"].strip(),
        "## Rigs: `configs/rigs/NAME.toml`",
        words["rigs"].strip(),
        *_sections(RigConfig.model_json_schema(), rig_words),
        "## Models: `configs/models/NAME.toml`",
        words["models"].strip(),
        *_model_tables(),
        "## Textures: `configs/textures/NAME.toml`",
        words["textures"].strip(),
        *_variants(TypeAdapter(Description).json_schema(), words["texture"]),
        "## Measurement plans: `configs/plans/NAME.toml`",
        *_sections(PlanFile.model_json_schema(), words["plan"]),
        "## Experiments: `configs/experiments/NAME.toml`",
        words["experiments"].strip(),
        *_sections(ExperimentFile.model_json_schema(), words["experiment"]),
        "## Populations of fingers: `configs/populations/NAME.toml`",
        *_sections(StudyPlan.model_json_schema(), words["population"]),
    ]
    return "\n\n".join(parts) + "\n"


def _words() -> dict[str, Any]:
    """What no record and no template says."""
    return tomllib.loads((DOCS / "keys.toml").read_text(encoding="utf-8"))


def _template_comments(path: Path) -> dict[str, str]:
    """`section.key` -> the comment on its line, of a TOML file; comments that go on are cut at
    their first line.
    """
    words, section = {}, ""
    for line in path.read_text(encoding="utf-8").splitlines():
        if header := re.match(r"\[+([\w.]+)\]", line):
            section = header[1] + "."
        elif said := re.match(r"(?:# )?(\w+) = .*?\s#\s*(.+)$", line):
            words[section + said[1]] = said[2].strip().rstrip(",;")
    return words


def _sections(schema: Schema, words: dict[str, str], path: str = "") -> Iterator[str]:
    """A table of the keys of a file or section, then the sections inside it."""
    definitions = schema.get("$defs", {})
    yield _said(schema.get("description", ""))
    yield _table(schema, definitions, words, path)
    for name, entry in schema["properties"].items():
        inner = f"{path}{name}"
        for found in _tables_in(entry, definitions):
            kind = found["properties"].get("kind", {}).get("const")
            table = f"[[{inner}]]" if entry.get("type") == "array" else f"[{inner}]"
            yield f"### `{table}`" + (f' with `kind = "{kind}"`' if kind else "")
            yield from _sections({**found, "$defs": definitions}, words, f"{inner}.")


def _variants(schema: Schema, words: dict[str, str]) -> Iterator[str]:
    """A table for each kind of a union."""
    definitions = schema["$defs"]
    for branch in schema["anyOf"]:
        found = definitions[branch["$ref"].rpartition("/")[2]]
        yield f'### `kind = "{found["properties"]["kind"]["const"]}"`'
        yield from _sections({**found, "$defs": definitions}, words)


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


def _table(schema: Schema, definitions: Schema, words: dict[str, str], path: str) -> str:
    """One row per key; KeyError where nothing says what a key means."""
    needed = schema.get("required", [])
    rows = ["| key | type and range | unit | default | meaning |", "|---|---|---|---|---|"]
    for name, entry in schema["properties"].items():
        if name == "kind" or _tables_in(entry, definitions):
            continue
        key = path + name
        default = "required" if name in needed else _value(entry.get("default"))
        about = words.get(key) or words.get(name) or ""
        if not about:
            raise KeyError(
                f"{key}: give its meaning in docs/keys.toml or configs/rigs/template.toml"
            )
        rows.append(f"| `{name}` | {_type(entry)} | {_unit(name)} | {default} | {_cell(about)} |")
    return "\n".join(rows) if len(rows) > 2 else "No keys of its own." if path else ""


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


def investigation_page() -> str:
    """The page as it stands, with its table of interventions as effects have it."""
    rows = ["| intervention | what to do | what is gone then |", "|---|---|---|"]
    for known in INTERVENTIONS:
        gone = ", ".join(f"`{name}`" for name in removed(known.name))
        rows.append(f"| `{known.name}` | {_cell(known.todo)} | {gone} |")
    return _with_tables("investigation.md", ["\n".join(rows)])


def processes_page() -> str:
    """The page as it stands, with figure and tables of processes, threads and memory."""
    tables = [
        _parts_table(kind, place, parts)
        for kind, place, parts in (("process", "child of", PROCESSES), ("thread", "in", THREADS))
    ]
    rows = ["| memory | its only writer | in | what |", "|---|---|---|---|"]
    rows += [f"| `{m.name}` | {m.writer} | `{m.file}` | {m.content} |" for m in MEMORY]
    return _with_tables("processes.md", [_processes_figure(), *tables, "\n".join(rows)])


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


def _with_tables(name: str, tables: Sequence[str]) -> str:
    """A page as it stands, but for what comes behind each mark up to the next empty line."""
    before, *rest = (DOCS / name).read_text(encoding="utf-8").split(GENERATED_TABLE + "\n\n")
    page = before
    for table, old in zip(tables, rest, strict=True):
        page += f"{GENERATED_TABLE}\n\n{table}\n\n" + old.partition("\n\n")[2]
    return page


def api_page() -> str:
    """What the daemon's HTTP API takes and answers."""
    # Only the description is wanted: nothing calls the daemon behind it.
    described = create_app(cast(Daemon, None)).openapi()
    words = _words()["api"]
    parts = ["# The daemon's HTTP API", GENERATED, words["introduction"].strip(), "## Requests"]
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            parts += _operation(f"{method.upper()} {path}", operation)
    parts += ["## Streams", words["streams"].strip(), "## Records"]
    schemas = described["components"]["schemas"]
    for name in sorted(schemas):
        parts += [
            f"### {name}",
            _said(schemas[name].get("description", "")),
            _fields(schemas[name]),
        ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _operation(title: str, operation: Schema) -> Iterator[str]:
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
    yield "\n".join(lines)


def _json(message: Schema) -> Schema:
    return cast(Schema, message["content"]["application/json"]["schema"])


def _fields(schema: Schema) -> str:
    if "properties" not in schema:
        return f"Type: {_type(schema)}."
    needed = schema.get("required", [])
    rows = ["| field | type and range | unit | default |", "|---|---|---|---|"]
    for name, entry in schema["properties"].items():
        nullable = (
            " or `null`" if any(b.get("type") == "null" for b in entry.get("anyOf", [])) else ""
        )
        default = "always there" if name in needed else _value(entry.get("default"))
        rows.append(f"| `{name}` | {_type(entry)}{nullable} | {_unit(name)} | {default} |")
    return "\n".join(rows)


def python_page() -> str:
    """The numbered examples, each with the words at its top."""
    words = _words()["python"]
    parts = ["# Python: the same from a script", GENERATED, words["introduction"].strip()]
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        source = path.read_text(encoding="utf-8")
        said = ast.get_docstring(ast.parse(source)) or ""
        title, _, text = said.partition("\n\n")
        code = source.split('"""', 2)[2].strip()
        parts += [
            f"## {title.rstrip('.')}",
            f"`examples/{path.name}`",
            text,
            f"```python\n{code}\n```",
        ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _said(text: str) -> str:
    """A docstring as Markdown: lines joined, paragraphs kept."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def main(
    write: Callable[[str, str], object] = lambda name, text: (DOCS / name).write_text(
        text, "utf-8"
    ),
) -> None:
    for name, text in pages().items():
        write(name, text)


if __name__ == "__main__":
    main()
