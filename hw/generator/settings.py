"""What a generator may do, how it is wired, and the words for what it is asked to do."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

FREQUENCY_LOW_HZ = 1e-6
FREQUENCY_HIGH_HZ = 20e6


class Shape(enum.Enum):
    """A waveform."""

    SINE = "sine"
    SQUARE = "square"
    DC = "dc"


class RangePolicy(enum.Enum):
    """What the output's attenuator does.

    FIXED keeps the range that the voltage limit needs. No relay switches while rendering, so the
    output has no gaps. But all amplitudes share that range's resolution, 1/16,383 of its span, and
    its accuracy. At a hundredth of the limit the amplitude is good to about a percent only. AUTO
    has the full accuracy at every amplitude. It disturbs the output for a moment whenever the
    amplitude crosses from one range to another (G5100A manual p. 166; where the 33220A's ranges
    meet is not verified).
    """

    FIXED = "fixed"
    AUTO = "auto"


@dataclass(frozen=True)
class ModulationInput:
    """What Modulation In on the rear panel does to the amplitude at 100 % depth; measure it, it is
    not verified.

    The amplitude is proportional to `input + full_scale_v`. It is zero at `-full_scale_v`, half of
    the highest at 0 V (and with an open input), and the highest at `+full_scale_v`. That is
    believed to be 5 V. There it is `amplitude_at_full_scale` times the amplitude programmed. The
    factor is 1 if modulation goes from 0 to 100 % of it, 2 for classical modulation around it.
    Raises ValueError for numbers that make no sense.
    """

    full_scale_v: float
    amplitude_at_full_scale: float

    def __post_init__(self) -> None:
        """Refuse what cannot be an input."""
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(
                    f"modulation input {name} must be a finite number > 0, not {value!r}"
                )


@dataclass(frozen=True)
class ExternalModulation:
    """The amplitude follows Modulation In: the fast envelope."""


@dataclass(frozen=True)
class GeneratorSettings:
    """How the generator is wired, and what it may ask of the electrode.

    `volts_per_volt` is electrode volts per volt at the generator's terminals (the amplifier's
    gain); `voltage_limit_v` is the peak at the electrode, offset included. Without a measured
    `modulation_input` there is no amplitude modulation. Raises ValueError for numbers that make no
    sense.
    """

    volts_per_volt: float
    voltage_limit_v: float
    frequency_low_hz: float
    frequency_high_hz: float
    reply_timeout_s: float = 1.0
    range_policy: RangePolicy = RangePolicy.FIXED
    modulation_input: ModulationInput | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be a setting."""
        for name, value in vars(self).items():
            if isinstance(value, (int, float)) and not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"generator {name} must be a finite number > 0, not {value!r}")
        if 0.0 in (self.volts_per_volt, self.voltage_limit_v, self.reply_timeout_s):
            raise ValueError("generator gain, voltage limit and timeout must be > 0")
        if (
            not FREQUENCY_LOW_HZ
            <= self.frequency_low_hz
            <= self.frequency_high_hz
            <= FREQUENCY_HIGH_HZ
        ):
            raise ValueError(
                f"generator frequency range {self.frequency_low_hz:g}..{self.frequency_high_hz:g}"
                f" Hz must be ordered and within {FREQUENCY_LOW_HZ:g}..{FREQUENCY_HIGH_HZ:g} Hz"
            )
