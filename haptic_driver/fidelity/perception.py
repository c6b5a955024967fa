"""What a finger feels of friction: thresholds from a file that a lab can exchange.

`configs/perception/published.toml` has published ones, each with its source, how far that was
read, and whether it is verified.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, FiniteFloat, model_validator

from haptic_driver.config import Section, config_names, find_config, parse
from haptic_driver.errors import BadInputError
from haptic_driver.textures.bands import CENTRES_HZ
from model.support.errors import nearest
from model.support.reading import read_toml

FOLDER = "perception"
# Ranges refuse what must be another unit: kilohertz, millimetres, per cent.
Hertz = Annotated[FiniteFloat, Field(ge=0.1, le=1e5)]
Metres = Annotated[FiniteFloat, Field(ge=1e-10, le=1e-3)]
Newtons = Annotated[FiniteFloat, Field(ge=1e-7, le=10.0)]
Share = Annotated[FiniteFloat, Field(gt=0.0, lt=1.0)]


class Sourced(Section):
    """What every published value says of itself."""

    source: str = Field(min_length=1)
    doi: str = ""
    read: Literal["full", "extract", "abstract", "memory"]
    unverified: bool = False
    conditions: str = Field(min_length=1)

    @model_validator(mode="after")
    def _memory_is_unverified(self) -> Sourced:
        if self.read == "memory" and not self.unverified:
            raise ValueError('what was read from "memory" needs unverified = true')
        return self


class Finding(Sourced):
    """Another published value, in words: for the reader, not for computing."""

    says: str = Field(min_length=1)


class FrictionJnd(Sourced):
    """The just noticeable difference of friction, as a share of it, and its spread."""

    relative: Share
    relative_low: Share
    relative_high: Share
    others: list[Finding] = Field(default_factory=list)

    @model_validator(mode="after")
    def _lies_within_its_spread(self) -> FrictionJnd:
        if not self.relative_low <= self.relative <= self.relative_high:
            raise ValueError("relative must lie between relative_low and relative_high")
        return self


class Finger(Sourced):
    """The mechanical impedance of a fingerpad to lateral displacement: spring, damper and mass."""

    stiffness_n_per_m: Annotated[FiniteFloat, Field(gt=0.0, le=1e5)]
    damping_n_s_per_m: Annotated[FiniteFloat, Field(ge=0.0, le=1e3)]
    mass_kg: Annotated[FiniteFloat, Field(ge=0.0, le=0.1)]

    def force_per_displacement_n_per_m(self, frequency_hz: float) -> float:
        """How large a force goes with a displacement, peak to peak or rms to rms."""
        turn = math.tau * frequency_hz
        spring = self.stiffness_n_per_m - self.mass_kg * turn * turn
        return math.hypot(spring, self.damping_n_s_per_m * turn)


class DisplacementPoint(Section):
    """A threshold of displacement at one frequency."""

    frequency_hz: Hertz
    displacement_peak_m: Metres


class ForcePoint(Section):
    """A threshold of lateral force at one frequency."""

    frequency_hz: Hertz
    force_peak_n: Newtons


class _Detection(Sourced):
    """`spread_factor`: people and contacts differ by so much, up and down."""

    spread_factor: Annotated[FiniteFloat, Field(ge=1.0, le=1000.0)]
    others: list[Finding] = Field(default_factory=list)


class DisplacementDetection(_Detection):
    """Detection thresholds of vibration as displacement, and the finger that makes them forces."""

    kind: Literal["displacement"]
    points: list[DisplacementPoint] = Field(min_length=1)
    finger: Finger

    @model_validator(mode="after")
    def _rises(self) -> DisplacementDetection:
        _require_rising([point.frequency_hz for point in self.points])
        return self

    def force_peak_n(self, frequency_hz: float) -> float:
        """The threshold as lateral force."""
        frequencies = [point.frequency_hz for point in self.points]
        displacements = [point.displacement_peak_m for point in self.points]
        displacement_m = _log_log(frequency_hz, frequencies, displacements)
        return displacement_m * self.finger.force_per_displacement_n_per_m(frequency_hz)

    @property
    def all_verified(self) -> bool:
        """Whether nothing of it rests on memory."""
        return not (self.unverified or self.finger.unverified)


class ForceDetection(_Detection):
    """Detection thresholds of vibration as lateral force, as a lab measures on its own rig."""

    kind: Literal["force"]
    points: list[ForcePoint] = Field(min_length=1)

    @model_validator(mode="after")
    def _rises(self) -> ForceDetection:
        _require_rising([point.frequency_hz for point in self.points])
        return self

    def force_peak_n(self, frequency_hz: float) -> float:
        """The threshold as lateral force."""
        frequencies = [point.frequency_hz for point in self.points]
        return _log_log(frequency_hz, frequencies, [point.force_peak_n for point in self.points])

    @property
    def all_verified(self) -> bool:
        """Whether nothing of it rests on memory."""
        return not self.unverified


Correlated = Annotated[FiniteFloat, Field(ge=-1.0, le=1.0)]


class Correlation(Sourced):
    """The correlation of asked and felt friction that others report, and at the best lag."""

    low: Correlated
    high: Correlated
    best_lag_low: Correlated
    best_lag_high: Correlated

    @property
    def as_it_is(self) -> list[float]:
        return [self.low, self.high]

    @property
    def at_best_lag(self) -> list[float]:
        return [self.best_lag_low, self.best_lag_high]


class Perception(Section):
    """Thresholds of a finger, as of a file in `configs/perception`."""

    name: str = Field(min_length=1)
    about: str = Field(min_length=1)
    friction_jnd: FrictionJnd
    detection: Annotated[DisplacementDetection | ForceDetection, Field(discriminator="kind")]
    correlation: Correlation | None = None

    @property
    def jnd_friction(self) -> float:
        """The just noticeable difference of friction, as a share of it."""
        return self.friction_jnd.relative

    def force_threshold_n(self, frequency_hz: float) -> float:
        """The weakest lateral force of one frequency that is noticed: its root mean square.

        Between the file's points it is interpolated in logarithms, beyond them held.
        """
        return self.detection.force_peak_n(frequency_hz) / math.sqrt(2.0)

    def band_thresholds_n(self) -> list[float]:
        """The force thresholds at the centres of the nine bands, root mean square."""
        return [self.force_threshold_n(frequency_hz) for frequency_hz in CENTRES_HZ.tolist()]

    @property
    def unverified(self) -> list[str]:
        """The numbers in use that rest on memory, in words; empty where none does."""
        found = []
        if self.friction_jnd.unverified:
            found.append("the just noticeable difference")
        if not self.detection.all_verified:
            found.append("detection thresholds")
        if self.correlation is not None and self.correlation.unverified:
            found.append("other labs' correlation")
        return found


def load_perception(name_or_path: str = "published") -> Perception:
    """Read thresholds by name in `configs/perception`, or by path.

    BadInputError says what is wrong with the name or the file.
    """
    names = config_names(FOLDER)
    if name_or_path in names:
        path = find_config(name_or_path, FOLDER)
    elif (path := Path(name_or_path)).suffix != ".toml" or not path.is_file():
        said = f"there is no file of thresholds '{name_or_path}'"
        hint = f"Give the path of a .toml file, or a name. {nearest(name_or_path, names)}"
        raise BadInputError("unknown_perception", said, hint)
    return parse(Perception, read_toml(path), str(path))


def _require_rising(frequencies_hz: list[float]) -> None:
    if any(later <= earlier for earlier, later in pairwise(frequencies_hz)):
        raise ValueError("frequency_hz of the points must rise")


def _log_log(x: float, xs: list[float], ys: list[float]) -> float:
    """Straight between the logarithms of points, held beyond the first and the last."""
    return float(np.exp(np.interp(math.log(x), np.log(xs), np.log(ys))))
