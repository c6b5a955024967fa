"""`haptic experiment`: psychophysics, from a file to thresholds."""

from __future__ import annotations

import select
import signal
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.table import Table
from rich.text import Text
from typer import Argument, Option

from haptic_driver.cli.control import client_of
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import (
    Json,
    ModelOption,
    RigOption,
    named,
    progress,
    report,
    signals_to,
    stderr,
    stdout,
)
from haptic_driver.errors import BadInputError

if TYPE_CHECKING:
    from haptic_driver.client import HapticClient, Session
    from haptic_driver.lab.pictures.psychometric import Answers
    from haptic_driver.lab.psychophysics.analysis import Group, Result
    from haptic_driver.lab.psychophysics.data import Row, SessionFiles
    from haptic_driver.lab.psychophysics.description import Experiment
    from haptic_driver.lab.psychophysics.run import Participant, Question

app = typer.Typer(no_args_is_help=True)
File = Annotated[str, named("experiments", "Experiment", Argument)]


@app.command()
def run(
    file: File,
    participant: Annotated[
        str, Option(help="Name of the participant, letters and digits, such as P01.")
    ],
    out: Annotated[Path, Option(help="Folder of results.")] = Path("out/experiment"),
    session: Annotated[str, Option(help="Name of the session, letters and digits.")] = "01",
    simulated: Annotated[
        bool, Option("--simulated", help="A simulated participant, see [simulated], answers.")
    ] = False,
    record: Annotated[
        bool, Option("--record", help="Record every tick beside the results.")
    ] = False,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Run a session of an experiment on a running daemon; one that was stopped goes on at its next
    trial.

    Ctrl-C stops it with the output off. Every trial is on the disk when it is answered.

    Example: `haptic experiment run friction_difference --participant P01 --out results`
    """
    from haptic_driver.client import LEASE_S  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.apparatus import DaemonApparatus, check_textures  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.data import SessionFiles  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.description import load_experiment  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.run import run_session  # noqa: PLC0415

    _check_names(participant=participant, session=session)
    experiment = load_experiment(file)
    files = SessionFiles(out, participant, session, experiment.file.name)
    with client_of(socket) as client:
        check_textures(experiment, client.textures())
        about = _about(experiment, client)
        answering = _participant(experiment, client, files, simulated)
        at_terminal = isinstance(answering, _Keys)
        tell = answering.tell if at_terminal else lambda said: None
        kept = (lambda row: None) if at_terminal or as_json else _say_trial
        ring = stderr.bell if at_terminal else lambda: None
        as_ctrl_c = signals_to(signal.default_int_handler)
        with as_ctrl_c, client.armed(LEASE_S) as held, _recorded(client, held, files, record):
            apparatus = DaemonApparatus(client, held, files.beh, tell, ring)
            done = run_session(experiment, files, apparatus, answering, about, kept)
    payload = done._asdict() | {
        "table": str(files.table),
        "participant_table": str(files.folder / f"sub-{participant}.csv"),
    }
    report(as_json, payload, lambda: stdout.print(f"{done.trials} trials in {files.table}"))


@app.command()
def simulate(
    file: File,
    participants: Annotated[int, Option(min=1, max=10_000, help="How many to simulate.")] = 20,
    seed: Annotated[int, Option(min=0, help="Of their answers.")] = 1,
    out: Annotated[
        Path | None, Option(help="New folder for results and pictures, as of people.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Try an experiment's design without a rig: how well are the thresholds of simulated
    participants found?

    Friction is felt as asked. Each answers by the file's [simulated]; trials per participant, bias
    and spread are said.

    Example: `haptic experiment simulate friction_difference --participants 10`
    """
    from haptic_driver.lab.psychophysics.description import load_experiment  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.rehearsal import try_design  # noqa: PLC0415

    experiment = load_experiment(file)
    if out is not None and out.exists():
        raise BadInputError("file_exists", f"{out}: exists already", "Give another --out")
    with progress("participants", participants) as advance:
        found = try_design(experiment, participants, seed, advance, out)
    written = [] if out is None else _written(out, felt=False)[1]
    rows = [one._asdict() for one in found]

    def show() -> None:
        table = Table(
            "condition",
            "trials",
            "threshold",
            "found, median",
            "spread",
            "95 % intervals that hold it",
        )
        for one in found:
            held = f"{one.held_by_interval:.0%}"
            numbers = (
                f"{one.trials:.0f}",
                f"{one.truth:.4g}",
                f"{one.median:.4g}",
                f"{one.relative_std:.0%}",
            )
            if one.positive is None:
                table.add_row(one.condition, *numbers, held)
            else:
                share = f"{one.positive:.0%} of {one.trials:.0f} answers are positive"
                stdout.print(f"{one.condition}: {share}")
        if table.rows:
            stdout.print(table)
        for path in written:
            stdout.print(path)

    payload = {"experiment": experiment.file.name, "participants": participants}
    report(as_json, payload | {"conditions": rows, "written": written}, show)


@app.command()
def check(
    file: File,
    normal_force: Annotated[float, Option(help="Normal force of the finger, N.")] = 0.5,
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    as_json: Json = False,
) -> None:
    """Say which levels of an experiment a rig can reach under a load; what is out of reach is no
    failure.

    Example: `haptic experiment check friction_difference --rig simulated`
    """
    from haptic_driver.cli.texture import reachable_by  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.description import load_experiment  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.rehearsal import reached  # noqa: PLC0415
    from haptic_driver.rig.config import load_rig  # noqa: PLC0415

    experiment = load_experiment(file)
    low, high = reachable_by(load_rig(rig), model, None, normal_force)
    found = [reached(experiment, condition, (low, high)) for condition in experiment.file.condition]

    def show() -> None:
        stdout.print(f"{rig} reaches friction {low:.3g} to {high:.3g} under {normal_force:g} N")
        for one in found:
            stdout.print(f"  {one.said()}")
            for texture in one.textures:
                stdout.print(f"    {texture.said()}")

    rows = [one._asdict() for one in found]
    report(
        as_json,
        {"reachable_cof": [low, high], "normal_force_n": normal_force, "conditions": rows},
        show,
    )


@app.command()
def analyse(
    folder: Annotated[
        Path, Argument(help="Folder of results, the --out of haptic experiment run.")
    ],
    felt: Annotated[
        bool, Option("--felt", help="Over measured levels, instead of requested ones.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Fit a psychometric function to every participant's answers to every condition, and draw them.

    Practice and trials that the rig could not deliver are left out. Thresholds, with 95 %
    intervals, and pictures go into the folder's `derivatives`.

    Example: `haptic experiment analyse out/experiment`
    """
    from haptic_driver.lab.psychophysics.analysis import groups_of  # noqa: PLC0415

    results, (table, *pictures) = _written(folder, felt)
    groups = groups_of(results)
    payload = {
        "results": [result.numbers() for result in results],
        "groups": [group._asdict() for group in groups],
        "table": table,
        "pictures": pictures,
    }
    report(as_json, payload, lambda: _show(results, groups, [table, *pictures]))


def _written(folder: Path, felt: bool) -> tuple[list[Result], list[str]]:
    """Results of a folder; and the table and pictures of them that are written there."""
    from haptic_driver.files import write_rows  # noqa: PLC0415
    from haptic_driver.lab.pictures.psychometric import (  # noqa: PLC0415
        Threshold,
        draw_functions,
        draw_levels,
        draw_thresholds,
    )
    from haptic_driver.lab.psychophysics.analysis import analyse as analysed  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.analysis import groups_of  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.data import label_of  # noqa: PLC0415

    results = analysed(folder, as_felt=felt)
    table = folder / "derivatives" / "thresholds.csv"
    write_rows(table, [result.numbers() for result in results])
    pictures = []
    for participant, task in dict.fromkeys((r.participant, r.task) for r in results):
        own = [r for r in results if (r.participant, r.task) == (participant, task)]
        title = f"{participant}, {task}" + (", measured levels" if felt else "")
        stem = f"sub-{participant}_task-{label_of(task)}"
        pictures += [table.with_name(f"{stem}_{what}.png") for what in ("psychometric", "levels")]
        draw_functions([_panel(r) for r in own], title, pictures[-2])
        draw_levels([_panel(r) for r in own], title, pictures[-1])
    for group in groups_of(results):
        stem = f"task-{label_of(group.task)}_condition-{label_of(group.condition)}"
        pictures.append(table.with_name(f"{stem}_participants.png"))
        each = zip(group.participants, group.thresholds, group.intervals_95, strict=True)
        mean = Threshold(f"mean of {len(group.participants)}", group.mean, group.mean_95)
        lines, title = [*starmap(Threshold, each), mean], f"{group.task}, {group.condition}"
        draw_thresholds(lines, title, group.axis, pictures[-1])
    return results, [str(table), *map(str, pictures)]


def _say_trial(row: Row) -> None:
    """A line for each trial, where nobody sits at a terminal."""
    felt = "" if row.delivered else f"; not delivered: {row.why_not_delivered}"
    stderr.print(f"trial {row.trial}, {row.condition}, level {row.level:.4g}: {row.response}{felt}")


def _panel(result: Result) -> Answers:
    # matplotlib is slow to import
    from haptic_driver.lab.pictures.psychometric import Answers  # noqa: PLC0415

    title, fit = f"{result.condition}: {result.trials} trials", result.fit
    if fit is None:
        nothing = np.empty(0)
        return Answers(
            title,
            nothing,
            nothing,
            nothing,
            said=result.why_none,
            axis=result.axis,
            courses=result.courses,
        )
    return Answers(
        title,
        fit.levels,
        fit.positive,
        fit.count,
        fit.function.at,
        fit.threshold,
        fit.interval_95,
        said=fit.why_none,
        axis=result.axis,
        courses=result.courses,
    )


def _show(results: Sequence[Result], groups: Sequence[Group], written: Sequence[str]) -> None:
    table = Table("participant", "condition", "trials", "left out", "threshold", "95 %", "slope")
    for r in results:
        table.add_row(
            r.participant, r.condition, str(r.trials), str(len(r.left_out)), *_threshold(r)
        )
    stdout.print(table)
    for r in results:
        for why, trials in Counter(r.left_out).most_common():
            stdout.print(f"left out of {r.participant}, {r.condition}: {why} ({trials})")
        if r.why_none:
            stdout.print(f"no threshold of {r.participant}, {r.condition}: {r.why_none}")
        if r.positive is not None:
            share, low, high = r.positive
            said = f"{share:.0%} of answers positive, 95 % interval {low:.0%} to {high:.0%}"
            stdout.print(f"{r.participant}, {r.condition}: {said}")
        for note in r.notes:
            stdout.print(f"note on {r.participant}, {r.condition}: {note}")
    for group in groups:
        low, high = group.mean_95
        said = f"{group.mean:.4g} (95 %: {low:.4g} to {high:.4g})"
        stdout.print(f"mean of {len(group.participants)}, {group.condition}: {said}")
    for path in written:
        stdout.print(path)


def _threshold(r: Result) -> tuple[str, str, str]:
    """A threshold, or on which side of the levels it lies; its interval, and the slope."""
    if r.fit is None:
        return "none", "", ""
    (low, high), (low_open, high_open) = r.fit.interval_95, r.fit.open_ends
    match low_open, high_open:
        case True, True:
            interval = ""
        case True, False:
            interval = f"up to {high:.4g}"
        case False, True:
            interval = f"from {low:.4g}"
        case _:
            interval = f"{low:.4g} to {high:.4g}"
    if r.why_none:
        side = r.why_none.partition(",")[0]
        return side if side.startswith(("below", "above")) else "none", interval, ""
    return f"{r.fit.threshold:.4g}", interval, f"{r.fit.function.slope:.3g}"


def _check_names(**names: str) -> None:
    for what, name in names.items():
        if not (name.isascii() and name.isalnum()):
            raise BadInputError(
                "bad_name",
                f"--{what} {name!r}: letters and digits alone",
                "Give a name such as P01",
            )


def _about(experiment: Experiment, client: HapticClient) -> dict[str, Any]:
    """What the sidecar says of rig, model, textures, clocks and the experiment."""
    from importlib.metadata import version  # noqa: PLC0415

    from haptic_driver.lab.psychophysics.apparatus import texture_hashes  # noqa: PLC0415

    status = client.status()
    marked = client.mark("experiment", {"task": experiment.file.name})
    named = "rig", "simulated", "model", "surface_hash", "actuator", "latency_budget_s", "real_time"
    return {
        "Instructions": experiment.file.instructions,
        "Rig": {
            name: value for name, value in status.model_dump(mode="json").items() if name in named
        },
        "TextureHashes": texture_hashes(experiment),
        "ClockOffsets": marked.model_dump(mode="json", include={"wall_offset_s", "lsl_offset_s"}),
        "SoftwareVersion": version("haptic-driver"),
        "Experiment": experiment.file.model_dump(mode="json", exclude_none=True),
    }


def _participant(
    experiment: Experiment, client: HapticClient, files: SessionFiles, simulated: bool
) -> Participant:
    from haptic_driver.lab.psychophysics.answers import MarkerParticipant  # noqa: PLC0415
    from haptic_driver.lab.psychophysics.rehearsal import pretended  # noqa: PLC0415

    if simulated:
        return pretended(experiment, files.participant, files.session)
    return (
        MarkerParticipant(client)
        if experiment.file.response.by == "markers"
        else _Keys(experiment.keys)
    )


@contextmanager
def _recorded(
    client: HapticClient, held: Session, files: SessionFiles, wanted: bool
) -> Iterator[None]:
    """Meanwhile every tick is recorded, for as long as the lease lasts: who is killed leaves none
    running.
    """
    if wanted:
        files.beh.mkdir(parents=True, exist_ok=True)
        path = files.table.with_name(
            files.table.stem.removesuffix("_beh") + "_recording.h5"
        ).absolute()
        # what a killed run has left; this one is the file's next
        if client.status().recording == str(path):
            client.record(None)
        held.record(path)
    try:
        yield
    finally:
        if wanted:
            held.record(None)


class _Keys:
    """Somebody at this terminal; in a pipe, a line for each key."""

    answered_s: float | None = None

    def __init__(self, keys: Sequence[str]) -> None:
        self._keys = keys

    def wait(self, text: str) -> None:
        stderr.print(Text.assemble((text, "bold"), "  Any key goes on."))
        self._pressed()

    def tell(self, text: str) -> None:
        stderr.print(text)

    def ask(self, question: Question) -> int:
        """The first key that means something, of those pressed from now on."""
        offered = ", ".join(
            f"{key}: {answer}" for key, answer in zip(self._keys, question.answers, strict=True)
        )
        stderr.print(f"{question.number}. {question.text}  {offered}")
        while (key := self._pressed()) not in self._keys:
            stderr.print(offered)
        return self._keys.index(key)

    def _pressed(self) -> str:
        if not sys.stdin.isatty():
            line = sys.stdin.readline()
            if not line:
                raise BadInputError(
                    "no_answers",
                    "the answers have ended",
                    "Run it on a terminal; it goes on from here",
                )
            return line.strip()[:1]
        import termios  # noqa: PLC0415  (no such thing on Windows)
        import tty  # noqa: PLC0415

        descriptor = sys.stdin.fileno()
        before = termios.tcgetattr(descriptor)
        try:
            tty.setcbreak(descriptor)
            termios.tcflush(descriptor, termios.TCIFLUSH)  # keys pressed too early answer nothing
            select.select([descriptor], [], [])
            return sys.stdin.read(1)
        finally:
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
