"""Configuration files: where they are found, what they may say, and what is wrong with them.

The range of a number stands here, where it is read; an unknown key is an error that offers the nearest one.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from haptic_driver.errors import BadInputError
from haptic_driver.limits import ICNIRP_PUBLIC_A_RMS, OperatingLimits
from haptic_driver.render.controller import Policy
from model.description import ModelDescription, read_model
from model.errors import ModelError, nearest

Positive = Annotated[FiniteFloat, Field(gt=0.0)]
NotNegative = Annotated[FiniteFloat, Field(ge=0.0)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class LimitsConfig(_Section):
    """What the rig allows at the electrode; see `OperatingLimits`."""

    voltage_v: Annotated[FiniteFloat, Field(gt=0.0, le=1000.0)]
    frequency_hz: Annotated[
        list[Annotated[FiniteFloat, Field(ge=1e-6, le=20e6)]], Field(min_length=2, max_length=2)
    ] = [
        1.0,
        1e6,
    ]
    contact_current_a_rms: Annotated[
        list[Annotated[list[Positive], Field(min_length=2, max_length=2)]], Field(min_length=1)
    ] = [list(point) for point in ICNIRP_PUBLIC_A_RMS]
    series_resistance_ohm: NotNegative = 0.0
    panel_capacitance_f: Annotated[FiniteFloat, Field(ge=0.0, le=1e-3)] = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> LimitsConfig:
        if self.frequency_hz[0] >= self.frequency_hz[1]:
            raise ValueError("frequency_hz must be [lowest, highest]")
        frequencies = [f for f, _ in self.contact_current_a_rms]
        if frequencies != sorted(set(frequencies)):
            raise ValueError("contact_current_a_rms must rise in frequency")
        return self


class GeneratorConfig(_Section):
    """The waveform generator and how to reach it."""

    model: Literal["agilent_33220a"] = "agilent_33220a"
    resource: str = Field(pattern=r"^(simulated|TCPIP\d*::[^:]+::\d{1,5}::SOCKET)$")
    reply_timeout_s: Annotated[FiniteFloat, Field(gt=0.0, le=30.0)] = 1.0


class AmplifierConfig(_Section):
    """The high-voltage amplifier; peak values at the electrode."""

    gain_v_per_v: Positive
    voltage_limit_v: Positive
    current_limit_a: Positive
    slew_limit_v_per_s: Positive
    voltage_monitor_v_per_v: Positive = 0.01


class OutputConfig(_Section):
    """How commands reach the electrode."""

    setpoint_interval_s: Annotated[FiniteFloat, Field(ge=0.001, le=1.0)] = 0.010
    latency_s: Annotated[FiniteFloat, Field(ge=0.0, le=1.0)] = 0.0
    voltage_rise_v_per_s: Positive = 10e3


class FingerConfig(_Section):
    """How the finger is read."""

    contact_on_n: Positive = 0.15
    contact_off_n: Positive = 0.10
    velocity_time_constant_s: Positive = 0.010


class ControllerConfig(_Section):
    """How operating points are chosen when the user does not say."""

    policy: Policy = "max_authority"
    fixed_frequency_hz: Positive | None = None
    lowest_carrier_hz: Positive = 100.0
    hysteresis: Annotated[FiniteFloat, Field(ge=0.0, le=1.0)] = 0.05


class SimulationConfig(_Section):
    """How the simulated instruments and finger behave.

    `model`: the finger's own, where it is not the one that drives the rig. `hide`: effects, by name with their
    parameters, that the finger has and the model that drives the rig does not.
    """

    amplitude_latency_s: NotNegative = 0.030
    frequency_latency_s: NotNegative = 0.003
    friction_cutoff_hz_per_mm_s: Positive = 13.8
    force_noise_n: NotNegative = 0.003
    force_range_n: Positive = 20.0
    seed: int = 1
    model: str | None = None
    hide: dict[str, dict[str, FiniteFloat]] = {}


class RigConfig(_Section):
    """One rig, as its file in `configs/rigs/` says."""

    name: str
    simulated: bool
    limits: LimitsConfig
    waveform_generator: GeneratorConfig
    amplifier: AmplifierConfig
    output: OutputConfig = OutputConfig()
    finger: FingerConfig = FingerConfig()
    controller: ControllerConfig = ControllerConfig()
    simulation: SimulationConfig = SimulationConfig()

    @model_validator(mode="after")
    def _consistent(self) -> RigConfig:
        if self.limits.voltage_v > self.amplifier.voltage_limit_v:
            raise ValueError(
                f"limits.voltage_v {self.limits.voltage_v:g} is above amplifier.voltage_limit_v "
                f"{self.amplifier.voltage_limit_v:g}"
            )
        if self.simulated != (self.waveform_generator.resource == "simulated"):
            raise ValueError("simulated and waveform_generator.resource disagree about whether this rig is simulated")
        if self.finger.contact_off_n > self.finger.contact_on_n:
            raise ValueError("finger.contact_off_n is above finger.contact_on_n")
        return self

    def operating_limits(self) -> OperatingLimits:
        """The limits as the controller and the safety gate use them."""
        limits = self.limits
        return OperatingLimits(
            voltage_v=limits.voltage_v,
            frequency_low_hz=limits.frequency_hz[0],
            frequency_high_hz=limits.frequency_hz[1],
            slew_v_per_s=self.amplifier.slew_limit_v_per_s,
            contact_current_a_rms=tuple((f, i) for f, i in limits.contact_current_a_rms),
            series_resistance_ohm=limits.series_resistance_ohm,
            amplifier_current_a=self.amplifier.current_limit_a,
            panel_capacitance_f=limits.panel_capacitance_f,
        )


def config_dirs() -> list[Path]:
    """Folders searched for `rigs/`, `models/`, `textures/`: `HAPTIC_CONFIGS`, `./configs`, the program's own."""
    named = os.environ.get("HAPTIC_CONFIGS")
    return [*([Path(named)] if named else []), Path("configs"), Path(__file__).resolve().parents[1] / "configs"]


def texture_dirs() -> list[Path]:
    """Folders searched for textures by name."""
    return [folder / "textures" for folder in config_dirs()]


def load_rig(name_or_path: str) -> RigConfig:
    """A rig by the name of its file in `configs/rigs/`, or by path."""
    path = find_config(name_or_path, "rigs")
    return parse(RigConfig, read_toml(path), str(path))


def load_model(name_or_path: str) -> ModelDescription:
    """A model by the name of its file in `configs/models/`, or by path."""
    path = find_config(name_or_path, "models")
    try:
        return read_model(path)
    except ModelError as error:
        raise BadInputError("bad_model", error.message, error.hint) from error


Parsed = TypeVar("Parsed", bound=BaseModel)


def parse(schema: type[Parsed], content: dict[str, Any], where: str) -> Parsed:
    """`content` as `schema`; BadInputError names file, key and the nearest valid choice for the first mistake."""
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        first = next((e for e in error.errors() if e["type"] == "extra_forbidden"), error.errors()[0])
        keys = [str(part) for part in first["loc"]]
        key = ".".join(keys) or "the file"
        if first["type"] == "extra_forbidden":
            known = _fields_at(schema, keys[:-1])
            raise BadInputError("unknown_key", f"{where}: unknown key '{key}'", nearest(keys[-1], known)) from error
        if first["type"] == "missing":
            raise BadInputError("bad_config", f"{where}: {key} is missing", "Add it") from error
        said = first["msg"].removeprefix("Value error, ")
        given = "" if first["type"] in ("missing", "value_error") else f", not {first['input']!r}"
        raise BadInputError("bad_config", f"{where}: {key}: {said}{given}", "Correct this key") from error


def _fields_at(schema: type[BaseModel], keys: list[str]) -> list[str]:
    """The keys that the section at `keys` knows."""
    for key in keys:
        inner = schema.model_fields[key].annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            schema = inner
    return list(schema.model_fields)


def find_config(name_or_path: str, kind: str) -> Path:
    """The file of that name in a folder `kind` (rigs, models, plans) of the config folders, or the path itself."""
    given = Path(name_or_path)
    if given.suffix == ".toml" or len(given.parts) > 1:
        if given.is_file():
            return given
        raise BadInputError(
            "file_not_found", f"{given}: there is no such file", f"Names found: {', '.join(_names(kind))}"
        )
    for folder in config_dirs():
        path = folder / kind / f"{name_or_path}.toml"
        if path.is_file():
            return path
    hint = nearest(name_or_path, sorted(set(_names(kind))))
    raise BadInputError(f"unknown_{kind[:-1]}", f"there is no {kind[:-1]} named '{name_or_path}'", hint)


def _names(kind: str) -> Iterator[str]:
    for folder in config_dirs():
        yield from (path.stem for path in sorted((folder / kind).glob("*.toml")))


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file; BadInputError says what is wrong with it."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError("file_unreadable", f"{path}: cannot be read ({error})", "Give a readable file") from error
    except tomllib.TOMLDecodeError as error:
        raise BadInputError("bad_toml", f"{path}: {error}", "Correct the TOML syntax there") from error
