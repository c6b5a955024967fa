"""`haptic calibrate-touch`: from the counts of a rig's touch screen to metres, by touching known
places.
"""

from __future__ import annotations

import datetime
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Annotated, Any

from rich.table import Table
from typer import Argument, Option

from haptic_driver.cli.output import Json, RigOption, report, stderr, stdout
from haptic_driver.config import config_names, find_config
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab.measuring.touched_places import (
    HOLD_S,
    PLAUSIBLE_M,
    STILL_SHARE,
    TouchFit,
    matrix_of,
    read_places,
    rig_lines,
    touch_places,
)
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.parts.finger_trackers import EvdevFingerConfig
from haptic_driver.signals import Array
from hw.finger.touch_screen import TouchReports, open_touch_reports
from model.support.errors import nearest


def calibrate_touch(
    places: Annotated[Path, Argument(help="CSV: x_m, y_m.")],
    rig: RigOption,
    spread_raw: Annotated[
        float | None,
        Option(min=0.0, help="Counts within which a finger holds still; else 0.5 % of an axis."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Calibrate a rig's touch screen: touch known places as asked, and paste what it says.

    Give at least 3 places that are not on a line; from 4 on they check one another, better 6:
    corners, middle, an edge. Nothing is energised: neither
    generator nor amplifier is opened. The rig's file stays as it is.

    Example: `haptic calibrate-touch places.csv --rig mine`
    """
    config, screen = _with_screen(rig)
    found = _touched(read_places(places), screen, spread_raw)
    if not found.agrees:
        raise _disagreement(found, places)
    payload = _payload(config, found)
    report(as_json, payload, lambda: _show(found, find_config(rig, "rigs")))


def _with_screen(rig: str) -> tuple[RigConfig, EvdevFingerConfig]:
    config = load_rig(rig)
    tracker = config.finger_tracker
    if isinstance(tracker, EvdevFingerConfig):
        return config, tracker
    having = []
    for name in config_names("rigs"):
        with suppress(HapticError):  # some file that has nothing to do with this one
            if isinstance(load_rig(name).finger_tracker, EvdevFingerConfig):
                having.append(name)
    known = f". {nearest(Path(rig).stem, having)}" if having else ""
    raise BadInputError(
        "no_touch_screen",
        f'rig {config.name} has no touch screen: its finger_tracker.kind is "{tracker.kind}"',
        f'Give a rig whose [finger_tracker] has kind = "evdev"{known}',
    )


def _touched(place_m: Array, screen: EvdevFingerConfig, spread_raw: float | None) -> TouchFit:
    with closing(open_touch_reports(screen.device)) as reports:
        spread = _spread(reports, spread_raw)
        still = f"{HOLD_S:g} s within {spread[0]:.0f} x {spread[1]:.0f} counts"
        stderr.print(
            f"Nothing is energised. Hold the finger still at each place: {still}. Ctrl-C ends it."
        )
        try:
            return touch_places(
                place_m,
                reports.read,
                spread,
                stderr.print,
                datetime.date.today(),
                clock=time.monotonic,
                sleep=time.sleep,
            )
        except KeyboardInterrupt as stop:
            raise HapticError(
                "interrupted", "interrupted", "Nothing was energised. Run it again"
            ) from stop


def _spread(reports: TouchReports, spread_raw: float | None) -> tuple[float, float]:
    if spread_raw is not None:
        return spread_raw, spread_raw
    if reports.span_raw is None or min(reports.span_raw) <= 0:
        said = "the touch screen does not say how many counts its axes have"
        raise BadInputError(
            "unknown_span", said, "Give --spread-raw, the counts within which a finger holds still"
        )
    x_raw, y_raw = reports.span_raw
    return max(STILL_SHARE * x_raw, 2.0), max(STILL_SHARE * y_raw, 2.0)


def _disagreement(found: TouchFit, places: Path) -> HapticError:
    off_mm = 1e3 * (found.touch_error_m or 0.0)
    said = (
        f"the touches disagree: one is off by {off_mm:.1f} mm (rms), above"
        f" {1e3 * PLAUSIBLE_M:g} mm; farthest off is place {found.worst + 1}"
    )
    hint = (
        f"Check its metres in {places}, or leave its row out; touch with one fingertip, in the"
        " order asked for"
    )
    return HapticError("touches_disagree", said, hint)


def _payload(config: RigConfig, found: TouchFit) -> dict[str, Any]:
    places = zip(found.touched, found.off_m, strict=True)
    return {
        "rig": config.name,
        "matrix_m": matrix_of(found.calibration),
        "measured_at": found.calibration.measured_on.isoformat(),
        "placeholder": False,
        "residual_m": found.calibration.residual_m,
        "touch_error_m": found.touch_error_m,
        "places": [{**place._asdict(), "off_m": off_m} for place, off_m in places],
        "worst": None if found.touch_error_m is None else found.worst + 1,
        "toml": rig_lines(found.calibration),
    }


def _show(found: TouchFit, rig_file: Path) -> None:
    table = Table("place", "x mm", "y mm", "x_raw", "y_raw", "off by mm", box=None)
    for number, (place, off_m) in enumerate(zip(found.touched, found.off_m, strict=True), start=1):
        lengths_mm = (f"{1e3 * length_m:.1f}" for length_m in place[:2])
        counts = (f"{count:.1f}" for count in place[2:])
        table.add_row(str(number), *lengths_mm, *counts, f"{1e3 * off_m:.2f}")
    stdout.print(table)
    calibration = found.calibration
    if calibration.residual_m is None or found.touch_error_m is None:
        stdout.print(
            "three places fit exactly, whatever was touched: nothing checks them. Give a fourth,"
            " better six"
        )
    else:
        stdout.print(
            f"residual {1e3 * calibration.residual_m:.2f} mm (rms): one touch is off by"
            f" {1e3 * found.touch_error_m:.2f} mm (rms)\nfarthest off: place {found.worst + 1}"
        )
    (a, b, _), (d, e, _) = calibration.matrix_m
    x, y = (f"({1e3 * along:.4f}, {1e3 * across:.4f}) mm" for along, across in ((a, d), (b, e)))
    stdout.print(f"a count of x_raw moves the finger by {x}, of y_raw by {y}")
    stdout.print(f"\nPut this into [finger_tracker] of {rig_file}:\n\n{rig_lines(calibration)}")
