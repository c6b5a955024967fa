"""The estimate of the finger's gains: when it learns, that it stays within bounds, that it never
asks for too much.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.errors import BadInputError
from haptic_driver.render import feedback
from haptic_driver.render.controller import INITIAL, Controller, ControllerSettings, ControllerState
from haptic_driver.render.feedback import FeedbackSettings, Gains, elsewhere, in_force
from haptic_driver.signals import NO_COMMAND, DriveCommand, FingerState, TargetFriction
from model.conditions import Conditions

LAW = FeedbackSettings(latency_s=0.02)
HELD = DriveCommand(250.0, 80.0, output_on=True)
FORCE_N = 0.5


@pytest.fixture(scope="module")
def controller(surface, limits):
    return Controller(ControllerSettings(surface, limits, feedback=LAW))


@pytest.fixture(scope="module")
def typical_n(touch):
    """Lateral force of the surface's own finger under the held command, by the model."""
    answer = touch.predict(Conditions(*(np.array([x]) for x in (250.0, 80.0, FORCE_N))))
    return float(answer.cof[0]) * FORCE_N


def finger(k, lateral_n, speed_m_s=0.05, normal_n=FORCE_N, in_contact=True):
    return FingerState(1.0 + 1e-3 * k, 0.0, 0.0, speed_m_s, 0.0, normal_n, in_contact, lateral_n)


def run(controller, ticks, state=INITIAL, start=0, command=HELD):
    """Ticks of (lateral force, changes) under a command that is held whatever the controller
    says.
    """
    for k, (lateral_n, changed) in enumerate(ticks, start=start):
        state, _ = controller.step(
            state, TargetFriction(0.7, True), finger(k, lateral_n, **changed), command
        )
    return state


def noisy(rng, mean_n, count, **changed):
    return [(mean_n + float(n), changed) for n in rng.normal(0.0, 0.003, count)]


@pytest.fixture(scope="module")
def taught(controller, typical_n):
    """A finger of gain 1.3, known after half a second."""
    rng = np.random.default_rng(3)
    return run(controller, noisy(rng, 1.3 * typical_n, 500))


def test_a_steady_finger_is_known(taught):
    known = taught.estimate
    assert known.gain == pytest.approx(1.3, rel=0.01)  # 3 mN of noise, averaged over 100 readings
    assert known.learning
    assert not known.at_limit
    assert known.gains.off_variance < FeedbackSettings(0.0).deviation ** 2


def test_drift_shows_in_the_rate(controller, taught, typical_n, rng):
    drifting = [
        (typical_n * (1.3 + 0.2e-3 * k) + float(rng.normal(0.0, 1e-3)), {}) for k in range(1500)
    ]
    known = run(controller, drifting, taught, start=500).estimate
    assert known.gain_rate_per_s == pytest.approx(0.2, rel=0.15)
    assert known.gain == pytest.approx(1.6 - 0.2 * LAW.time_constant_s, rel=0.01)


FROZEN = {
    "rests": {"speed_m_s": 0.001},
    "force unknown": {"lateral": math.nan},
    "force infinite": {"lateral": math.inf},
    "sensor stands still": {"lateral": 0.1},
}


@pytest.mark.parametrize("why", FROZEN)
def test_nothing_is_learnt_while_it(controller, taught, typical_n, rng, why):
    changed = dict(FROZEN[why])
    stuck = changed.pop("lateral", None)
    after = run(
        controller, [(0.1, changed)], taught, start=500
    )  # at most one reading that may count
    ticks = [(stuck, changed)] * 300 if stuck is not None else noisy(rng, 0.1, 300, **changed)
    later = run(controller, ticks, after, start=501).estimate
    assert later.gains[:2] == after.estimate.gains[:2]
    assert not later.learning


def test_a_stroke_must_be_on_its_way_before_it_teaches(controller, taught, rng):
    rested = run(controller, noisy(rng, 0.1, 50, speed_m_s=0.0), taught, start=500)
    first = run(controller, noisy(rng, 0.1, 5), rested, start=550).estimate  # 0.25 mm at 50 mm/s
    assert first.gain == taught.estimate.gain
    then = run(controller, noisy(rng, 0.1, 20), rested, start=550).estimate
    assert then.gain < taught.estimate.gain


def test_a_ramp_of_the_output_teaches_nothing(controller, taught):
    """At the rate of a touch-down, 10 V per tick; it is felt 20 ms later, give or take 10 ms."""
    state = run(
        controller,
        [(0.4, {})] * 2,
        taught,
        start=500,
        command=DriveCommand(250.0, 20.0, output_on=True),
    )
    for k in range(502, 545):
        ramp = DriveCommand(250.0, min(20.0 + 10.0 * (k - 502), 140.0), output_on=True)
        state, _ = controller.step(
            state, TargetFriction(0.7, True), finger(k, 0.1 + 1e-6 * k), ramp
        )
        if 524 <= k <= 532:
            assert not state.estimate.learning


def test_a_change_of_the_carrier_teaches_nothing(controller, taught):
    state, other = taught, DriveCommand(300.0, 80.0, output_on=True)
    for k in range(500, 560):
        state, _ = controller.step(
            state, TargetFriction(0.7, True), finger(k, 0.1 + 1e-6 * k), other
        )
        if k <= 528:  # the change is felt within 20 ms, give or take 10 ms
            assert not state.estimate.learning
    assert state.estimate.learning


def test_what_is_known_of_the_rise_is_forgotten_with_the_carrier(controller, taught):
    known = taught.estimate._replace(gains=taught.estimate.gains._replace(rise=0.5))
    near, far = (elsewhere(LAW, known, 200.0, hz).gains for hz in (202.0, 10e3))
    assert near.rise == pytest.approx(0.5, abs=0.01)
    assert far.rise == pytest.approx(known.gains.off, rel=0.02)
    assert far.rise_variance == pytest.approx(LAW.deviation**2, rel=0.1)
    assert (
        (near.off, near.off_variance)
        == (far.off, far.off_variance)
        == (known.gains.off, known.gains.off_variance)
    )
    there = taught._replace(estimate=known, frequency_hz=10e3)
    moved = run(controller, [(0.3, {"speed_m_s": 0.0})], there, start=500)
    assert moved.frequency_hz < 1e3  # where authority is
    assert moved.estimate.gains.rise == pytest.approx(known.gains.off, rel=0.05)


def test_off_the_screen_what_was_known_fades(controller, taught):
    lifted = [(math.nan, {"in_contact": False, "normal_n": 0.0})] * 1
    state = run(controller, lifted, taught, start=500)
    later = run(controller, lifted, state, start=500 + round(1e3 * LAW.memory_s)).estimate
    kept = (taught.estimate.gains.off - 1.0) * math.exp(-(LAW.memory_s + 1e-3) / LAW.memory_s)
    assert later.gains.off - 1.0 == pytest.approx(kept, rel=1e-6)


def test_one_wild_reading_moves_little(controller, taught):
    state = run(controller, [(50.0, {})], taught, start=500).estimate
    assert abs(state.gain - taught.estimate.gain) < 0.05


@given(
    forces=st.lists(
        st.one_of(st.floats(-50.0, 50.0), st.just(math.nan), st.just(math.inf)),
        min_size=1,
        max_size=60,
    ),
    times=st.lists(st.one_of(st.floats(-0.01, 0.1), st.just(math.nan)), min_size=60, max_size=60),
    speed=st.floats(0.0, 1.0),
    load=st.floats(0.1, 2.0),
    target=st.floats(0.1, 3.0),
)
def test_whatever_is_felt_gains_stay_bounded_and_points_safe(
    surface, refusal, limits, forces, times, speed, load, target
):
    controller = Controller(ControllerSettings(surface, limits, feedback=LAW))
    state, time_s, applied = INITIAL, 1.0, DriveCommand(250.0, 0.0, output_on=False)
    for lateral_n, elapsed_s in zip(forces, times, strict=False):
        time_s += elapsed_s if math.isfinite(elapsed_s) else 0.0
        here = FingerState(time_s, 0.0, 0.0, speed, 0.0, load, True, lateral_n)
        state, point = controller.step(state, TargetFriction(target, True), here, applied)
        assert refusal(limits, point) is None
        applied = DriveCommand(point.frequency_hz, point.voltage_v, point.voltage_v > 0.0)
        known = state.estimate
        assert all(LAW.lowest_gain <= g <= LAW.highest_gain for g in (*known.gains[:2], known.gain))
        _, _, p, q, r = known.gains
        prior = LAW.deviation**2
        assert -1e-12 <= p <= prior + 1e-12
        assert -1e-12 <= r <= prior + 1e-12
        assert p * r - q * q >= -1e-9  # a covariance, to rounding


def test_an_unknown_finger_is_approached_from_below(controller, limits, surface):
    """With a reading but nothing learnt; and one of which most is known is met in a texture's
    valleys as well.
    """
    plain = Controller(ControllerSettings(surface, limits))
    _, bold = plain.step(INITIAL, TargetFriction(0.8, True), finger(0, 0.2), NO_COMMAND)
    state = run(controller, [(0.2, {"speed_m_s": 0.0})])
    _, careful = controller.step(
        state, TargetFriction(0.8, True), finger(1, 0.2001, speed_m_s=0.0), HELD
    )
    assert 0.0 < careful.voltage_v < bold.voltage_v
    lifted = 0.4  # s
    faded = (1.0 - math.exp(-lifted / LAW.memory_s)) * LAW.deviation**2
    gains = Gains(1.0, 1.0, faded, LAW.correlation * faded, faded)
    back = ControllerState(estimate=state.estimate._replace(gains=gains))
    _, valley = controller.step(
        back, TargetFriction(0.55, True), finger(1, 0.2001, speed_m_s=0.0), HELD
    )
    assert valley.cof == pytest.approx(0.55, rel=0.05)
    assert valley.voltage_v > 0.0


def test_without_a_force_sensor_there_is_no_caution(controller, limits, surface):
    plain = Controller(ControllerSettings(surface, limits))
    _, bold = plain.step(INITIAL, TargetFriction(0.8, True), finger(0, math.nan), NO_COMMAND)
    _, same = controller.step(INITIAL, TargetFriction(0.8, True), finger(0, math.nan), HELD)
    assert same == bold


def test_a_step_changes_nothing_it_was_given(controller, taught):
    commands = taught.commands.copy()
    run(controller, [(0.3, {})] * 5, taught, start=500)
    np.testing.assert_array_equal(taught.commands, commands)
    assert np.isnan(INITIAL.commands).all()


def test_the_command_in_force_then():
    commands = np.full((8, 3), np.nan)
    commands[:4] = [[4.0, 300.0, 50.0], [3.0, 250.0, 40.0], [2.0, 250.0, 30.0], [1.0, 250.0, 20.0]]
    assert in_force(commands[1:], 2.5, 0.1) == (250.0, 30.0, 30.0, 30.0, True)
    assert in_force(commands[1:], 2.5, 0.6) == (250.0, 30.0, 20.0, 40.0, True)
    assert not in_force(commands, 3.5, 0.6).steady  # two carriers
    assert in_force(commands, 2.5, 0.1) == (250.0, 30.0, 30.0, 30.0, False)  # another is on its way
    assert in_force(commands, 0.5, 0.1)[1:4] == (0.0, 0.0, 0.0)  # before all commands


@pytest.mark.parametrize(
    "wrong", [{"latency_s": 0.2}, {"lowest_gain": 1.5}, {"correlation": 1.0}, {"deviation": 0.0}]
)
def test_settings_without_meaning_are_refused(wrong):
    with pytest.raises(BadInputError):
        feedback.checked(LAW._replace(**wrong))
