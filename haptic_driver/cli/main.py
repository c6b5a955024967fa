"""The `haptic` command line: puts the command groups together and turns every failure into a
message.
"""

from __future__ import annotations

import gc
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from pydantic import ValidationError
from typer import Option

from haptic_driver.cli import ON_A_RIG, PANELS
from haptic_driver.cli.output import (
    compiling,
    lose_output,
    output_was_lost,
    prepare_output,
    report_error,
    stderr,
)
from haptic_driver.daemon.verbs import commands
from haptic_driver.errors import BadInputError, HapticError
from hw import plugins

COMMANDS = "haptic_driver.commands"  # the group of entry points that name a PANELS
CLI = "haptic_driver.cli"
INTERRUPTED = 130  # as shells have it: 128 and the number of the signal


class Listed(NamedTuple):
    """A command: the panel and line of `haptic --help`, and the package that has its module."""

    panel: str
    line: str
    package: str


def listed(package: str, panels: Mapping[str, Mapping[str, str]]) -> dict[str, Listed]:
    """The commands of a package by name; those of a group of another package have two words."""
    return {
        name: Listed(panel, line, package)
        for panel, lines in panels.items()
        for name, line in lines.items()
    }


def own() -> dict[str, Listed]:
    """The driver's commands, and among them the verbs of the daemon."""
    verbs = {name: verb.said for name, verb in commands().items() if " " not in name}
    return listed(CLI, PANELS) | listed("", {ON_A_RIG: verbs})


def known() -> dict[str, Listed]:
    """All commands by name: the driver's, then those of every package that an entry point names.

    One that cannot be loaded is left out, with a note.
    """
    found = own()
    for name, point in plugins.installed(COMMANDS).items():
        try:
            panels = plugins.load(COMMANDS, name, "package of commands")
        except ValueError as error:
            stderr.print(f"note: {error}")
        else:
            found = found | listed(point.module, panels) | found
    return found


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


def build_app(all_known: Mapping[str, Listed], imported: Iterable[str]) -> typer.Typer:
    """The command line; of a command that is not `imported` it knows the name and the line
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
    for name, (panel, line, package) in all_known.items():
        if " " in name:
            continue
        if name not in imported:
            app.command(name, help=line, rich_help_panel=panel)(_not_imported)
        elif not package:
            app.command(name)(import_module(f"{CLI}.control").command_of(commands()[name]))
        elif hasattr(module := module_of(name, package), "app"):
            app.add_typer(_group(name, module.app, all_known, imported), name=name, help=line)
        else:
            app.command(name)(getattr(module, _function(name)))
    return app


def _group(
    name: str, its: typer.Typer, all_known: Mapping[str, Listed], imported: Iterable[str]
) -> typer.Typer:
    """A group with its own commands, and those that other packages have for it."""
    group = typer.Typer(no_args_is_help=True)
    group.registered_commands = [*its.registered_commands]
    for words, (_, line, package) in all_known.items():
        outer, _, inner = words.partition(" ")
        if outer == name and inner:
            if words in imported:
                group.command(inner)(getattr(module_of(words, package), _function(words)))
            else:
                group.command(inner, help=line)(_not_imported)
    return group


def _with_bare_flags(command: Any) -> Any:
    """The same command line whose help shows no type behind a flag, as if it took a value."""
    own_help = command.get_help_option(command.context_class(command))
    for parameter in (*command.params, own_help):
        if getattr(parameter, "is_flag", False) and parameter.metavar is None:
            parameter.metavar = ""
    for inner in getattr(command, "commands", {}).values():
        _with_bare_flags(inner)
    return command


def module_of(name: str, package: str) -> Any:
    """Where a command or group lives."""
    return import_module(f"{package}.{'control' if name == 'arm' else _function(name)}")


def _function(name: str) -> str:
    return name.replace("-", "_").replace(" ", "_")


def asked(words: Sequence[str], all_known: Mapping[str, Listed]) -> list[str]:
    """The command that a line asks for, and behind a group's name that of the group."""
    for i, word in enumerate(words):
        if word in all_known:
            return [word, " ".join([word, *words[i + 1 : i + 2]])]
    return []


def _not_imported() -> None:
    raise AssertionError("a command that runs is imported first")


def _being_completed() -> list[str]:
    """The words behind `haptic` on the line that a shell asks to complete."""
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or ""
    return line.split()[1:]


def _interrupted() -> HapticError:
    """What to say of a command that Ctrl-C ended."""
    return HapticError(
        "interrupted", "interrupted", "What it had opened is closed; haptic status says what is on"
    )


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
    # Imports make many objects and no garbage; to look for it took a tenth of `haptic solve`, and
    # at the end a quarter.
    gc.set_threshold(50_000)
    prepare_output()
    status = main(sys.argv[1:], begin)
    gc.freeze()
    sys.exit(status)


def main(arguments: list[str], begin: Callable[[], None] = lambda: None) -> int:
    """Run one command line and return its exit status; `begin` is called when all is imported."""
    # The parser takes a negative number for an option, but not one behind a space.
    if arguments[:1] in (["set"], ["scene"]):
        arguments = [f" {word}" if re.match(r"-\.?\d", word) else word for word in arguments]
    words = arguments or _being_completed()
    found = own() if words[:1] and words[0] in commands() else known()
    app = build_app(found, asked(words, found))
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
        failure = _interrupted()
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
        # typer may turn Ctrl-C into the status that shells have for it
        if outcome != INTERRUPTED:
            return 1 if output_was_lost() and not _acts(arguments) else outcome or 0
        failure = _interrupted()
    report_error(failure, "--json" in arguments)
    return failure.exit_status
