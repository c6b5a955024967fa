"""`haptic calibrate-panel`: what a touch screen's own counts say of the contact area."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from haptic_driver.cli.output import Json, report, stdout
from haptic_driver.files import require_free
from haptic_driver.lab.contact.panel_file import calibrated_by, read_frames, write_calibration
from haptic_driver.lab.contact.panel_frame import PanelCalibration

ONE_FINGER = "one finger: how far the areas of other fingers are off is not known"


def calibrate_panel(
    frames: Annotated[Path, Argument(help="Capacitive frames: NPY or NPZ [frame, row, column].")],
    areas: Annotated[
        Path, Argument(help="CSV, a row per frame: contact_area_m2, and finger if several.")
    ],
    out: Annotated[Path, Option(help="TOML to write.")] = Path("panel.toml"),
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Calibrate a panel's capacitive frames to contact areas that a camera saw at the same time.

    Example: `haptic calibrate-panel frames.npy contact.csv --out panel.toml`
    """
    require_free(out, force)
    calibration, left = calibrated_by(read_frames(frames), areas)
    write_calibration(calibration, out)
    said = [ONE_FINGER] if calibration.fingers == 1 else []
    said += [f"{count} frames are not used: {why}" for why, count in left.items()]
    payload = {"out": str(out), "said": said, **calibration.model_dump()}
    report(as_json, payload, lambda: _show(calibration, out, said))


def _show(calibration: PanelCalibration, out: Path, said: list[str]) -> None:
    stdout.print(f"{out}: {calibration.touches} touches of {calibration.fingers} fingers")
    for words in said:
        stdout.print(f"  {words}")
    left = "fingers" if calibration.fingers > 1 else "touches"
    median = f"{calibration.constant_error:.0%} by the others' median area"
    stdout.print(f"areas of {left} left out are off by {calibration.error:.0%}; {median}")
