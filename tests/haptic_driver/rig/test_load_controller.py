"""What the load controller decides, look by look."""

from __future__ import annotations

from dataclasses import replace

import pytest

from haptic_driver.rig.load_controller import (
    NOTHING,
    Act,
    Felt,
    LoadSettings,
    LoadState,
    Phase,
    Seen,
    step,
)

SETTINGS = LoadSettings(0.5)
TOUCH = Felt(0.010, 0.05)
HOLDING = LoadState(Phase.HOLD, start_m=0.009, touch=TOUCH, risen=Felt(0.011, 0.45), moved_s=0.9)
QUIET = Seen(1.0, 0.5, 0.0, False, 0.011, False)


def test_it_approaches_by_short_slow_moves_until_the_finger_is_felt():
    seen = Seen(1.0, 0.0, 0.0, False, 0.009, False)
    state, order = step(SETTINGS, LoadState(), seen)
    assert (order.act, order.speed_m_s) == (Act.MOVE, 1e-3)
    assert order.depth_m == pytest.approx(0.009 + 0.15e-3)
    assert state.phase is Phase.APPROACH
    state, _ = step(SETTINGS, state, seen._replace(load_n=0.049))
    assert state.phase is Phase.APPROACH
    state, order = step(SETTINGS, state, seen._replace(load_n=0.05, depth_m=0.0095))
    assert (state.phase, state.touch) == (Phase.HOLD, Felt(0.0095, 0.05))
    assert order.depth_m > 0.0095


def test_a_stage_that_only_says_that_it_moves_is_let_go():
    seen, order = QUIET._replace(load_n=0.3), NOTHING
    state, order = step(SETTINGS, HOLDING, seen)
    assert order.act is Act.MOVE
    for time_s in (1.1, 1.2, 1.3, 1.4, 1.45):
        state, order = step(SETTINGS, state, seen._replace(time_s=time_s, moving=True))
        assert (state.phase, order) == (Phase.HOLD, NOTHING)
    state, order = step(SETTINGS, state, seen._replace(time_s=1.51, moving=True))
    assert (state.phase, order.act) == (Phase.ENDED, Act.RETRACT)


def test_a_late_machine_is_no_stalled_stage_but_looks_that_follow_tell():
    """A load was let go 0.02 mm from its target, since nobody had looked for half a second."""
    state, order = step(SETTINGS, HOLDING, QUIET._replace(load_n=0.3))
    assert order.act is Act.MOVE
    times_s = [1.9 + 0.09 * k for k in range(6)]
    phases = []
    for time_s in times_s:
        seen = QUIET._replace(load_n=0.3, time_s=time_s, moving=True)
        state, order = step(SETTINGS, state, seen)
        phases.append(state.phase)
    assert phases == [*[Phase.HOLD] * 5, Phase.ENDED]


def test_a_moving_bit_that_stays_set_at_the_target_is_let_go():
    """A load of 0.12 N of 0.5 was said to be held."""
    state = replace(HOLDING, sent_m=0.011)
    for time_s in (1.0, 1.1, 1.2, 1.3, 1.4, 1.49, 1.51):
        seen = QUIET._replace(load_n=0.12, time_s=time_s, moving=True)
        state, order = step(SETTINGS, state, seen)
    assert (state.phase, order.act) == (Phase.ENDED, Act.RETRACT)
    assert "says that it moves" in state.reason


def test_a_move_is_the_gains_share_of_what_hertz_says_is_missing():
    """A sphere on a plane: load k d^1.5, whose slope at 0.5 N is 700 N/m."""
    settings = replace(SETTINGS, drift_per_s=1e-9)
    k = (700.0 / 1.5) ** 1.5 / 0.5**0.5  # slope 1.5 k^(2/3) F^(1/3)
    missing_m = (0.5 / k) ** (2 / 3) - (0.4 / k) ** (2 / 3)
    _, order = step(settings, HOLDING, QUIET._replace(load_n=0.4))
    assert order.depth_m - 0.011 == pytest.approx(0.45 * missing_m, rel=1e-5)


@pytest.mark.parametrize("stiffer", [0.1, 0.4, 1.0, 2.0, 10.0])
def test_the_way_that_a_rising_load_takes_tells_how_stiff_a_finger_is(stiffer):
    """A sphere on a plane whose slope at 0.5 N is 700 N/m times `stiffer`: 1.5 F / slope deep. A
    fifth more is taken, as other fingers stiffen more; beyond three times either way nothing is
    believed.
    """

    def depth_m(load_n: float) -> float:
        return 1.5 * 0.5 / (stiffer * 700.0) * (load_n / 0.5) ** (2 / 3)

    settings = replace(SETTINGS, depth_m=50e-3, softest_n_per_m=70.0)
    taken = min(max(1.2 * stiffer, 1 / 3), 3.0)
    state = replace(HOLDING, start_m=None, touch=Felt(depth_m(0.05), 0.05), risen=None)
    for load_n in (0.2, 0.49, 0.1):
        deep = depth_m(load_n)
        state, order = step(settings, state, QUIET._replace(load_n=load_n, depth_m=deep))
        known = deep - depth_m(0.05) >= 0.15e-3 or state.risen is not None
        assert state.stiffer == pytest.approx(taken if known else 1.0)
        assert order.depth_m - deep <= SETTINGS.step_m / min(taken, 1.0) * (1.0 + 1e-9)
    assert state.risen is not None or depth_m(0.49) - depth_m(0.05) < 0.15e-3


def test_a_load_that_does_not_rise_tells_nothing_of_the_finger():
    state = replace(HOLDING, touch=Felt(0.0108, 0.06), risen=None)
    after, _ = step(SETTINGS, state, QUIET._replace(load_n=0.05))
    assert (after.phase, after.stiffer, after.risen) == (Phase.HOLD, 1.0, None)


def test_what_a_bound_takes_away_is_not_added_up():
    state = replace(HOLDING, start_m=None, touch=Felt(0.0113, 0.0), risen=None)
    for i in range(100):
        depth_m = 0.011 + (i % 2) * 2e-6  # it moves, or the loop ends
        seen = QUIET._replace(time_s=1.0 + i, load_n=0.0, depth_m=depth_m)
        state, order = step(SETTINGS, state, seen)
        assert order.depth_m == pytest.approx(depth_m + SETTINGS.step_m)
        assert order.speed_m_s == SETTINGS.rate_m_s
    assert state.drift_m_s == 0.0


def test_it_never_goes_deeper_than_its_bound_and_lets_go_there():
    deep = replace(HOLDING, risen=Felt(0.0125, 0.45))
    near = QUIET._replace(load_n=0.4, depth_m=0.010 + SETTINGS.depth_m - 1e-5)
    _, order = step(SETTINGS, deep, near)
    assert order.depth_m == 0.010 + SETTINGS.depth_m
    state, order = step(SETTINGS, deep, near._replace(depth_m=order.depth_m))
    assert (state.phase, order.act) == (Phase.ENDED, Act.RETRACT)
    assert "3.0 mm" in state.reason


def test_it_looks_for_a_finger_no_deeper_than_the_last_touch_needed():
    """By what tissue and plate may drift between two touches, and never beyond the reach."""
    for last_m, way_m in ((0.010, 0.0018), (0.050, 0.003)):
        begun = LoadState(start_m=0.009, last_m=last_m)
        near = QUIET._replace(load_n=0.0, depth_m=0.009 + way_m - 1e-5)
        state, order = step(SETTINGS, begun, near)
        assert order.depth_m == pytest.approx(0.009 + way_m)
        state, order = step(SETTINGS, begun, near._replace(depth_m=order.depth_m))
        assert (order.act, state.reason[:19]) == (Act.RETRACT, "no finger is felt w")


@pytest.mark.parametrize("load_n", [0.05, 0.3])
def test_a_load_where_the_finger_is_free_is_not_pressed_on(load_n):
    state, order = step(SETTINGS, LoadState(), QUIET._replace(load_n=load_n))
    assert (state.phase, order.act) == (Phase.ENDED, Act.RETRACT)
    assert "where the finger is free" in state.reason


def test_a_reading_from_before_the_stage_stood_clear_tells_nothing():
    """On a busy machine the load before the stage lifted was "felt where the finger is free"."""
    clear = LoadState(clear_s=0.95)
    old = QUIET._replace(load_n=0.45, load_age_s=0.1)
    waiting, order = step(SETTINGS, clear, old)
    assert (waiting.phase, order.act) == (Phase.APPROACH, Act.NOTHING)
    fresh = old._replace(time_s=1.01, load_age_s=0.0)
    assert step(SETTINGS, waiting, fresh)[1].act is Act.RETRACT
    assert step(SETTINGS, waiting, fresh._replace(load_n=0.0))[1].act is Act.MOVE
    silent = old._replace(time_s=1.5, load_age_s=0.6)
    assert step(SETTINGS, waiting, silent)[1].act is Act.RETRACT


def test_a_load_that_stays_where_the_finger_was_free_ends_it():
    """The zero rises, so the stage lifts, and what it reads does not fall."""
    seen = QUIET._replace(depth_m=0.009 - 1e-5)
    state, order = step(SETTINGS, HOLDING, seen)
    assert (state.phase, order.act) == (Phase.ENDED, Act.RETRACT)
    assert "where the finger was free" in state.reason


def depth_m(load_n: float, stiffer: float = 1.0) -> float:
    """Of a sphere on a plane, 700 N/m at 0.5 N: 1.5 F / slope."""
    return 1.5 * 0.5 / (700.0 * stiffer) * (load_n / 0.5) ** (2 / 3)


def ahead_m(touch_n: float, limit_n: float) -> float:
    """So far ahead a finger three times as stiff bears the limit, and a tenth of it is shown."""
    pressed_m = depth_m(limit_n, 3.0) - depth_m(10.0 * touch_n, 3.0)
    return pressed_m - (depth_m(0.1 * limit_n) - depth_m(touch_n))


@pytest.mark.parametrize(("limit_n", "least_m"), [(3.0, 0.0), (4.0, 0.0), (1.0, 0.15e-3)])
def test_how_far_the_stage_goes_unanswered_follows_from_the_limit(limit_n, least_m):
    settings = replace(SETTINGS, load_limit_n=limit_n)
    assert settings.unanswered_m == pytest.approx(max(ahead_m(0.05, limit_n), least_m))


def test_the_stage_is_never_far_ahead_of_the_softest_finger():
    rising = replace(HOLDING, risen=None)
    needed_m = depth_m(0.2) - depth_m(0.05)
    seen = QUIET._replace(load_n=0.2, depth_m=0.010 + needed_m + 0.25e-3)
    state, order = step(SETTINGS, rising, seen)
    assert order.depth_m == pytest.approx(0.010 + needed_m + ahead_m(0.05, 3.0))
    at_bound = seen._replace(depth_m=order.depth_m, time_s=1.1)
    state, order = step(SETTINGS, state, at_bound)
    assert (state.phase, order) == (Phase.HOLD, NOTHING)
    state, order = step(SETTINGS, state, at_bound._replace(time_s=1.15, load_age_s=0.06))
    assert (state.phase, order) == (Phase.HOLD, NOTHING)  # read before the stage rested
    answered, order = step(SETTINGS, state, at_bound._replace(time_s=1.2, load_n=0.21))
    assert (answered.phase, order.act) == (Phase.HOLD, Act.MOVE)
    state, order = step(SETTINGS, state, at_bound._replace(time_s=1.2))
    assert (state.phase, order.act) == (Phase.ENDED, Act.RETRACT)
    assert "0.20 N are too little" in state.reason


def test_a_held_finger_is_followed_as_far_as_tissue_and_plate_drift():
    end_m = 0.011 + SETTINGS.drift_m
    held = replace(HOLDING, touch=Felt(0.0105, 0.05), risen=Felt(0.011, 0.5))
    seen = QUIET._replace(depth_m=end_m - 1e-5)
    state, order = step(SETTINGS, held, seen._replace(load_n=0.499))
    assert (state.phase, order.act) == (Phase.HOLD, Act.MOVE)
    for time_s in (1.1, 1.2):
        seen = QUIET._replace(depth_m=end_m, time_s=time_s)
        state, order = step(SETTINGS, state, seen)
    assert (state.phase, order.act) == (Phase.ENDED, Act.RETRACT)


def test_near_the_limit_it_is_followed_no_further_than_to_the_limit():
    """A sphere on a plane of 700 N/m: 1.1 mm at 0.5 N, and as the power of two thirds."""
    settings = LoadSettings(2.5)
    to_limit_m = 1.5 * 0.5 / 700.0 * ((3.0 / 0.5) ** (2 / 3) - (2.5 / 0.5) ** (2 / 3))
    state = replace(HOLDING, risen=Felt(0.011, 2.5))
    for time_s in (1.1, 1.2):
        seen = Seen(time_s, 2.5, 0.0, False, 0.011 + to_limit_m, False)
        state, _ = step(settings, state, seen)
    assert state.phase is Phase.ENDED


WRONG = {
    "load": (QUIET._replace(load_n=0.75), "0.75 N"),
    "no answer": (QUIET._replace(load_n=None), "sensor is silent"),
    "pulling": (QUIET._replace(load_n=-0.05), "its zero or its sign"),
    "no number": (QUIET._replace(load_n=float("nan")), "saturated"),
    "saturated": (QUIET._replace(saturated=True), "saturated"),
    "silent": (QUIET._replace(load_age_s=0.11), "silent"),
    "unknown age": (QUIET._replace(load_age_s=float("nan")), "silent"),
    "stage lost": (QUIET._replace(depth_m=None), "stage does not answer"),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize(("retracts", "act"), [(True, Act.RETRACT), (False, Act.STOP)])
@pytest.mark.parametrize("state", [LoadState(start_m=0.009), HOLDING], ids=["approach", "hold"])
def test_whatever_is_wrong_ends_it_once(name, moving, retracts, act, state):
    seen, said = WRONG[name]
    settings = replace(SETTINGS, retracts=retracts)
    ended, order = step(settings, state, seen._replace(moving=moving))
    assert (ended.phase, order.act) == (Phase.ENDED, act)
    assert said in ended.reason
    assert step(settings, ended, QUIET) == (ended, NOTHING)


def test_the_limit_holds_below_one_and_a_half_times_a_high_target():
    assert LoadSettings(2.9).trip_n == 3.0
    assert LoadSettings(1.0).trip_n == 1.5


@pytest.mark.parametrize(
    "given",
    [
        {"target_n": 0.05},
        {"target_n": 3.0},
        {"target_n": float("nan")},
        {"target_n": 0.5, "gain": 1.1},
        {"target_n": 0.5, "stiffness_n_per_m": 0.0},
        {"target_n": 0.5, "step_m": float("inf")},
    ],
)
def test_what_makes_no_loop_is_refused(given):
    with pytest.raises(ValueError, match="load"):
        LoadSettings(**given)
