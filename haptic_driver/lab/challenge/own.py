"""A challenge answered by this program: diagnoses as answers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from haptic_driver.files import write_text
from haptic_driver.lab.challenge.answers import Answer, Region
from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.description import ModelDescription
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.where import Region as Found
from model.diagnosis.witness import FRICTION
from model.diagnosis.workflow import Diagnosis, diagnose
from model.reporting.model_file import fitted_model
from model.touch_model import TouchModel

VERDICTS: dict[str, Literal["named", "listed", "unknown", "nothing"]] = {
    "effect_found": "named",
    "ambiguous": "listed",
    "unexplained": "unknown",
    "no_discrepancy": "nothing",
}
CONDITIONS = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "time_s")


def own_answer(path: Path, model: str = "reference") -> Answer:
    """What a diagnosis of a file says; an empty answer where nothing can be tested."""
    description = load_model(model)
    found = diagnose(description, read_measurements(path))
    if found.findings is None:
        return Answer()
    verdict = found.findings.verdict
    return Answer(
        verdict=VERDICTS[found.name],
        effects=verdict.suspects,
        probability=min(verdict.probability, 1.0),
        where=[_region(r) for r in found.findings.before.certain if r.witness == FRICTION],
        strength=_strength(found, description),
    )


def _region(region: Found) -> Region:
    return {
        axis: [low, high]
        for axis, low, high in zip(region.axes, region.low, region.high, strict=True)
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
