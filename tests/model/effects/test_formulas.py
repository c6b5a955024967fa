"""Each effect against numbers by hand, another model that must come out the same, or the printed
integral.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

from model import effects as e
from model.conditions import Conditions
from model.effects import BY_NAME
from model.electric.dielectrics import EPS0, GABRIEL_DRY, GABRIEL_WET
from model.touch_model import Prediction, PreparedTouch, TouchModel, prepare
from tests.model.touches import touches

MU, AREA_M2 = 0.512, 1e-4
CURRENTS = ("current_rms_a", "stuck_current_rms_a", "electrode_current_a", "electrode_voltage_v")
FREQUENCIES = np.array([1.0, 10.0, 250.0, 3e3, 1e5, 1e6])


def assert_same(
    one: Prediction, other: Prediction, rtol: float = 1e-8, without: tuple[str, ...] = ()
) -> None:
    """To what the loop is closed to, 1e-10 of the total pressure."""
    for f in fields(Prediction):
        if f.name not in without:
            a, b = getattr(one, f.name), getattr(other, f.name)
            np.testing.assert_allclose(
                a, b, rtol=rtol, atol=1e-10 * (f.name == "electrostatic_force_n")
            )


@pytest.fixture
def prepared(models):
    def run(
        conditions: Conditions, *effects: e.Effect, model: TouchModel | None = None
    ) -> PreparedTouch:
        d = (model or models["reference"]).description
        return prepare(d.values, d.dielectric, effects, conditions.drive())

    return run


@dataclass(frozen=True)
class Skin:
    """A data set with other permittivities and conductivities, by factors."""

    eps_factor: float
    sigma_factor: float
    name: str = "scaled"
    source: str = "made up"

    def permittivity(self, frequency_hz):
        k = GABRIEL_DRY.permittivity(frequency_hz)
        return self.eps_factor * k.real + 1j * self.sigma_factor * k.imag


class TestAmplifierBandwidth:
    def test_by_hand(self, prepared):
        """First order: V/sqrt 2 at f_c, V/sqrt 5 at 2 f_c, V/sqrt 101 at 10 f_c; third order:
        V/sqrt 65 at 2 f_c.
        """
        c = touches([100.0, 1e3, 2e3, 1e4], 60.0)
        first = prepared(
            c, BY_NAME["amplifier_bandwidth"](cutoff_hz=1e3, order=1.0)
        ).circuit.mean_square_v2[:, 0]
        np.testing.assert_allclose(first, 1800.0 / np.array([1.01, 2.0, 5.0, 101.0]), rtol=1e-14)
        third = prepared(
            c, BY_NAME["amplifier_bandwidth"](cutoff_hz=1e3, order=3.0)
        ).circuit.mean_square_v2[:, 0]
        np.testing.assert_allclose(third[1:3], 1800.0 / np.array([2.0, 65.0]), rtol=1e-14)

    @pytest.mark.parametrize("order", [1, 2, 3, 4])
    def test_the_lag_of_a_whole_order_is_butterworths(self, prepared, order):
        f = np.array([1.0, 50.0, 500.0, 1e3, 2e3, 2e4, 1e6])
        got = prepared(
            touches(f, 60.0), BY_NAME["amplifier_bandwidth"](cutoff_hz=1e3, order=order)
        ).electrode_v
        poles = np.exp(0.5j * np.pi * (1.0 + (2.0 * np.arange(order) + 1.0) / order))
        gain = np.prod(-poles[:, None] / (1j * f / 1e3 - poles[:, None]), axis=0)
        np.testing.assert_allclose(
            got, 60.0 * gain, rtol=1.5e-3, atol=1e-12
        )  # the rule's nodes, for the fourth order; 5e-5 for two

    def test_the_lag_grows_steadily_with_the_order(self, prepared):
        """By Bode's relation it ends at 90 degrees per order."""
        orders = np.array([0.5, 1.0, 1.3, 2.0, 3.7])
        end = [
            prepared(touches(1e9, 1.0), BY_NAME["amplifier_bandwidth"](1.0, n)).electrode_v[0]
            for n in orders
        ]
        np.testing.assert_allclose(
            np.exp(1j * np.angle(end)), np.exp(-0.5j * np.pi * orders), atol=2e-4
        )

    def test_a_bias_passes(self, prepared):
        slow = BY_NAME["amplifier_bandwidth"](cutoff_hz=1.0, order=4.0)
        square = prepared(touches(1e5, 50.0, voltage_offset_v=30.0), slow).circuit.mean_square_v2[0]
        assert square[0] < 1e-30
        assert square[1] == 900.0
        direct = prepared(touches(1e5, 50.0, waveform="dc"), slow).circuit.mean_square_v2[0, 0]
        assert direct == 2500.0


class TestAmplifierSlewLimit:
    def test_by_hand(self, prepared):
        """1 V/us at 10 kHz: 15.9 V is the largest sine; from 29.7 V on a triangle of 25 V, its
        fundamental 20.264 V.
        """
        limit = BY_NAME["amplifier_slew_limit"](slew_rate_v_per_s=1e6)
        volts = np.array([5.0, 15.9, 29.7, 100.0])
        square = prepared(touches(1e4, volts), limit).circuit.mean_square_v2[:, 0]
        assert 8.0 / np.pi**2 * 25.0 == pytest.approx(20.264236728467556, rel=1e-14)
        np.testing.assert_allclose(
            square, np.minimum(volts, 20.264236728467556) ** 2 / 2.0, rtol=1e-14
        )

    @pytest.mark.parametrize("share", [0.2, 0.3, 0.5, 0.54, 0.6, 0.7, 0.8, 0.9, 1.1])
    def test_amount_and_lag_are_those_of_an_output_that_follows_as_fast_as_it_can(
        self, prepared, share
    ):
        """Stepped through eight periods of 1 V at 1 Hz; `share` of the sine's steepest slope is the
        limit.
        """
        count = 10_000
        turns = np.arange(8 * count) / count
        out, most = [0.0], share * 2.0 * np.pi / count
        for wanted in np.sin(2.0 * np.pi * turns[1:]).tolist():
            out.append(out[-1] + min(max(wanted - out[-1], -most), most))
        fundamental = 2j * np.mean(out[-count:] * np.exp(-2j * np.pi * turns[-count:]))
        limit = BY_NAME["amplifier_slew_limit"](slew_rate_v_per_s=share * 2.0 * np.pi)
        got = prepared(touches(1.0, 1.0), limit).electrode_v[0]
        assert got == pytest.approx(fundamental, abs=5e-4)

    @pytest.mark.parametrize("over", [0.1, 0.5, 1.0, 2.0, 10.0])
    def test_what_is_lacking_of_a_soft_limit_leads_by_a_quarter_period(self, prepared, over):
        """V/(1 + (V/V_t)^3)^(1/3), V_t = 20.264 V, as far as that is softer than the lesser of V
        and V_t.
        """
        volts = over * 20.264236728467556
        soft, hard = (
            BY_NAME["amplifier_slew_limit"](1e6, sharpness) for sharpness in (3.0, float("inf"))
        )
        got, sharp = (prepared(touches(1e4, volts), limit).electrode_v[0] for limit in (soft, hard))
        left = (1.0 + over**3) ** (
            -1.0 / 3.0
        )  # of the sine; the hard limit leaves the lesser of 1 and 1/over
        hard_left = min(1.0, 1.0 / over)
        more_lag = np.arccos(left) - np.arccos(hard_left)
        assert got == pytest.approx(sharp * left / hard_left * np.exp(-1j * more_lag), rel=1e-9)
        if over < 0.7:  # no limit at all
            assert sharp == volts

    def test_direct_current_is_not_limited(self, with_effects, models):
        limited = with_effects(BY_NAME["amplifier_slew_limit"](slew_rate_v_per_s=1e2))
        c = touches(1e6, 75.0, waveform="dc")
        assert_same(limited.predict(c), models["reference"].predict(c), 0.0)


class TestDriveGainError:
    @pytest.mark.parametrize("waveform", ["sine", "square", "dc"])
    def test_is_another_voltage(self, with_effects, models, waveform):
        doubled = with_effects(BY_NAME["drive_gain_error"](gain=2.0))
        for offset in (0.0, 15.0, -7.0):
            got = doubled.predict(
                touches(FREQUENCIES, 30.0, waveform=waveform, voltage_offset_v=offset)
            )
            base = models["reference"].predict(
                touches(FREQUENCIES, 60.0, waveform=waveform, voltage_offset_v=2.0 * offset)
            )
            assert_same(got, base)


class TestSeriesResistance:
    def test_length_by_hand(self, prepared):
        """10 kohm behind 1 cm2 at 1 kHz: j w eps0 R A0 = j 55.6 nm; 10 Mohm at 100 Hz: j 5.56
        um.
        """
        for f, ohm, length_m in ((1e3, 1e4, 5.563250275e-8), (100.0, 1e7, 5.563250275e-6)):
            c = touches(f, 75.0)
            h = (
                prepared(c, BY_NAME["series_resistance"](resistance_ohm=ohm)).circuit.h_m
                - prepared(c).circuit.h_m
            )
            # eps0 = 8.8541878e-12: ten digits; rounding of h
            assert h[0, 0].imag == pytest.approx(length_m, rel=1e-7)
            assert abs(h[0, 0].real) < 1e-18

    def test_limits_the_stuck_current_as_ohm_says(self, with_effects, models):
        c = touches(FREQUENCIES, 75.0)
        v, jw = models["reference"].description.values, 2j * np.pi * FREQUENCIES
        layers = v.insulator_thickness_m / (jw * EPS0 * 3.9 + 1e-13)
        layers = layers + v.skin_thickness_m / (jw * EPS0 * GABRIEL_DRY.permittivity(FREQUENCIES))
        expected = 75.0 / np.sqrt(2.0) / np.abs(layers / AREA_M2 + 5e4)
        got = with_effects(BY_NAME["series_resistance"](resistance_ohm=5e4)).predict(c)
        np.testing.assert_allclose(got.stuck_current_rms_a, expected, rtol=1e-9)  # rounding


class TestFloatingBody:
    def test_is_a_thicker_insulator(self, with_effects, variant):
        """eps0 A0/C is 8.854 um of air for 100 pF: 34.5 um more of an insulator of 3.9."""
        plain = variant(insulator_conductivity_s_per_m=0.0)
        thick = variant(
            insulator_conductivity_s_per_m=0.0,
            insulator_thickness_m=1e-6 + 3.9 * EPS0 * AREA_M2 / 1e-10,
        )
        assert thick.description.values.insulator_thickness_m == pytest.approx(35.531e-6, abs=1e-9)
        floating = with_effects(BY_NAME["floating_body"](body_capacitance_f=1e-10), base=plain)
        c = touches(FREQUENCIES, 75.0)
        assert_same(floating.predict(c), thick.predict(c))


class TestSkinHydration:
    @pytest.mark.parametrize(
        ("wetness", "eps", "sigma"), [(1.0, 1.5, 14.0), (-1.0, 1 / 1.5, 1 / 14), (2.0, 2.25, 196)]
    )
    def test_is_another_data_set(self, with_effects, variant, wetness, eps, sigma):
        """Leak included: it follows the skin's conductivity."""
        wet = with_effects(BY_NAME["skin_hydration"](wetness=wetness))
        c = touches(FREQUENCIES, 75.0, voltage_offset_v=20.0)
        assert_same(wet.predict(c), variant(dielectric=Skin(eps, sigma)).predict(c))


class TestSkinNonlinearity:
    @pytest.mark.parametrize("gap_m", [0.0, 6e-6])
    @pytest.mark.parametrize(
        ("frequency_hz", "voltage_v"), [(10.0, 75.0), (250.0, 30.0), (1e5, 100.0)]
    )
    def test_is_a_better_conductor(self, with_effects, variant, frequency_hz, voltage_v, gap_m):
        """V_skin is V |d2/k2|/|d1/k1 + gap + d2/k2| of the skin as it conducts then: halved until
        both agree.
        """
        skin = complex(GABRIEL_DRY.permittivity(np.array([frequency_hz]))[0])
        jw_eps0 = 2j * np.pi * frequency_hz * EPS0
        others = 1e-6 / (3.9 + 1e-13 / jw_eps0) + gap_m / (1.0 + 1e-14 / jw_eps0)

        def across_v(factor: float) -> float:
            length = 200e-6 / complex(skin.real, skin.imag * factor)
            return voltage_v * abs(length) / abs(others + length)

        scale_v = 0.5 if gap_m == 0.0 else 0.02
        low, high = 1.0, 1e9
        for _ in range(200):
            middle = (low * high) ** 0.5
            low, high = (
                (middle, high)
                if middle < 1.0 + (across_v(middle) / scale_v) ** 2
                else (low, middle)
            )
        leakless = variant(leak_scale=0.0)
        got = with_effects(
            BY_NAME["skin_nonlinearity"](voltage_scale_v=scale_v, gap_m=gap_m), base=leakless
        )
        c = touches(frequency_hz, voltage_v)
        assert_same(got.predict(c), variant(leak_scale=0.0, dielectric=Skin(1.0, low)).predict(c))
        assert low > 1.05  # the factor differs from 1

    @pytest.mark.parametrize("gap_m", [0.0, 7e-6, 1e-3])
    def test_a_leak_beside_the_gap_leaves_more_to_the_skin(self, with_effects, variant, gap_m):
        """As much as without a gap where it leaks a lot; where there is no gap, nothing leaks
        beside it.
        """
        skin_s = [
            with_effects(BY_NAME["skin_nonlinearity"](1.0, gap_m), base=variant(leak_scale=leak))
            .predict(touches(250.0, 75.0))
            .stuck_current_rms_a[0]
            for leak in (0.0, 1.0, 1e5)
        ]
        touching = with_effects(BY_NAME["skin_nonlinearity"](1.0, 0.0)).predict(
            touches(250.0, 75.0)
        )
        assert skin_s[2] == pytest.approx(touching.stuck_current_rms_a[0], rel=1e-3)
        assert skin_s[0] < skin_s[1] < skin_s[2] if gap_m else skin_s[0] == skin_s[2]


class TestConduction:
    def test_an_insulator_that_leaks(self, with_effects, variant):
        got = with_effects(BY_NAME["johnsen_rahbek"](insulator_conductivity_s_per_m=3e-9))
        expected = variant(insulator_conductivity_s_per_m=3e-9 + 1e-13)
        c = touches(FREQUENCIES, 40.0)
        assert_same(got.predict(c), expected.predict(c))

    def test_air_that_conducts(self, with_effects, variant):
        got = with_effects(BY_NAME["humid_gap_conduction"](gap_conductivity_s_per_m=2e-8))
        expected = variant(air_conductivity_s_per_m=2e-8 + 1e-14)
        c = touches(FREQUENCIES, 75.0, voltage_offset_v=30.0)
        assert_same(got.predict(c), expected.predict(c))


class TestElectrodePolarization:
    def test_admittance_by_hand(self, prepared):
        """1/(R + 1/(Q (j w)^n)), over j w eps0."""
        f = 100.0 / (2.0 * np.pi)  # w = 100/s
        for resistance, exponent, expected in (
            (1e-6, 1.0, 0.02j),  # a capacitor of 200 uF/m2; R takes 2e-8 of it
            (1e6, 1.0, 1e-6),  # a resistor: 50 ohm m2 of reactance beside it
            (1e-6, 0.5, 2e-4 * 10.0 * np.exp(0.25j * np.pi)),  # a Warburg element
            (500.0, 0.5, 1.0 / (500.0 + 500.0 * np.exp(-0.25j * np.pi))),
        ):
            effect = BY_NAME["electrode_polarization"](
                transfer_resistance_ohm_m2=resistance,
                admittance_s_sn_per_m2=2e-4,
                exponent=exponent,
            )
            bypass = prepared(touches(f, 75.0), effect).circuit.bypass_per_m[0, 0]
            assert bypass * 1j * 100.0 * EPS0 == pytest.approx(expected, rel=1e-4)

    @pytest.mark.parametrize("frequency_hz", [1.0, 250.0, 1e4])
    def test_lies_beside_the_gap(self, with_effects, gain_by_quadrature, models, frequency_hz):
        effect = BY_NAME["electrode_polarization"](
            transfer_resistance_ohm_m2=30.0, admittance_s_sn_per_m2=1e-3, exponent=0.75
        )
        force_n = with_effects(effect).predict(touches(frequency_hz, 75.0)).electrostatic_force_n[0]
        pressure_pa = (0.5 + force_n) / AREA_M2
        jw = 2j * np.pi * frequency_hz
        beside = 1.0 / (30.0 + 1.0 / (1e-3 * jw**0.75)) / (jw * EPS0)
        gain = gain_by_quadrature(
            models["reference"], frequency_hz, pressure_pa, beside_per_m=beside
        )
        expected_n = AREA_M2 * gain * 75.0**2 / 2.0
        assert force_n == pytest.approx(expected_n, rel=1e-4)  # interpolation


class TestSweatFilm:
    """k^m = (1 - phi) k_air^m + phi k_sweat^m; m may be off by the 1e-3 that keeps it from 0."""

    def gap(
        self, prepared, frequency_hz: float, share: float, arrangement: float
    ) -> tuple[complex, float]:
        effect = BY_NAME["sweat_film"](
            share=share, sweat_conductivity_s_per_m=0.1, arrangement=arrangement
        )
        circuit = prepared(touches(frequency_hz, np.sqrt(2.0)), effect).circuit
        return circuit.k_gap[0, 0], circuit.mean_square_v2[0, 0]

    @pytest.mark.parametrize("frequency_hz", [10.0, 1e3, 1e6])
    @pytest.mark.parametrize("share", [0.01, 0.4])
    def test_columns_and_films(self, prepared, frequency_hz, share):
        """In parallel with the air, which has the mean field of the gap; or in series with it: one
        displacement crosses both.
        """
        jw = 2j * np.pi * frequency_hz * EPS0
        air, sweat = 1.0 + 1e-14 / jw, 80.0 + 0.1 / jw
        series = 1.0 / ((1.0 - share) / air + share / sweat)
        for arrangement, expected, square, off in (
            (1.0, (1.0 - share) * air + share * sweat, 1.0, 1e-12),
            (-1.0, series, abs(series / air) ** 2, 1.2e-2),
        ):
            k, found = self.gap(prepared, frequency_hz, share, arrangement)
            assert abs(k - expected) <= 6e-3 * abs(expected)  # 0.01^(1/1.001) against 0.01: 5e-3
            assert found == pytest.approx(square, rel=off)

    def test_between_the_ends_the_product_of_powers(self, prepared):
        jw = 2j * np.pi * 250.0 * EPS0
        air, sweat = 1.0 + 1e-14 / jw, 80.0 + 0.1 / jw
        k, square = self.gap(prepared, 250.0, 0.05, 0.0)
        expected = air**0.95 * sweat**0.05
        assert abs(k - expected) <= 1e-2 * abs(expected)
        assert square == pytest.approx(abs(expected / air), rel=1e-2)

    def test_no_arrangement_within_its_bounds_is_singular(self, prepared):
        k, _ = self.gap(prepared, 250.0, 0.05, -1e-3)
        assert np.isfinite(k)


class TestSpeedDependentGap:
    def test_lift_by_hand(self, prepared):
        """1 - exp(-v/v0): 0 at rest, 0.632121 at v0, 0.864665 at 2 v0, 1 far above."""
        lift = BY_NAME["speed_dependent_gap"](lift_m=2e-6, speed_scale_m_s=0.05)
        speeds = np.array([0.0, 0.05, 0.1, 10.0])
        shift = prepared(touches(250.0, 75.0, speed_m_s=speeds), lift).circuit.gap_shift_m
        np.testing.assert_allclose(
            shift, 2e-6 * np.array([0.0, 0.632121, 0.864665, 1.0]), rtol=1e-6, atol=0.0
        )

    def test_more_air_everywhere_is_a_thicker_insulator(self, with_effects, variant):
        """Without leak, air in series may as well lie in the insulator: 1 um of it is 3.9 um of
        3.9.
        """
        dry = {
            "leak_scale": 0.0,
            "air_conductivity_s_per_m": 0.0,
            "insulator_conductivity_s_per_m": 0.0,
        }
        lift = with_effects(
            BY_NAME["speed_dependent_gap"](lift_m=1e-6, speed_scale_m_s=1e-5), base=variant(**dry)
        )  # at 1 m/s all of the lift
        c = touches(FREQUENCIES, 75.0, speed_m_s=1.0)
        expected = variant(**dry, insulator_thickness_m=4.9e-6).predict(c)
        assert_same(lift.predict(c), expected, without=("stuck_current_rms_a",))

    @pytest.mark.parametrize("frequency_hz", [10.0, 1e4])
    def test_a_leak_beside_the_wider_gap(
        self, with_effects, models, gain_by_quadrature, frequency_hz
    ):
        """E = V/(a (u + du) + b)."""
        lift = with_effects(BY_NAME["speed_dependent_gap"](lift_m=3e-6, speed_scale_m_s=1e-5))
        force_n = lift.predict(touches(frequency_hz, 75.0, speed_m_s=1.0)).electrostatic_force_n[0]
        gain = gain_by_quadrature(
            models["reference"], frequency_hz, (0.5 + force_n) / AREA_M2, wider_m=3e-6
        )
        expected_n = AREA_M2 * gain * 75.0**2 / 2.0
        assert force_n == pytest.approx(expected_n, rel=1e-4)  # interpolation


class TestTrappedCharge:
    def charge(self, volts: float, at_rest: float = 1.0) -> e.Effect:
        return BY_NAME["trapped_charge"](surface_voltage_v=volts, share_at_rest=at_rest)

    def test_mean_squares_by_hand(self, prepared):
        """V^2/2 + V_s^2 for a sine, V^2 + V_s^2 for a square wave, (V - V_s)^2 for direct
        current.
        """
        for waveform, expected in (
            ("sine", 450.0 + 400.0),
            ("square", 900.0 + 400.0),
            ("dc", 100.0),
        ):
            square = prepared(
                touches(250.0, 30.0, waveform=waveform), self.charge(20.0)
            ).circuit.mean_square_v2
            assert square.tolist() == [[expected]]
        for offset, bias in ((20.0, 0.0), (-20.0, 1600.0), (50.0, 900.0)):
            biased = touches(250.0, 30.0, voltage_offset_v=offset)
            square = prepared(biased, self.charge(20.0)).circuit.mean_square_v2
            assert square.sum() == pytest.approx(450.0 + bias, rel=1e-14)

    def test_direct_voltage_against_the_charge_cancels_it(self, with_effects):
        charged = with_effects(self.charge(20.0))
        found = charged.predict(touches(0.0, [19.0, 20.0, 21.0], waveform="dc"))
        assert found.electrostatic_force_n[1] == 0.0
        assert found.cof[1] == MU
        # equally far from the charge on either side, at the same light pressure
        assert found.electrostatic_force_n[0] == pytest.approx(
            found.electrostatic_force_n[2], rel=1e-6
        )
        offset = charged.predict(touches(0.0, 0.0, voltage_offset_v=[20.0, -20.0], waveform="dc"))
        assert offset.electrostatic_force_n[0] == 0.0
        assert offset.electrostatic_force_n[1] > 0.0

    def test_at_rest_a_share_is_left(self, with_effects, models):
        for share in (0.0, 0.25, 1.0):
            got = with_effects(self.charge(40.0, share)).predict(touches(250.0, 0.0))
            base = models["reference"].predict(touches(250.0, 40.0 * np.sqrt(2.0 * share)))
            assert_same(got, base, without=CURRENTS)

    def test_a_resting_charge_drives_no_current(self, with_effects):
        got = with_effects(self.charge(20.0)).predict(touches(250.0, 0.0))
        assert got.stuck_current_rms_a[0] == 0.0
        assert got.current_rms_a[0] == 0.0


class TestChargeBuildUp:
    HALF = BY_NAME["charge_build_up"](share=0.5, time_constant_s=2.0, corner_hz=10.0)

    def test_mean_squares_by_hand(self, prepared):
        """Half of it goes for good under direct voltage, 0.316060 after one time constant; at f_b
        half of that, at 100 f_b a ten-thousandth.
        """
        times = [0.0, 2.0, 1e3]
        direct = prepared(touches(0.0, 30.0, waveform="dc", time_s=times), self.HALF)
        np.testing.assert_allclose(
            direct.circuit.mean_square_v2[:, 0], [900.0, 615.546, 450.0], rtol=1e-6
        )
        sine = prepared(touches([1e-3, 10.0, 1e3], 30.0, time_s=1e3), self.HALF)
        np.testing.assert_allclose(
            sine.circuit.mean_square_v2[:, 0], [225.0, 337.5, 449.9775], rtol=1e-6
        )

    def test_a_bias_is_screened_and_the_sine_on_it_is_not(self, prepared):
        biased = touches(1e5, 30.0, voltage_offset_v=-40.0, time_s=1e3)
        square = prepared(biased, self.HALF).circuit.mean_square_v2
        np.testing.assert_allclose(square, [[450.0, 800.0]], rtol=1e-6)

    def test_it_screens_the_drive_and_not_what_is_trapped(self, prepared):
        """(0.707107 30 V - 20 V)^2."""
        charge = BY_NAME["trapped_charge"](surface_voltage_v=20.0, share_at_rest=1.0)
        direct = touches(0.0, 30.0, waveform="dc", time_s=1e3)
        square = prepared(direct, charge, self.HALF).circuit.mean_square_v2
        np.testing.assert_allclose(square, [[1.4719]], rtol=1e-4)


class TestContactAreaLaw:
    LAW = BY_NAME["contact_area_law"](exponent=0.5)

    @pytest.mark.parametrize(("load_n", "area_m2"), [(0.5, 1e-4), (2.0, 2e-4), (0.125, 5e-5)])
    def test_at_each_load_it_is_a_touch_of_that_area(self, with_effects, variant, load_n, area_m2):
        """Pressure, attraction and every current, with what lies in series with the whole touch."""
        series = BY_NAME["series_resistance"](resistance_ohm=2e4)
        got = with_effects(series, self.LAW).predict(touches(FREQUENCIES, 75.0, load_n))
        fixed = with_effects(series, base=variant(contact_area_m2=area_m2))
        assert_same(got, fixed.predict(touches(FREQUENCIES, 75.0, load_n)))


class TestAirBreakdown:
    def test_a_limit_that_no_gap_reaches_changes_nothing(self, with_effects, models):
        """75 V over the stack alone, z = 0.45 um, is 1.7e8 V/m."""
        c = touches([250.0, 1e4], 75.0)
        capped = with_effects(BY_NAME["air_breakdown"](breakdown_field_v_per_m=1e9))
        assert_same(capped.predict(c), models["reference"].predict(c), 1e-12)

    @pytest.mark.parametrize("waveform", ["square", "dc"])
    def test_of_a_square_wave_the_field_itself_is_capped(self, with_effects, models, waveform):
        """All gaps at the cap: p = eps0 E_bd^2/2 over all of them."""
        capped = with_effects(BY_NAME["air_breakdown"](breakdown_field_v_per_m=1e4))
        c = touches(1e4, 1e3, waveform=waveform)
        leakless = replace(
            capped.description,
            parameters={
                **capped.description.parameters,
                "leak_scale": replace(capped.description.parameters["leak_scale"], value=0.0),
            },
        )
        model = TouchModel(leakless)
        model.__dict__["table"] = models["reference"].table
        force_n = model.predict(c).electrostatic_force_n[0]
        assert force_n == pytest.approx(AREA_M2 * EPS0 / 2.0 * 1e8, rel=1e-2)


class TestCapillaryAdhesion:
    def test_presses_as_load_does(self, with_effects, models):
        wet = with_effects(BY_NAME["capillary_adhesion"](pressure_pa=2e3))
        got = wet.predict(touches(FREQUENCIES, 75.0, 0.5))
        base = models["reference"].predict(touches(FREQUENCIES, 75.0, 0.7))
        assert_same(got, base, without=("cof", "within_theory"))
        np.testing.assert_allclose(
            got.cof, MU * (1.0 + (got.electrostatic_force_n + 0.2) / 0.5), rtol=1e-12
        )


class TestElectrowetting:
    EFFECT = BY_NAME["electrowetting"](
        coefficient_pa_per_v2=0.5, saturation_v=80.0, cutoff_hz=200.0
    )

    def test_pressure_by_hand(self, prepared):
        """c V^2/(1 + (V/V_sat)^2)/(1 + (f/f_c)^2): 1600 Pa at V_sat, half at f_c, a tenth at 3 f_c;
        3200 Pa at last.
        """
        c = touches([1e-3, 200.0, 600.0, 1e-3, 1e-3], [80.0, 80.0, 80.0, 0.0, 1e5])
        added = prepared(c, self.EFFECT).circuit.added_pa
        np.testing.assert_allclose(added, [1600.0, 800.0, 160.0, 0.0, 3200.0], rtol=1e-6)
        np.testing.assert_allclose(
            prepared(touches(1e-3, 40.0), self.EFFECT).circuit.added_pa, 640.0, rtol=1e-6
        )

    def test_presses_and_rubs_as_load_does(self, with_effects, models):
        f = np.array([10.0, 200.0, 1e4])
        extra_n = 0.16 / (1.0 + (f / 200.0) ** 2)
        got = with_effects(self.EFFECT).predict(touches(f, 80.0))
        base = models["reference"].predict(touches(f, 80.0, 0.5 + extra_n))
        assert_same(got, base, without=("cof", "within_theory"))
        np.testing.assert_allclose(
            got.cof, MU * (1.0 + (got.electrostatic_force_n + extra_n) / 0.5), rtol=1e-12
        )

    def test_an_offset_alone_is_direct_current(self, with_effects):
        wet = with_effects(self.EFFECT)
        offset = wet.predict(touches(250.0, 0.0, voltage_offset_v=60.0))
        direct = wet.predict(touches(250.0, 60.0, waveform="dc"))
        assert_same(
            offset, direct, without=("electrode_current_a", "electrode_voltage_v")
        )  # of a sine of 0 V


class TestFriction:
    @pytest.mark.parametrize("exponent", [0.5, 2.0 / 3.0, 1.3])
    def test_load_dependent_under_attraction(self, with_effects, models, exponent):
        loads = np.array([0.1, 0.5, 2.0])
        got = with_effects(BY_NAME["load_dependent_friction"](exponent=exponent)).predict(
            touches(250.0, 75.0, loads)
        )
        base = models["reference"].predict(touches(250.0, 75.0, loads))
        assert_same(got, base, 1e-12, without=("cof",))
        tangential_n = MU * 0.5 * ((loads + got.electrostatic_force_n) / 0.5) ** exponent
        np.testing.assert_allclose(got.cof, tangential_n / loads, rtol=1e-12)

    def test_velocity_dependent_by_hand(self, with_effects, models):
        """(v/20 mm/s)^s."""
        speeds = np.array([5e-3, 0.02, 0.08])
        got = with_effects(BY_NAME["velocity_dependent_friction"](exponent=0.5))
        np.testing.assert_allclose(
            got.predict(touches(250.0, 0.0, speed_m_s=speeds)).cof,
            MU * np.array([0.5, 1.0, 2.0]),
            rtol=1e-12,
        )
        base = models["reference"].predict(touches(250.0, 75.0, speed_m_s=speeds))
        loaded = got.predict(touches(250.0, 75.0, speed_m_s=speeds))
        np.testing.assert_allclose(loaded.cof, base.cof * np.array([0.5, 1.0, 2.0]), rtol=1e-12)
        assert_same(loaded, base, 1e-12, without=("cof",))

    def test_contact_ageing_by_hand(self, with_effects, models):
        """mu_inf - (mu_inf - mu_0) exp(-t/T): from 0.7 of mu_inf, 0.889636 of it after T."""
        ageing = with_effects(BY_NAME["contact_ageing"](share=0.3, time_constant_s=60.0))
        times = np.array([-5.0, 0.0, 60.0, 120.0, 1e6])
        share = np.array([0.7, 0.7, 1.0 - 0.3 * 0.36787944117, 1.0 - 0.3 * 0.13533528324, 1.0])
        np.testing.assert_allclose(
            ageing.predict(touches(250.0, 0.0, time_s=times)).cof, MU * share, rtol=1e-10
        )  # ten digits
        base = models["reference"].predict(touches(250.0, 75.0, time_s=times))
        loaded = ageing.predict(touches(250.0, 75.0, time_s=times))
        np.testing.assert_allclose(loaded.cof, base.cof * share, rtol=1e-10)
        rising = with_effects(BY_NAME["contact_ageing"](share=-0.5, time_constant_s=10.0))
        assert rising.predict(touches(250.0, 0.0, time_s=0.0)).cof[0] == pytest.approx(
            1.5 * MU, rel=1e-12
        )


class TestViscoelasticSkin:
    @pytest.mark.parametrize("name", ["reference", "table1"])
    def test_is_a_stiffer_contact(self, with_effects, models, variant, name):
        """Twice Y* at four times 20 mm/s with n = 1/2; leak included, which falls as 1/Y*."""
        stiff = with_effects(BY_NAME["viscoelastic_skin"](exponent=0.5), base=models[name])
        twice = variant(name, skin_modulus_pa=20e6, screen_modulus_pa=140e9)
        v = twice.description.values
        assert v.effective_modulus_pa == pytest.approx(2.0 * 13.330851e6, rel=1e-7)
        got = stiff.predict(touches(FREQUENCIES, 75.0, speed_m_s=0.08))
        assert_same(got, twice.predict(touches(FREQUENCIES, 75.0)))
        without = stiff.predict(touches(250.0, 0.0, speed_m_s=0.08))
        assert without.cof[0] == MU  # the signature: friction without voltage unchanged


@pytest.mark.parametrize("name", ["velocity_dependent_friction", "viscoelastic_skin"])
def test_at_the_papers_speed_the_base_model_comes_back(with_effects, models, median, name):
    """20 mm/s, given or not; the effect itself is strong."""
    moved = with_effects(median(BY_NAME[name], 2.0))
    for columns in ({}, {"speed_m_s": 0.02}):
        c = touches(FREQUENCIES, 75.0, voltage_offset_v=20.0, **columns)
        assert_same(moved.predict(c), models["reference"].predict(c), 1e-12)
    fast = touches(FREQUENCIES, 75.0, speed_m_s=0.2)
    assert (
        np.abs(moved.predict(fast).cof / models["reference"].predict(fast).cof - 1.0).max() > 1e-3
    )


def test_skin_and_film_reach_the_current_of_a_stuck_finger(with_effects, variant):
    """Worst case, whatever lies in the gap: the layers alone."""
    wet = variant(dielectric=GABRIEL_WET)
    c = touches(FREQUENCIES, 75.0)
    for effect in (
        BY_NAME["humid_gap_conduction"](gap_conductivity_s_per_m=1e-7),
        BY_NAME["electrode_polarization"](
            transfer_resistance_ohm_m2=1.0, admittance_s_sn_per_m2=1.0, exponent=0.8
        ),
        BY_NAME["capillary_adhesion"](pressure_pa=1e3),
        BY_NAME["sweat_film"](share=0.1, sweat_conductivity_s_per_m=1.0, arrangement=1.0),
    ):
        got = with_effects(effect, base=wet).predict(c)
        np.testing.assert_allclose(
            got.stuck_current_rms_a, wet.predict(c).stuck_current_rms_a, rtol=1e-12
        )
