"""The numbers a touch depends on: frozen records with unit, range, source and uncertainty.

`TouchParameters` is what the physics computes with: plain floats, the unit in the name. `ModelDescription` is what a
file in `configs/models/` says: the same numbers with where they come from, plus the dielectric set and the friction
law.
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from model.dielectrics import Dielectric, PowerLaw, named, read_csv
from model.errors import ModelError, nearest

FrictionLaw = Literal["applied_load", "total_load"]
FRICTION_LAWS: tuple[FrictionLaw, ...] = ("applied_load", "total_load")


def _parameter(unit: str, low: float, high: float, about: str) -> Any:
    return field(metadata={"unit": unit, "low": low, "high": high, "about": about})


@dataclass(frozen=True)
class TouchParameters:
    """One finger on one screen. The range beside each number is what a file may say."""

    insulator_permittivity: float = _parameter("1", 1.0, 100.0, "eps_1, relative permittivity of the insulator")
    insulator_thickness_m: float = _parameter("m", 1e-8, 1e-3, "d_1, thickness of the insulator")
    insulator_conductivity_s_per_m: float = _parameter("S/m", 0.0, 1e-3, "sigma_1, conductivity of the insulator")
    air_conductivity_s_per_m: float = _parameter("S/m", 0.0, 1e-3, "sigma_g, conductivity of the air gap")
    skin_thickness_m: float = _parameter("m", 1e-6, 1e-2, "d_2, thickness of the stratum corneum")
    screen_modulus_pa: float = _parameter("Pa", 1e3, 1e13, "Y_1, Young's modulus of the screen")
    screen_poisson_ratio: float = _parameter("1", 0.0, 0.5, "nu_1, Poisson's ratio of the screen")
    skin_modulus_pa: float = _parameter("Pa", 1e3, 1e12, "Y_2, Young's modulus of the stratum corneum")
    skin_poisson_ratio: float = _parameter("1", 0.0, 0.5, "nu_2, Poisson's ratio of the stratum corneum")
    roughness_rms_m: float = _parameter("m", 1e-8, 1e-3, "h_rms, rms height of the fingerpad's roughness")
    hurst_exponent: float = _parameter("1", 0.2, 0.98, "H of the fingerpad's roughness")
    roll_off_wavenumber_per_m: float = _parameter("1/m", 1.0, 1e7, "q_0, smallest wavenumber of the roughness")
    cut_off_wavenumber_per_m: float = _parameter("1/m", 1e3, 1e12, "q_1, largest wavenumber of the roughness")
    contact_gamma: float = _parameter("1", 0.1, 1.0, "gamma of (45)")
    contact_area_m2: float = _parameter("m^2", 1e-6, 1e-2, "A_0, apparent area of contact")
    leak_scale: float = _parameter("1", 0.0, 1e6, "factor on the skin-limited contact conductance alpha")
    cof_off: float = _parameter("1", 0.01, 5.0, "mu_off, coefficient of friction without voltage")

    @property
    def effective_modulus_pa(self) -> float:
        """Y* of (38)."""
        screen = (1.0 - self.screen_poisson_ratio**2) / self.screen_modulus_pa
        skin = (1.0 - self.skin_poisson_ratio**2) / self.skin_modulus_pa
        return 1.0 / (screen + skin)


SPECIFICATION = {f.name: f.metadata for f in fields(TouchParameters)}


@dataclass(frozen=True)
class Parameter:
    """One number of a model file: `std` is one standard deviation in the same unit, None where unknown."""

    value: float
    unit: str
    source: str
    std: float | None = None


@dataclass(frozen=True)
class ModelDescription:
    """A model as its file describes it; the default variant, `corrected`, is the only one so far."""

    name: str
    about: str
    dielectric: Dielectric
    friction_law: FrictionLaw
    parameters: dict[str, Parameter]
    variant: str = "corrected"

    @property
    def values(self) -> TouchParameters:
        """The bare numbers that the physics computes with."""
        return TouchParameters(**{name: p.value for name, p in self.parameters.items()})

    def provenance(self) -> dict[str, Any]:
        """Everything that identifies this model, as JSON can hold it."""
        dielectric = {"name": self.dielectric.name, "source": self.dielectric.source, "content": repr(self.dielectric)}
        return {
            "name": self.name,
            "about": self.about,
            "variant": self.variant,
            "friction_law": self.friction_law,
            "dielectric": dielectric,
            "parameters": {name: asdict(p) for name, p in self.parameters.items()},
        }

    @property
    def content_hash(self) -> str:
        """Equal for equal physics, whatever the file's name and comments."""
        physics = {
            "variant": self.variant,
            "friction_law": self.friction_law,
            "dielectric": _numbers_of(self.dielectric),
            "values": asdict(self.values),
        }
        return hashlib.sha256(json.dumps(physics, sort_keys=True).encode()).hexdigest()[:16]


def read_model(path: Path) -> ModelDescription:
    """Read a model file; ModelError says which key of which file is wrong, and the nearest valid choice."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelError(f"{path}: model file cannot be read ({error.strerror})", "Give an existing file") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: not valid TOML: {error}", "Compare with configs/models/reference.toml") from error
    _check_keys(content, ["name", "about", "friction_law", "dielectric", "parameters"], str(path))
    law = content.get("friction_law", "applied_load")
    if law not in FRICTION_LAWS:
        raise ModelError(f"{path}: friction_law '{law}' is unknown", nearest(str(law), list(FRICTION_LAWS)))
    return ModelDescription(
        name=str(content.get("name", path.stem)),
        about=str(content.get("about", "")),
        dielectric=_read_dielectric(content.get("dielectric", {"set": "gabriel_dry"}), path),
        friction_law=law,
        parameters=_read_parameters(content.get("parameters", {}), path),
    )


def _read_parameters(table: Any, path: Path) -> dict[str, Parameter]:
    where = f"{path}, [parameters]"
    if not isinstance(table, dict):
        raise ModelError(f"{where}: is not a table", "Compare with configs/models/reference.toml")
    _check_keys(table, list(SPECIFICATION), where)
    missing = [name for name in SPECIFICATION if name not in table]
    if missing:
        raise ModelError(f"{where}: {missing[0]} is missing", f"Give {SPECIFICATION[missing[0]]['about']}")
    read = {name: _read_parameter(name, table[name], where) for name in SPECIFICATION}
    low, high = read["roll_off_wavenumber_per_m"].value, read["cut_off_wavenumber_per_m"].value
    if high < 2.0 * low:
        raise ModelError(
            f"{where}: cut_off_wavenumber_per_m {high:g} is not above roll_off_wavenumber_per_m {low:g}",
            "The cut-off must be at least twice the roll-off",
        )
    return read


def _read_parameter(name: str, entry: Any, where: str) -> Parameter:
    spec = SPECIFICATION[name]
    entry = entry if isinstance(entry, dict) else {"value": entry}
    _check_keys(entry, ["value", "std", "source"], f"{where} {name}")
    value = _number(entry.get("value"), f"{where} {name}")
    if not spec["low"] <= value <= spec["high"]:
        raise ModelError(
            f"{where}: {name} = {value:g} is out of range",
            f"It must lie in {spec['low']:g}..{spec['high']:g} {spec['unit']}",
        )
    std = entry.get("std")
    if std is not None:
        std = _number(std, f"{where} {name}.std")
        if std < 0.0:
            raise ModelError(f"{where}: {name}.std = {std:g} is negative", "A standard deviation is 0 or more")
    return Parameter(value, spec["unit"], str(entry.get("source", "")), std)


def _read_dielectric(table: Any, path: Path) -> Dielectric:
    where = f"{path}, [dielectric]"
    if not isinstance(table, dict) or "set" not in table:
        raise ModelError(f"{where}: has no key 'set'", 'For example: set = "gabriel_dry"')
    kind = str(table["set"])
    if kind == "power_law":
        keys = ["eps_inf", "amplitude", "exponent", "conductivity_s_per_m"]
        _check_keys(table, ["set", *keys], where)
        eps_inf, amplitude, exponent, conductivity = (_number(table.get(key), f"{where} {key}") for key in keys)
        return PowerLaw(eps_inf, amplitude, exponent, conductivity)
    if kind == "csv":
        _check_keys(table, ["set", "file"], where)
        return read_csv(path.parent / str(table.get("file", "")))
    _check_keys(table, ["set"], where)
    return named(kind)


def _check_keys(table: dict[str, Any], known: list[str], where: str) -> None:
    for key in table:
        if key not in known:
            raise ModelError(f"{where}: unknown key '{key}'", nearest(key, known))


def _numbers_of(dielectric: Dielectric) -> str:
    """What the data set says, whatever it is called and wherever it comes from."""
    return f"{type(dielectric).__name__} {[v for k, v in vars(dielectric).items() if k not in ('name', 'source')]}"


def _number(value: Any, where: str) -> float:
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        shown = repr(value)[:40]
        raise ModelError(f"{where}: {shown} is not a finite number", "Give a number in SI units")
    return number
