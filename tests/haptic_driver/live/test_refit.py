"""A model mended by rows: of the blind generator's finger, which shares no code with the model."""

import numpy as np
import pytest

from haptic_driver.live.proof import attempt
from haptic_driver.live.window import Window
from model.conditions import Conditions
from model.touch_model import TouchModel
from tests.blind.generator import touch as outside
from tests.blind.generator.effects_electric import skin_hydration
from tests.blind.generator.nuisance import ROUGHNESS

ERROR = 0.01  # of friction, of a row


def felt(frequency_hz, voltage_v, load_n, wetness=0.0, **finger):
    """Friction [n] of a finger from outside."""
    columns = np.broadcast_arrays(frequency_hz, voltage_v, load_n, 0.02, 0.0)
    state = outside.prepare(
        outside.Rows(*(np.array(c, float) for c in columns)), outside.Finger(**finger), ROUGHNESS
    )
    skin_hydration(state, wetness, {"fall": 1.0}, True)
    return outside.friction(state)


def rows(rng, count, start_s, drift=0.0, **finger):
    """As a texture gives them on one carrier: every voltage, under loads that change, ten in a
    second.
    """
    voltage_v = np.sqrt(rng.uniform(0.0, 110.0**2, count)) * (np.arange(count) % 6 > 0)
    load_n, time_s = (
        np.exp(rng.uniform(np.log(0.3), np.log(0.9), count)),
        start_s + 0.1 * np.arange(count),
    )
    cof = felt(200.0, voltage_v, load_n, **finger) * np.exp(
        ERROR * rng.standard_normal(count) + drift * (time_s - start_s)
    )
    return [
        Window(200.0 * (v > 0.0), v, n, 0.02, c, ERROR * c, t, 0.1, 1, 1)
        for v, n, c, t in zip(
            voltage_v.tolist(), load_n.tolist(), cof.tolist(), time_s.tolist(), strict=True
        )
    ]


def rise(model, frequency_hz, voltage_v, load_n):
    n = np.array([load_n, load_n])
    low, high = (
        TouchModel(model)
        .predict(Conditions(np.full(2, frequency_hz), np.array([0.0, voltage_v]), n))
        .cof
    )
    return high / low - 1.0


@pytest.fixture(scope="module")
def description(touch):
    return touch.description


MOIST = {"wetness": 1.2, "mu_off": 0.6}


@pytest.fixture(scope="module")
def moist(description):
    rng = np.random.default_rng(4)
    known, unseen = rows(rng, 300, 0.0, **MOIST), rows(rng, 30, 30.0, **MOIST)
    return attempt(known, unseen, description, description)


def test_a_moist_finger_is_followed_to_a_carrier_that_was_not_used(moist, description):
    """Moisture lowers the rise at 200 Hz, and raises it at 10 kHz."""
    assert moist.model is not None, moist.said
    for frequency_hz, load_n in ((200.0, 0.5), (10e3, 0.5), (10e3, 0.8)):
        off, on = felt(frequency_hz, np.array([0.0, 100.0]), load_n, **MOIST)
        truth = on / off - 1.0
        before, after = (
            abs(rise(m, frequency_hz, 100.0, load_n) / truth - 1.0)
            for m in (description, moist.model)
        )
        assert after < 0.5 * before
    assert moist.model.effect_parameters["skin_hydration"]["wetness"].value > 0.5
    assert moist.model.parameters["cof_off"].value == pytest.approx(MOIST["mu_off"], rel=0.01)


def test_a_finger_that_the_model_describes_is_left_alone(rng, description):
    found = attempt(rows(rng, 200, 0.0), rows(rng, 30, 20.0), description, description)
    assert found.model is None
    assert "not better" in found.said


def test_a_model_mended_before_is_the_one_to_beat(rng, moist, description):
    known, unseen = rows(rng, 200, 0.0, **MOIST), rows(rng, 30, 20.0, **MOIST)
    assert attempt(known, unseen, description, moist.model).model is None


def test_what_was_felt_minutes_ago_hardly_counts(rng, description):
    old, new = rows(rng, 100, -400.0), rows(rng, 200, 0.0, **MOIST)
    found = attempt([*old, *new], rows(rng, 30, 20.0, **MOIST), description, description)
    assert found.model is not None, found.said
    truth = np.divide(*felt(200.0, np.array([100.0, 0.0]), 0.5, **MOIST)) - 1.0
    assert rise(found.model, 200.0, 100.0, 0.5) == pytest.approx(truth, rel=0.05)


def test_friction_that_drifts_as_a_whole_is_taken_as_that(rng, description):
    """5 % in 25 s: the newest level, and nothing of it in the rise."""
    unseen = rows(rng, 30, 25.0, mu_off=0.512 * 1.05)
    found = attempt(rows(rng, 250, 0.0, 0.002), unseen, description, description)
    assert found.model is not None, found.said
    assert found.model.parameters["cof_off"].value == pytest.approx(0.512 * 1.04, rel=0.012)
    assert rise(found.model, 200.0, 100.0, 0.5) == pytest.approx(
        rise(description, 200.0, 100.0, 0.5), rel=0.05
    )


def test_too_little_is_said_to_be_too_little(rng, description):
    known = rows(rng, 60, 0.0, **MOIST)
    resting = [row for row in known if row.voltage_v == 0.0]
    for few in (known[:5], resting):
        assert "too few to calibrate" in attempt(few, known, description, description).said


def test_a_finger_far_from_any_is_no_finger(rng, description):
    """An amplifier that puts out three times as much, say."""
    spoilt = [row._replace(voltage_v=row.voltage_v / 3.0) for row in rows(rng, 230, 0.0)]
    found = attempt(spoilt[:200], spoilt[200:], description, description)
    assert found.model is None
    assert "far from any finger's" in found.said
