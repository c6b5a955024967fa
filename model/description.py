"""A model as its file describes it: parameters with their sources, skin data, friction law,
effects.

It is checked by hand: ranges are data of parameters and effects, which fits take as bounds too.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from model.effects import BY_NAME, Effect
from model.effects.learned import LEARNED, LearnedForm, learned_kind
from model.electric.dielectrics import (
    Dielectric,
    PowerLaw,
    described,
    named,
    of_description,
    read_csv,
)
from model.learned_file import KEYS, read_form
from model.parameters import FRICTION_LAWS, SPECIFICATION, FrictionLaw, Parameter, TouchParameters
from model.support.errors import ModelError, nearest
from model.support.reading import read_toml
from model.touch import Drive

FITS = ("fit to ", "calibrated, ")  # how the sources begin of numbers that a fit found
VARIANTS = ("corrected", "published", "published_absolute")  # the last two: `published.py`
Known = tuple[str, float, float]  # unit and range of a number
POWER_LAW = {
    "eps_inf": ("1", 1.0, 1e6),
    "amplitude": ("1", 0.0, 1e9),
    "exponent": ("1", 0.0, 1.0),
    "conductivity_s_per_m": ("S/m", 0.0, 1e3),
}


@dataclass(frozen=True)
class ModelDescription:
    """A model as its file describes it; `variant` is one of `VARIANTS`, `learned_form` that of the
    effect `learned`.
    """

    name: str
    about: str
    dielectric: Dielectric
    friction_law: FrictionLaw
    parameters: dict[str, Parameter]
    effect_parameters: dict[str, dict[str, Parameter]] = field(default_factory=dict)
    variant: str = "corrected"
    learned_form: LearnedForm | None = None

    @property
    def is_published(self) -> bool:
        """Whether it is to be computed by the equations as printed."""
        return self.variant != "corrected"

    @property
    def is_fitted(self) -> bool:
        """Whether any number of it was found by a fit, and by no person."""
        numbers = [self.parameters, *self.effect_parameters.values()]
        return any(p.source.startswith(FITS) for each in numbers for p in each.values())

    @property
    def values(self) -> TouchParameters:
        """The bare numbers that the physics computes with."""
        return TouchParameters(**{name: p.value for name, p in self.parameters.items()})

    def with_values(self, **values: float) -> ModelDescription:
        """The same with other numbers."""
        changed = {name: replace(self.parameters[name], value=values[name]) for name in values}
        return replace(self, parameters=self.parameters | changed)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that are switched on, in the catalogue's order, a learned one last."""
        on = self.effect_parameters
        return tuple(
            kind(**{name: p.value for name, p in on[key].items()})
            for key, kind in self.kinds.items()
            if key in on
        )

    @property
    def kinds(self) -> dict[str, type[Effect]]:
        """Every effect that may be on, by name."""
        return (
            BY_NAME
            if self.learned_form is None
            else BY_NAME | {LEARNED: learned_kind(self.learned_form)}
        )

    def outside(self, drive: Drive) -> str:
        """Which input lies outside the range of what was learned, in words; empty where none
        does.
        """
        if self.learned_form is None:
            return ""
        for effect in self.effects:
            drive = drive if effect.name == LEARNED else effect.drive(drive)
        return self.learned_form.outside(drive)

    def provenance(self) -> dict[str, Any]:
        """Everything that identifies this model, as JSON can hold it."""
        said = {
            "name": self.name,
            "about": self.about,
            "variant": self.variant,
            "friction_law": self.friction_law,
            "dielectric": described(self.dielectric),
            "parameters": {name: asdict(p) for name, p in self.parameters.items()},
            "effects": {
                key: {name: asdict(p) for name, p in values.items()}
                for key, values in self.effect_parameters.items()
            },
            **self._learned(),
        }
        plain: dict[str, Any] = json.loads(json.dumps(said))
        return plain

    @classmethod
    def of(cls, provenance: Mapping[str, Any]) -> ModelDescription:
        """The model again; KeyError, TypeError or ValueError where the provenance is not one."""
        form = provenance.get("learned_form")
        return cls(
            name=provenance["name"],
            about=provenance["about"],
            dielectric=of_description(provenance["dielectric"]),
            friction_law=provenance["friction_law"],
            parameters={name: Parameter(**p) for name, p in provenance["parameters"].items()},
            effect_parameters={
                key: {name: Parameter(**p) for name, p in values.items()}
                for key, values in provenance["effects"].items()
            },
            variant=provenance["variant"],
            learned_form=None if form is None else LearnedForm.of(form),
        )

    @property
    def content_hash(self) -> str:
        """Equal for equal physics, whatever the file's name and comments."""
        physics = {
            "variant": self.variant,
            "friction_law": self.friction_law,
            "dielectric": _numbers_of(self.dielectric),
            "values": asdict(self.values),
            "effects": [[effect.name, asdict(effect)] for effect in self.effects],
            **self._learned(),
        }
        return hashlib.sha256(json.dumps(physics, sort_keys=True).encode()).hexdigest()[:16]

    def _learned(self) -> dict[str, Any]:
        return {} if self.learned_form is None else {"learned_form": asdict(self.learned_form)}


def read_model(path: Path) -> ModelDescription:
    """Read a model file; ModelError says which key of which file is wrong, and the nearest valid
    choice.
    """
    content = read_toml(path)
    keys = [
        "name",
        "about",
        "variant",
        "friction_law",
        "dielectric",
        "parameters",
        "effects",
        "origin",
    ]
    _check_keys(content, keys, str(path))
    variant = content.get("variant", "corrected")
    if variant not in VARIANTS:
        raise ModelError(
            f"{path}: variant '{variant}' is unknown", nearest(str(variant), list(VARIANTS))
        )
    if variant != "corrected" and content.get("effects"):
        raise ModelError(
            f"{path}: variant '{variant}' has no effects",
            "Remove [effects], or use variant 'corrected'",
        )
    law = content.get("friction_law", "applied_load" if variant == "corrected" else "total_load")
    if law not in FRICTION_LAWS:
        raise ModelError(
            f"{path}: friction_law '{law}' is unknown", nearest(str(law), list(FRICTION_LAWS))
        )
    effects = content.get("effects", {})
    learned = effects.get(LEARNED) if isinstance(effects, dict) else None
    form = read_form(learned, f"{path}, [effects.{LEARNED}]") if isinstance(learned, dict) else None
    return ModelDescription(
        name=str(content.get("name", path.stem)),
        about=str(content.get("about", "")),
        dielectric=_read_dielectric(content.get("dielectric", {"set": "gabriel_dry"}), path),
        friction_law=law,
        parameters=_read_parameters(content.get("parameters", {}), path),
        effect_parameters=_read_effects(effects, form, path),
        variant=variant,
        learned_form=form,
    )


def _read_parameters(table: Any, path: Path) -> dict[str, Parameter]:
    where = f"{path}, [parameters]"
    if not isinstance(table, dict):
        raise ModelError(f"{where}: is not a table", "Compare with configs/models/reference.toml")
    _check_keys(table, list(SPECIFICATION), where)
    missing = [
        name
        for name, spec in SPECIFICATION.items()
        if name not in table and spec.get("default") is None
    ]
    if missing:
        raise ModelError(
            f"{where}: {missing[0]} is missing", f"Give {SPECIFICATION[missing[0]]['about']}"
        )
    read = {
        name: _read_number(
            name, table.get(name, spec["default"]), (spec["unit"], spec["low"], spec["high"]), where
        )
        for name, spec in SPECIFICATION.items()
    }
    low, high = read["roll_off_wavenumber_per_m"].value, read["cut_off_wavenumber_per_m"].value
    if high < 2.0 * low:
        raise ModelError(
            f"{where}: cut_off_wavenumber_per_m {high:g} is not above roll_off_wavenumber_per_m"
            f" {low:g}",
            "The cut-off must be at least twice the roll-off",
        )
    return read


def _read_effects(
    table: Any, form: LearnedForm | None, path: Path
) -> dict[str, dict[str, Parameter]]:
    where = f"{path}, [effects]"
    if not isinstance(table, dict):
        raise ModelError(
            f"{where}: is not a table",
            "For example: [effects.series_resistance] resistance_ohm = 1e4",
        )
    _check_keys(table, [*BY_NAME, LEARNED], where)
    kinds = BY_NAME if form is None else BY_NAME | {LEARNED: learned_kind(form)}
    read: dict[str, dict[str, Parameter]] = {}
    for key, values in table.items():
        known = (
            {p.name: (p.unit, p.low, p.high) for p in kinds[key].parameters()}
            if key in kinds
            else {}
        )
        if not isinstance(values, dict):
            raise ModelError(f"{where}: {key} is not a table", f"Give {', '.join(known or KEYS)}")
        given = {k: v for k, v in values.items() if key != LEARNED or k not in KEYS}
        _check_keys(given, list(known), f"{path}, [effects.{key}]")
        asked = {p.name: known[p.name] for p in kinds[key].asked(given)} if key in kinds else {}
        read[key] = _read_numbers(given, asked, f"{path}, [effects.{key}]")
    return read


def _read_numbers(
    table: dict[str, Any], known: Mapping[str, Known], where: str
) -> dict[str, Parameter]:
    """All of the `known`, none of which may be missing."""
    missing = [name for name in known if name not in table]
    if missing:
        raise ModelError(f"{where}: {missing[0]} is missing", f"Give {', '.join(known)}")
    return {name: _read_number(name, table[name], spec, where) for name, spec in known.items()}


def _read_number(name: str, entry: Any, spec: Known, where: str) -> Parameter:
    unit, low, high = spec
    entry = entry if isinstance(entry, dict) else {"value": entry}
    _check_keys(entry, ["value", "std", "source"], f"{where} {name}")
    value = _number(entry.get("value"), f"{where} {name}")
    if not low <= value <= high:
        raise ModelError(
            f"{where}: {name} = {value:g} is out of range",
            f"It must lie in {low:g}..{high:g} {unit}",
        )
    std = entry.get("std")
    if std is not None:
        std = _number(std, f"{where} {name}.std")
        if std < 0.0:
            raise ModelError(
                f"{where}: {name}.std = {std:g} is negative", "A standard deviation is 0 or more"
            )
    return Parameter(value, unit, str(entry.get("source", "")), std)


def _read_dielectric(table: Any, path: Path) -> Dielectric:
    where = f"{path}, [dielectric]"
    if not isinstance(table, dict) or "set" not in table:
        raise ModelError(f"{where}: has no key 'set'", 'For example: set = "gabriel_dry"')
    kind = str(table["set"])
    if kind == "power_law":
        _check_keys(table, ["set", *POWER_LAW], where)
        values: dict[str, Any] = {
            name: p.value for name, p in _read_numbers(table, POWER_LAW, where).items()
        }
        return PowerLaw(**values)
    if kind == "csv":
        _check_keys(table, ["set", "file"], where)
        if not isinstance(table.get("file"), str):
            raise ModelError(
                f"{where}: set = 'csv' has no key 'file'", 'For example: file = "skin.csv"'
            )
        return read_csv(path.parent / table["file"])
    _check_keys(table, ["set"], where)
    return named(kind)


def _check_keys(table: dict[str, Any], known: list[str], where: str) -> None:
    for key in table:
        if key not in known:
            raise ModelError(f"{where}: unknown key '{key}'", nearest(key, known))


def _numbers_of(dielectric: Dielectric) -> str:
    """What the data set says, whatever it is called and wherever it comes from."""
    return (
        f"{type(dielectric).__name__}"
        f" {[v for k, v in vars(dielectric).items() if k not in ('name', 'source')]}"
    )


def _number(value: Any, where: str) -> float:
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        shown = repr(value)[:40]
        raise ModelError(f"{where}: {shown} is not a finite number", "Give a number in SI units")
    return number
