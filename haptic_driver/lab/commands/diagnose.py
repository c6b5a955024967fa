"""`haptic diagnose`: where data and model disagree, and which effect is missing."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from rich.table import Column, Table
from rich.text import Text
from typer import Argument, Option

from haptic_driver.cli.output import (
    Json,
    ModelOption,
    RigOption,
    RowsOption,
    named,
    report,
    status,
    stdout,
)
from haptic_driver.config import config_names
from haptic_driver.errors import BadInputError
from haptic_driver.files import bad_input, require_free, writing
from haptic_driver.lab.commands.columns import (
    ColumnOption,
    MapOption,
    columns_named,
    refuse_both,
    tell_doubts,
)
from haptic_driver.lab.measuring.check import described
from haptic_driver.lab.measuring.data_file import meta_path
from haptic_driver.lab.measuring.plan import LONGEST_S, Plan, Setting, load_plan, write_plan
from haptic_driver.lab.measuring.recordings import read_data
from haptic_driver.lab.measuring.resolving import ways
from haptic_driver.lab.pictures.model import draw_resolution
from haptic_driver.lab.raw_trials.folder import Bad, write_trials
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from model.description import ModelDescription
from model.diagnosis.data import COLUMNS, Measurements
from model.diagnosis.where import ALARM
from model.diagnosis.workflow import diagnose as run
from model.effects.learned import LEARNED
from model.planning.resolution import Resolution, resolution
from model.planning.separation import APART
from model.reporting.page import gap_said, leading_hypotheses, question, sentence
from model.reporting.report import write_report
from model.support.reading import read_text
from model.support.tables import BadRowsError, Named
from model.touch import SPEED_REFERENCE_M_S
from model.touch_model import TouchModel


def diagnose(
    data: Annotated[
        Path | None,
        Argument(help="CSV: frequency_hz, voltage_v, ..., cof; a recording (.h5); or trials."),
    ] = None,
    model: ModelOption = "reference",
    out: Annotated[Path, Option(help="Folder for report.html, report.json, model.toml.")] = Path(
        "diagnosis"
    ),
    also: Annotated[
        list[Path] | None,
        Option(help="More data of the same finger and rig; may be given repeatedly."),
    ] = None,
    column: ColumnOption = None,
    map_file: MapOption = None,
    rows: RowsOption = None,
    leave_out_bad: Annotated[
        bool, Option("--leave-out-bad", help="Go on without rows that cannot be used, and tell.")
    ] = False,
    seed: Annotated[int, Option(help="Of the random draws in tests and folds.", min=0)] = 0,
    plan: Annotated[
        str | None, named("plans", "A plan to judge beforehand, beside data or without")
    ] = None,
    rig: RigOption = "simulated",
    strength: Annotated[
        float,
        Option(
            help="With --plan: of the effects, in standard deviations beyond the usual.",
            min=-3.0,
            max=3.0,
        ),
    ] = 0.0,
    noise: Annotated[
        float, Option(help="With --plan: of one friction, relative.", min=1e-4, max=0.5)
    ] = 0.02,
    as_json: Json = False,
) -> None:
    """Find where measured friction and the model disagree, name the missing effect, add it, and
    prove it.

    Gives one verdict: no_discrepancy, effect_found, ambiguous, unexplained or not_testable. A name
    is given only when the data earn it. Where more data would tell more, `DIR/next_plan.toml` is a
    plan for `haptic measure`; what it measures goes in with `--also`.

    A recording of `haptic record` is cut into rows of steady sliding, which `--rows out.csv` keeps.
    With `--map` the data are raw trial files, or folders of them, whose rows are those of `haptic
    rows`. `--column cof=COF_mean:1` says what a table calls a column, and in which unit it is;
    `lateral_force_n` may stand in place of `cof`.

    Without data, `--plan P --rig R` says which effects that plan could separate on that rig. It
    compares the plan as it is, with the electrode's current as far as a card reads it, and with a
    full sweep. With data, also which those could, with the noise that they state; they are not
    diagnosed then.

    Example: `haptic diagnose data.csv --model reference --out diagnosis`
    """
    given = [*([] if data is None else [data]), *(also or ())]
    if not given and plan is None:
        raise BadInputError(
            "bad_data", "give data or --plan", "haptic diagnose data.csv, or --plan full --rig R"
        )
    refuse_both(map_file, column)
    if map_file is not None and not given:
        raise BadInputError("usage", "--map is given without trial files", "Give them too")
    named = columns_named(column, COLUMNS, "cof=COF_mean:1")
    description = load_model(model)
    names, left = ", ".join(path.name for path in given), list[Bad]()
    if map_file is not None:
        given, left = _rows_of_trials(given, map_file, rows, out, leave_out_bad)
        rows = None
    measurements = _measured(given, rows, leave_out_bad, named) if given or rows else None
    if measurements is not None and left:
        more = tuple(error.message for _, error in left)
        measurements = replace(measurements, bad_rows=(*more, *measurements.bad_rows))
    if plan is not None:
        _show_levels((plan, rig), description, measurements, out, (strength, noise), as_json)
        return
    assert measurements is not None
    with status("diagnosing") as tell:
        diagnosis = run(description, measurements, seed, tell)
    with writing(out):
        found = write_report(diagnosis, description, out, names)
    following = _write_next_plan(found["next_experiments"], out / "next_plan.toml")
    again = once_more(following, given, model, out, column or ()) if following else None
    report(
        as_json,
        found | {"next_plan": str(following) if following else None},
        lambda: _show(found, out, again),
    )


def _rows_of_trials(
    given: Sequence[Path], map_file: Path, rows: Path | None, out: Path, leave_out_bad: bool
) -> tuple[list[Path], list[Bad]]:
    """A file with the rows of raw trials, and the trials that were left out of it."""
    if rows is not None:
        require_free(rows, option="--rows")
    kept = rows or out / "rows.csv"
    found = write_trials(given, map_file, kept, leave_out_bad=leave_out_bad)
    tell_doubts(found)
    return [kept], found.bad


def _measured(
    given: Sequence[Path], rows: Path | None, leave_out_bad: bool, named: Mapping[str, Named]
) -> Measurements:
    try:
        return read_data(given, rows, leave_out_bad, named)
    except BadInputError as error:
        if isinstance(error.__cause__, BadRowsError):
            hint = f"{error.hint}\nTo go on without such rows: --leave-out-bad"
            raise BadInputError(error.code, error.message, hint) from error
        raise


def _show_levels(
    plan_and_rig: tuple[str, str],
    description: ModelDescription,
    measured: Measurements | None,
    out: Path,
    strength_and_noise: tuple[float, float],
    as_json: bool,
) -> None:
    (plan, rig), (strength, noise) = plan_and_rig, strength_and_noise
    touch = TouchModel(description)
    sets, refusals = ways(load_rig(rig), touch, load_plan(plan), noise)
    if measured is not None:
        sets = {"the data": measured} | sets
    with status("comparing") as tell, bad_input("bad_plan"):
        found = {name: resolution(description, data, strength, tell) for name, data in sets.items()}
    picture = out / "resolution.png"
    with writing(out):
        draw_resolution(found, picture)
    payload = {
        "enough": APART,
        "levels": [
            {
                "name": name,
                "observations": sets[name].count,
                "effects": {
                    effect: {"visible": level.visible(i), "alike": level.alike(i)}
                    for i, effect in enumerate(level.names)
                },
            }
            for name, level in found.items()
        ],
        "refused": described(refusals),
        "picture": str(picture),
    }

    def show() -> None:
        table = Table(
            Column("effect", no_wrap=True),
            *(f"{name} ({data.count})" for name, data in sets.items()),
        )
        for effect in dict.fromkeys(name for level in found.values() for name in level.names):
            table.add_row(effect, *(_told_apart(level, effect) for level in found.values()))
        stdout.print(table)
        stdout.print(
            f"Told apart: chi-square of {APART:.3g} or more. In brackets: rows times witnesses."
        )
        for line in described(refusals):
            stdout.print(f"left out, {line}")
        stdout.print(f"picture: {picture}")

    report(as_json, payload, show)


def _told_apart(known: Resolution, name: str) -> str:
    if name not in known.names:
        return "-"
    i = known.names.index(name)
    if known.visible(i) < APART:
        return "leaves no trace"
    alike = known.alike(i)
    return f"not from {', '.join(alike)}" if alike else "from all others"


def _write_next_plan(steps: Sequence[Mapping[str, Any]], path: Path) -> Path | None:
    """What to measure next, as a plan; None, and no file left from before, where there are no
    settings to measure.
    """
    settings = []
    for step in steps:
        # of data that do not say how fast they were
        speed_m_s = step.get("speed_m_s", SPEED_REFERENCE_M_S)
        if step["kind"] == "setting" and speed_m_s > 0.0:  # a held finger is no slide
            told = (
                step["frequency_hz"] or 0.0,
                step["voltage_v"],
                step["normal_force_n"],
                speed_m_s,
            )
            time_s = step.get("time_s")
            due_s = time_s if time_s is not None and 0.0 <= time_s <= LONGEST_S else None
            settings.append(Setting(*told, step.get("voltage_offset_v") or 0.0, time_s=due_s))
    if not settings:
        path.unlink(missing_ok=True)
        return None
    repeats = steps[0]["repeats"]
    write_plan(
        path,
        Plan(name="next", about=steps[0]["purpose"], settings=tuple(settings), repeats=repeats),
    )
    return path


def _show(found: dict[str, Any], out: Path, again: str | None) -> None:
    still = "" if found["adequate"] else " (the model is not adequate yet)"
    stdout.print(
        Text.assemble(
            "verdict: ", (found["verdict"], "bold"), still, f": {'; '.join(found['reasons'])}"
        )
    )
    if asked := question(found):
        stdout.print(asked)
    stdout.print(sentence(found))
    for said in found["learned"]["words"] if found["learned"] else ():
        stdout.print(f"  {said}")
    for effect in found["effects"]:
        if effect["name"] == LEARNED:  # no cause and no name: its values are in the model's file
            continue
        values = ", ".join(
            f"{name} = {p['value']:.3g} ± {p['std']:.2g} {_unit(p)}".rstrip()
            for name, p in effect["parameters"].items()
        )
        stdout.print(f"  {effect['name']}: probability {effect['probability']:.3f}; {values}")
        if effect["indistinguishable_from"]:
            stdout.print(
                f"    these data cannot tell it from {', '.join(effect['indistinguishable_from'])}"
            )
    if found["hypotheses"]:
        table = Table("hypothesis", "probability", title="most probable", title_justify="left")
        for said, p in leading_hypotheses(found):
            table.add_row(said, f"{p:.3g}")
        stdout.print(table)
    for region in [r for r in found["where"][:3] if r["p_value"] < ALARM]:
        said = f"p = {region['p_value']:.2g}, sign {region['sign']:+d}"
        stdout.print(f"  disagrees at {place(region)}: {said}")
    fit = found["fit"]
    if fit["gap_closed"] is not None:
        held = fit["held_out_chi2_per_point"]
        stdout.print(
            f"held out: {held['before']:.2f} -> {held['after']:.2f} per point (1 is noise);"
            f" the new model {gap_said(fit['gap_closed'], fit['gap_closed_interval'])}"
        )
    for note in _notes(found):
        stdout.print(note)
    if again is not None:
        stdout.print(f"to tell more, on the same rig:\n  {again}")
    stdout.print(f"report: {out / 'report.html'}; model: {found['model']}")
    for picture in found["pictures"]:
        stdout.print(f"picture: {picture}")


def _notes(found: Mapping[str, Any]) -> Iterator[str]:
    yield from found["data"]["read_as"]
    yield from (f"warning: {warning}" for warning in found["warnings"])
    if hidden := len(found["out_of_sight"]):
        yield f"effects of usual size that these data could not show: {hidden}; see the report"


def place(region: Mapping[str, Any]) -> str:
    """Where a region lies, on one axis or on two."""
    axes, lows, highs = (
        value if isinstance(value, list) else [value]
        for value in (region["axis"], region["low"], region["high"])
    )
    return " and ".join(
        f"{axis} {low:g} to {high:g}" for axis, low, high in zip(axes, lows, highs, strict=True)
    )


def once_more(
    plan: Path, given: Sequence[Path], model: str, out: Path, columns: Sequence[str] = ()
) -> str:
    """The commands that measure a plan and diagnose all of it, as they may be pasted."""
    measured = out / "more.csv"
    rig = _rig_of(given[0])
    also = [word for path in [*given[1:], measured] for word in ("--also", str(path))]
    measure = ["haptic", "measure", "--rig", rig, "--plan", str(plan), "--out", str(measured)]
    called = [word for said in columns for word in ("--column", said)]
    diagnose = ["haptic", "diagnose", str(given[0]), *also, *called]
    diagnose += ["--model", model, "--out", str(out)]
    return f"{shlex.join(measure)} && \\\n  {shlex.join(diagnose)}"


def _rig_of(data: Path) -> str:
    """The rig that a file was measured on: its name, or its file where that lies beside."""
    sidecar = meta_path(data)
    name = json.loads(read_text(sidecar)).get("rig", "") if sidecar.exists() else ""
    if name in config_names("rigs"):
        return str(name)
    beside = sorted(data.parent.glob("*.toml")) if name else []
    said = f'name = "{name}"'
    return str(next((path for path in beside if said in read_text(path)), "RIG.toml"))


def _unit(parameter: Mapping[str, Any]) -> str:
    """A pure number has none."""
    return "" if parameter["unit"] == "1" else str(parameter["unit"])
