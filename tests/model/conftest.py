"""What the tests of the physics share: reference values, the shipped models, and the theory as
printed, done slowly.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import erf

from model.conditions import Conditions
from model.contact.gap_table import gap_mass, gap_table, integrals_of
from model.description import ModelDescription, read_model
from model.effects import Effect
from model.electric.circuit import GapCircuit
from model.electric.dielectrics import EPS0
from model.electric.layers import branch, leak_per_m_pa
from model.touch_model import TouchModel, prepare
from tests.fingers import MODELS

REFERENCE = Path(__file__).parent / "reference.json"


@pytest.fixture(scope="session")
def reference():
    """Values of an independent implementation, good to 0.05 %; columns as arrays."""
    content: dict[str, Any] = _columns(json.loads(REFERENCE.read_text(encoding="utf-8")))
    return content


def _columns(node: Any) -> Any:
    if isinstance(node, dict):
        return {name: _columns(below) for name, below in node.items()}
    return np.array(node) if isinstance(node, list) else node


@pytest.fixture(scope="session")
def fresh_tables(tmp_path_factory):
    """Gives a model its gap table from a folder of this run, which its workers share: no test ever
    reads a table of an earlier source.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    gap_table.cache_clear()

    def ready(model: TouchModel) -> TouchModel:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("HAPTIC_CACHE_DIR", str(folder / "gap-tables"))
            assert model.table.values.size > 0
        return model

    yield ready
    gap_table.cache_clear()


@pytest.fixture(scope="session")
def models(fresh_tables):
    """The two shipped models by name."""
    return {
        name: fresh_tables(TouchModel(read_model(MODELS / f"{name}.toml")))
        for name in ("reference", "table1")
    }


@pytest.fixture(scope="session")
def variant(fresh_tables, models):
    """The reference model with other numbers, or another dielectric set or friction law."""

    def make(base: str = "reference", **changes: Any) -> TouchModel:
        description: ModelDescription = models[base].description
        own = {k: changes.pop(k) for k in ("dielectric", "friction_law") if k in changes}
        parameters = dict(description.parameters)
        for name, value in changes.items():
            parameters[name] = replace(parameters[name], value=value)
        return fresh_tables(TouchModel(replace(description, parameters=parameters, **own)))

    return make


@dataclass(frozen=True)
class Chosen(ModelDescription):
    """A description whose effects are given as they are, in their order, and need not come from a
    file.
    """

    chosen: tuple[Effect, ...] = ()

    @property
    def effects(self) -> tuple[Effect, ...]:
        return self.chosen


@pytest.fixture(scope="session")
def with_effects(models):
    """A model of another (the reference by default) with these effects, on the same table."""

    def make(*effects: Effect, base: TouchModel | None = None) -> TouchModel:
        base = base or models["reference"]
        own = {f.name: getattr(base.description, f.name) for f in fields(ModelDescription)}
        model = TouchModel(Chosen(**own, chosen=effects))
        model.__dict__["table"] = base.table
        return model

    return make


@dataclass(frozen=True)
class Scales:
    """A finger's scales of pressure and of length: Y* q0 h_rms (Pa) and h_rms (m)."""

    pressure_pa: float
    length_m: float


@pytest.fixture(scope="session")
def scales_of():
    def of(model: TouchModel) -> Scales:
        v = model.description.values
        return Scales(
            v.effective_modulus_pa * v.roll_off_wavenumber_per_m * v.roughness_rms_m,
            v.roughness_rms_m,
        )

    return of


@pytest.fixture(scope="session")
def k_by_quadrature(scales_of):
    """int P/|u + z|^2 du in 1/m2 at a pressure, past the table."""

    def k(model: TouchModel, pressure_pa: float, z_m: complex) -> float:
        scales = scales_of(model)
        mass = gap_mass(model.table.shape, pressure_pa / scales.pressure_pa)
        z_hat = np.array([z_m / scales.length_m], complex)
        return float(integrals_of(mass, z_hat)[0][0]) / scales.length_m**2

    return k


@dataclass(frozen=True)
class Stack:
    """What the gap's field depends on, per frequency: E(u) = V/(a u + k_gap h), a = 1 + leak p
    h.
    """

    omega: NDArray
    h_m: NDArray
    k_gap: NDArray
    leak_per_m_pa: NDArray


@pytest.fixture(scope="session")
def stack_of():
    """The layers of a model without effects at frequencies of any shape."""

    def of(model: TouchModel, frequency_hz: NDArray) -> Stack:
        v = model.description.values
        b = branch(v, model.description.dielectric, frequency_hz)
        return Stack(b.omega, b.h_m(v), b.k_gap, leak_per_m_pa(v, b))

    return of


@pytest.fixture(scope="session")
def gain_by_quadrature(k_by_quadrature, stack_of):
    """Pressure per mean square volt, (eps0/2) int P/|a (u + wider) + b|^2 du, past the table; what
    lies beside the gap too is in a, over j w eps0.
    """

    def gain(
        model: TouchModel,
        frequency_hz: float,
        pressure_pa: float,
        wider_m: float = 0.0,
        beside_per_m: complex = 0.0,
    ) -> float:
        s = stack_of(model, np.array([frequency_hz]))
        a = 1.0 + (s.leak_per_m_pa[0] * pressure_pa + beside_per_m) * s.h_m[0]
        z_m = wider_m + s.k_gap[0] * s.h_m[0] / a
        return float(0.5 * EPS0 * k_by_quadrature(model, pressure_pa, z_m) / abs(a) ** 2)

    return gain


@pytest.fixture(scope="session")
def circuit_of():
    """A circuit from scales, (stack, mean square voltage) of each branch and load, all but the
    scales [n].
    """

    def of(
        scales: Scales,
        branches: list[tuple[Any, NDArray]],
        load_pa: NDArray,
        **changes: NDArray | float,
    ) -> GapCircuit:
        shape = np.shape(load_pa)

        def by_branch(values: list[NDArray], dtype: type) -> NDArray:
            return np.stack([np.broadcast_to(np.asarray(v, dtype), shape) for v in values], axis=1)

        rest = {"gap_shift_m": 0.0, "added_pa": 0.0, "field_limit_v_per_m": np.inf, **changes}
        return GapCircuit(
            pressure_scale_pa=np.full(shape, scales.pressure_pa),
            length_scale_m=np.full(shape, scales.length_m),
            h_m=by_branch([s.h_m for s, _ in branches], complex),
            k_gap=by_branch([s.k_gap for s, _ in branches], complex),
            bypass_per_m=np.zeros((*shape, len(branches)), complex),
            leak_per_m_pa=by_branch([s.leak_per_m_pa for s, _ in branches], complex),
            mean_square_v2=by_branch([v for _, v in branches], float),
            crest_square=np.full((*shape, len(branches)), 2.0),
            load_pa=np.asarray(load_pa, float),
            **{
                name: np.array(np.broadcast_to(np.asarray(v, float), shape))
                for name, v in rest.items()
            },
        )

    return of


@pytest.fixture(scope="session")
def sine_circuit():
    """The circuit of a model as the chain prepares it, for sines; everything broadcasts."""

    def of(model: TouchModel, frequency_hz: Any, voltage_v: Any, load_pa: Any) -> GapCircuit:
        description = model.description
        load_n = np.asarray(load_pa) * description.values.contact_area_m2
        columns = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(x, float)) for x in (frequency_hz, voltage_v, load_n))
        )
        drive = Conditions(*columns).drive()
        return prepare(
            description.values, description.dielectric, description.effects, drive
        ).circuit

    return of


@dataclass(frozen=True)
class PrintedTheory:
    """Equations (41)-(49) in SI units, every integral by brute quadrature and every derivative by
    differences.

    Nothing here is shared with the source: no closed form of a moment, no scaling, other variables
    and other rules.
    """

    H: float
    h_rms: float
    q0: float
    q1: float
    gamma: float
    Y: float

    def spectrum(self, q: NDArray) -> NDArray:
        return (
            self.H / np.pi * self.h_rms**2 / self.q0**2 * (q / self.q0) ** (-2.0 * (1.0 + self.H))
        )  # (41)

    def moment(self, power: int, low: NDArray, log_width: NDArray, nodes: int = 48) -> NDArray:
        """int q^power C(q) dq from `low` over a given width in log q: exact also for widths of
        1e-14.
        """
        x, w = np.polynomial.legendre.leggauss(nodes)
        q = low[..., None] * np.exp(0.5 * log_width[..., None] * (x + 1.0))
        return 0.5 * log_width * ((q ** (power + 1) * self.spectrum(q)) @ w)

    def stress_ratio(self, p: float, tau: NDArray) -> NDArray:
        """p/(2 sqrt G) of (42)-(43) at zeta = 1 + e^tau."""
        log_zeta = np.log1p(np.exp(tau))
        G = 0.25 * np.pi * self.Y**2 * self.moment(3, np.full_like(tau, self.q0), log_zeta)
        return p / (2.0 * np.sqrt(G))

    def mean_separation(self, p_zeta: NDArray, tau: NDArray) -> NDArray:
        """(45) with (46), (47) at zeta = 1 + e^tau and the pressure p A0/A(zeta)."""
        low = self.q0 * (1.0 + np.exp(tau))
        width = np.log(self.q1 / low)
        # below this width w p'/Y* > 20 at the least p', where the inner integral is 0 in double
        # precision
        least = (p_zeta / (20.0 * self.Y)) ** 2 / (np.pi * low**4 * self.spectrum(low))
        least = np.minimum(least, 0.5 * width)
        x, gauss = np.polynomial.legendre.leggauss(80)
        span = np.log(width / least)
        y = least[:, None] * np.exp(0.5 * span[:, None] * (x + 1.0))
        q = low[:, None] * np.exp(y)
        w = (np.pi * self.moment(3, np.broadcast_to(low[:, None], y.shape), y)) ** -0.5
        inner = self._inner(w * p_zeta[:, None] / self.Y)
        outer = y * q**3 * self.spectrum(q) * w * inner  # dq = q y d(log y)
        return np.sqrt(np.pi) * 0.5 * span * (outer @ gauss)

    def _inner(self, x0: NDArray) -> NDArray:
        x, gauss = np.polynomial.legendre.leggauss(80)
        span = np.maximum(np.log(7.0 / x0), 0.0)  # exp(-49) = 5e-22: nothing beyond 7
        at = x0[..., None] * np.exp(0.5 * span[..., None] * (x + 1.0))
        return (
            0.5
            * span
            * (((self.gamma + 3.0 * (1.0 - self.gamma) * erf(at) ** 2) * np.exp(-(at**2))) @ gauss)
        )

    def at_zeta_one(self, p: float) -> float:
        return float(
            self.mean_separation(np.array([p]), np.array([-60.0]))[0]
        )  # zeta - 1 = 1e-26: 1 in doubles


@pytest.fixture(scope="session")
def printed_theory():
    """The slow theory of a model's finger; Y* of (38) from its moduli."""

    def of(model: TouchModel) -> PrintedTheory:
        v = model.description.values
        compliance = (1.0 - v.screen_poisson_ratio**2) / v.screen_modulus_pa
        compliance += (1.0 - v.skin_poisson_ratio**2) / v.skin_modulus_pa
        return PrintedTheory(
            v.hurst_exponent,
            v.roughness_rms_m,
            v.roll_off_wavenumber_per_m,
            v.cut_off_wavenumber_per_m,
            v.contact_gamma,
            1.0 / compliance,
        )

    return of
