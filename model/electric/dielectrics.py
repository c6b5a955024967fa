"""Dielectric data of skin: a pluggable, named input.

A set gives the complex relative permittivity k = eps' - j eps'' with the conduction included once,
eps'' = sigma_total/(w eps0). The paper adopts Yamamoto & Yamamoto 1976, whose digits are not
public: no set here is theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import pi
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from model.support.arrays import Array, ComplexArray
from model.support.errors import ModelError, nearest
from model.support.tables import read_table

EPS0 = 8.8541878128e-12  # F/m, CODATA 2018


class Dielectric(Protocol):
    """A named data set of the skin's permittivity."""

    @property
    def name(self) -> str:
        """The identifier used in model files."""

    @property
    def source(self) -> str:
        """Where the numbers come from, and under which licence."""

    def permittivity(self, frequency_hz: Array) -> ComplexArray:
        """Complex relative permittivity k at each frequency (> 0), same shape."""


def total_conductivity_s_per_m(permittivity: ComplexArray, frequency_hz: Array) -> Array:
    """sigma = w eps0 eps'': everything that dissipates, at each frequency."""
    return np.asarray(-permittivity.imag * 2.0 * pi * frequency_hz * EPS0)


@dataclass(frozen=True)
class ColeCole:
    """eps_inf + sum D/(1 + (j w tau)^(1-a)) + sigma/(j w eps0); `terms` are (D, tau_s, a)."""

    name: str
    source: str
    eps_inf: float
    terms: tuple[tuple[float, float, float], ...]
    conductivity_s_per_m: float

    def permittivity(self, frequency_hz: Array) -> ComplexArray:
        jw = 2j * pi * np.asarray(frequency_hz, dtype=np.float64)
        k = self.eps_inf + self.conductivity_s_per_m / (jw * EPS0)
        for strength, tau_s, a in self.terms:
            k = k + strength / (1.0 + (jw * tau_s) ** (1.0 - a))
        return np.asarray(k)


@dataclass(frozen=True)
class PowerLaw:
    """eps_inf + A (j f/250 Hz)^-m + sigma/(j w eps0): causal, a surrogate and not a measurement."""

    eps_inf: float
    amplitude: float
    exponent: float
    conductivity_s_per_m: float
    name: str = "power_law"
    source: str = "surrogate: a causal power law, not measured data"

    def permittivity(self, frequency_hz: Array) -> ComplexArray:
        f = np.asarray(frequency_hz, dtype=np.float64)
        conduction = self.conductivity_s_per_m / (2j * pi * f * EPS0)
        return np.asarray(
            self.eps_inf + self.amplitude * (1j * f / 250.0) ** -self.exponent + conduction
        )


@dataclass(frozen=True)
class Tabulated:
    """A user's own data: eps' and total conductivity at given frequencies, interpolated in
    logarithms.
    """

    name: str
    source: str
    frequency_hz: tuple[float, ...]
    eps_real: tuple[float, ...]
    conductivity_s_per_m: tuple[float, ...]

    def permittivity(self, frequency_hz: Array) -> ComplexArray:
        """See `Dielectric`; outside the table the conductivity and eps' of its ends are held."""
        f = np.asarray(frequency_hz, dtype=np.float64)
        at, nodes = np.log(f), np.log(self.frequency_hz)
        eps = np.exp(np.interp(at, nodes, np.log(self.eps_real)))
        sigma = np.exp(np.interp(at, nodes, np.log(self.conductivity_s_per_m)))
        return np.asarray(eps - 1j * sigma / (2.0 * pi * f * EPS0))


GABRIEL_DRY = ColeCole(
    name="gabriel_dry",
    source="Gabriel et al. 1996, Phys. Med. Biol. 41:2271, dry skin",
    eps_inf=4.0,
    terms=((32.0, 7.23e-12, 0.0), (1100.0, 32.48e-9, 0.20)),
    conductivity_s_per_m=2e-4,
)
GABRIEL_WET = ColeCole(
    name="gabriel_wet",
    source=(
        "Gabriel et al. 1996, Phys. Med. Biol. 41:2271, wet skin; third relaxation time and sigma"
        " unverified"
    ),
    eps_inf=4.0,
    terms=(
        (39.0, 7.958e-12, 0.10),
        (280.0, 79.577e-9, 0.0),
        (3e4, 1.592e-6, 0.16),
        (3e4, 1.592e-3, 0.20),
    ),
    conductivity_s_per_m=4e-4,
)
NAMED: dict[str, Dielectric] = {d.name: d for d in (GABRIEL_DRY, GABRIEL_WET)}


def named(name: str) -> Dielectric:
    """The shipped set of that name; ModelError with the nearest name otherwise."""
    if name not in NAMED:
        raise ModelError(
            f"there is no dielectric set '{name}'", nearest(name, [*NAMED, "power_law", "csv"])
        )
    return NAMED[name]


def read_csv(path: Path) -> Tabulated:
    """A set from columns `frequency_hz, eps_real, conductivity_s_per_m`; ModelError says which line
    is wrong.
    """
    columns = ("frequency_hz", "eps_real", "conductivity_s_per_m")
    wanted = (
        f"Wanted: columns {', '.join(columns)}; at least 2 rows, frequencies rising, all values"
        " positive"
    )
    table = read_table(path, columns, wanted)
    frequency, eps_real, conductivity = (table.numbers(name) for name in columns)
    positive = bool(np.all(np.stack([frequency, eps_real, conductivity]) > 0.0))
    if frequency.size < 2 or not positive or not np.all(np.diff(frequency) > 0.0):
        raise ModelError(f"{path}: not a usable dielectric table", wanted)
    return Tabulated(
        name=path.stem,
        source=f"user's table {path.name}",
        frequency_hz=tuple(frequency.tolist()),
        eps_real=tuple(eps_real.tolist()),
        conductivity_s_per_m=tuple(conductivity.tolist()),
    )


KINDS = {kind.__name__: kind for kind in (ColeCole, PowerLaw, Tabulated)}


def described(dielectric: Dielectric) -> dict[str, Any]:
    """A set as JSON can hold it."""
    assert isinstance(dielectric, ColeCole | PowerLaw | Tabulated)
    return {"kind": type(dielectric).__name__} | asdict(dielectric)


def of_description(given: Mapping[str, Any]) -> Dielectric:
    """The set again; KeyError or TypeError where it is not described so."""
    numbers = {key: _tuples(value) for key, value in given.items() if key != "kind"}
    made: Dielectric = KINDS[given["kind"]](**numbers)
    return made


def _tuples(value: Any) -> Any:
    """What JSON made lists of."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
