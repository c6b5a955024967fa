"""A learned term's form in a model file: `[effects.learned]` has it beside the term's
parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, get_args

from model.effects.learned import LOG_INPUTS, QUANTITIES, LearnedForm, Shape, Term
from model.support.errors import ModelError, nearest

KEYS = ("acts_on", "shape", "terms", "lowest_voltage_v", "with_phase")
AMPLITUDE = "amplitude"
HIGHEST_AMPLITUDE = 10.0  # of a logarithm: no quantity of a touch is off by 20,000 times
HIGHEST_V = 1000.0  # no electrode under a finger is driven with more
EXAMPLE = "For example: terms = [{ amplitude = 0.1, frequency_hz = [10.0, 100.0, 1000.0] }]"


def form_lines(form: LearnedForm) -> list[str]:
    """The form as lines of TOML, in SI units."""
    terms = []
    for term in form.terms:
        nodes = {name: list(values) for name, values in zip(term.inputs, term.nodes, strict=True)}
        terms.append(
            "  { "
            + ", ".join(f"{k} = {v!r}" for k, v in {AMPLITUDE: term.amplitude, **nodes}.items())
            + " },"
        )
    return [
        (
            f'acts_on = "{form.acts_on}"  # {QUANTITIES[form.acts_on].words}; at this place of the'
            f" chain: {form.place}"
        ),
        f'shape = "{form.shape}"',
        f"lowest_voltage_v = {form.lowest_voltage_v!r}",
        f"with_phase = {str(form.with_phase).lower()}",
        "terms = [  # nodes of each input, whose ends are its range of validity",
        *terms,
        "]",
    ]


def read_form(table: Mapping[str, Any], where: str) -> LearnedForm:
    """The form in a table of a model file; ModelError says what is wrong with it, and where."""
    missing = [key for key in KEYS if key not in table]
    if missing:
        raise ModelError(
            f"{where}: {missing[0]} is missing", "Take the table from the model.toml of a diagnosis"
        )
    acts_on, shape, with_phase = str(table["acts_on"]), table["shape"], table["with_phase"]
    if acts_on not in QUANTITIES:
        raise ModelError(
            f"{where}: acts_on '{acts_on}' is unknown", nearest(acts_on, list(QUANTITIES))
        )
    if shape not in get_args(Shape):
        raise ModelError(
            f"{where}: shape '{shape}' is unknown", nearest(str(shape), list(get_args(Shape)))
        )
    if not isinstance(with_phase, bool) or (with_phase and not QUANTITIES[acts_on].has_phase):
        raise ModelError(
            f"{where}: with_phase must be false: {acts_on} has no phase", "Set with_phase = false"
        )
    if not isinstance(table["terms"], list) or not table["terms"]:
        raise ModelError(f"{where}: terms is no list of tables", EXAMPLE)
    terms = tuple(_read_term(entry, acts_on, shape, where) for entry in table["terms"])
    lowest_v = _positive("lowest_voltage_v", table["lowest_voltage_v"], HIGHEST_V, where)
    return LearnedForm(acts_on, shape, terms, lowest_v, with_phase)


def _read_term(entry: Any, acts_on: str, shape: Shape, where: str) -> Term:
    known = QUANTITIES[acts_on].inputs
    if not isinstance(entry, dict) or not 1 <= len(entry.keys() - {AMPLITUDE}) <= (
        2 if shape == "spline" else 1
    ):
        raise ModelError(f"{where}: a term has one input, or two in a spline", EXAMPLE)
    nodes: dict[str, tuple[float, ...]] = {}
    for name, values in entry.items():
        if name == AMPLITUDE:
            continue
        if name not in known:
            raise ModelError(
                f"{where}: {acts_on} has no input '{name}'", nearest(name, list(known))
            )
        numbers = values if isinstance(values, list) else []
        rising = (
            len(numbers) > 1
            and all(_is_number(x) for x in numbers)
            and sorted(set(numbers)) == numbers
        )
        if not rising or (name in LOG_INPUTS and numbers[0] <= 0.0):
            raise ModelError(f"{where}: {name} is no list of rising numbers, two or more", EXAMPLE)
        nodes[name] = tuple(float(x) for x in numbers)
    amplitude = _positive(AMPLITUDE, entry.get(AMPLITUDE, 1.0), HIGHEST_AMPLITUDE, where)
    return Term(tuple(nodes), tuple(nodes.values()), amplitude)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _positive(name: str, value: Any, most: float, where: str) -> float:
    if not _is_number(value) or not 0.0 < value <= most:
        raise ModelError(
            f"{where}: {name} = {value!r} is not a positive number up to {most:g}", EXAMPLE
        )
    return float(value)
