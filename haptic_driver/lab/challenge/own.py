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
from haptic_driver.lab.challenge.regions import certified
from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.description import ModelDescription
from model.diagnosis.changed import places
from model.diagnosis.data import COLUMNS, Measurements, read_measurements
from model.diagnosis.hypotheses import Candidate
from model.diagnosis.model_fit import Fit
from model.diagnosis.witness import FRICTION
from model.diagnosis.workflow import Diagnosis, Findings, diagnose
from model.reporting.model_file import fitted_effects, fitted_model, fitted_nuisances
from model.support.errors import nearest
from model.support.tables import read_table
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
METHODS = ("diagnosis", "base", *CRITERIA, "regions")


def own_answer(path: Path, method: str, unseen: Conditions | None = None) -> Answer:
    """What one of METHODS says of a file, and of friction in `unseen`; an empty answer where
    nothing can be tested.

    `base` names nothing and fits the finger alone. `aicc` and `bic` take the best single effect.
    `regions` says where the finger alone does not fit, and names nothing.
    """
    if method not in METHODS:
        hint = nearest(method, list(METHODS))
        raise BadInputError("bad_method", f"there is no method '{method}'", hint)
    description = load_model("reference")
    data = replace(read_measurements(path), sure=frozenset(COLUMNS))  # the rules say the units
    found = diagnose(description, data)
    if found.findings is None:
        return Answer()
    if method == "diagnosis":
        fit = found.findings.chosen.fit
        model = fitted_model(found, description, "data")
        said = _by_diagnosis(found, found.findings, model, description)
    else:
        fit = _chosen(found.findings, method, found.data.count).fit
        model = _fitted(found.findings, fit, description)
        said = _by_method(found.data, fit, method)
    finger = _finger(found.findings, fit, description)
    return Answer(**said, finger=finger, predicted=_predicted(model, unseen))


def read_unseen(path: Path) -> Conditions | None:
    """The settings of a file that `sets.make` has written; None of an older challenge."""
    if not path.exists():
        return None
    table = read_table(path, CONDITIONS[:3], "Make the challenge again in another folder")
    columns: dict[str, Any] = {n: table.numbers(n) for n in CONDITIONS if n in table.columns}
    return Conditions(**columns)


def _predicted(model: ModelDescription, unseen: Conditions | None) -> list[float] | None:
    """Friction there; None where the model says nothing of some setting."""
    if unseen is None:
        return None
    cof = TouchModel(model).predict(unseen).cof
    return cof.tolist() if np.isfinite(cof).all() else None


def _by_method(data: Measurements, fit: Fit, method: str) -> dict[str, Any]:
    if method == "regions":
        regions = certified(data, fit)
        return {"verdict": "unknown" if regions else "nothing", "where": regions}
    effects = [kind.name for kind in fit.kinds]
    return {"verdict": "named" if effects else "nothing", "effects": effects}


def _fitted(found: Findings, fit: Fit, description: ModelDescription) -> ModelDescription:
    """The model with what a fit says of the finger and of its effects."""
    numbers = fitted_nuisances(description, fit, found.problem.predictor.free)
    return replace(
        description,
        parameters=description.parameters | numbers,
        effect_parameters=description.effect_parameters | fitted_effects(fit),
    )


def _chosen(found: Findings, method: str, count: int) -> Candidate:
    """The base model, or the one of the least criterion among it and the single effects."""
    if method in ("base", "regions"):
        return found.hypotheses.base
    models = [found.hypotheses.base, *found.hypotheses.singles]
    charge = CRITERIA[method]
    return min(models, key=lambda c: float(c.fit.chi2 + charge(c.fit.vector.size, count)))


def _by_diagnosis(
    found: Diagnosis, findings: Findings, model: ModelDescription, description: ModelDescription
) -> dict[str, Any]:
    verdict = findings.verdict
    boxes = places(found.data, findings.changed)
    return {
        "verdict": VERDICTS[found.name],
        "effects": verdict.suspects,
        "probability": min(verdict.probability, 1.0),
        "where": [{axis: [low, high] for axis, (low, high) in box.items()} for box in boxes],
        "strength": _strength(found.data, model, description),
    }


def _finger(found: Findings, fit: Fit, description: ModelDescription) -> dict[str, list[float]]:
    """The finger's numbers with their standard deviations."""
    numbers = fitted_nuisances(description, fit, found.problem.predictor.free)
    return {
        name: [number.value, number.std]
        for name, number in numbers.items()
        if name in FINGER and number.std
    }


def _strength(data: Measurements, model: ModelDescription, description: ModelDescription) -> float:
    """Root mean square of the relative change that the added effects make for the fitted finger."""
    without = replace(
        model,
        effect_parameters=description.effect_parameters,
        learned_form=description.learned_form,
    )
    if model == without:
        return 0.0
    rows = data.subset(data.of(FRICTION))
    cof, base = (_friction(each, rows) for each in (model, without))
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
