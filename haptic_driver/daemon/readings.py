"""Which readings are believed: the one way from a finger tracker and a force sensor into the shared
memory.

A reading is believed if its time lies between the last one and now. Its values must lie within the
sensor's range and the screen's size in the rig's file. Anything else is a fault. A frozen sensor is
stale by its own times, so these must not be ahead. A place or a force that cannot be would choose a
voltage for a finger that is not there.
"""

from __future__ import annotations

import cmath
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from haptic_driver.limits import PALM_M2, OperatingLimits
from haptic_driver.live.current_sensor import Seen, TouchEstimate
from haptic_driver.processes.shared_memory import Sensed
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.parts.force_sensors import ForceSensorSection
from hw.errors import NotBelieved
from hw.finger.tracker import FingerReading
from hw.force.sensor import ForceReading

# A driver that takes its sensor's clock to ours is off by its own delays, some ms at most. Output
# ends 100 ms after the last reading: 5 ms more of it are none that a finger feels.
SLACK_S = 0.005
LEAST_TOUCH_M2 = 1e-6  # less is that of a touch which begins or ends, and tells no pressure

STAMPS = "its driver has to stamp readings with the time of CLOCK_MONOTONIC (time.monotonic)"


class Readings:
    """Asks both, and believes what can be true on this rig.

    `clock` is the one by which readings are stamped. `disown` is told whose reading is not
    believed, by its key in the rig's file, and why.
    """

    def __init__(
        self,
        config: RigConfig,
        read_finger: Callable[[], FingerReading],
        read_force: Callable[[], ForceReading],
        clock: Callable[[], float] = time.monotonic,
        disown: Callable[[str, str], object] = lambda key, said: None,
    ) -> None:
        section = config.force_sensor
        self.read_force = read_force
        self._read_finger = read_finger
        self._clock, self._disown = clock, disown
        self._screen = config.screen
        self._force = (
            section if isinstance(section, ForceSensorSection) else ForceSensorSection(kind="")
        )
        kind = "none" if section is None else section.kind
        self._sensor = f"the force sensor ({kind})"
        self._tracker = f"the finger tracker ({config.finger_tracker.kind})"
        self._finger_s = self._force_s = -math.inf

    def read(self) -> Sensed:
        """What both say now, its times in order and not ahead. Raises DeviceError; NotBelieved for
        what cannot be.
        """
        finger, force = self._read_finger(), self.read_force()
        now_s = self._clock()
        with self._of("finger_tracker"):
            self._finger_s = _believed_time_s(self._tracker, finger.time_s, self._finger_s, now_s)
            _refuse(self._not_on_screen(finger))
            _refuse(self._no_area(finger))
        with self._of("force_sensor"):
            self._force_s = _believed_time_s(self._sensor, force.time_s, self._force_s, now_s)
            _refuse(self._not_measured(force))
        tells_area = finger.touching and finger.contact_area_m2 >= LEAST_TOUCH_M2
        return Sensed(
            self._finger_s,
            finger.position_x_m,
            finger.position_y_m,
            finger.touching,
            self._force_s,
            force.normal_force_n,
            force.lateral_force_n,
            force.saturated,
            contacts=math.nan if finger.contacts is None else finger.contacts,
            palm=finger.palm,
            contact_area_m2=finger.contact_area_m2 if tells_area else math.nan,
            contact_area_std_m2=finger.contact_area_std_m2 if tells_area else math.nan,
        )

    @contextmanager
    def _of(self, key: str) -> Iterator[None]:
        try:
            yield
        except NotBelieved as error:
            self._disown(key, error.message)
            raise

    def _not_on_screen(self, finger: FingerReading) -> Iterator[tuple[str, str]]:
        """What is wrong with the place of a finger that touches; of another it says nothing."""
        screen, x_m, y_m = self._screen, finger.position_x_m, finger.position_y_m
        within = _is_within(x_m, screen.width_m, screen.margin_m) and _is_within(
            y_m, screen.height_m, screen.margin_m
        )
        if finger.touching and not within:
            yield (
                (
                    f"{self._tracker} puts the finger at x {x_m:.4g} m, y {y_m:.4g} m, "
                    f"on a screen of {screen.width_m:g} m by {screen.height_m:g} m"
                ),
                "correct its calibration, or screen.width_m and screen.height_m in the rig's file",
            )

    def _no_area(self, finger: FingerReading) -> Iterator[tuple[str, str]]:
        """What is wrong with a touch's area; NaN is one that is not told."""
        area_m2, std_m2 = finger.contact_area_m2, finger.contact_area_std_m2
        told = finger.touching and not math.isnan(area_m2)
        if told and not (0.0 <= area_m2 <= PALM_M2 and 0.0 <= std_m2 < math.inf):
            yield (
                f"{self._tracker} tells a contact area of {1e6 * area_m2:.4g} mm², standard"
                f" deviation {1e6 * std_m2:.4g} mm²",
                "correct how it is told, in the rig's file or in the tracker's driver",
            )

    def _not_measured(self, force: ForceReading) -> Iterator[tuple[str, str]]:
        """What is wrong with forces that the sensor itself does not disown; NaN is one that it does
        not measure.
        """
        section, lateral_n = self._force, force.lateral_force_n
        forces = [("normal", force.normal_force_n, section.normal_range_n)]
        if section.measures_lateral or not math.isnan(lateral_n):
            forces.append(("lateral", lateral_n, section.lateral_range_n))
        for name, force_n, range_n in forces:
            if not force.saturated and not abs(force_n) <= range_n:
                yield (
                    (
                        f"{self._sensor} reads a {name} force of {force_n:.4g} N, and measures up"
                        f" to {range_n:g} N"
                    ),
                    (
                        f"look at the sensor and its scale, or correct force_sensor.{name}_range_n"
                        " in the rig's file"
                    ),
                )


def _refuse(wrong: Iterator[tuple[str, str]]) -> None:
    for said, hint in wrong:
        raise NotBelieved(said, hint)


def not_covered(sensed: Sensed, limits: OperatingLimits, one_touch_m2: float) -> str | None:
    """Why a rig's limits of current do not hold for what its screen tells; None where they do.

    `one_touch_m2` is the contact of the signed model's finger.
    """
    holds_for = f"limits.touching_area_m2 has the limits hold for {limits.holds_for(one_touch_m2)}"
    if sensed.palm and limits.touching_area_m2 < PALM_M2:
        return f"a palm lies on the screen, up to {1e6 * PALM_M2:g} mm², and {holds_for}"
    most = limits.touches(one_touch_m2)
    if sensed.contacts > most:
        return f"{sensed.contacts:.0f} fingers touch the screen, more than {most}: {holds_for}"
    # surely more, by two standard deviations; NaN is no area
    surely_m2 = sensed.contact_area_m2 - 2.0 * sensed.contact_area_std_m2
    if surely_m2 > max(limits.touching_area_m2, one_touch_m2):
        return f"a touch covers {1e6 * sensed.contact_area_m2:.3g} mm² of the screen: {holds_for}"
    return None


def touch_estimate(config: RigConfig, model: Callable[[], str]) -> TouchEstimate | None:
    """What estimates friction from the electrode's current; None where the rig cannot, or need
    not.
    """
    given, stray_f = config.without_force, config.stray_capacitance_f
    if given is None or stray_f is None or not config.friction_from_current:
        return None
    return TouchEstimate(given.load_n, stray_f, model)


def with_monitors(sensed: Sensed, monitors: tuple[float | None, float | None]) -> Sensed:
    """With what the amplifier's monitors said last, V and A."""
    volts, amperes = (math.nan if value is None else value for value in monitors)
    return sensed._replace(monitor_voltage_v=volts, monitor_current_a=amperes)


def with_electrode(sensed: Sensed, seen: Seen) -> Sensed:
    """With what is at the electrode, and with load and friction as estimated from it, if they are.

    Feedback gets a lateral force only where the estimate tells something of the finger.
    """
    if seen.reading is None:
        return sensed
    reading, felt = seen.reading, seen.felt
    sensed = sensed._replace(
        electrode_time_s=seen.time_s,
        electrode_voltage_v=abs(reading.voltage_v),
        electrode_voltage_phase_rad=(
            cmath.phase(reading.voltage_v) if reading.referenced else math.nan
        ),
        current_a=abs(reading.current_a),
        current_phase_rad=cmath.phase(reading.current_a),
    )
    if felt is None:
        return sensed
    return sensed._replace(
        normal_force_n=felt.load_n,
        lateral_force_n=felt.cof * felt.load_n if felt.tells else math.nan,
        estimated_cof=felt.cof,
        estimated_cof_std=felt.cof_std,
    )


def _believed_time_s(who: str, time_s: float, last_s: float, now_s: float) -> float:
    """The time of a reading, which may be that of the last one; NotBelieved where it is neither
    that nor later.

    What lies outside by no more than SLACK_S is moved inside.
    """
    if not last_s - SLACK_S <= time_s <= now_s + SLACK_S or not math.isfinite(time_s):
        if time_s > now_s:
            said = f"{who} gives a reading of {time_s - now_s:.4g} s after now"
        elif time_s < last_s:
            said = f"{who} gives a reading of {last_s - time_s:.4g} s before the last one"
        else:
            said = f"{who} gives a reading of time {time_s}"
        raise NotBelieved(said, STAMPS)
    return min(max(time_s, last_s), now_s)


def _is_within(place_m: float, size_m: float, margin_m: float) -> bool:
    return -margin_m <= place_m <= size_m + margin_m
