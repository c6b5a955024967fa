"""Kinds of finger trackers."""

from __future__ import annotations

import datetime
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, Self

from pydantic import Field

from haptic_driver.config import Section, Within
from haptic_driver.errors import BadInputError
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import Metres, NoPart, Part, PartSection, ServedSection, Wiring

if TYPE_CHECKING:
    from hw.finger.touch_screen import TouchCalibration
    from hw.finger.tracker import FingerTracker

STAGE_INTERVAL_S = 0.005  # between questions for the stage's place


Direction = Annotated[float, Within(-1.0, 1.0, "it is a part of a unit vector")]


class Reports(NamedTuple):
    """What is known of a tracker's reports before it has told any.

    The time between two, the smallest step of a place, the standard deviation of a report's time.
    """

    interval_s: float = 0.0
    resolution_m: float = 1e-5
    jitter_s: float = 0.0

    @property
    def noise_m(self) -> float:
        """Standard deviation of a place, by its steps."""
        return self.resolution_m / math.sqrt(12.0)


class NoFingerTracker(NoPart):
    """No tracker: the place of the finger is unknown."""

    def examine(self, at: Examination) -> Checks:
        yield at.unverified("there is none: nothing can be rendered by position")


class StageFingerConfig(PartSection):
    """The finger rides on the stage."""

    needs_stage = True

    kind: Literal["stage"]
    origin_m: Annotated[list[Metres], Field(min_length=2, max_length=2)] = Field(
        description="where the finger is on the screen when the stage is at 0"
    )
    direction: Annotated[list[Direction], Field(min_length=2, max_length=2)] = Field(
        default=[1.0, 0.0], description="of the stage's travel on the screen"
    )

    @property
    def is_simulated(self) -> None:
        """The stage has the finger's place on any rig."""

    def reports(self) -> Reports:
        """A stage is asked for its place, and says it of some moment since it was last asked."""
        return Reports(STAGE_INTERVAL_S, jitter_s=STAGE_INTERVAL_S / math.sqrt(12.0))

    def examine(self, at: Examination) -> Checks:
        yield at.unverified("the stage carries the finger: see the stage")

    def make(self, wiring: Wiring) -> Part[FingerTracker]:
        """Asks the stage for its place."""
        from hw.finger.tracker import StageFinger

        assert wiring.stage is not None  # or the file would have been refused
        (x_m, y_m), (dx, dy) = self.origin_m, self.direction
        finger = StageFinger(
            wiring.stage.read_status,
            origin_m=(x_m, y_m),
            direction=(dx, dy),
            interval_s=STAGE_INTERVAL_S,
        )
        return Part(finger, [finger.start], [finger.close])


class TouchAreaConfig(Section):
    """How a touch screen's axes of contact tell its area, by touches that a camera saw."""

    m2_per_raw2: Annotated[float, Within(1e-15, 1e-2, "no screen counts finer or coarser")] = Field(
        description="contact area over ABS_MT_TOUCH_MAJOR times ABS_MT_TOUCH_MINOR, median over"
        " the touches"
    )
    log_std: Annotated[float, Within(0.01, 2.0, "it is a spread of logarithms")] = Field(
        description="standard deviation of that quotient's logarithm over them"
    )
    measured_at: datetime.date = Field(description="when they were seen")


class EvdevFingerConfig(PartSection):
    """A touch screen by its event device; `matrix_m` takes (x_raw, y_raw, 1) to metres.

    `report_rate_hz` is how often it reports, for the latency by which positions are extrapolated.
    Where it tells how large a contact is, `area` has friction looked up for that.
    """

    served_as = "finger_tracker"

    kind: Literal["evdev"]
    device: str = Field(
        description="event device of the touch screen, or `host:port` that sends its events"
    )
    report_rate_hz: Annotated[
        float, Within(1.0, 1e5, "no touch screen tells less or more often")
    ] = Field(
        default=100.0,
        description="how often it tells; part of the latency by which positions are extrapolated",
    )
    report_jitter_s: Annotated[float, Within(0.0, 0.1, "no screen is so late")] | None = Field(
        default=None,
        description="how far a report's time is off, standard deviation; left out: it may be old by"
        " up to an interval",
    )
    matrix_m: Annotated[
        list[Annotated[list[Metres], Field(min_length=3, max_length=3)]],
        Field(min_length=2, max_length=2),
    ] = Field(description="(x_raw, y_raw, 1) -> metres")
    measured_at: datetime.date = Field(description="when `matrix_m` was measured")
    placeholder: bool = Field(description="false once it was measured: haptic calibrate-touch")
    area: TouchAreaConfig | None = Field(
        default=None, description="of a contact, where the screen tells how large that is"
    )

    def calibration(self) -> str:
        """When, and whether it was."""
        return f"{self.measured_at}{', placeholder' if self.placeholder else ''}"

    def served_at(self, where: str) -> Self:
        """The simulated screen there has counts and a pace of its own."""
        from hw.finger.simulated_touch_screen import PANEL, SCREEN

        own = {
            "report_rate_hz": PANEL.report_rate_hz,
            "report_jitter_s": 0.0,
            "matrix_m": [list(row) for row in SCREEN.matrix_m],
            "placeholder": False,
        }
        return self.model_copy(update={"device": where, **own})

    def reports(self) -> Reports:
        """One count is the step of a place. What nobody has measured of times: a screen that scans
        by its own clock tells places of any age up to an interval.
        """
        (a, b, _), (c, d, _) = self.matrix_m
        interval_s, jitter_s = 1.0 / self.report_rate_hz, self.report_jitter_s
        if jitter_s is None:
            jitter_s = interval_s / math.sqrt(12.0)
        return Reports(interval_s, max(math.hypot(a, c), math.hypot(b, d)), jitter_s)

    def touch_calibration(self) -> TouchCalibration:
        """The same, as the driver takes it; BadInputError for a matrix that is no map of a
        plane.
        """
        from hw.finger.touch_screen import TouchCalibration

        (a, b, c), (d, e, f) = self.matrix_m
        try:
            return TouchCalibration(((a, b, c), (d, e, f)), self.measured_at, self.placeholder)
        except ValueError as error:
            said, hint = (
                f"finger_tracker.matrix_m: {error}",
                "Measure it with haptic calibrate-touch",
            )
            raise BadInputError("bad_config", said, hint) from error

    def examine(self, at: Examination) -> Checks:
        """Its calibration, and whether its events can be read."""
        yield from at.called("touch calibration").told(self._examine_calibration)
        yield from at.called("touch screen").told(self._examine_screen)

    def _examine_calibration(self, at: Examination) -> Checks:
        if self.touch_calibration().placeholder:
            hint = "measure it by touching known places: haptic calibrate-touch"
            yield at.warning("a placeholder", hint)
        else:
            yield at.dated("measured", self.measured_at, " (haptic calibrate-touch)")

    def _examine_screen(self, at: Examination) -> Checks:
        from hw.finger.touch_screen import open_touch_reports

        opened = open_touch_reports(self.device)
        opened.close()
        yield at.ok(self.device)
        reports = self.reports()
        said = (
            f"a report every {1e3 * reports.interval_s:.3g} ms, its time off by"
            f" {1e3 * reports.jitter_s:.2g} ms (report_rate_hz, report_jitter_s)"
        )
        hint = "slide a finger while the daemon runs: haptic status has both as they are"
        yield at.called("touch reports").unverified(said, hint)
        area = at.called("contact area")
        if opened.tells_area is False and self.area is not None:
            said = "this screen has no ABS_MT_TOUCH_MAJOR: it tells no area of a contact"
            yield area.failed(said, "remove finger_tracker.area from the rig's file")
        elif opened.tells_area and self.area is None:
            said = "this screen tells how large a contact is, which is not used"
            yield area.unverified(said, "[finger_tracker.area] has friction looked up for it")
        elif self.area is not None:
            told = f"major x minor x {self.area.m2_per_raw2:.3g} m2, off by {self.area.log_std:.0%}"
            yield area.dated(told, self.area.measured_at)

    def make(self, wiring: Wiring) -> Part[FingerTracker]:
        """Reads its event device."""
        from hw.finger.touch_screen import AreaCalibration, EvdevTouchScreen

        told = self.area
        area = None if told is None else AreaCalibration(told.m2_per_raw2, told.log_std)
        screen = EvdevTouchScreen(self.device, self.touch_calibration(), area)
        return Part(screen, [screen.open], [screen.close])


class RecordedFingerConfig(PartSection):
    """A slide played back; the path of the CSV counts from the rig's file."""

    files = ("file",)

    kind: Literal["recorded"]
    file: str = Field(description="CSV of a slide; its path counts from the rig's file")

    @property
    def is_simulated(self) -> None:
        """A file has the finger's place on any rig."""

    def examine(self, at: Examination) -> Checks:
        there = Path(self.file).is_file()
        said = f"plays {self.file}{'' if there else ': missing'}"
        yield at.ok(said) if there else at.failed(said)

    def make(self, wiring: Wiring) -> Part[FingerTracker]:
        """Plays the slide once."""
        from haptic_driver.rig.slide import read_slide
        from hw.finger.tracker import RecordedFinger

        slide = read_slide(Path(self.file))
        return Part(
            RecordedFinger(
                slide.time_s,
                slide.position_m,
                0.0 * slide.position_m,
                slide.normal_force_n > 0.0,
                clock=time.monotonic,
            )
        )


class SimulatedFingerConfig(ServedSection):
    """The touch screen of a simulated rig, whose events come over a socket."""

    served_as = "finger_tracker"

    kind: Literal["simulated"] = "simulated"

    def reports(self) -> Reports:
        """It stamps each as it takes it."""
        from hw.finger.simulated_touch_screen import PANEL

        return Reports(1.0 / PANEL.report_rate_hz, 1.0 / PANEL.x_counts_per_m)

    def make(self, wiring: Wiring) -> Part[FingerTracker]:
        from hw.finger.simulated_touch_screen import SCREEN
        from hw.finger.touch_screen import EvdevTouchScreen

        screen = EvdevTouchScreen(self._where, SCREEN)
        return Part(screen, [screen.open], [screen.close])


def reports_of(tracker: object) -> Reports:
    """Of a tracker's section; a kind of yours may say its own by a method `reports`."""
    say: Callable[[], Reports] = getattr(tracker, "reports", Reports)
    return say()
