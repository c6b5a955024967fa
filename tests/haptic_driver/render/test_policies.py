"""Policies: `quiet` is quiet where it can be, and a new one takes one function."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.file import ready_for_lookup
from haptic_driver.render import compiled
from haptic_driver.render.choice import Choice
from haptic_driver.render.controller import INITIAL, Controller, ControllerSettings, step
from haptic_driver.render.policies import POLICIES, description, from_hz, policy
from haptic_driver.rig.config import ControllerConfig
from haptic_driver.signals import NO_COMMAND, FingerState, TargetFriction

# The surface has limits of its own.
WIDE = OperatingLimits(1e3, 1e-3, 1e7, contact_current_a_rms=((1.0, 1.0),))
QUIET_FROM_HZ = 500.0 * (1.0 - 1e-9)  # half of the 1000 Hz from which a ripple is not felt
THIRD = 2.0 ** (1.0 / 3.0)


def ask(controller, cof, normal_force_n=0.5, state=INITIAL):
    finger = FingerState(0.0, 0.0, 0.0, 0.0, 0.0, normal_force_n, True)
    return controller.step(state, TargetFriction(cof, True), finger, NO_COMMAND)


@pytest.fixture(scope="module")
def quiet(surface):
    return Controller(ControllerSettings(surface, WIDE, policy="quiet"))


# --- quiet -------------------------------------------------------------------------------------


@given(cof=st.floats(0.513, 1.5), force=st.floats(0.1, 2.0), before=st.floats(0.513, 1.5))
def test_no_carrier_is_felt_where_a_quiet_one_reaches(quiet, brute_force, grid, cof, force, before):
    """By 5 % of its authority, or else hysteresis may keep a carrier that was needed before."""
    high = brute_force(force, cof).cof_high[grid.frequency_hz >= QUIET_FROM_HZ].max()
    state, _ = ask(quiet, before, force)
    for present, most in ((INITIAL, high), (state, 0.512 + (high - 0.512) / 1.05 - 1e-9)):
        _, point = ask(quiet, cof, force, present)
        if cof <= most:
            assert point.reachable
            assert point.frequency_hz >= QUIET_FROM_HZ


@given(cof=st.floats(0.513, 1.5), force=st.floats(0.1, 2.0))
def test_beyond_them_it_is_the_highest_that_reaches(quiet, brute_force, grid, cof, force):
    """To a third of an octave."""
    high = np.where(grid.frequency_hz >= 100.0, brute_force(force, cof).cof_high, 0.0)
    _, point = ask(quiet, cof, force)
    assert point.reachable == (high.max() >= cof)
    if not point.reachable:
        assert point.cof == pytest.approx(high.max(), abs=1e-9)
    elif cof > high[grid.frequency_hz >= QUIET_FROM_HZ].max():
        highest_hz = grid.frequency_hz[high >= cof].max()
        assert highest_hz / THIRD < point.frequency_hz <= highest_hz * (1.0 + 1e-9)


@pytest.mark.parametrize(("quiet_above_hz", "frequency_hz"), [(400.0, 200.0), (20e3, 10e3)])
def test_what_is_felt_is_a_setting(make_file, quiet_above_hz, frequency_hz):
    """The lower a carrier of this surface, the more it can do."""
    axis = frequency_hz * 2.0 ** np.arange(-6.0, 3.0)
    rise = np.broadcast_to(np.linspace(2e-4, 1e-4, 9)[:, None], (9, 4))
    file = make_file(axis, np.geomspace(0.1, 2.0, 4), np.linspace(0.0, 100.0, 11), rise)
    lookup = ready_for_lookup(file, WIDE)
    settings = ControllerSettings(lookup, WIDE, policy="quiet", quiet_above_hz=quiet_above_hz)
    _, point = ask(Controller(settings), 0.7)
    assert point.frequency_hz == pytest.approx(frequency_hz, rel=1e-9)


# --- a new one ---------------------------------------------------------------------------------


@pytest.fixture
def highest_pitch():
    """A policy of somebody's own, registered as the shipped ones are."""

    @policy
    def highest_pitch(settings: ControllerSettings) -> Choice:
        """The carrier is the highest that reaches the target."""
        hz = np.exp(settings.surface.log_frequency)
        return Choice(from_hz(settings, 100.0) / hz, cost_per_v=0, cost_per_a=0)

    yield highest_pitch.__name__
    del POLICIES["highest_pitch"]


def test_a_new_policy_compiles_nothing(surface, quiet, brute_force, grid, highest_pitch):
    ask(quiet, 0.6)
    forms = list(step.signatures)
    controller = Controller(ControllerSettings(surface, WIDE, policy=highest_pitch))
    for target in (0.52, 0.6, 0.8):
        reaching = grid.frequency_hz[np.isfinite(brute_force(0.5, target).voltage_v)]
        assert ask(controller, target)[1].frequency_hz == pytest.approx(reaching.max(), rel=1e-9)
    assert step.signatures == forms


def test_a_new_policy_runs_through_solve_and_a_rigs_file(haptic, surface_path, highest_pitch):
    options = ("--friction", 0.6, "--surface", surface_path, "--json", "--policy")
    names = (highest_pitch, "max_authority")
    found = {name: haptic("solve", *options, name).said for name in names}
    assert found[highest_pitch]["policy"] == "highest_pitch"
    assert found[highest_pitch]["frequency_hz"] > found["max_authority"]["frequency_hz"]
    assert found[highest_pitch]["cof"] == pytest.approx(0.6)
    assert ControllerConfig(policy=highest_pitch).policy == "highest_pitch"
    assert description(highest_pitch) == "The carrier is the highest that reaches the target."


def test_no_kernel_reads_what_the_folder_of_machine_code_is_not_named_by():
    """Policies may change without a word to the cache, so no compiled function may use one."""
    read = {
        (kernel.__name__, name)
        for kernel in compiled.KERNELS
        for name in kernel.py_func.__code__.co_names
        if getattr(kernel.py_func.__globals__.get(name), "__module__", "").endswith(".policies")
    }
    assert compiled.KERNELS
    assert read == set()
