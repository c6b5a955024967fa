"""The controller: what each policy chooses, that it does not hop, and that all it wants passes the
gate.
"""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.file import ready_for_lookup
from haptic_driver.render.choice import Choice
from haptic_driver.render.controller import (
    INITIAL,
    Candidate,
    Control,
    Controller,
    ControllerSettings,
    ControllerState,
    as_felt,
    best_node,
    careful_cof,
    is_clearly_better,
    step,
)
from haptic_driver.render.correction import NO_CORRECTION, Factors
from haptic_driver.render.feedback import Estimate, FeedbackSettings, Gains
from haptic_driver.render.policies import POLICIES
from haptic_driver.render.surface import NO_CAPS, Inverse, cof_at, highest_cof
from haptic_driver.signals import NO_COMMAND, FingerState, TargetFriction
from model.conditions import Conditions

AUTHORITY, VOLTAGE, CURRENT = (0.0, 0.0), (1.0, 0.0), (0.0, 1e6)  # per volt and per ampere
CHOOSING = [policy for policy in POLICIES if policy != "fixed_frequency"]
COF_OFF = 0.512
WIDE = OperatingLimits(
    1e3, 1e-3, 1e7, contact_current_a_rms=((1.0, 1.0),)
)  # the surface has its own
ON_SURFACE = 1e-9  # node frequencies and friction go through a logarithm and back


def finger(normal_force_n=0.5):
    return FingerState(0.0, 0.0, 0.0, 0.0, 0.0, normal_force_n, True)


def ask(controller, cof, normal_force_n=0.5, state=INITIAL):
    return controller.step(state, TargetFriction(cof, True), finger(normal_force_n), NO_COMMAND)


def make(surface, policy="max_authority", limits=WIDE, **settings):
    return Controller(ControllerSettings(surface, limits, policy=policy, **settings))


@pytest.fixture(scope="module")
def controllers(surface):
    return {policy: make(surface, policy) for policy in CHOOSING}


# --- what each policy chooses
# ----------------------------------------------------------------------------------


def by(surface, choice):
    """A control that knows no finger, and chooses so."""
    law, highest = FeedbackSettings(0.0), highest_cof(surface)
    return Control(surface, highest, NO_CORRECTION, False, law, False, choice, 0.05, NO_CAPS)


def some_ranks(rng):
    """A band of frequencies in which each has one of three ranks, infinite outside."""
    first = int(rng.integers(0, 150))
    stop = int(rng.integers(first + 1, 201))
    rank = np.full(200, np.inf)
    rank[first:stop] = rng.choice([1.0, 2.0, 5.0], stop - first)
    return rank


@pytest.mark.parametrize(
    ("costs", "ranked"), [(AUTHORITY, False), (VOLTAGE, True), (CURRENT, False)]
)
def test_the_best_node_of_any_band_is_that_of_trying_all(surface, brute_force, rng, costs, ranked):
    """Those that reach the target, of them the least rank, of them the least cost or most
    authority.
    """
    for _ in range(150):
        rank = some_ranks(rng)
        if not ranked:
            rank = np.minimum(rank, 1.0, where=np.isfinite(rank), out=rank)
        target, force = float(rng.uniform(0.5, 1.8)), float(0.1 * 20.0 ** rng.uniform())
        reach = brute_force(force, target)
        index = best_node(by(surface, Choice(rank, *costs)), target, force)
        cost = {VOLTAGE: reach.voltage_v, CURRENT: reach.current_rms_a, AUTHORITY: -reach.cof_high}
        tried = np.isfinite(rank) & (reach.cof_high >= target)
        counted = cost[costs]
        if tried.any():
            tried &= rank == rank[tried].min()
        else:
            tried, counted = np.isfinite(rank), cost[AUTHORITY]
        assert tried[index]
        # equal to rounding: two neighbours may be as good as one another
        assert counted[index] == pytest.approx(counted[tried].min(), rel=1e-9)


def test_policies_differ_where_they_should(controllers):
    """Otherwise the comparisons above would hold for a controller that ignores its policy."""
    chosen = {policy: ask(controllers[policy], 0.515)[1] for policy in CHOOSING}
    assert len({round(p.frequency_hz) for p in chosen.values()}) == 5
    assert chosen["min_voltage"].voltage_v < chosen["max_authority"].voltage_v
    assert chosen["min_current"].current_rms_a < chosen["max_authority"].current_rms_a


@pytest.mark.parametrize("frequency", [1.0, 3.7, 100.0, 137.0, 2500.0, 3333.3, 1e6])
def test_fixed_frequency_is_exactly_the_one_asked_for(surface, touch, frequency):
    controller = make(surface, "fixed_frequency", fixed_frequency_hz=frequency)
    low, high = controller.reachable(0.5)
    target = 0.5 * (low + high)
    state, point = ask(controller, target)
    assert point.frequency_hz == frequency
    assert state.frequency_hz == frequency
    assert point.reachable
    answer = touch.predict(Conditions(*(np.array([x]) for x in (frequency, point.voltage_v, 0.5))))
    assert answer.cof[0] == pytest.approx(target, rel=1e-3)  # the inversion's promise


@pytest.mark.parametrize("policy", CHOOSING)
@pytest.mark.parametrize("force", [0.2, 0.5, 1.5])
def test_reachable_is_what_the_policy_reaches(controllers, brute_force, grid, policy, force):
    low, high = controllers[policy].reachable(force)
    lowest_hz = 10e3 if policy == "carrier" else 100.0
    tried = brute_force(force, 0.6).cof_high[grid.frequency_hz >= lowest_hz]
    assert low == pytest.approx(COF_OFF, abs=ON_SURFACE)
    assert high == pytest.approx(tried.max(), abs=ON_SURFACE)
    inside, outside, endless = (
        ask(controllers[policy], cof, force)[1] for cof in (high - 1e-6, high + 1e-3, math.inf)
    )
    assert inside.reachable
    assert not outside.reachable
    assert endless.cof == endless.cof_high == pytest.approx(high, abs=ON_SURFACE)
    assert endless.cof_low == pytest.approx(low, abs=ON_SURFACE)


# --- targets out of reach, and none at all
# ---------------------------------------------------------------------


@pytest.mark.parametrize("policy", CHOOSING)
@pytest.mark.parametrize("before", [0.514, 0.6, 0.9])
def test_history_does_not_spoil_the_nearest_reachable_friction(controllers, policy, before):
    """A target out of reach gives the nearest reachable friction, also when the frequency was
    chosen for another.
    """
    controller = controllers[policy]
    state, _ = ask(controller, before)
    _, point = ask(controller, 3.0, state=state)
    low, high = controller.reachable(0.5)
    # hysteresis may keep a frequency with up to 5 % less authority
    assert point.cof - low >= (high - low) / 1.05 - ON_SURFACE


@pytest.mark.parametrize(
    ("target", "force"),
    [
        (TargetFriction(math.nan, True), 0.5),
        (TargetFriction(0.6, False), 0.5),
        (TargetFriction(0.0, True), 0.5),
        (TargetFriction(0.6, True), 0.0),
        (TargetFriction(0.6, True), math.nan),
    ],
)
@pytest.mark.parametrize("policy", CHOOSING)
def test_nothing_asked_or_no_load_is_zero_volts(controllers, policy, target, force):
    state, _ = ask(controllers[policy], 0.6)
    after, point = controllers[policy].step(state, target, finger(force), NO_COMMAND)
    assert after.frequency_hz == state.frequency_hz
    assert (point.voltage_v, point.current_rms_a, point.stuck_current_rms_a) == (0.0, 0.0, 0.0)
    assert point.frequency_hz == state.frequency_hz


# --- the frequency does not hop
# --------------------------------------------------------------------------------


def count_changes(controller, targets, forces):
    state, used = INITIAL, []
    for cof, force in zip(targets.tolist(), forces.tolist(), strict=True):
        state, point = ask(controller, cof, force, state)
        used.append(point.frequency_hz)
    return np.count_nonzero(np.diff(used))


def test_a_varying_target_under_a_noisy_finger_does_not_hop(surface, rng):
    targets = 0.8 - 0.25 * np.cos(np.linspace(0.0, 2.0 * np.pi, 1500))
    forces = 0.5 + 0.05 * rng.standard_normal(1500)
    assert (
        count_changes(make(surface, "min_voltage", hysteresis=0.0), targets, forces) > 100
    )  # it would
    assert count_changes(make(surface, "min_voltage"), targets, forces) <= 2


def reaching(voltage_v=50.0, current_a=1e-4, high=1.0, rank=1.0):
    """What a frequency that reaches a friction of 0.7 from one of 0.5 takes for it."""
    return Candidate(rank, Inverse(voltage_v, 0.7, current_a, current_a, 0.5, high))


@pytest.mark.parametrize(
    ("costs", "best", "present", "moves"),
    [
        (VOLTAGE, reaching(10.0), reaching(10.4), False),
        (VOLTAGE, reaching(10.0), reaching(10.6), True),
        (VOLTAGE, reaching(0.1), reaching(0.9), False),  # either is next to nothing
        (CURRENT, reaching(10.0, 1e-4), reaching(10.0, 1.06e-4), True),
        (AUTHORITY, reaching(high=1.0), reaching(high=0.9), True),
        # neither reaches: the one that comes nearer
        (AUTHORITY, reaching(high=0.8), reaching(high=1.0, rank=1.06), True),
        (AUTHORITY, reaching(high=1.0), reaching(high=0.8, rank=1.04), False),
        (AUTHORITY, reaching(high=0.709), reaching(high=1.0, rank=2.0), False),
        (AUTHORITY, reaching(high=0.711), reaching(high=1.0, rank=2.0), True),
        # no rank of its own: as if it were as good a one
        (AUTHORITY, reaching(high=1.0), reaching(high=0.99, rank=math.inf), False),
        (AUTHORITY, reaching(high=1.0), reaching(high=0.9, rank=math.inf), True),
    ],
)
def test_a_carrier_moves_for_what_its_policy_counts_and_for_more_than_the_hysteresis(
    surface, costs, best, present, moves
):
    control = by(surface, Choice(np.ones(200), *costs))
    assert is_clearly_better(control, best, present, 0.7) is moves


@pytest.mark.parametrize("target_cof", [0.5, 0.6, 0.8, 1.1])
@pytest.mark.parametrize("caution", [1.0, 4.0])
def test_what_is_asked_of_a_finger_that_is_not_known_costs_least(target_cof, caution):
    """Expected: the least squared error and variance, by the law of variances, found by scipy."""
    gains, factors, low = Gains(1.1, 0.9, 4e-3, 1e-3, 9e-3), Factors(1.05, 0.8), 0.5

    def loss(on_surface):
        shares = np.array([factors.off * low, factors.rise * (on_surface - low)])
        covariance = np.array(
            [[gains.off_variance, gains.covariance], [gains.covariance, gains.rise_variance]]
        )
        error = shares @ [gains.off, gains.rise] - target_cof
        return error**2 + caution * shares @ covariance @ shares

    expected = minimize_scalar(loss, bounds=(low, 3.0), method="bounded", options={"xatol": 1e-9}).x
    assert careful_cof(gains, factors, low, target_cof, caution) == pytest.approx(
        expected, abs=1e-6
    )


def test_a_finger_that_is_known_is_met_whatever_is_asked():
    known, factors = Gains(1.1, 0.9), Factors(1.05, 0.8)
    for target_cof in (0.58, 0.7, 1.2):
        asked = careful_cof(known, factors, 0.5, target_cof, 4.0)
        assert 1.1 * 1.05 * 0.5 + 0.9 * 0.8 * (asked - 0.5) == pytest.approx(target_cof, rel=1e-12)


# --- safety
# ------------------------------------------------------------------------------------------------

RIGS = {
    "public limit": {},
    "series resistance": {"series_resistance_ohm": 100e3},
    "weak amplifier": {
        "amplifier_current_a": 2e-3,
        "panel_capacitance_f": 1e-9,
        "slew_v_per_s": 1e6,
    },
    "narrow": {"voltage_v": 37.0, "frequency_low_hz": 150.0, "frequency_high_hz": 20e3},
}


@pytest.fixture(scope="module")
def rigs(surface_file):
    plain = {"voltage_v": 150.0, "frequency_low_hz": 1.0, "frequency_high_hz": 1e6}
    limits = {name: OperatingLimits(**(plain | changed)) for name, changed in RIGS.items()}
    return {name: (limit, ready_for_lookup(surface_file, limit)) for name, limit in limits.items()}


@given(
    rig=st.sampled_from(list(RIGS)),
    policy=st.sampled_from(CHOOSING),
    cof=st.one_of(st.floats(0.01, 5.0), st.just(math.inf)),
    force=st.floats(1e-6, 100.0),
    present=st.one_of(st.none(), st.integers(0, 199)),
)
def test_every_point_passes_the_gate(rigs, refusal, surface_file, rig, policy, cof, force, present):
    limits, ready = rigs[rig]
    before = ControllerState(
        math.nan if present is None else float(surface_file.frequency_hz[present])
    )
    _, point = ask(make(ready, policy), cof, force, before)
    assert refusal(limits, point) is None


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("cof", [math.inf, 0.5145])
def test_every_point_at_a_fixed_frequency_passes_the_gate(rigs, refusal, rig, cof):
    """Also between the nodes, where limit curve and worst-case current are not those of either
    neighbour.
    """
    limits, ready = rigs[rig]
    refused = []
    asked = [*np.geomspace(1.0, 1e6, 700).tolist(), 2.5e3, 100e3]
    for frequency in asked:
        _, point = ask(
            make(ready, "fixed_frequency", fixed_frequency_hz=frequency, limits=limits), cof
        )
        reason = refusal(limits, point)
        if reason is not None:
            refused.append((frequency, point.voltage_v, reason))
    assert not refused, f"{len(refused)} of {len(asked)} refused; the first: {refused[0]}"


# --- settings
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "code", "words"),
    [
        ({"policy": "best"}, "bad_policy", "max_authority"),
        ({"policy": "fixed_frequency"}, "bad_frequency", "1..1e+06 Hz"),
        ({"policy": "fixed_frequency", "fixed_frequency_hz": 2e6}, "bad_frequency", "1..1e+06 Hz"),
        (
            {"policy": "fixed_frequency", "fixed_frequency_hz": math.nan},
            "bad_frequency",
            "1..1e+06 Hz",
        ),
        ({"lowest_carrier_hz": 1.1e6}, "bad_frequency", "surface"),
    ],
)
def test_settings_without_a_frequency_to_use_are_refused(surface, settings, code, words):
    with pytest.raises(BadInputError) as refused:
        ControllerSettings(surface, WIDE, **settings)
    assert refused.value.code == code
    assert words in refused.value.hint


def test_the_stage_is_compiled_once_for_all_rigs(surface):
    """However their arrays lie in memory: a daemon that compiles at its start takes many times as
    long.
    """
    state, _ = ask(make(surface), 0.6)
    forms = list(step.signatures)
    turned = NO_CORRECTION._replace(
        gain_factor=np.ones((2, 2, 2, 2)).transpose(1, 0, 3, 2)[:, ::-1]
    )
    read_only = surface.cof.copy()
    read_only.setflags(write=False)
    ask(
        make(surface._replace(cof=read_only), correction=turned, feedback=FeedbackSettings(0.05)),
        0.6,
        state=state,
    )
    fixed = make(
        surface._replace(cof=np.asfortranarray(surface.cof)),
        "fixed_frequency",
        fixed_frequency_hz=250,
    )
    ask(pickle.loads(pickle.dumps(fixed)), 0.6)  # as the daemon sends it to render
    assert step.signatures == forms


@pytest.mark.parametrize(
    ("target", "in_reach"), [(0.65, False), (0.66, True), (0.82, True), (0.83, False)]
)
def test_friction_is_told_as_this_finger_feels_it(target, in_reach):
    """Without voltage 1.1 * 1.2 * 0.5; each step above it counts 0.8 * 0.5."""
    found = Inverse(60.0, 0.7, 1e-4, 2e-4, 0.5, 0.9)
    point = as_felt(200.0, found, Factors(1.2, 0.5), Gains(1.1, 0.8, 0.0, 0.0, 0.0), target)
    assert point == pytest.approx((200.0, 60.0, 0.74, 1e-4, 2e-4, in_reach, 0.66, 0.82))


# --- another surface
# -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("voltage_v", "told"), [(70.0, True), (1e-12, False), (0.0, False), (math.nan, False)]
)
def test_another_surface_takes_one_gain_that_leaves_friction_as_it_was(surface, voltage_v, told):
    """Also from next to no voltage, where two rises have no ratio: there it is friction at half the
    highest voltage.
    """
    low = surface.cof[:, :, :1]
    other = surface._replace(cof=0.9 * low + 1.4 * (surface.cof - low))
    law = {"fixed_frequency_hz": 200.0, "feedback": FeedbackSettings(0.03)}
    before, after = (make(each, "fixed_frequency", **law) for each in (surface, other))
    known = Estimate(Gains(1.1, 0.8, 0.01, 0.0, 0.01), time_s=1.0, normal_force_n=0.5)
    gains = after.carried(
        before, ControllerState(200.0, known), 0.02, 1.0, voltage_v
    ).estimate.gains
    assert gains.off == gains.rise
    assert 0.5 < gains.off < 2.0
    at_v = voltage_v if told else 0.5 * surface.voltage_v[-1]
    off, on = (cof_at(surface, 200.0, v, 0.5) for v in (0.0, at_v))
    assert gains.off * cof_at(other, 200.0, at_v, 0.5) == pytest.approx(
        1.1 * off + 0.8 * (on - off)
    )
