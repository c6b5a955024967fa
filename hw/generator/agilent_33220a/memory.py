"""The simulated 33220A's memory of arbitrary waveforms: DAC codes under a name."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hw.generator.agilent_33220a.limits import ARBITRARY_POINTS_HIGH, DAC_HIGH, NON_VOLATILE_SLOTS
from hw.generator.scpi import ScpiError, parse_block

VOLATILE = "VOLATILE"
_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,11}")
_LEAST_POINTS = 2


@cache
def _built_in() -> dict[str, NDArray[np.float64]]:
    """Shapes of about the right kind; only that SINC does not span the DAC is known of the real ones."""
    t = np.linspace(0.0, 1.0, 1000)
    beats = np.exp(-(((t - 0.35) / 0.02) ** 2)) - 0.2 * np.exp(-(((t - 0.42) / 0.03) ** 2))
    return {
        "EXP_RISE": 1.0 - 2.0 * np.exp(-5.0 * t),
        "EXP_FALL": 2.0 * np.exp(-5.0 * t) - 1.0,
        "NEG_RAMP": 1.0 - 2.0 * t,
        "SINC": np.sinc(10.0 * (t - 0.5)),
        "CARDIAC": beats / np.abs(beats).max(),
    }


class ArbitraryMemory:
    """Waveforms as shares of the DAC's full scale, -1 to 1. Methods raise ScpiError."""

    def __init__(self) -> None:
        self._built_in = _built_in()
        self._stored: dict[str, NDArray[np.float64]] = {}

    def points(self, name: str) -> NDArray[np.float64]:
        """Return the waveform of that name."""
        name = name.upper()
        waveform = self._stored.get(name, self._built_in.get(name))
        if waveform is None:
            raise ScpiError(780)
        return waveform

    def extremes(self, name: str) -> tuple[float, float]:
        """Return the lowest and highest point as shares of the waveform's own peak-to-peak value."""
        points = self.points(name)
        span = float(np.ptp(points)) or 1.0
        return float(points.min()) / span, float(points.max()) / span

    def store_shares(self, arguments: list[str]) -> None:
        """`DATA VOLATILE,<-1..1>,...`."""
        self._store(_numbers(arguments), 1.0)

    def store_codes(self, arguments: list[str], *, swapped: bool) -> None:
        """`DATA:DAC VOLATILE,<-8191..8191>,...` or a block of 16-bit codes, big-endian unless `swapped`."""
        if len(arguments) == 2 and (data := parse_block(arguments[1])) is not None:
            if len(data) % 2:
                raise ScpiError(-161)
            _only_volatile(arguments)
            codes = np.frombuffer(data, "<i2" if swapped else ">i2").astype(np.float64)
        else:
            codes = _numbers(arguments)
        self._store(codes, DAC_HIGH)

    def copy(self, arguments: list[str]) -> None:
        """`DATA:COPY <name>,VOLATILE`."""
        if len(arguments) not in (1, 2):
            raise ScpiError(-108 if arguments else -109)
        name = arguments[0].upper()
        if not _NAME.fullmatch(name) or name in (VOLATILE, *self._built_in):
            raise ScpiError(782)
        if len(arguments) == 2 and arguments[1].upper() != VOLATILE:
            raise ScpiError(-224)
        if name not in self._stored and self.free() == 0:
            raise ScpiError(785)
        self._stored[name] = self.points(VOLATILE)

    def delete(self, name: str, selected: str) -> None:
        """`DATA:DEL <name>`; not what is built in or selected."""
        if name.upper() in (selected, *self._built_in):
            raise ScpiError(781)
        self.points(name)
        del self._stored[name.upper()]

    def delete_all(self, selected: str) -> None:
        """`DATA:DEL:ALL`; the selected one stays."""
        self._stored = {name: points for name, points in self._stored.items() if name == selected}

    def names(self) -> list[str]:
        """All waveforms that can be selected."""
        return [*sorted(self._stored, key=lambda name: name != VOLATILE), *self._built_in]

    def non_volatile(self) -> list[str]:
        """Names of what survives switching off."""
        return [name for name in self._stored if name != VOLATILE]

    def free(self) -> int:
        """How many non-volatile waveforms there is room for."""
        return NON_VOLATILE_SLOTS - len(self.non_volatile())

    def _store(self, values: NDArray[np.float64], full_scale: float) -> None:
        if not _LEAST_POINTS <= len(values) <= ARBITRARY_POINTS_HIGH or np.abs(values).max() > full_scale:
            raise ScpiError(-222)
        self._stored[VOLATILE] = values / full_scale


def _only_volatile(arguments: list[str]) -> None:
    if not arguments or arguments[0].upper() != VOLATILE:
        raise ScpiError(-224 if arguments else -109)


def _numbers(arguments: list[str]) -> NDArray[np.float64]:
    _only_volatile(arguments)
    try:
        values = np.array(arguments[1:], dtype=np.float64)
    except ValueError:
        raise ScpiError(-104) from None
    if not (len(values) and np.isfinite(values).all()):
        raise ScpiError(-104 if len(values) else -109)
    return values
