"""What keeps a rig safe, what happens when it fails, and the tests that show it.

Tests run on simulated instruments; on a rig the same has to be tried by hand. Each is named as
`file::function`, and a test looks whether it is there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.part import NO_WATCHDOG, NoPart
from haptic_driver.rig.parts.interlocks import InterlockBox
from haptic_driver.rig.parts.load_stages import LoadStageSection

DRIVER = "tests/haptic_driver"
RIG = f"{DRIVER}/rig/test_rig.py"
WATCHDOG = "tests/hw/safety/test_watchdog.py"


class Mechanism(NamedTuple):
    """`here` says what of it a rig's file names, and nothing where the rig has none.

    `without` is what then remains; a mechanism without it is left out of the paper.
    """

    name: str
    here: Callable[[RigConfig], str]
    fails: str
    then: str
    tests: tuple[str, ...]
    without: str = ""

    def facts(self, rig: RigConfig) -> dict[str, Any]:
        """What the paper says of it on this rig."""
        here = self.here(rig)
        return {
            "mechanism": self.name,
            "configured": here or None,
            "fails": self.fails,
            "then": self.then if here else self.without,
            "tests": [*self.tests] if here else [],
        }


def _always(said: str) -> Callable[[RigConfig], str]:
    return lambda rig: said


def _lease(rig: RigConfig) -> str:
    return f"{rig.safety.lease_s:g} s"


def _watchdog(rig: RigConfig) -> str:
    watchdog = rig.watchdog
    if watchdog is None or watchdog.generator == NO_WATCHDOG:
        return ""
    return f"period {watchdog.period_s:g} s"


def _interlock(rig: RigConfig) -> str:
    return "heartbeat box" if isinstance(rig.interlock, InterlockBox) else ""


def _voltage_monitor(rig: RigConfig) -> str:
    safety = rig.safety
    said = f"{100 * safety.monitor_tolerance:g} % or {safety.monitor_tolerance_v:g} V"
    return said if "voltage monitor" in rig.monitors else ""


def _current_monitor(rig: RigConfig) -> str:
    said = f"trips at {1e3 * rig.amplifier.current_limit_a:g} mA peak"
    return said if "current monitor" in rig.monitors else ""


def _fault_line(rig: RigConfig) -> str:
    return "fault line" if "fault line" in rig.monitors else ""


def _envelope(rig: RigConfig) -> str:
    return "" if isinstance(rig.analog_output, NoPart) else rig.analog_output.kind


def _load_stage(rig: RigConfig) -> str:
    stage = rig.load_stage
    return f"lets go at {stage.load_limit_n:g} N" if isinstance(stage, LoadStageSection) else ""


MECHANISMS = (
    Mechanism(
        "last gate",
        _always("always"),
        "a set point beyond a limit reaches it",
        "zero volts with the reason, in other code than what chose the point; never clamped",
        (
            f"{DRIVER}/render/test_safety.py"
            "::test_gate_passes_unchanged_or_gives_zero_never_something_between",
            "tests/limits/test_limits_hold.py"
            "::test_nothing_that_goes_out_exceeds_a_limit_by_the_full_model",
        ),
    ),
    Mechanism(
        "rig",
        _always("always"),
        "a command beyond the limits reaches the device layer",
        "refused, and the output goes off",
        (f"{RIG}::test_a_command_beyond_the_limits_switches_off_and_raises",),
    ),
    Mechanism(
        "lease",
        _lease,
        "who armed the rig falls silent",
        "the output goes to zero when the lease ends",
        (f"{RIG}::test_output_that_is_not_refreshed_goes_to_zero",),
    ),
    Mechanism(
        "processes",
        _always("always"),
        "control, render or watchdog is killed, or render is stopped",
        "the others bring the electrode to zero within the lease",
        (
            f"{DRIVER}/daemon/test_kills.py"
            "::test_output_is_zero_within_the_lease_after_each_process_is_killed_or_stopped",
        ),
    ),
    Mechanism(
        "watchdog",
        _watchdog,
        "the driver dies or hangs; the watchdog itself is stopped",
        "it switches off over its own connection; one that is stopped is noticed and ended",
        (
            f"{WATCHDOG}::test_whatever_ends_the_driver_switches_off",
            f"{WATCHDOG}::test_one_that_is_stopped_is_noticed_and_ended",
        ),
        "if the driver dies, the output stays as it is",
    ),
    Mechanism(
        "interlock",
        _interlock,
        "its heartbeat stops: computer, program or cable",
        "its contact opens by its own clock and takes the amplifier's enable line away",
        (
            "tests/hw/safety/test_interlock.py"
            "::test_silence_opens_the_contact_by_the_boxs_own_clock",
            f"{RIG}::test_an_interlock_box_opens_by_itself_when_the_caller_stalls",
        ),
        "if computer, driver and watchdog stop together, or a cable is cut, the output stays on",
    ),
    Mechanism(
        "voltage monitor",
        _voltage_monitor,
        "the electrode has another voltage than was commanded, or any while off",
        "off, latched until somebody acknowledges it",
        (
            f"{RIG}::test_a_monitor_that_contradicts_the_command_latches_a_trip",
            f"{RIG}::test_voltage_that_appears_while_off_is_a_trip",
        ),
        "nobody sees a wrong gain; 'off' means that the generator says so",
    ),
    Mechanism(
        "current monitor",
        _current_monitor,
        "the amplifier gives more than its limit",
        "off, latched",
        (f"{RIG}::test_more_current_than_the_amplifier_may_give_is_a_trip",),
        "nobody sees a current that is too high",
    ),
    Mechanism(
        "amplifier",
        _fault_line,
        "it trips, or its enable line falls",
        "off, latched",
        (f"{RIG}::test_an_amplifier_that_trips_or_loses_its_enable_line_is_a_trip",),
        "a tripped amplifier shows on its voltage monitor at best",
    ),
    Mechanism(
        "OFF",
        _always("always"),
        "the generator does not answer, or says that it is on",
        "'off' is said with evidence only, else 'unknown'; tried again until it is heard",
        (
            f"{RIG}::test_off_is_claimed_only_with_evidence",
            f"{RIG}::test_an_off_that_was_not_heard_is_tried_again",
            f"{DRIVER}/daemon/web/test_api.py::test_off_is_heard_while_the_event_loop_hangs",
        ),
    ),
    Mechanism(
        "sensors",
        _always("always"),
        "force or position freezes, or is what cannot be",
        "the output ramps to zero; a fault says what",
        (
            f"{DRIVER}/daemon/test_readings.py::test_what_cannot_be_is_a_fault_with_the_output_off",
            f"{DRIVER}/daemon/test_render_process.py"
            "::test_the_output_ramps_to_zero_when_it_may_not_be_trusted",
        ),
    ),
    Mechanism(
        "machine",
        _always("always"),
        "no threads, processes, memory or disk are left",
        "OFF needs none of them, nor does the watchdog",
        (
            f"{DRIVER}/daemon/test_denied.py::test_whatever_is_denied_after_arming_off_is_off",
            f"{WATCHDOG}::test_whatever_is_denied_after_arming_it_switches_off",
        ),
    ),
    Mechanism(
        "claims",
        _always("always"),
        "a second program opens the rig",
        "it is refused before it opens anything",
        (f"{DRIVER}/rig/test_claims.py::test_a_second_program_on_a_rig_touches_nothing",),
    ),
    Mechanism(
        "envelope",
        _envelope,
        "what render says is old",
        "zero is written",
        (
            f"{DRIVER}/daemon/test_envelope_process.py"
            "::test_what_render_said_long_ago_is_not_written",
        ),
    ),
    Mechanism(
        "load stage",
        _load_stage,
        "force sensor or stage fails, the finger is pressed too hard, or the driver dies",
        "it lifts off, or stops where the file says so; by the watchdog if the driver is dead",
        (
            f"{DRIVER}/rig/test_load_loop.py::test_a_sensor_that_fails_makes_the_stage_lift_off",
            f"{DRIVER}/rig/test_load_controller.py"
            "::test_the_limit_holds_below_one_and_a_half_times_a_high_target",
            "tests/hw/safety/test_guarded_stage.py"
            "::test_a_killed_driver_leaves_a_finger_that_is_free_and_an_output_that_is_off",
        ),
    ),
)
