"""What was learned, as a report says it: place, inputs, range, formula, proof."""

from __future__ import annotations

from typing import Any

from model.diagnosis.learned import LearnedTerm
from model.effects.learned import (
    LEARNED,
    LOG_INPUTS,
    NEEDED,
    QUANTITIES,
    UNITS,
    LearnedForm,
    middle,
)
from model.parameters import Parameter
from model.reporting.model_file import fitted_effects

SHORT = {
    "frequency_hz": "f",
    "voltage_v": "V",
    "normal_force_n": "N",
    "speed_m_s": "v",
    "time_s": "t",
}


def learned_record(found: LearnedTerm) -> dict[str, Any]:
    """The learned term as JSON can hold it; `words` are sentences for people."""
    form, proof = found.form, found.proof
    return {
        "place": form.place,
        "indistinguishable_places": [place for place in found.alike if place != form.place],
        "places": found.places,
        "acts_on": form.acts_on,
        "inputs": [list(term.inputs) for term in form.terms],
        "shape": form.shape,
        "formula": _formula(found),
        "range": {name: list(ends) for name, ends in form.ranges.items()},
        "in_model": found.is_proved,
        "gap_closed": proof.gap_closed,
        "gap_closed_interval": proof.interval,
        "gap_closed_by_smooth_term": found.smooth_closed,
        "words": _words(found),
    }


def _words(found: LearnedTerm) -> list[str]:
    form, others = found.form, [place for place in found.alike if place != found.form.place]
    place = (
        f"The discrepancy acts at this place of the chain: {form.place}"
        f" ({QUANTITIES[form.acts_on].words})"
    )
    alike = f"; these data cannot tell that from {' or '.join(others)}." if others else "."
    inputs = " and of ".join(" with ".join(term.inputs) for term in form.terms)
    shape = "a smooth term" if form.shape == "spline" else f"a short formula, {_formula(found)},"
    ends = [
        f"{name} {low:g} to {high:g} {UNITS[name]}" for name, (low, high) in form.ranges.items()
    ]
    closed, low, high = (
        f"{min(x, 1.0):.0%}" for x in (found.proof.gap_closed, *found.proof.interval)
    )
    proof = (
        f"On data left out of the fit it closes {closed} of the gap (95 % interval {low} to {high})"
    )
    kept = (
        "; it is in model.toml as effect learned."
        if found.is_proved
        else ", too little to be put into model.toml."
    )
    return [
        place + alike,
        f"It is described by {shape} of {inputs}.",
        f"Known for {', '.join(ends)}; {_beyond(form)}.",
        proof + kept,
        "It is learned from these data alone: no cause, and no promise elsewhere.",
    ]


def _beyond(form: LearnedForm) -> str:
    """What happens outside the range."""
    held = [name for name in form.ranges if name in NEEDED]
    refused = [name for name in form.ranges if name not in NEEDED]
    said = [f"surfaces beyond that {' and '.join(refused)} are refused"] if refused else []
    said += [f"beyond that {' and '.join(held)} it stays as at the nearest end"] if held else []
    return ", and ".join(said)


def _formula(found: LearnedTerm) -> str | None:
    """The short formula with its numbers; None for a spline, whose values are in the model file."""
    if found.form.shape == "spline":
        return None
    values = fitted_effects(found.candidate.fit)[LEARNED]
    factors = [_factor(found.form, i, values) for i in range(len(found.form.terms))]
    return f"{found.form.acts_on} x {' x '.join(factors)}"


def _factor(form: LearnedForm, i: int, values: dict[str, Parameter]) -> str:
    name, (low, high) = form.terms[i].inputs[0], form.terms[i].nodes[0]
    own = {
        key: values[f"{name}_{key}"].value
        for key in ("exponent", "amount", "scale", "steepness")
        if f"{name}_{key}" in values
    }
    x = (
        SHORT[name]
        if name in LOG_INPUTS or low == 0.0
        else f"({SHORT[name]} - {low:.3g} {UNITS[name]})"
    )
    if form.shape == "power":
        return f"({x}/{middle(name, (low, high)):.3g} {UNITS[name]})^{own['exponent']:.3g}"
    steepness = f"^{own['steepness']:.3g}" if form.shape == "step" else ""
    return f"exp({own['amount']:.3g}/(1 + ({own['scale']:.3g} {UNITS[name]}/{x}){steepness}))"
