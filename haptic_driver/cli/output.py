"""What every command shares: one JSON object or text on stdout, errors and progress on
stderr.

What is printed stands as it is: a path or a hint such as `[force_sensor]` is never taken for
markup. Emphasis is a `Text`.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from io import TextIOWrapper
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, TextIO

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment
from rich.text import Text
from typer import Option

from haptic_driver.base.strict_json import finite
from haptic_driver.config import config_names
from haptic_driver.errors import BadInputError, HapticError, shown


def named(kind: str, what: str, declare: Callable[..., Any] = Option) -> Any:
    """An option or argument for a file by its name in the config folders of a kind (rigs, models,
    ...) or its path.
    """
    return declare(
        help=f"{what}: a name in configs/{kind} or a path.",
        autocompletion=lambda: config_names(kind),
    )


Json = Annotated[bool, Option("--json", help="Print one JSON object and nothing else.")]
ModelOption = Annotated[str, named("models", "Model")]
RigOption = Annotated[str, named("rigs", "Rig")]
RowsOption = Annotated[
    Path | None, Option(help="CSV to write: the rows that recordings were cut into.")
]

LINE_S = 10.0  # between lines of progress where nobody watches a bar
SIMULATED = ("simulated", "bold")  # a part of a `Text`


class PlainConsole(Console):
    """A console on which text moves no cursor and turns no direction, whoever wrote it."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """As a `Console` renders it, each piece of text as it is shown."""
        for piece in super().render(renderable, options):
            yield piece if piece.control else Segment(shown(piece.text, lines=True), piece.style)


stdout = PlainConsole(highlight=False, soft_wrap=True, markup=False, emoji=False)
stderr = PlainConsole(stderr=True, highlight=False, soft_wrap=True, markup=False, emoji=False)


def report(as_json: bool, payload: dict[str, Any], show: Callable[[], None]) -> None:
    """Print `payload` as strict JSON (NaN becomes null), or call `show` for a person; out at once,
    in a pipe too.

    Where standard output takes none of it, that is said, and what was done stays done.
    """
    text = json.dumps(finite(payload), allow_nan=False) + "\n" if as_json else ""
    try:
        if as_json:
            sys.stdout.write(text)
        else:
            show()
        sys.stdout.flush()
    except OSError as error:
        lose_output(error)


def say(text: str) -> None:
    """A line on standard output, in the middle of what goes on whether or not it is taken."""
    try:
        stdout.print(text)
        sys.stdout.flush()
    except OSError as error:
        lose_output(error)


class _Lost:
    """Whether standard output has failed to take something."""

    output = False


def output_was_lost() -> bool:
    """Whether something that this program had to say could not be written."""
    return _Lost.output


def lose_output(error: OSError) -> None:
    """Standard output takes no more: say so on stderr, and let what is left of it go nowhere.

    A reader that has left, as `head` does, gets no message.
    """
    _Lost.output = True
    _to_nowhere(sys.stdout)
    if isinstance(error, BrokenPipeError):
        return
    with suppress(OSError):
        said = f" what was to be printed is lost: {error.strerror or error}"
        stderr.print(Text.assemble(("note:", "bold"), said))


def _to_nowhere(stream: TextIO) -> None:
    with suppress(OSError, ValueError):  # ValueError: closed, or no file
        number = stream.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)


def prepare_output() -> None:
    """Make of the three standard streams what can be written to whatever it is given.

    One that whoever called has closed goes nowhere, so that no file takes its number; a letter that
    an encoding lacks is escaped.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115  (for the whole run)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def report_error(error: HapticError, as_json: bool) -> None:
    """What was wrong, where, and what to do: on stderr, and with `--json` on stdout too."""
    try:
        stderr.print(Text.assemble(("error:", "bold red"), f" {error.message}"))
        if error.hint:
            stderr.print(Text.assemble(("hint:", "bold"), f" {error.hint}"))
    except OSError:
        _to_nowhere(sys.stderr)
    if as_json:
        try:
            sys.stdout.write(json.dumps({"error": error.content}) + "\n")
            sys.stdout.flush()
        except OSError as lost:
            lose_output(lost)


class Lines:
    """A line on stderr now and then, where it is no terminal."""

    def __init__(self) -> None:
        self._said_s = time.monotonic()

    def say(self, line: str) -> None:
        """Unless the last one is too young."""
        if not stderr.is_terminal and time.monotonic() - self._said_s >= LINE_S:
            self._said_s = time.monotonic()
            try:
                stderr.file.write(f"{line}\n")
                stderr.file.flush()
            except (OSError, ValueError):  # nobody reads it: what it tells of goes on
                _to_nowhere(sys.stderr)


class Advance:
    """Called with the number of steps done, in steps of any size; `tell` says what is being done or
    waited for.
    """

    def __init__(self, bar: Progress, what: str, total: int) -> None:
        self._bar = bar
        self._task = bar.add_task(what, total=total)
        self._what, self._total = what, total
        self._every = max(total // 200, 1)
        self._shown = 0
        self._lines = Lines()

    def __call__(self, done: int) -> None:
        """Redraw, if it is worth it."""
        self._lines.say(f"{self._what}: {done} of {self._total}")
        if done - self._shown >= self._every or done >= self._total:
            self._shown = done
            self._bar.update(self._task, completed=done)

    def tell(self, what: str) -> None:
        """Instead of what was said before."""
        self._what = what
        self._bar.update(self._task, description=what)


@contextmanager
def progress(what: str, total: int) -> Iterator[Advance]:
    """A bar on stderr where that is a terminal, a line now and then elsewhere."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=stderr, transient=True, disable=not stderr.is_terminal) as bar:
        yield Advance(bar, what, total)


def confirm_attended(rig: str) -> None:
    """A real rig is energised and moved only while somebody is there who says so; BadInputError
    otherwise.
    """
    if not sys.stdin.isatty():
        said = f"rig {rig} is real, and nobody was asked whether to begin: no terminal"
        raise BadInputError(
            "not_attended",
            said,
            "Run it on a terminal, or give --yes while somebody watches the rig",
        )
    if not typer.confirm("Begin?", err=True):
        raise BadInputError(
            "not_attended", "not begun: nothing was moved or energised", "Answer y to begin"
        )


@contextmanager
def status(what: str) -> Iterator[Callable[[str], None]]:
    """A function to call with what is being done now; shown on stderr, now and then where that is
    no terminal.
    """
    lines = Lines()
    with stderr.status(what) if stderr.is_terminal else nullcontext() as shown:

        def tell(step: str) -> None:
            lines.say(f"{what}: {step}")
            if shown is not None:
                shown.update(f"{what}: {step}")

        yield tell


@contextmanager
def signals_to(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Meanwhile what ends a program goes to `handler`; afterwards to whom it went before."""
    numbers = [
        getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
    ]
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def compiling() -> Iterator[None]:
    """Meanwhile say which kernels are compiled: on stderr, and only on a terminal. For where numba
    is imported.
    """
    if "numba" not in sys.modules:
        yield
        return
    # numba is slow to import
    from haptic_driver.processes.compilation import compilation  # noqa: PLC0415

    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    bar = Progress(*columns, console=stderr, transient=True, disable=not stderr.is_terminal)
    task = bar.add_task("")

    def tell(kernel: str | None, done: int) -> None:
        if kernel is None:
            bar.stop()
        else:
            bar.start()
            bar.update(
                task, description=f"compiling, this once: kernel {done + 1}, {kernel}", refresh=True
            )

    with compilation(tell):
        yield
