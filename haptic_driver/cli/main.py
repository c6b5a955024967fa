"""The `haptic` command line: puts the command groups together and turns every failure into a
message.
"""

from __future__ import annotations

import gc
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from typer import Option

from haptic_driver.cli.output import (
    compiling,
    lose_output,
    output_was_lost,
    prepare_output,
    report_error,
)
from haptic_driver.daemon.verbs import commands
from haptic_driver.errors import BadInputError, HapticError

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # its threads would wait for each other over small matrices

ON_A_RIG = "On a rig, simulated or real"
# What `haptic --help` lists besides the verbs of the daemon. A module is imported only when its
# command is asked for: `haptic off` must not wait for matplotlib.
PANELS = {
    "Without a rig": (
        "demo",
        "predict",
        "surface",
        "solve",
        "explore",
        "study",
        "sensitivity",
        "reproduce",
        "contact",
        "simulate",
    ),
    ON_A_RIG: (
        "doctor",
        "safety",
        "datasheet",
        "calibrate-touch",
        "load",
        "daemon",
        "arm",
        "texture",
        "scene",
        "watch",
    ),
    "Record and experiment": ("record", "mark", "export", "experiment"),
    "When friction is not as the model says": (
        "measure",
        "figure",
        "rows",
        "diagnose",
        "investigate",
        "calibrate",
        "why",
    ),
}
GROUPS = {
    "surface": "Build, describe and draw the lookup surface.",
    "texture": "List, draw, check, import and play textures.",
    "scene": "Put objects on the screen, move them while they are felt, and see them replayed.",
    "daemon": "Run the daemon.",
    "load": "Have a load stage hold a finger's load, and find the finger's stiffness.",
    "experiment": (
        "Run psychophysical experiments, try their design without a rig, and fit what was answered."
    ),
}


def panels() -> dict[str, tuple[str, ...]]:
    """The commands in panels."""
    verbs = tuple(name for name in commands() if " " not in name)
    return PANELS | {ON_A_RIG: (*PANELS[ON_A_RIG], *verbs)}


def known() -> list[str]:
    """All commands."""
    return [name for names in panels().values() for name in names]


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


def build_app(imported: Iterable[str]) -> typer.Typer:
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
    for panel, names in panels().items():
        for name in names:
            if name not in imported:
                app.command(name, help=summary_of(name), rich_help_panel=panel)(_not_imported)
            elif name in GROUPS:
                app.add_typer(module_of(name).app, name=name, help=GROUPS[name])
            elif name in commands():
                app.command(name)(module_of("arm").command_of(commands()[name]))
            else:
                app.command(name)(getattr(module_of(name), name.replace("-", "_")))
    return app


def _with_bare_flags(command: Any) -> Any:
    """The same command line whose help shows no type behind a flag, as if it took a value."""
    own_help = command.get_help_option(command.context_class(command))
    for parameter in (*command.params, own_help):
        if getattr(parameter, "is_flag", False) and parameter.metavar is None:
            parameter.metavar = ""
    for inner in getattr(command, "commands", {}).values():
        _with_bare_flags(inner)
    return command


def module_of(name: str) -> Any:
    """Where a command or group lives."""
    return import_module(f"haptic_driver.cli.{_module(name)}")


def summary_of(name: str) -> str:
    """What a command does: its docstring's first paragraph, read without importing its module."""
    if name in GROUPS:
        return GROUPS[name]
    if name in commands():
        return commands()[name].said
    source = Path(__file__).with_name(f"{_module(name)}.py").read_text(encoding="utf-8")
    docstring = source.partition(f"\ndef {name.replace('-', '_')}(")[2].split('"""')[1]
    return " ".join(docstring.partition("\n\n")[0].split())


def _module(name: str) -> str:
    return "control" if name == "arm" else name.replace("-", "_")


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


def _acts(arguments: list[str]) -> bool:
    """Whether a command line asks a daemon for something: it is done, whoever reads about it."""
    words = [word for word in arguments if not word.startswith("-")]
    if words[:1] == ["arm"]:
        return True
    verb = commands().get(" ".join(words[:2])) or commands().get(" ".join(words[:1]))
    return words[:1] in (["mark"], ["record"], ["scene"]) or (
        verb is not None and verb.method == "POST"
    )


def run(begin: Callable[[], None] = lambda: None) -> None:
    """Run the command line of this process. Exit status: 0 done, 1 failed, 2 bad input.

    `begin` is called when all is imported and the command begins.
    """
    gc.set_threshold(
        50_000
    )  # imports make many objects and no garbage; to look for it took a tenth of `haptic solve`,
    prepare_output()
    status = main(sys.argv[1:], begin)
    gc.freeze()  # and at the end a quarter
    sys.exit(status)


def main(arguments: list[str], begin: Callable[[], None] = lambda: None) -> int:
    """Run one command line and return its exit status; `begin` is called when all is imported."""
    # The parser takes a negative number for an option, but not one behind a space.
    if arguments[:1] in (["set"], ["scene"]):
        arguments = [f" {word}" if re.match(r"-\.?\d", word) else word for word in arguments]
    asked = [word for word in arguments or _being_completed() if word in known()][:1]
    app = build_app(asked)
    begin()
    try:
        with compiling():
            command = _with_bare_flags(typer.main.get_command(app))
            outcome = command.main(arguments, prog_name="haptic", standalone_mode=False)
    except HapticError as error:
        failure = error
    except USAGE_ERROR as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            return BadInputError.exit_status
        context = getattr(error, "ctx", None)
        path = context.command_path if context is not None else "haptic"
        failure = BadInputError("usage", _said(error), f"See: {path} --help")
    except (KeyboardInterrupt, typer.Abort):
        failure = HapticError(
            "interrupted", "interrupted", "The output was switched off where a rig was open"
        )
    except BrokenPipeError as error:
        lose_output(error)
        return 1
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        failure = HapticError(
            "system",
            f"{where}{error.strerror or error}",
            "Check that path, its rights and its disk",
        )
    else:
        if output_was_lost() and not _acts(arguments):
            return 1
        return outcome if isinstance(outcome, int) else 0
    report_error(failure, "--json" in arguments)
    return failure.exit_status
