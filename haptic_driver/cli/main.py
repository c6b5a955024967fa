"""The `haptic` command line: puts the command groups together and turns every failure into a message."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version
from typing import Annotated, Any

import typer

from haptic_driver.cli import demo, diagnose, measure, predict, solve, surface
from haptic_driver.cli.output import report_error
from haptic_driver.errors import BadInputError, HapticError
from hw.errors import DeviceError
from model.errors import ModelError

# What the parser raises for a wrong command line, whether typer ships its parser or imports it.
USAGE_ERROR: Any = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")

app = typer.Typer(
    no_args_is_help=True, add_completion=True, rich_markup_mode="markdown", pretty_exceptions_enable=False,
    help="Friction under a finger: from a target to a safe voltage on an electroadhesive touch screen.",
)  # fmt: skip
app.add_typer(surface.app, name="surface")
app.command()(predict.predict)
app.command()(solve.solve)
app.command()(demo.demo)
app.command()(diagnose.diagnose)
app.command()(measure.measure)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"haptic-driver {version('haptic-driver')}")
        raise typer.Exit


@app.callback()
def _options(
    shown: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show version.")
    ] = False,
) -> None:
    pass


def run() -> None:
    """Entry point of the `haptic` script. Exit status: 0 done, 1 failed, 2 bad input."""
    sys.exit(main(sys.argv[1:]))


def main(arguments: list[str]) -> int:
    """Run one command line and return its exit status."""
    try:
        outcome = app(arguments, standalone_mode=False, prog_name="haptic")
    except HapticError as error:
        failure = error
    except ModelError as error:
        failure = BadInputError("bad_model", error.message, error.hint)
    except DeviceError as error:
        failure = HapticError(error.code, error.message, error.hint)
    except USAGE_ERROR as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            return BadInputError.exit_status
        context = getattr(error, "ctx", None)
        command = context.command_path if context is not None else "haptic"
        failure = BadInputError("usage", error.format_message(), f"See: {command} --help")
    except (KeyboardInterrupt, typer.Abort):
        failure = HapticError("interrupted", "interrupted", "The output was switched off where a rig was open")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    else:
        return outcome if isinstance(outcome, int) else 0
    report_error(failure, "--json" in arguments)
    return failure.exit_status
