"""The corrected model as a file that the simulator loads: fitted finger, named effects, and their
origin.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from model.description import POWER_LAW, ModelDescription
from model.diagnosis.model_fit import Fit
from model.diagnosis.space import Nuisance
from model.diagnosis.workflow import Diagnosis
from model.effects.learned import LEARNED
from model.electric.dielectrics import NAMED, PowerLaw, Tabulated
from model.learned_file import form_lines
from model.parameters import SPECIFICATION, Parameter
from model.support.errors import ModelError
from model.support.toml import toml_value

TABLES = "dielectric"  # folder beside the model file that a user's own dielectric table goes to
Scalar = float | int | str


def program() -> str:
    """Name and version of this program."""
    try:
        return f"haptic-driver {version('haptic-driver')}"
    except PackageNotFoundError:
        return "haptic-driver, not installed"


def fitted_nuisances(
    description: ModelDescription, fit: Fit, free: Sequence[Nuisance], source: str = ""
) -> dict[str, Parameter]:
    """The finger's own parameters as fitted, with one standard deviation to first order, within a
    file's ranges.

    `free`: those with which the fit's vector begins.
    """
    found = {}
    for i, nuisance in enumerate(free):
        before, specification = description.parameters[nuisance.name], SPECIFICATION[nuisance.name]
        x = float(fit.vector[i])
        exact = nuisance.value(before.value, np.asarray(x))
        value = float(np.clip(exact, specification["low"], specification["high"]))
        std = nuisance.slope(before.value, x) * float(np.sqrt(fit.covariance[i, i]))
        found[nuisance.name] = Parameter(value, before.unit, source, std)
    return found


def fitted_effects(fit: Fit, source: str = "") -> dict[str, dict[str, Parameter]]:
    """Every effect's parameters as fitted, with one standard deviation to first order."""
    found: dict[str, dict[str, Parameter]] = {}
    position = fit.vector.size - sum(len(kind.parameters()) for kind in fit.kinds)
    for kind in fit.kinds:
        found[kind.name] = {}
        for p in kind.parameters():
            value = float(p.from_normal(fit.vector[position]))
            slope = abs(value) * p.std if p.scale == "log" else p.std
            std = slope * float(np.sqrt(fit.covariance[position, position]))
            found[kind.name][p.name] = Parameter(value, p.unit, source, std)
            position += 1
    return found


def fitted_model(
    diagnosis: Diagnosis, description: ModelDescription, source_name: str
) -> ModelDescription:
    """The input model with the fitted finger and the effects that were named or learned; unchanged
    without a fit.
    """
    if diagnosis.findings is None:
        return description
    findings = diagnosis.findings
    fit, free = findings.chosen.fit, findings.problem.predictor.free
    data = f"{Path(source_name).name}, sha256 {diagnosis.data.content_hash[:16]}"
    effects = fitted_effects(fit, f"fit to {data}") if findings.adds_effects else {}
    learned = findings.learned if LEARNED in effects else None
    own_name = description.name.removesuffix("-fitted")
    return replace(
        description,
        name="+".join([own_name, *effects]) if effects else f"{own_name}-fitted",
        about=f"{description.name}, fitted to {data}: {diagnosis.name}",
        parameters=description.parameters
        | fitted_nuisances(description, fit, free, f"fit to {data}"),
        effect_parameters=description.effect_parameters | effects,
        learned_form=description.learned_form if learned is None else learned.form,
    )


def write_model(
    diagnosis: Diagnosis, description: ModelDescription, path: Path, source_name: str
) -> ModelDescription:
    """Write the corrected model to `path`, and return it.

    An older, different file of that name is kept as `<stem>-1.toml`, `-2`, ... in order of age. A
    user's own dielectric table is copied into a folder beside the file. ModelError where the
    dielectric set cannot be written to a file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    model = fitted_model(diagnosis, description, source_name)
    text = model_text(
        model, dielectric_entry(model, path.parent), _origin(diagnosis, description, source_name)
    )
    if path.exists():
        if _without_date(path.read_bytes()) == _without_date(text.encode()):
            return model
        _keep(path)
    partial = path.with_name(path.name + ".part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
    return model


def model_text(
    model: ModelDescription, dielectric: Mapping[str, Scalar], origin: Mapping[str, Scalar]
) -> str:
    """A model as TOML that `read_model` reads back to the same physics."""
    lines = [
        (
            "# Fitted to data; [origin] says by what and to which. Values in SI units, std is one"
            " standard deviation."
        ),
        f"name = {toml_value(model.name)}",
        f"about = {toml_value(model.about)}",
        f"variant = {toml_value(model.variant)}",
        f"friction_law = {toml_value(model.friction_law)}",
        *_table("dielectric", dielectric),
        "",
        "[parameters]",
        *_parameters(model.parameters),
    ]
    for effect, values in model.effect_parameters.items():
        form = form_lines(model.learned_form) if effect == LEARNED and model.learned_form else []
        lines += ["", f"[effects.{effect}]", *form, *_parameters(values)]
    return "\n".join([*lines, *_table("origin", origin), ""])


def _table(name: str, entries: Mapping[str, Scalar]) -> list[str]:
    return ["", f"[{name}]", *(f"{key} = {toml_value(value)}" for key, value in entries.items())]


def _parameters(values: Mapping[str, Parameter]) -> list[str]:
    width = max(map(len, values))
    return [f"{name:<{width}} = {_parameter(p)}" for name, p in values.items()]


def _parameter(parameter: Parameter) -> str:
    std = (
        ""
        if parameter.std is None or not np.isfinite(parameter.std)
        else f", std = {toml_value(parameter.std)}"
    )
    source = f", source = {toml_value(parameter.source)}" if parameter.source else ""
    return f"{{ value = {toml_value(parameter.value)}{std}{source} }}"


def dielectric_entry(model: ModelDescription, folder: Path) -> dict[str, Scalar]:
    """The `[dielectric]` table of a model file in `folder`; a table of values is copied there.
    Raises ModelError.
    """
    chosen = model.dielectric
    if isinstance(chosen, PowerLaw):
        return {"set": "power_law", **{name: float(getattr(chosen, name)) for name in POWER_LAW}}
    if isinstance(chosen, Tabulated):
        return {"set": "csv", "file": _write_table(chosen, folder)}
    if NAMED.get(chosen.name) == chosen:
        return {"set": chosen.name}
    raise ModelError(
        f"dielectric set '{chosen.name}' cannot be written to a model file",
        "Tabulate it as a CSV file",
    )


def _write_table(table: Tabulated, folder: Path) -> str:
    """Copy a dielectric table to a place of its own under `folder`; the file keeps its name, which
    is part of it.
    """
    columns = zip(table.frequency_hz, table.eps_real, table.conductivity_s_per_m, strict=True)
    rows = [
        "frequency_hz,eps_real,conductivity_s_per_m",
        *(",".join(repr(float(v)) for v in row) for row in columns),
    ]
    text = "\n".join([*rows, ""])
    given = re.fullmatch(r"user's table (.+)", table.source)
    name = (
        Path(given[1]).name if given and Path(given[1]).stem == table.name else f"{table.name}.csv"
    )
    number = 0
    while True:
        relative = Path(f"{TABLES}-{number}" if number else TABLES) / name
        target = folder / relative
        if not target.exists():
            target.parent.mkdir(exist_ok=True)
            target.write_text(text, encoding="utf-8")
            return relative.as_posix()
        if target.read_bytes() == text.encode():
            return relative.as_posix()
        number += 1


def _origin(
    diagnosis: Diagnosis, description: ModelDescription, source_name: str
) -> dict[str, Scalar]:
    origin: dict[str, Scalar] = {
        "data": Path(source_name).name,
        "data_sha256": diagnosis.data.content_hash,
        "verdict": diagnosis.name,
        "parent_model": description.name,
        "parent_hash": description.content_hash,
    }
    if diagnosis.findings is not None:
        verdict, base, chosen = (
            diagnosis.findings.verdict,
            diagnosis.findings.hypotheses.base,
            diagnosis.findings.chosen,
        )
        origin["probability"] = verdict.probability
        origin["log_evidence"] = float(chosen.alone.log_evidence)
        origin["log_evidence_gain"] = float(chosen.alone.log_evidence - base.alone.log_evidence)
        for name, alike in verdict.group.items():
            if alike:
                origin[f"{name}_indistinguishable_from"] = ", ".join(alike)
    return origin | {
        "seed": diagnosis.seed,
        "program": program(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _without_date(text: bytes) -> bytes:
    return re.sub(rb"(?m)^date = .*\n", b"", text)


def _keep(path: Path) -> None:
    """Copy the file at `path` to the next free number."""
    number = 1
    while True:
        try:
            with (
                path.with_name(f"{path.stem}-{number}{path.suffix}").open("xb") as kept,
                path.open("rb") as old,
            ):
                shutil.copyfileobj(old, kept)
        except FileExistsError:
            number += 1
        else:
            return
