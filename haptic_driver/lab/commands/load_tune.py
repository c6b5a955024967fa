"""`haptic load tune`: the stiffness of a finger that a load stage presses."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

from typer import Option

from haptic_driver.cli.load import Yes, pressed
from haptic_driver.cli.output import Json, RigOption, report, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.lab.load_tuning import tune
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.load_gains import LoadGains
from haptic_driver.rig.parts.load_stages import LoadStageSection


def load_tune(
    by: Annotated[str, Option(help="Who tunes; it is written beside the figures.")],
    newtons: Annotated[float, Option(help="Load at which to tune, N.")] = 0.5,
    rig: RigOption = "simulated-paper",
    out: Annotated[
        Path | None, Option(help="File to write; the rig's gains_file if left out.")
    ] = None,
    yes: Yes = False,
    as_json: Json = False,
) -> None:
    """Find the finger's stiffness by steps of a tenth of a held load, and write it down.

    `haptic load hold` and `haptic measure` take it from the file that `load_stage.gains_file`
    names.

    Example: `haptic load tune --rig simulated-paper --by 'A. Smith' --out load_gains.toml`
    """
    if not by.strip():
        raise BadInputError("usage", "--by is empty", "Say who tunes")
    config = load_rig(rig)
    section = config.load_stage
    named = section.gains_file if isinstance(section, LoadStageSection) else ""
    path = out or (Path(named) if named else None)
    with pressed(config, newtons, yes) as loop:
        found = tune(loop)
    gains = LoadGains(**found._asdict(), tuned_by=by.strip(), tuned_at=datetime.date.today())
    if path is not None:
        gains.write(path)
    said = {**gains.model_dump(mode="json"), "out": None if path is None else str(path)}
    report(as_json, said, lambda: _show(gains, path))


def _show(gains: LoadGains, path: Path | None) -> None:
    found = f"{gains.stiffness_n_per_m:.3g} N/m, the steps differ by {gains.spread_n_per_m:.2g} N/m"
    stdout.print(f"stiffness at 0.5 N: {found} (1 sigma)")
    if path is None:
        stdout.print(
            "not written down: give --out, or name load_stage.gains_file in the rig's file"
        )
    else:
        stdout.print(f"-> {path}; used where load_stage.gains_file names it")
