from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from haptic_driver.lab.figures.closed_forms import closed_form
from model.contact.gap_table import gap_mass, gap_nodes, integrals_of
from model.electric.charges import Layers, coefficients, constant_layers
from model.electric.dielectrics import EPS0
from model.solver import solve
from model.support.errors import ModelError
from tests.model.electric import transient

FINGERS = ("reference", "table1")
GAP_M = np.array([1e-8, 1e-6, 44e-6])
KEY_HZ, KEY_V = 250.0, 75.0


@dataclass(frozen=True)
class Fields:
    """Fields of insulator, gap and skin in V/m, all of one shape."""

    insulator: np.ndarray
    gap: np.ndarray
    skin: np.ndarray


@dataclass(frozen=True)
class Transient:
    """Charge densities in C/m^2 and fields in V/m over time, [t, n] for t times and n gaps."""

    rho1_c_per_m2: np.ndarray
    rho2_c_per_m2: np.ndarray
    fields: Fields

    @property
    def pressure_pa(self) -> np.ndarray:
        """Electrostatic pressure (28) of each gap, eps0/2 E_g^2, at each moment [t, n]."""
        return 0.5 * EPS0 * self.fields.gap**2


def fields(
    layers: Layers, gap_m: np.ndarray, voltage_v: np.ndarray, rho1: np.ndarray, rho2: np.ndarray
) -> Fields:
    """(9)-(11): fields under a voltage and interface charges; everything broadcasts."""
    l1, lg, l2 = layers.elastances(gap_m)
    displacement = (voltage_v + l1 * rho1 - l2 * rho2) / (l1 + lg + l2)  # eps_g E_g
    return Fields(
        insulator=(displacement - rho1) / layers.insulator_permittivity_f_per_m,
        gap=displacement / layers.air_permittivity_f_per_m,
        skin=(displacement + rho2) / layers.skin_permittivity_f_per_m,
    )


def simulate(
    layers: Layers, gap_m: np.ndarray, time_s: np.ndarray, voltage_v: np.ndarray
) -> Transient:
    """The charges that the model finds, with their fields by (9)-(11)."""
    rho1, rho2 = transient.simulate(layers, gap_m, time_s, voltage_v)
    return Transient(rho1, rho2, fields(layers, gap_m, voltage_v[:, None], rho1, rho2))


def sine(amplitude_v: float, frequency_hz: float, time_s: np.ndarray) -> np.ndarray:
    """V0 cos(w t), the drive of (34)-(35)."""
    return amplitude_v * np.cos(2.0 * np.pi * frequency_hz * time_s)


def steady_charges(
    layers: Layers, gap_m: np.ndarray, voltage_v: float
) -> tuple[np.ndarray, np.ndarray]:
    """rho1 and rho2 in C/m^2 long after a direct voltage: one current crosses three resistances in
    series.
    """
    air = layers.air_conductivity_s_per_m + layers.contact_conductance_s_per_m2 * gap_m
    resistance = layers.insulator_thickness_m / layers.insulator_conductivity_s_per_m
    resistance = (
        resistance + gap_m / air + layers.skin_thickness_m / layers.skin_conductivity_s_per_m
    )
    current = voltage_v / resistance
    tau1 = layers.insulator_permittivity_f_per_m / layers.insulator_conductivity_s_per_m
    tau_gap = layers.air_permittivity_f_per_m / air
    tau2 = layers.skin_permittivity_f_per_m / layers.skin_conductivity_s_per_m
    return current * (tau_gap - tau1), current * (tau2 - tau_gap)


def mean_pressure_pa(
    model, layers: Layers, pressure_pa: float, time_s: np.ndarray, voltage_v: np.ndarray
) -> np.ndarray:
    """Electrostatic pressure over time [t], averaged over the gaps of a contact held by
    `pressure_pa`.
    """
    p = model.description.values
    scale = p.effective_modulus_pa * p.roll_off_wavenumber_per_m * p.roughness_rms_m
    transient = simulate(layers, gap_nodes() * p.roughness_rms_m, time_s, voltage_v)
    return transient.pressure_pa @ gap_mass(model.table.shape, pressure_pa / scale)


@pytest.fixture(scope="module")
def layers_of(models):
    """The layers of a shipped model, the skin at 250 Hz unless told otherwise."""

    def of(name: str = "reference", at_hz: float = KEY_HZ, alpha: float = 0.0) -> Layers:
        d = models[name].description
        return replace(
            constant_layers(d.values, d.dielectric, at_hz), contact_conductance_s_per_m2=alpha
        )

    return of


def rates(
    layers: Layers, gap_m: float, voltage_v: float, rho: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """d rho/dt and the fields from (2)-(8), the laws as one linear system: no formula of
    (9)-(17).
    """
    e1, eg, e2 = (
        layers.insulator_permittivity_f_per_m,
        layers.air_permittivity_f_per_m,
        layers.skin_permittivity_f_per_m,
    )
    law = np.array(
        [
            [-e1, eg, 0.0],
            [0.0, -eg, e2],
            [layers.insulator_thickness_m, gap_m, layers.skin_thickness_m],
        ]
    )  # (4), (5), (8)
    size = np.abs(law).max(axis=1)
    field = np.linalg.solve(law / size[:, None], np.array([rho[0], rho[1], voltage_v]) / size)
    conductivity = np.array(
        [
            layers.insulator_conductivity_s_per_m,
            layers.air_conductivity_s_per_m + layers.contact_conductance_s_per_m2 * gap_m,
            layers.skin_conductivity_s_per_m,
        ]
    )
    current = conductivity * field
    return np.array([current[0] - current[1], current[1] - current[2]]), field


def by_ode(layers: Layers, gap_m: float, time_s: np.ndarray, voltage) -> np.ndarray:
    """Charges [2, t] by scipy's stiff solver, in units of the charge that 1 V puts on the gap."""
    unit = EPS0 / (gap_m + 1e-6)
    found = solve_ivp(
        lambda t, y: rates(layers, gap_m, float(voltage(t)), y * unit)[0] / unit,
        (time_s[0], time_s[-1]),
        np.zeros(2),
        method="Radau",
        t_eval=time_s,
        rtol=1e-9,  # so that its accumulated error stays below the 1e-8 asked of ours
        atol=1e-13,
    )
    assert found.success
    return found.y * unit


@pytest.mark.parametrize("name", FINGERS)
@pytest.mark.parametrize("gap_m", [1e-6, 44e-6])
def test_coefficients_are_those_of_the_laws(layers_of, name, gap_m):
    layers = layers_of(name, alpha=1e-4)
    k = coefficients(layers, gap_m)
    for column, (state, volt) in enumerate(
        [((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((0.0, 0.0), 1.0)]
    ):
        expected = -rates(layers, gap_m, volt, np.array(state))[0]
        got = [(k.a, k.d), (k.b, k.e), (k.c, k.f)][column]
        np.testing.assert_allclose(got, expected, rtol=1e-9)  # conditioning of the linear solve


@given(
    gap_m=st.floats(-9.0, -3.5).map(lambda e: 10.0**e),
    volt=st.floats(1.0, 200.0),
    rho1=st.floats(-1e-4, 1e-4),
    rho2=st.floats(-1e-4, 1e-4),
)
@settings(max_examples=50)
def test_fields_obey_gauss_and_kirchhoff(layers_of, gap_m, volt, rho1, rho2):
    layers = layers_of()
    got = fields(layers, gap_m, volt, rho1, rho2)
    d1, dg, d2 = (
        layers.insulator_permittivity_f_per_m * got.insulator,
        layers.air_permittivity_f_per_m * got.gap,
        layers.skin_permittivity_f_per_m * got.skin,
    )
    size = abs(d1) + abs(dg) + abs(d2)
    assert dg - d1 == pytest.approx(rho1, abs=1e-14 * size)
    assert d2 - dg == pytest.approx(rho2, abs=1e-14 * size)
    drops = [
        layers.insulator_thickness_m * got.insulator,
        gap_m * got.gap,
        layers.skin_thickness_m * got.skin,
    ]
    assert sum(drops) == pytest.approx(volt, abs=1e-13 * sum(map(abs, drops)))


class TestAgainstAnOdeSolver:
    """Asked: 1e-8."""

    @pytest.mark.parametrize("gap_m", [1e-6, 44e-6])
    @pytest.mark.parametrize(
        "until_s", [1e-3, 5e3]
    )  # the skin's charging, and that of the slowest layer
    def test_direct_current(self, layers_of, gap_m, until_s):
        layers, time = layers_of(), np.linspace(0.0, until_s, 41)
        expected = KEY_V * by_ode(layers, gap_m, time, lambda t: 1.0)
        got = simulate(layers, np.array([gap_m]), time, np.full(41, KEY_V))
        closed = closed_form(coefficients(layers, gap_m), 0.0).charges(time)
        for i, rho in enumerate((got.rho1_c_per_m2, got.rho2_c_per_m2)):
            scale = np.abs(expected[i]).max()
            np.testing.assert_allclose(rho[:, 0], expected[i], rtol=1e-8, atol=1e-8 * scale)
            np.testing.assert_allclose(KEY_V * closed[i], expected[i], rtol=1e-8, atol=1e-8 * scale)

    @pytest.mark.parametrize("frequency_hz", [1.0, 250.0, 1e4])
    def test_alternating_current(self, layers_of, frequency_hz):
        layers, gap_m = layers_of(at_hz=frequency_hz), 44e-6
        time = np.linspace(0.0, 3.0 / frequency_hz, 61)
        expected = KEY_V * by_ode(
            layers, gap_m, time, lambda t: np.cos(2.0 * np.pi * frequency_hz * t)
        )
        closed = closed_form(coefficients(layers, gap_m), frequency_hz).charges(time)
        fine = np.linspace(0.0, 3.0 / frequency_hz, 60_001)
        got = simulate(layers, np.array([gap_m]), fine, sine(KEY_V, frequency_hz, fine))
        for i, rho in enumerate((got.rho1_c_per_m2, got.rho2_c_per_m2)):
            scale = np.abs(expected[i]).max()
            np.testing.assert_allclose(KEY_V * closed[i], expected[i], rtol=1e-8, atol=1e-8 * scale)
            # straight pieces of 1/20000 of a period miss the cosine by (w dt)^2/8 = 1.2e-8
            np.testing.assert_allclose(rho[::1000, 0], expected[i], rtol=3e-8, atol=3e-8 * scale)

    def test_any_voltage_and_uneven_steps(self, layers_of):
        layers, gap_m = layers_of(alpha=2e-4), 5e-6
        time = np.array([0.0, 1e-5, 3e-5, 4e-4, 5e-4, 2e-3, 2.1e-3, 1e-2])
        voltage = np.array([0.0, 40.0, -20.0, 75.0, 75.0, -75.0, 0.0, 0.0])
        got = simulate(layers, np.array([gap_m]), time, voltage)
        y, expected = np.zeros(2), [np.zeros(2)]
        for i in range(time.size - 1):  # the solver is restarted at every corner
            unit = EPS0 / gap_m
            found = solve_ivp(
                lambda t, y, unit=unit: (
                    rates(layers, gap_m, np.interp(t, time, voltage), y * unit)[0] / unit
                ),
                (time[i], time[i + 1]),
                y,
                method="Radau",
                rtol=1e-10,
                atol=1e-13,
            )
            y = found.y[:, -1]
            expected.append(y * unit)
        for i, rho in enumerate((got.rho1_c_per_m2, got.rho2_c_per_m2)):
            column = np.array(expected)[:, i]
            np.testing.assert_allclose(
                rho[:, 0], column, rtol=1e-8, atol=1e-8 * np.abs(column).max()
            )


class TestClosedFormAsPrinted:
    """Where the gap conducts better than its neighbours, the two charges couple and the missing
    terms show.
    """

    COUPLED = Layers(1e-6, EPS0, 1e-10, EPS0, 1e-9, 2e-6, EPS0, 3e-10)
    GAP_M = 1e-6

    @pytest.mark.parametrize("frequency_hz", [0.0, 1.0, 5.0])
    def test_neutral_layers_start_with_the_current_of_the_voltage(self, frequency_hz):
        """d rho/dt (0) = -(c, f) V0: so it is with the mended lambda and delta, and is not with the
        printed ones.
        """
        k = coefficients(self.COUPLED, self.GAP_M)

        def start(*, printed: bool) -> np.ndarray:
            x = closed_form(k, frequency_hz, printed=printed)
            rho1 = x.omega * x.alpha[1] - (k.a + k.e) * x.eta + x.lambda_
            rho2 = x.omega * x.beta[1] - (k.a + k.e) * x.kappa + x.delta
            return np.array([rho1, rho2])

        drive = np.array([-k.c, -k.f])
        np.testing.assert_allclose(
            start(printed=False), drive, rtol=1e-11
        )  # rounding, eased by the differences
        off = np.abs(start(printed=True) / drive - 1.0)
        assert (off > 1e-2).all()

    def test_only_the_mended_ones_follow_the_solver(self):
        k = coefficients(self.COUPLED, self.GAP_M)
        time = np.linspace(0.0, 0.1, 50)
        exact = simulate(self.COUPLED, np.array([self.GAP_M]), time, np.ones(50))
        mended, printed = (closed_form(k, 0.0, printed=p).charges(time) for p in (False, True))
        for i, rho in enumerate((exact.rho1_c_per_m2[:, 0], exact.rho2_c_per_m2[:, 0])):
            scale = np.abs(rho).max()
            assert np.abs(mended[i] - rho).max() < 1e-12 * scale
            assert np.abs(printed[i] - rho).max() > 0.05 * scale


class TestLimits:
    @pytest.mark.parametrize("name", FINGERS)
    def test_long_after_switching_on_one_current_crosses_all_layers(self, layers_of, name):
        layers = layers_of(name)
        got = simulate(layers, GAP_M, np.array([0.0, 1e6]), np.full(2, KEY_V))
        rho1, rho2 = steady_charges(layers, GAP_M, KEY_V)
        np.testing.assert_allclose(
            got.rho1_c_per_m2[-1], rho1, rtol=1e-9
        )  # 1e7 between the rates of the two modes
        np.testing.assert_allclose(got.rho2_c_per_m2[-1], rho2, rtol=1e-9)
        conduction = [
            layers.insulator_conductivity_s_per_m * got.fields.insulator[-1],
            layers.air_conductivity_s_per_m * got.fields.gap[-1],
        ]
        np.testing.assert_allclose(conduction[0], conduction[1], rtol=1e-6)

    def test_at_once_the_layers_are_capacitors_in_series(self, layers_of):
        got = simulate(layers_of(), GAP_M, np.array([0.0]), np.array([KEY_V]))
        d = layers_of()
        eps2 = d.skin_permittivity_f_per_m / EPS0
        expected = KEY_V / (GAP_M + 1e-6 / 3.9 + 200e-6 / eps2)
        np.testing.assert_allclose(got.fields.gap[0], expected, rtol=1e-13)  # rounding
        np.testing.assert_array_equal(got.rho1_c_per_m2, 0.0)

    def test_charges_vanish_at_high_frequency(self, layers_of):
        """Appendix B: the limit that the paper states, as 1/w."""
        k = coefficients(layers_of(), GAP_M)
        amplitude = [np.abs(np.array(k.response(2j * np.pi * f))) for f in (1e8, 1e9)]
        np.testing.assert_allclose(
            amplitude[1] / amplitude[0], 0.1, rtol=1e-6
        )  # (rate/w)^2 is 1e-9

    def test_insulators_keep_no_charge(self):
        layers = Layers(1e-6, 4 * EPS0, 0.0, EPS0, 0.0, 1e-4, 1e3 * EPS0, 0.0)
        got = simulate(
            layers, GAP_M, np.linspace(0.0, 1.0, 5), np.array([0.0, 5.0, -5.0, 70.0, 70.0])
        )
        np.testing.assert_array_equal(got.rho1_c_per_m2, 0.0)
        np.testing.assert_array_equal(got.rho2_c_per_m2, 0.0)

    def test_equal_relaxation_leaves_no_charge(self):
        """Maxwell-Wagner: charge gathers only where relaxation times differ."""
        layers = Layers(1e-6, 4 * EPS0, 4e-9, EPS0, 1e-9, 1e-4, 1e3 * EPS0, 1e-6)
        got = simulate(layers, GAP_M, np.linspace(0.0, 0.1, 5), np.full(5, KEY_V))
        scale = EPS0 * np.abs(got.fields.gap)
        assert (np.abs(got.rho1_c_per_m2) < 1e-12 * scale).all()
        assert (np.abs(got.rho2_c_per_m2) < 1e-12 * scale).all()


@pytest.mark.parametrize("alpha", [0.0, 2e-4])
def test_total_current_is_conserved_through_the_stack(layers_of, alpha):
    """Conduction and displacement together are the same in all three layers: 1e-9."""
    layers, gap_m = layers_of(alpha=alpha), 10e-6
    time = np.linspace(0.0, 8e-3, 201)
    volt, slope = (
        sine(KEY_V, KEY_HZ, time),
        -2.0 * np.pi * KEY_HZ * KEY_V * np.sin(2.0 * np.pi * KEY_HZ * time),
    )
    got = simulate(layers, np.array([gap_m]), time, volt)
    rho1, rho2 = got.rho1_c_per_m2[:, 0], got.rho2_c_per_m2[:, 0]
    k = coefficients(layers, gap_m)
    d_rho1, d_rho2 = (
        -(k.a * rho1 + k.b * rho2 + k.c * volt),
        -(k.d * rho1 + k.e * rho2 + k.f * volt),
    )
    rate = fields(layers, gap_m, slope, d_rho1, d_rho2)  # fields are linear in voltage and charges
    air = layers.air_conductivity_s_per_m + alpha * gap_m
    through = [
        layers.insulator_conductivity_s_per_m * got.fields.insulator[:, 0]
        + layers.insulator_permittivity_f_per_m * rate.insulator,
        air * got.fields.gap[:, 0] + layers.air_permittivity_f_per_m * rate.gap,
        layers.skin_conductivity_s_per_m * got.fields.skin[:, 0]
        + layers.skin_permittivity_f_per_m * rate.skin,
    ]
    size = np.abs(through[1]).max()
    assert np.abs(through[0] - through[1]).max() < 1e-9 * size
    assert np.abs(through[2] - through[1]).max() < 1e-9 * size


@pytest.mark.parametrize("name", FINGERS)
@pytest.mark.parametrize("frequency_hz", [1.0, 250.0, 1e5])
@pytest.mark.parametrize("with_leak", [False, True])
def test_steady_alternation_is_the_frequency_domain(
    models, layers_of, stack_of, name, frequency_hz, with_leak
):
    """Section 2 of the physics at the frequency where the constants are taken, with alpha = 0 and
    with the leak.
    """
    model, jw = models[name], 2j * np.pi * frequency_hz
    stack = stack_of(model, np.array([frequency_hz]))
    beta = stack.leak_per_m_pa[0] * 5e3 if with_leak else 0.0
    layers = layers_of(name, frequency_hz, alpha=float((beta * jw * EPS0).real))
    expected = 1.0 / ((1.0 + beta * stack.h_m[0]) * GAP_M + stack.k_gap[0] * stack.h_m[0])
    rho1, rho2 = coefficients(layers, GAP_M).response(jw)
    np.testing.assert_allclose(fields(layers, GAP_M, 1.0, rho1, rho2).gap, expected, rtol=1e-9)
    closed = closed_form(coefficients(layers, GAP_M), frequency_hz)
    # the phasor of rho1 = alpha_1 cos + alpha_2 sin
    np.testing.assert_allclose(closed.alpha[0] - 1j * closed.alpha[1], rho1, rtol=1e-9)
    np.testing.assert_allclose(closed.beta[0] - 1j * closed.beta[1], rho2, rtol=1e-9)


class TestPressure:
    def test_one_gap(self, layers_of):
        got = simulate(layers_of(), GAP_M, np.array([0.0]), np.array([KEY_V]))
        eps2 = layers_of().skin_permittivity_f_per_m / EPS0
        expected = 0.5 * EPS0 * (KEY_V / (GAP_M + 1e-6 / 3.9 + 200e-6 / eps2)) ** 2
        np.testing.assert_allclose(got.pressure_pa[0], expected, rtol=1e-13)  # rounding

    @pytest.mark.parametrize("name", FINGERS)
    def test_mean_over_gaps_and_time_is_the_chain(
        self, models, layers_of, circuit_of, stack_of, scales_of, name
    ):
        """After the start-up the mean over one period is p_e of the chain without leak, at the same
        pressure.
        """
        model = models[name]
        stack, scales = stack_of(model, np.array([KEY_HZ])), scales_of(model)
        circuit = circuit_of(
            scales, [(replace(stack, leak_per_m_pa=0.0), np.array([KEY_V**2 / 2]))], np.array([5e3])
        )
        p_e = float(solve(model.table, circuit)[0][0])
        layers = layers_of(name, KEY_HZ)
        # the slow mode (minutes) has not decayed after one period; it holds a share (skin's w
        # tau)^-2 of the charge
        time = np.arange(0, 4001) / 2000 / KEY_HZ
        over_time = mean_pressure_pa(model, layers, 5e3 + p_e, time, sine(KEY_V, KEY_HZ, time))
        period = over_time[2000:4000]
        assert float(period.mean()) == pytest.approx(p_e, rel=2e-3)

    def test_direct_voltage_at_once_is_the_integral_over_the_gaps(
        self, models, layers_of, scales_of
    ):
        model, layers = models["reference"], layers_of()
        scales = scales_of(model)
        z = 1e-6 / 3.9 + 200e-6 * EPS0 / layers.skin_permittivity_f_per_m
        k_hat, _ = integrals_of(
            gap_mass(model.table.shape, 6e3 / scales.pressure_pa),
            np.array([z / scales.length_m], complex),
        )
        got = mean_pressure_pa(model, layers, 6e3, np.array([0.0]), np.array([KEY_V]))
        expected = 0.5 * EPS0 * KEY_V**2 * k_hat[0] / scales.length_m**2
        assert got[0] == pytest.approx(expected, rel=1e-12)  # the same rule on the same nodes

    def test_leak_takes_the_pressure_away_over_time(self, models, layers_of):
        model = models["reference"]
        time = np.array([0.0, 1e-3, 1.0, 60.0])
        p = mean_pressure_pa(model, layers_of(alpha=6.8e-3), 5e3, time, np.full(time.size, KEY_V))
        assert p[-1] < 0.01 * p[1]


class TestInput:
    @pytest.mark.parametrize("at_hz", [0.0, -1.0, np.nan, np.inf])
    def test_constants_need_a_frequency(self, layers_of, at_hz):
        with pytest.raises(ModelError, match="is no frequency"):
            layers_of(at_hz=at_hz)
