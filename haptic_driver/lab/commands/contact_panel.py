"""`haptic contact-panel`: the contact area of each touch in a panel's capacitive frames."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from haptic_driver.cli.output import Json, report, stdout
from haptic_driver.errors import HapticError, require_range
from haptic_driver.files import require_free, write_rows
from haptic_driver.lab.contact.judge import NO_FINGER
from haptic_driver.lab.contact.panel_file import read_calibration, read_frames
from haptic_driver.lab.contact.panel_frame import PanelCalibration, Touch
from haptic_driver.lab.contact.times import read_times

Row = dict[str, str | float]
BEYOND = "beyond the areas of the calibration"
NO_TIMES = "nothing says when frames were taken: one a second is counted"


def contact_panel(
    frames: Annotated[
        Path, Argument(help="Capacitive frames: NPY or NPZ [frame, row, column], or CSV of one.")
    ],
    calibration: Annotated[Path, Option(help="TOML of `haptic calibrate-panel`.")],
    times: Annotated[Path | None, Option(help="Time stamps in s, a line per frame.")] = None,
    rate: Annotated[float | None, Option(help="Frames per second, where no file says.")] = None,
    out: Annotated[Path, Option(help="CSV to write.")] = Path("contact.csv"),
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Tell the contact area of each touch in a panel's capacitive frames.

    Example: `haptic contact-panel frames.npy --calibration panel.toml --rate 100`
    """
    if rate is not None:
        require_range("--rate", rate, 1e-3, 1e6, unit=" frames per second")
    require_free(out, force)
    panel, given = read_calibration(calibration), read_frames(frames)
    time_s = np.arange(len(given)) / (rate or 1.0)
    if times is not None:
        time_s = read_times(times, len(given))
    said = [] if times is not None or rate is not None else [NO_TIMES]
    rows = [
        _row(panel, number, float(time), touch, said)
        for number, (time, frame) in enumerate(zip(time_s, given, strict=True))
        for touch in (*panel.seen(frame),) or (None,)
    ]
    write_rows(out, rows)
    area_m2 = [float(row["contact_area_m2"]) for row in rows if not row["bad"]]
    bad = dict(Counter(str(row["bad"]) for row in rows if row["bad"]))
    words = ", ".join(f"{count} {why}" for why, count in bad.items()) or "none is bad"
    if not area_m2:
        none = f"{frames}: no touch counts ({words})"
        raise HapticError("no_contact", none, "Is the calibration of this panel and its counts?")
    mean_m2 = float(np.mean(area_m2))
    payload = {
        "out": str(out),
        "frames": len(given),
        "counted": len(area_m2),
        "bad": bad,
        "area_m2": mean_m2,
        "said": said,
    }

    def show() -> None:
        stdout.print(f"{out}: {len(area_m2)} touches in {len(given)} frames count; {words}")
        for one in said:
            stdout.print(f"  {one}")
        share = f"each within {panel.log_std:.0%} (1 sigma), most of it common to a finger"
        stdout.print(f"contact area {1e6 * mean_m2:.1f} mm² on average, {share}")

    report(as_json, payload, show)


def _row(
    panel: PanelCalibration, number: int, time_s: float, touch: Touch | None, said: list[str]
) -> Row:
    """A line of the CSV; a touch that does not count has no area, and says why."""
    row: Row = {"frame": number, "time_s": f"{time_s:.9g}"}
    bad, doubts = (touch.bad if touch else NO_FINGER), list(said)
    values = dict.fromkeys(("contact_area_m2", "contact_area_std_m2"), "")
    if touch and not bad:
        area_m2, std_m2 = panel.area(touch)
        values = {"contact_area_m2": f"{area_m2:.6g}", "contact_area_std_m2": f"{std_m2:.4g}"}
        if not panel.least_area_m2 <= area_m2 <= panel.most_area_m2:
            doubts.append(BEYOND)
    row |= values
    row["centre_row"] = f"{touch.row:.4g}" if touch else ""
    row["centre_column"] = f"{touch.column:.4g}" if touch else ""
    return row | {"bad": bad, "doubts": "; ".join(doubts)}
