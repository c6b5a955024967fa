"""A challenge answered by this program: by diagnoses, and by what people do instead."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.files import write_text
from haptic_driver.lab.challenge.answers import FINGER, Answer
from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.description import ModelDescription
from model.diagnosis.changed import places
from model.diagnosis.data import COLUMNS, Measurements, read_measurements
from model.diagnosis.hypotheses import Candidate
from model.diagnosis.model_fit import Fit
from model.diagnosis.witness import FRICTION
from model.diagnosis.workflow import Diagnosis, Findings, diagnose
from model.reporting.model_file import fitted_model, fitted_nuisances
from model.support.errors import nearest
from model.touch_model import TouchModel

VERDICTS: dict[str, Literal["named", "listed", "unknown", "nothing"]] = {
    "effect_found": "named",
    "ambiguous": "listed",
    "unexplained": "unknown",
    "no_discrepancy": "nothing",
}
CONDITIONS = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "time_s")


def aicc(k: int, n: int) -> float:
    """What AICc charges k parameters with n observations."""
    return 2 * k + 2 * k * (k + 1) / max(n - k - 1, 1)


def bic(k: int, n: int) -> float:
    """What BIC charges them."""
    return k * math.log(n)


CRITERIA: dict[str, Callable[[int, int], float]] = {"aicc": aicc, "bic": bic}
METHODS = ("diagnosis", "base", *CRITERIA)


def own_answer(path: Path, method: str, model: str = "reference") -> Answer:
    """What one of METHODS says of a file; an empty answer where nothing can be tested.

    `base` names nothing and fits the finger alone. `aicc` and `bic` take the best single effect.
    """
    if method not in METHODS:
        hint = nearest(method, list(METHODS))
        raise BadInputError("bad_method", f"there is no method '{method}'", hint)
    description = load_model(model)
    data = replace(read_measurements(path), sure=frozenset(COLUMNS))  # the rules say the units
    return answer_of(diagnose(description, data), description, method)


def answer_of(found: Diagnosis, description: ModelDescription, method: str) -> Answer:
    """The same, of data that are diagnosed."""
    if found.findings is None:
        return Answer()
    if method == "diagnosis":
        return _by_diagnosis(found, found.findings, description)
    chosen = _chosen(found.findings, method, found.data.count)
    effects = [kind.name for kind in chosen.fit.kinds]
    return Answer(
        verdict="named" if effects else "nothing",
        effects=effects,
        finger=_finger(found.findings, chosen.fit, description),
    )


def _chosen(found: Findings, method: str, count: int) -> Candidate:
    """The base model, or the one of the least criterion among it and the single effects."""
    if method == "base":
        return found.hypotheses.base
    models = [found.hypotheses.base, *found.hypotheses.singles]
    charge = CRITERIA[method]
    return min(models, key=lambda c: float(c.fit.chi2 + charge(c.fit.vector.size, count)))


def _by_diagnosis(found: Diagnosis, findings: Findings, description: ModelDescription) -> Answer:
    verdict = findings.verdict
    return Answer(
        verdict=VERDICTS[found.name],
        effects=verdict.suspects,
        probability=min(verdict.probability, 1.0),
        where=[
            {axis: [low, high] for axis, (low, high) in box.items()}
            for box in places(found.data, findings.changed)
        ],
        strength=_strength(found, description),
        finger=_finger(findings, findings.chosen.fit, description),
    )


def _finger(found: Findings, fit: Fit, description: ModelDescription) -> dict[str, list[float]]:
    """The finger's numbers with their standard deviations."""
    numbers = fitted_nuisances(description, fit, found.problem.predictor.free)
    return {
        name: [number.value, number.std]
        for name, number in numbers.items()
        if name in FINGER and number.std
    }


def _strength(found: Diagnosis, description: ModelDescription) -> float:
    """Root mean square of the relative change that the added effects make for the fitted finger."""
    with_effects = fitted_model(found, description, "data")
    without = replace(
        with_effects,
        effect_parameters=description.effect_parameters,
        learned_form=description.learned_form,
    )
    if with_effects == without:
        return 0.0
    data = found.data.subset(found.data.of(FRICTION))
    cof, base = (_friction(model, data) for model in (with_effects, without))
    return float(np.sqrt(np.mean((cof / base - 1.0) ** 2)))


def _friction(model: ModelDescription, data: Measurements) -> Any:
    columns: dict[str, Any] = {
        name: data.columns[name] for name in CONDITIONS if name in data.columns
    }
    return TouchModel(model).predict(Conditions(**columns)).cof


def write_answers(path: Path, answers: Mapping[str, Answer]) -> None:
    """Write answers as `read_answers` reads them; what is not answered is left out."""
    said = {
        name: answer.model_dump(exclude_defaults=True) for name, answer in sorted(answers.items())
    }
    write_text(path, json.dumps(said, indent=1) + "\n")
