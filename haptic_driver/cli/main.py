"""The `haptic` command line: puts the command groups together and turns every failure into a
message.
"""

from __future__ import annotations

import gc
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from typer import Option

from haptic_driver.cli.output import compiling, report_error
from haptic_driver.errors import BadInputError, HapticError
from hw.errors import DeviceError
from model.support.errors import ModelError

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # its threads would wait for each other over small matrices

# Panels of `haptic --help`: the first line of each command's docstring, or its group's help. The
# help imports none of them. A module is imported only when its command is asked for: `haptic off`
# must not wait for matplotlib.
WITHOUT_RIG = {
    "demo": (
        "Slide a finger over a texture on a simulated rig and compare friction with its target."
    ),
    "predict": "Predict force, friction and current for a table of conditions.",
    "surface": "Build, describe and draw the lookup surface.",
    "solve": "Find the frequency and voltage that give a target friction within the rig's limits.",
    "explore": (
        "Draw the force's spectrum under several drives, the impedance, where force turns steep,"
        " and friction."
    ),
    "study": (
        "Solve a surface for every finger of a study and say how friction, force and reach spread"
        " over them."
    ),
    "sensitivity": (
        "Say how much each uncertain number adds to the spread of the electrostatic force (Sobol"
        " indices)."
    ),
    "reproduce": (
        "Compute figures 4 to 8 of the paper: pictures, CSV tables, and its statements beside what"
        " comes out."
    ),
    "simulate": (
        "Serve the simulated instruments of a rig on loopback until interrupted, for any software"
        " to talk to."
    ),
}
ON_A_RIG = {
    "doctor": (
        "Check a rig without energising it: identity, settings, limits, monitors, calibration"
        " dates, scheduling."
    ),
    "calibrate-touch": (
        "Calibrate a rig's touch screen: touch known places as asked, and paste what it says."
    ),
    "daemon": "Run the daemon.",
    "arm": (
        "Arm, and hold the lease until Ctrl-C or `haptic disarm`; whatever ends this leaves the"
        " output off."
    ),
    "set": "Ask for one friction everywhere; somebody must have armed.",
    "texture": "List, draw, check, import and play textures.",
    "off": (
        "Output to zero at once; whoever armed stays armed. Fails when the output cannot be shown"
        " to be off."
    ),
    "disarm": "Output to zero at once, and end the lease, whoever holds it.",
    "status": "Say what the daemon does; `output_on` is null where nobody knows.",
    "watch": (
        "Show state, friction, voltage and flags until Ctrl-C; in a pipe or with --json, a JSON"
        " object per line."
    ),
    "use": (
        "Render by another model, such as one that `haptic calibrate` made for a finger; while the"
        " daemon is idle."
    ),
    "reset": "Acknowledge a fault or trip whose cause is gone.",
}
EXPERIMENTS = {
    "record": "Record every tick into a file, until --stop.",
    "mark": "Write a marker among the daemon's events and into the recording.",
    "export": "Write a run of a recording as CSV or Parquet, one row per tick.",
    "experiment": (
        "Run psychophysical experiments, try their design without a rig, and fit what was answered."
    ),
}
DIAGNOSIS = {
    "measure": "Measure friction, and the electrode's voltage and current, over a plan's settings.",
    "diagnose": (
        "Find where measured friction and the model disagree, name the missing effect, add it, and"
        " prove it."
    ),
    "investigate": (
        "Measure, diagnose, propose and measure again, until the missing effect has a name."
    ),
    "calibrate": (
        "Fit a finger's own numbers (roughness, skin thickness, leakage, friction at 0 V) to its"
        " data."
    ),
    "why": (
        "Diagnose what was rendered so far, while rendering goes on: which effect is missing from"
        " the model."
    ),
    "adapt": (
        "Mend the finger's model while it renders, by what is felt, as its skin dries or moistens;"
        " or go back."
    ),
}
PANELS = {
    "Without a rig": WITHOUT_RIG,
    "On a rig, simulated or real": ON_A_RIG,
    "Record and experiment": EXPERIMENTS,
    "When friction is not as the model says": DIAGNOSIS,
}
COMMANDS = WITHOUT_RIG | ON_A_RIG | EXPERIMENTS | DIAGNOSIS
GROUPS = ("surface", "texture", "daemon", "experiment")
CONTROL = (
    "arm",
    "set",
    "off",
    "disarm",
    "use",
    "adapt",
    "reset",
    "status",
)  # in one module; each other one has its own

# What the parser raises for a wrong command line, whether typer ships its parser or imports it.
USAGE_ERROR: Any = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")


def _show_version(wanted: bool) -> None:
    if wanted:
        commit = _commit()
        typer.echo(f"haptic-driver {version('haptic-driver')}" + (f" ({commit})" if commit else ""))
        raise typer.Exit


def _commit() -> str:
    """The commit that a wheel was built from, or that of the checkout; empty where there is
    neither.
    """
    package = Path(__file__).resolve().parents[1]
    if (built_from := package / "commit.txt").is_file():
        return built_from.read_text(encoding="ascii").strip()
    if not (package.parent / ".git").exists():
        return ""
    ask = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        done = subprocess.run(ask, cwd=package, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip()


def _options(
    shown: Annotated[
        bool, Option("--version", callback=_show_version, is_eager=True, help="Show version.")
    ] = False,
) -> None:
    pass


def build_app(imported: Iterable[str] = COMMANDS) -> typer.Typer:
    """The command line; of a command that is not `imported` it knows the name and the summary
    alone.
    """
    app = typer.Typer(
        no_args_is_help=True,
        add_completion=True,
        rich_markup_mode="markdown",
        pretty_exceptions_enable=False,
        help=(
            "Friction under a finger: from a target to a safe voltage on an electroadhesive touch"
            " screen."
        ),
        epilog="Exit status: 0 done, 1 failed, 2 what was given cannot be used.",
    )
    app.callback()(_options)
    for panel, commands in PANELS.items():
        for name, summary in commands.items():
            if name not in imported:
                app.command(name, help=summary, rich_help_panel=panel)(_not_imported)
            elif name in GROUPS:
                app.add_typer(module_of(name).app, name=name)
            else:
                app.command(name)(
                    getattr(
                        module_of(name), "set_target" if name == "set" else name.replace("-", "_")
                    )
                )
    return app


def module_of(name: str) -> Any:
    """Where a command or group lives."""
    return import_module(
        f"haptic_driver.cli.{'control' if name in CONTROL else name.replace('-', '_')}"
    )


def _not_imported() -> None:
    raise AssertionError("a command that runs is imported first")


def _being_completed() -> list[str]:
    """The words behind `haptic` on the line that a shell asks to complete."""
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or ""
    return line.split()[1:]


def _said(error: Any) -> str:
    """What the parser says, and what it was given."""
    cause = error.__cause__
    given = f", not {cause.errors()[0]['input']!r}" if isinstance(cause, ValidationError) else ""
    return f"{error.format_message()}{given}"


def run() -> None:
    """Entry point of the `haptic` script. Exit status: 0 done, 1 failed, 2 bad input."""
    gc.set_threshold(
        50_000
    )  # imports make many objects and no garbage; to look for it took a tenth of `haptic solve`,
    status = main(sys.argv[1:])
    gc.freeze()  # and at the end a quarter
    sys.exit(status)


def main(arguments: list[str]) -> int:
    """Run one command line and return its exit status."""
    if arguments[:1] == [
        "set"
    ]:  # the parser takes a negative number for an option, but not one behind a space
        arguments = [f" {word}" if re.match(r"-\.?\d", word) else word for word in arguments]
    asked = [word for word in arguments or _being_completed() if word in COMMANDS][:1]
    app = build_app(asked)
    try:
        with compiling():
            outcome = app(arguments, standalone_mode=False, prog_name="haptic")
    except HapticError as error:
        failure = error
    except ModelError as error:
        failure = BadInputError(error.code, error.message, error.hint)
    except DeviceError as error:
        failure = HapticError(error.code, error.message, error.hint)
    except USAGE_ERROR as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            return BadInputError.exit_status
        context = getattr(error, "ctx", None)
        command = context.command_path if context is not None else "haptic"
        failure = BadInputError("usage", _said(error), f"See: {command} --help")
    except (KeyboardInterrupt, typer.Abort):
        failure = HapticError(
            "interrupted", "interrupted", "The output was switched off where a rig was open"
        )
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        failure = HapticError(
            "system",
            f"{where}{error.strerror or error}",
            "Check that path, its rights and its disk",
        )
    else:
        return outcome if isinstance(outcome, int) else 0
    report_error(failure, "--json" in arguments)
    return failure.exit_status
