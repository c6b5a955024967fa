"""What the generator can put out: its built-in shapes, and arbitrary waveforms as codes of its DAC."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hw.errors import LimitExceeded

POINTS_LOW, POINTS_HIGH = 2, 65_536
CODE_HIGH = 8191  # 14 bits, symmetrical


class Shape(enum.Enum):
    """A built-in waveform; the value is the instrument's word for it."""

    SINE = "SIN"
    SQUARE = "SQU"
    DC = "DC"

    @property
    def function(self) -> str:
        """What `FUNC?` answers."""
        return self.value

    @property
    def low(self) -> float:
        """Lowest point, where the largest magnitude is 1."""
        return 1.0 if self is Shape.DC else -1.0

    @property
    def high(self) -> float:
        """Highest point, where the largest magnitude is 1."""
        return 1.0


@dataclass(frozen=True, eq=False)
class ArbitraryWaveform:
    """One period of any waveform, as DAC codes that span the DAC's full scale.

    Whether the instrument counts the amplitude of a waveform that does not span the DAC from the DAC's ends or from
    the waveform's own is not verified. So every waveform is stretched to the ends; `low` and `high`, its extremes
    where the largest magnitude is 1, go into amplitude and offset. Then both ways of counting agree, the peak at
    the electrode is exact for one-sided waveforms too, and all of the DAC's resolution is used.
    """

    codes_raw: NDArray[np.int16]
    low: float
    high: float

    @classmethod
    def from_samples(cls, samples: ArrayLike) -> ArbitraryWaveform:
        """Take 2..65,536 samples of one period, in any unit; raises LimitExceeded for what cannot be a waveform."""
        values = np.asarray(samples, dtype=np.float64)
        if values.ndim != 1 or not POINTS_LOW <= values.size <= POINTS_HIGH:
            raise LimitExceeded(
                f"an arbitrary waveform of shape {values.shape} was given",
                f"give one row of {POINTS_LOW} to {POINTS_HIGH} samples",
            )
        if not np.isfinite(values).all():
            raise LimitExceeded("an arbitrary waveform holds values that are not finite", "replace them")
        peak = np.abs(values).max()
        values = values / peak if peak > 0.0 else values
        low, high = float(values.min()), float(values.max())
        if high - low < 1.0 / CODE_HIGH:
            raise LimitExceeded("an arbitrary waveform is constant", "use Shape.DC for a constant voltage")
        codes = np.rint(CODE_HIGH * (2.0 * values - high - low) / (high - low)).astype(np.int16)
        return cls(codes, low, high)

    @property
    def function(self) -> str:
        """What `FUNC?` answers."""
        return "USER"

    def upload_command(self, *, binary: bool) -> bytes:
        """Return the message that stores the codes: a block of big-endian codes (`FORM:BORD NORM`), or decimal."""
        if not binary:
            return b"DATA:DAC VOLATILE," + ",".join(map(str, self.codes_raw.tolist())).encode("ascii")
        data = self.codes_raw.astype(">i2").tobytes()
        length = str(len(data))
        return f"DATA:DAC VOLATILE, #{len(length)}{length}".encode("ascii") + data


Waveform = Shape | ArbitraryWaveform
