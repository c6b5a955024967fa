"""`haptic measure`: an experiment on the rig, from a plan to a data file."""

from __future__ import annotations

import datetime
from math import ceil
from pathlib import Path
from typing import Annotated, Any

from rich.text import Text
from typer import Option

from haptic_driver.cli.output import (
    SIMULATED,
    Json,
    ModelOption,
    RigOption,
    confirm_attended,
    named,
    progress,
    report,
    stderr,
    stdout,
)
from haptic_driver.config import parse
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab.measuring.benches import bench_for
from haptic_driver.lab.measuring.check import described
from haptic_driver.lab.measuring.data_file import DataFile
from haptic_driver.lab.measuring.plan import load_plan
from haptic_driver.lab.measuring.run import Experiment, prepare, run
from haptic_driver.lab.measuring.spectra import Stray, mark_spectra
from haptic_driver.lab.measuring.start_line import start_line
from haptic_driver.lab.strokes.file import StrokesFile, require_free, strokes_path
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.simulation.finger_function import load_finger
from haptic_driver.simulation.finger_model import finger_of
from model.effects.interventions import BY_INTERVENTION, NOTHING
from model.support.reading import read_toml
from model.touch_model import TouchModel


def measure(
    plan: Annotated[str, named("plans", "Plan")],
    out: Annotated[Path, Option(help="CSV to write, one row at a time.")],
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    resume: Annotated[
        bool, Option("--resume", help="Continue a file that was interrupted.")
    ] = False,
    force: Annotated[bool, Option("--force", help="Overwrite an existing file.")] = False,
    strict: Annotated[
        bool, Option("--strict", help="Refused points are an error, not skipped.")
    ] = False,
    seed: Annotated[
        int | None, Option(min=0, help="Order and noise; the plan's own if left out.")
    ] = None,
    hide: Annotated[
        Path | None, Option(help="TOML: effects that the simulated finger has.")
    ] = None,
    finger: Annotated[
        str | None, Option(help="module:function, all that the simulated finger does.")
    ] = None,
    figure: Annotated[
        bool, Option("--figure", help="Draw figure 3 beside the data: haptic figure.")
    ] = False,
    yes: Annotated[
        bool, Option("--yes", help="A real rig begins without asking; somebody is there.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Measure friction, and the electrode's voltage and current, over a plan's settings.

    Points outside the rig's limits, with the finger currents that the model predicts, are listed
    first and never energised. Every row is on the disk before the next begins. On a real rig the
    stage slides once per row, and waits for the finger to press as the plan says. Where the rig's
    `[line_in]` says `start = "stroke"`, a row that slides waits for an edge too. A simulated
    finger may be given effects that the model does not know, as `[series_resistance] resistance_ohm
    = 2e4` in a file. It may also be any function of arrays `(frequency_hz, voltage_v,
    normal_force_n, speed_m_s, time_s)` that returns the lateral force in N. Or it returns
    `(lateral_force_n, current_a, electrode_voltage_v)` with complex peak phasors against the set
    voltage. The data do not say which.

    Every stroke is kept beside the data, in `data.strokes.h5`.

    Example: `haptic measure --rig simulated --plan paper --out data.csv`
    """
    config = load_rig(rig)
    if not config.simulated and (hide is not None or finger is not None):
        raise BadInputError(
            "usage",
            f"rig {config.name} is real: nothing can be hidden in its finger",
            "Leave it out",
        )
    if resume and force:
        raise BadInputError(
            "usage", "--resume and --force contradict each other", "Give one of them"
        )
    if hide is not None and finger is not None:
        raise BadInputError(
            "usage", "--hide and --finger both say what the finger does", "Give one of them"
        )
    if hide is not None:
        config = _hiding(config, hide)
    function = None if finger is None else load_finger(finger)
    touch = TouchModel(load_model(model))
    finger_of(touch, config.simulation)  # refused before anything is written
    experiment = prepare(config, touch, load_plan(plan), seed)
    _tell_refused(experiment, strict)
    _ask(experiment, yes)
    identity = experiment.identity(function.source if function else "")
    path = strokes_path(out)
    if not resume:
        require_free(path, force=force)
    opened = (
        DataFile.resume(out, identity, experiment.rows)
        if resume
        else DataFile.create(out, identity, force=force)
    )
    begin = StrokesFile.resume if resume else StrokesFile.create
    about: dict[str, str | float] = {
        "plan": identity.plan,
        "model": identity.model,
        "rig": identity.rig,
        "simulated": float(identity.simulated),
    }
    total = len(experiment.rows)
    with (
        opened as data,
        begin(path, about) as strokes,
        progress("measuring", total) as advance,
        start_line(config, advance.tell) as line,
    ):
        bench = bench_for(experiment, data.done, function, advance.tell)
        bench.await_start = line.wait if line else bench.await_start
        try:
            with bench:
                off = run(experiment, bench, data, advance, advance.tell, strokes)
        except KeyboardInterrupt as stop:
            output = bench.rig.output
            said = f"interrupted; {data.done} of {total} rows are in {out}, the output is {output}"
            hint = "" if output.on is False else "Switch the amplifier off by hand. "
            raise HapticError("interrupted", said, f"{hint}Continue with --resume") from stop
    stray = _check_spectra(experiment, out)
    payload = _payload(experiment, data.done, out, stray)
    payload |= {} if line is None else {"edges": line.reader.edges, "edges_ignored": line.ignored}
    drawn = _draw(out, model) if figure else []
    payload |= {"files": [str(file) for file in drawn]} if figure else {}

    def say() -> None:
        _show(experiment, out, off, stray)
        for file in drawn:
            stdout.print(str(file), markup=False)

    report(as_json, payload, say)


def _draw(out: Path, model: str) -> list[Path]:
    """Figures 3 and 7(a) beside the data."""
    # only who draws waits
    from haptic_driver.lab.commands.figure import curves_of, draw  # noqa: PLC0415
    from haptic_driver.lab.strokes.means import stroke_means  # noqa: PLC0415

    means = stroke_means(out, {})
    return draw(means, out.with_name(f"{out.stem}-figure-3.png"), curves_of(means, model, None))


def _payload(experiment: Experiment, rows: int, out: Path, stray: Stray | None) -> dict[str, Any]:
    return {
        "rows": rows,
        "skipped": experiment.skipped,
        "out": str(out),
        "strokes": str(strokes_path(out)),
        "plan": experiment.plan.name,
        "simulated": experiment.config.is_computed,
        "duration_s": experiment.duration_s,
        "stray_capacitance": None if stray is None else stray._asdict(),
        "refused": [
            {**refusal.setting._asdict(), "reason": refusal.reason}
            for refusal in experiment.refusals
        ],
    }


def _ask(experiment: Experiment, yes: bool) -> None:
    """A real rig is energised and moved only while somebody is there who has said so."""
    if yes or experiment.config.simulated:
        return
    done = experiment.plan.intervention
    highest_v = max((row.setting.voltage_v for row in experiment.rows), default=0.0)
    stderr.print(
        f"rig {experiment.config.name} is real: {len(experiment.rows)} rows, up to {highest_v:g} V"
        f" peak, at least {ceil(experiment.duration_s / 60)} min; the stage will move, and home if"
        " it has not.\nTake the finger off the screen: the force sensor's bias comes first."
        + (f"\nThe plan wants this done: {BY_INTERVENTION[done].todo}." if done != NOTHING else "")
    )
    if any(row.setting.by_meter for row in experiment.rows):
        stderr.print(
            "The LCR meter drives the electrode: take the amplifier's lead off it, and wire the"
            " meter's to it."
        )
    confirm_attended(experiment.config.name)


def _hiding(config: RigConfig, path: Path) -> RigConfig:
    """The rig with the effects of a file hidden in its finger, beside those of its own."""
    try:
        content = read_toml(path)
    except BadInputError as error:
        hint = f"{error.hint}. For example: [series_resistance] resistance_ohm = 2e4"
        raise BadInputError("bad_hide", error.message, hint) from None
    simulation = config.simulation
    both = {**simulation.model_dump(), "hide": {**simulation.hide, **content}}
    return config.model_copy(update={"simulation": parse(type(simulation), both, str(path))})


def _check_spectra(experiment: Experiment, out: Path) -> Stray | None:
    """Marks what contradicts Kramers and Kronig, and says so."""
    if not any(row.setting.sweep for row in experiment.rows):
        return None
    failed, stray = mark_spectra(out, datetime.date.today())
    if failed:
        said = (
            f"{failed} rows of sweeps contradict Kramers and Kronig: something changed while they"
            " were measured"
        )
        stderr.print(f"warning: {said}; they are marked in the column kramers_kronig")
    return stray


def _tell_refused(experiment: Experiment, strict: bool) -> None:
    refusals = experiment.refusals
    if not refusals:
        return
    for line in described(refusals):
        stderr.print(f"refused: {line}")
    said = (
        f"rig {experiment.config.name} refuses {len(refusals)} of {len(experiment.plan.settings)}"
        " points"
    )
    if strict:
        raise BadInputError(
            "refused",
            f"plan {experiment.plan.name}: {said}",
            "Change the plan, or leave out --strict",
        )
    stderr.print(f"warning: {said}; {experiment.skipped} rows are skipped")


def _show(experiment: Experiment, out: Path, off: KnownOutput, stray: Stray | None) -> None:
    measured = f"{len(experiment.rows)} rows of plan '{experiment.plan.name}' on "
    if experiment.config.simulated:
        minutes = f" rig -> {out} ({experiment.duration_s / 60:.1f} min of simulated time)"
        stdout.print(Text.assemble(measured, "a ", SIMULATED, minutes))
    else:
        stdout.print(f"{measured}rig {experiment.config.name} -> {out}")
    if experiment.skipped:
        stdout.print(f"{experiment.skipped} rows skipped: outside the rig's limits")
    if stray is not None:
        stdout.print(f"for the model's file: {stray.as_parameter()}", markup=False)
    stdout.print(f"output at the end: {off}")
