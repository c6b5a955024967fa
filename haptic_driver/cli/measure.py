"""`haptic measure`: an experiment on the rig, from a plan to a data file."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from math import ceil
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text
from typer import Option

from haptic_driver.cli.output import (
    SIMULATED,
    Json,
    ModelOption,
    RigOption,
    named,
    progress,
    report,
    stderr,
    stdout,
)
from haptic_driver.config import parse, read_toml
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.experiments.bench import SimulatedBench
from haptic_driver.experiments.check import told
from haptic_driver.experiments.data_file import DataFile
from haptic_driver.experiments.plan import load_plan
from haptic_driver.experiments.run import Experiment, prepare, run
from haptic_driver.experiments.stage_bench import StageBench
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.evidence import OffEvidence
from haptic_driver.rig.states import RigState
from haptic_driver.simulation.friction import FrictionLaw, with_hidden
from haptic_driver.surface.models import load_model
from model.touch_model import TouchModel

GIVEN = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "time_s")  # what a --hide-function takes


def measure(
    plan: Annotated[str, named("plans", "Plan")],
    out: Annotated[Path, Option(help="CSV to write, one row at a time.")],
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    resume: Annotated[bool, Option("--resume", help="Continue a file that was interrupted.")] = False,
    force: Annotated[bool, Option("--force", help="Overwrite an existing file.")] = False,
    strict: Annotated[bool, Option("--strict", help="Refused points are an error, not skipped.")] = False,
    seed: Annotated[int | None, Option(min=0, help="Order and noise; the plan's own if left out.")] = None,
    hide: Annotated[Path | None, Option(help="TOML: effects that the simulated finger has.")] = None,
    hide_function: Annotated[str | None, Option(help="module:function, the simulated finger's whole friction.")] = None,
    yes: Annotated[bool, Option("--yes", help="A real rig begins without asking; somebody is there.")] = False,
    as_json: Json = False,
) -> None:
    """Measure friction over a plan's frequencies, voltages, loads and speeds.

    Points outside the rig's limits, with the finger currents that the model predicts, are listed first and never
    energised. Every row is on the disk before the next begins. On a real rig the stage slides once per row, and waits
    for the finger to press as the plan says. A simulated finger may be given effects that the model does not know, as
    `[series_resistance] resistance_ohm = 2e4` in a file, or as any function `(frequency_hz, voltage_v, normal_force_n,
    speed_m_s, time_s) -> lateral force in N`; the data do not say which.

    Example: `haptic measure --rig simulated --plan paper --out data.csv`
    """
    config = load_rig(rig)
    if not config.simulated and (hide is not None or hide_function is not None):
        raise BadInputError("usage", f"rig {config.name} is real: nothing can be hidden in its finger", "Leave it out")
    if resume and force:
        raise BadInputError("usage", "--resume and --force contradict each other", "Give one of them")
    if hide is not None and hide_function is not None:
        raise BadInputError("usage", "--hide and --hide-function both say what friction is", "Give one of them")
    if hide is not None:
        config = _hiding(config, hide)
    law, source = (None, "") if hide_function is None else _function(hide_function)
    touch = TouchModel(load_model(model))
    with_hidden(touch, config.simulation.hide)  # refused before anything is written
    experiment = prepare(config, touch, load_plan(plan), seed)
    _tell_refused(experiment, strict)
    _ask(experiment, yes)
    identity = experiment.identity(source)
    opened = DataFile.resume(out, identity, experiment.rows) if resume else DataFile.create(out, identity, force=force)
    total = len(experiment.rows)
    with opened as data, progress("measuring", total) as advance:
        bench = _bench(experiment, data.done, law, advance.tell)
        try:
            with bench:
                off = run(experiment, bench, data, advance, advance.tell)
        except KeyboardInterrupt as stop:
            is_off = bench.rig.state is RigState.OFF
            output = "the output is off" if is_off else "the output MAY STILL BE ON: switch the amplifier off by hand"
            said = f"interrupted; {data.done} of {total} rows are in {out}, {output}"
            raise HapticError("interrupted", said, "Continue with --resume") from stop
    report(as_json, _payload(experiment, data.done, out), lambda: _show(experiment, out, off))


def _payload(experiment: Experiment, rows: int, out: Path) -> dict[str, Any]:
    return {
        "rows": rows,
        "skipped": experiment.skipped,
        "out": str(out),
        "plan": experiment.plan.name,
        "simulated": experiment.config.simulated,
        "duration_s": experiment.duration_s,
        "refused": [{**refusal.setting._asdict(), "reason": refusal.reason} for refusal in experiment.refusals],
    }


def _bench(
    experiment: Experiment, done: int, law: FrictionLaw | None, tell: Callable[[str], None]
) -> SimulatedBench | StageBench:
    config, plan = experiment.config, experiment.plan
    if config.simulated:
        return SimulatedBench(config, experiment.model, seed=experiment.seed, first_row=done, friction=law)
    return StageBench(config, plan, tell)


def _ask(experiment: Experiment, yes: bool) -> None:
    """A real rig is energised and moved only while somebody is there who has said so."""
    if yes or experiment.config.simulated:
        return
    highest_v = max((row.setting.voltage_v for row in experiment.rows), default=0.0)
    stderr.print(
        f"rig {experiment.config.name} is real: {len(experiment.rows)} rows, up to {highest_v:g} V peak, at least "
        f"{ceil(experiment.duration_s / 60)} min; the stage will move, and home if it has not.\n"
        "Take the finger off the screen: the force sensor's bias comes first."
    )
    if not sys.stdin.isatty():
        said = f"rig {experiment.config.name} is real, and nobody was asked whether to begin: no terminal"
        raise BadInputError("not_attended", said, "Run it on a terminal, or give --yes while somebody watches the rig")
    if not typer.confirm("Begin?", err=True):
        raise BadInputError("not_attended", "not begun: nothing was moved or energised", "Answer y to begin")


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


def _function(name: str) -> tuple[FrictionLaw, str]:
    """A friction function by `module:function` or `file.py:function`, and its source."""
    module_name, _, function_name = name.rpartition(":")
    hint = "Give module:function or file.py:function"
    try:
        if module_name.endswith(".py"):
            spec = importlib.util.spec_from_file_location(Path(module_name).stem, module_name)
            if spec is None or spec.loader is None:
                raise ImportError(module_name)
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
        else:
            sys.path.insert(0, "")
            try:
                module = importlib.import_module(module_name)
            finally:
                sys.path.remove("")
        function = getattr(module, function_name)
        source = inspect.getsource(module)
    except Exception as error:
        raise BadInputError("bad_function", f"--hide-function {name}: cannot be loaded ({error!r})", hint) from error
    if not callable(function):
        raise BadInputError("bad_function", f"--hide-function {name}: is not a function", hint)

    def law(frequency_hz: float, voltage_v: float, normal_force_n: float, speed_m_s: float, time_s: float) -> float:
        try:
            return float(function(frequency_hz, voltage_v, normal_force_n, speed_m_s, time_s))
        except Exception as error:
            said = f"--hide-function {name}: raised {error!r}"
            raise HapticError("function_failed", said, f"It is called with {', '.join(GIVEN)}") from error

    return law, source


def _tell_refused(experiment: Experiment, strict: bool) -> None:
    refusals = experiment.refusals
    if not refusals:
        return
    for line in told(refusals):
        stderr.print(f"refused: {line}")
    said = f"rig {experiment.config.name} refuses {len(refusals)} of {len(experiment.plan.settings)} points"
    if strict:
        raise BadInputError("refused", f"plan {experiment.plan.name}: {said}", "Change the plan, or leave out --strict")
    stderr.print(f"warning: {said}; {experiment.skipped} rows are skipped")


def _show(experiment: Experiment, out: Path, off: OffEvidence) -> None:
    measured = f"{len(experiment.rows)} rows of plan '{experiment.plan.name}' on "
    if experiment.config.simulated:
        minutes = f" rig -> {out} ({experiment.duration_s / 60:.1f} min of simulated time)"
        stdout.print(Text.assemble(measured, "a ", SIMULATED, minutes))
    else:
        stdout.print(f"{measured}rig {experiment.config.name} -> {out}")
    if experiment.skipped:
        stdout.print(f"{experiment.skipped} rows skipped: outside the rig's limits")
    stdout.print(f"output at the end: {off}")
