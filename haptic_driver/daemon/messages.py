"""What the daemon sends its clients: states, status, answers. What they ask is in `verbs.py`.

Without numpy, which `haptic status` does not wait for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Literal, dataclass_transform

from pydantic import Field, FiniteFloat, RootModel

from haptic_driver.config import Checked
from haptic_driver.errors import HapticError, shown
from haptic_driver.recording.clock import ClockOffsets
from haptic_driver.recording.event import Event
from haptic_driver.textures.objects import SceneDescription
from hw.health import Health

LEASE_HEADER = "X-Haptic-Lease"
SOMEBODY = "somebody"  # who holds a lease and did not say

Column = list[float | int | None]


def number(value: float | None, form: str) -> str:
    """A number that may be missing, for a person."""
    return "-" if value is None else format(value, form)


class RefusedError(HapticError):
    """The daemon is not in a state to do this; nothing was changed."""


class DaemonState(StrEnum):
    """Where the daemon is; output is possible in `rendering` alone."""

    DISCONNECTED = "disconnected"
    IDLE = "idle"
    ARMED = "armed"
    RENDERING = "rendering"
    FAULT = "fault"


class Timing(Checked):
    """How the newest ticks, a second of them, kept their time.

    `in_time`: share of the newest 100 instants that had their tick within 2 ms; None before the
    first. `missed`: instants without a tick. `lateness_counts` by bin, whose lower edges are beside
    it. `last_cause`: what was late.
    """

    in_time: float | None
    missed: int
    lateness_edges_s: list[float]
    lateness_counts: list[int]
    last_cause: str | None


class AgreementCell(Checked):
    """Felt friction over expected friction in one range of one condition: `share` off, and its
    weight, 1 / variance.
    """

    axis: str
    low: float
    high: float
    share: float
    weight: float


class RenderedFidelity(Checked):
    """How felt friction compares with what was asked, from tick `first_tick` to `last_tick`.

    The names are those of `docs/fidelity.md`, which says what each means; null is unknown. Lists
    have an entry for each of the nine bands. `said` puts it in sentences.
    """

    first_tick: int
    last_tick: int
    sliding_time_s: float
    share_within_5_percent: float | None
    constant_share_within_5_percent: float | None
    constant_cof: float | None
    relative_error_rms: float | None
    cof_error_rms: float | None
    correlation: float | None
    band_gain: list[float | None]
    band_coherence: list[float | None]
    share_above_jnd: float | None
    bands_felt: list[bool | None]
    reach_hz: float | None
    said: list[str]


class LineInStatus(Checked):
    """A rig's line in since the daemon's start."""

    start: str  # what its edges begin: a recording, or strokes of `haptic measure`
    edges: int
    ignored: int  # of these: they came while something was being begun or ended, or could not
    bounces: int  # rises that were no edges
    last_edge_s: float | None  # on CLOCK_MONOTONIC
    lost: str | None  # why nothing is heard; null while the line is

    def __str__(self) -> str:
        said = [f"{self.edges} edges", f"{self.ignored} ignored", f"{self.bounces} bounces"]
        return ", ".join(said if self.lost is None else [f"LOST: {self.lost}", *said])


class LoadPhase(StrEnum):
    """What a load stage does: nothing, to where the finger is free, until the first touch, the
    loop, back. `stopped`: it rests where it was, which is its rig's way to let go. `may_press`: it
    has not shown that it let go.
    """

    FREE = "free"
    CLEARING = "clearing"
    APPROACH = "approach"
    HOLD = "hold"
    LETTING_GO = "letting_go"
    STOPPED = "stopped"
    MAY_PRESS = "may_press"


class LoadStatus(Checked):
    """What a load stage does; `target_n` is null while no load is wanted.

    `load_n` is the mean of the newest 0.1 s, null while the force sensor is silent. `depth_m` is
    where the stage is while it presses, towards the finger.
    """

    phase: LoadPhase
    target_n: float | None
    load_n: float | None
    depth_m: float | None

    def __str__(self) -> str:
        said = self.phase.replace("_", " ")
        asked = "" if self.target_n is None else f" {self.target_n:g} N"
        return f"{said}{asked}, {number(self.load_n, '.2f')} N measured"


class InstrumentStatus(Checked):
    """How well an instrument answers; see `hw.health.Health`. Null is what nobody knows yet, or
    what the instrument has not.

    `age_s`: since something new was heard of it. `read_s`: for so long the last question lasted.
    `unchanged_s`: for so long it has repeated what noise should move. `ordered` and `got`: what it
    is to become, and what it is. `zero_age_s`: since its zero was taken. `every_s`: mean time
    between reports of a finger that moves; `jitter_s`: its standard deviation. `wrong`: why its
    newest reading is not to be believed.
    """

    name: str
    age_s: float | None
    read_s: float | None
    asked: int
    missed: int
    saturated: bool
    unchanged_s: float | None
    ordered: float | None
    got: float | None
    zero: list[float]
    zero_age_s: float | None
    every_s: float | None
    jitter_s: float | None
    wrong: str | None

    @classmethod
    def of(cls, health: Health, now_s: float) -> InstrumentStatus:
        """The record as it is now."""
        return cls(
            name=health.name,
            age_s=known(health.age_s(now_s)),
            read_s=known(health.took_s),
            asked=health.asked,
            missed=health.missed,
            saturated=health.saturated,
            unchanged_s=health.same_s if math.isfinite(health.same_since_s) else None,
            ordered=health.ordered,
            got=health.got,
            zero=list(health.zero),
            zero_age_s=known(now_s - health.zero_s),
            every_s=known(health.every_s),
            jitter_s=known(health.jitter_s),
            wrong=shown(health.wrong) or None,
        )

    @property
    def row(self) -> tuple[str, str, str, str, str]:
        """Name, age, time of a reading, missed and what is wrong, for a person."""
        name = self.name.replace("_", " ").replace(".", " ")
        read = "-" if self.read_s is None else f"{1e3 * self.read_s:.2g} ms"
        if self.every_s is not None and self.jitter_s is not None:
            read += f", reports every {1e3 * self.every_s:.3g} ± {1e3 * self.jitter_s:.2g} ms"
        missed = f"{self.missed} of {self.asked}"
        return name, spell(self.age_s), read, missed, self.wrong or ""


def known(value: float) -> float | None:
    """A number, or None in place of what is none."""
    return value if math.isfinite(value) else None


def spell(seconds: float | None) -> str:
    """A time for a person."""
    if seconds is None:
        return "never"
    return f"{1e3 * seconds:.0f} ms" if seconds < 1.0 else f"{seconds:.1f} s"


class Status(Checked):
    """`haptic status`; `output_on` is None where nobody knows, also where what instruments said is
    too old. `output_said` has it in words, with who said so and when.

    `frequency_hz` and `voltage_v` are commanded: 0 V where the output is off, None where there is
    no command and nobody knows that it is.
    """

    state: DaemonState
    simulated: bool
    rig: str
    model: str
    texture: str | None
    target_cof: float | None
    measured_cof: float | None  # null without a force sensor
    # lowest and highest, under the present load
    reachable_cof: Annotated[list[float], Field(min_length=2, max_length=2)]
    frequency_hz: float | None
    voltage_v: float | None
    current_rms_a: float | None  # into the sliding finger, as the surface says of what is commanded
    output_on: bool | None
    output_said: str
    output_age_s: float | None = None  # of the answers that it rests on; null where on none
    ticks: int
    overruns: int
    timing: Timing
    underruns: int  # gaps of an analog envelope
    switched: int  # how often the generator's output came on
    relay_interval_s: float  # at most so often it does
    flags: list[str]
    fault: str | None
    lease_left_s: float | None
    lease_holder: str | None  # as it calls itself
    actuator: str  # "setpoints over SCPI", "analog envelope", or of samples
    real_time: bool
    latency_budget_s: dict[str, float]
    latency_measured_s: float | None = None  # from a place to the friction of that place
    latency_error_s: float | None = None  # one standard error of it
    latency_why: str = ""  # why it is not known, or what else it may be
    fidelity: RenderedFidelity | None = None  # of the present target, over 10 s at most
    surface_hash: str
    estimated_cof: float | None = None  # by the model and the current, without a force sensor
    estimated_cof_std: float | None = None  # one standard deviation of it
    normal_force_n: float | None = None  # of the newest tick with a finger; null without one
    position_x_m: float | None = None  # likewise
    position_y_m: float | None = None
    speed_m_s: float | None = None
    contacts: int | None = None  # fingers and palms on the screen; null where it tells one alone
    current_a: float | None = None  # peak, into the electrode, as monitors read it last
    load: LoadStatus | None = None  # of the load stage; null without one
    feedback: bool = True  # friction is held by what is felt; else by the model alone
    # since arming, with what the surface expects of the finger
    agreement: list[AgreementCell] = Field(default=[])
    disagreement: str | None = None  # the last sentence about it
    adaptation: str | None = None  # the result of the last refit; null while there is none
    recording: str | None  # the file; None also while a recording waits for space
    recording_fault: str | None  # what is missing of the present recording, and why
    line_in: LineInStatus | None = None  # null where the rig has none
    instruments: list[InstrumentStatus] = Field(default=[])  # those that are asked

    def __str__(self) -> str:
        asked = self._asked_said()
        simulated = " (simulated)" if self.simulated else ""
        low, high = self.reachable_cof
        missed = f"{self.overruns} overruns, {self.underruns} underruns"
        felt = f"measured {number(self.measured_cof, '.3f')}"
        if self.estimated_cof is not None:
            std = number(self.estimated_cof_std, ".3f")
            felt = f"not measured, estimated {self.estimated_cof:.3f} ± {std}"
        lines = [
            f"{self.state}, output {self.output_said}",
            f"rig {self.rig}{simulated}, by {self.actuator}; model {self.model}",
            (f"asked {asked}; {felt}; within reach {low:.2f} to {high:.2f}"),
            (
                f"commanded {number(self.frequency_hz, '.4g')} Hz, {number(self.voltage_v, '.4g')}"
                " V peak"
            ),
            f"{self.ticks} ticks, {missed}; flags: {', '.join(self.flags) or 'none'}",
        ]
        if self.fidelity is not None:
            lines.append(self.fidelity.said[0])
        if self.latency_measured_s is not None:
            lines.append(f"latency {self.latency_said()}")
        if self.timing.last_cause is not None:
            lines.append(
                f"{number(self.timing.in_time, '.0%')} of the last ticks in time;"
                f" {self.timing.last_cause}"
            )
        said: dict[str, str | None] = {
            "on the screen:": None if self.contacts is None else f"{self.contacts} contacts",
            "load stage:": None if self.load is None else str(self.load),
            "lease held by": self.lease_holder,
            "fault:": self.fault,
            "recording into": self.recording,
        }
        said |= {"recording fault:": self.recording_fault, "adapting:": self.adaptation}
        said |= {"line in:": None if self.line_in is None else str(self.line_in)}
        lines += [f"{what} {it}" for what, it in said.items() if it is not None]
        return "\n  ".join([*lines, *_columns([one.row for one in self.instruments])])

    __repr__ = __str__  # what a notebook shows

    def in_short(self) -> str:
        """One line: what the daemon does, and what it was asked."""
        said = [f"{self.state}, output {self.output_said}", f"asked {self._asked_said()}"]
        low, high = self.reachable_cof
        if self.target_cof is not None and not low <= self.target_cof <= high:
            said.append(f"beyond reach, {low:.2f} to {high:.2f}")
        said += [] if self.recording is None else [f"recording into {self.recording}"]
        said += [] if self.adaptation is None else [f"adapting: {self.adaptation}"]
        said += [] if self.fault is None else [f"fault: {self.fault}"]
        if self.load is not None and self.load.phase is LoadPhase.MAY_PRESS:
            said.append("the load stage may still press: lift the finger by hand")
        return "; ".join(said)

    def _asked_said(self) -> str:
        if self.texture is not None:
            return self.texture
        return "nothing" if self.target_cof is None else f"friction {self.target_cof:.3g}"

    def latency_said(self) -> str:
        """The latency as measured, where that is known, beside the rig's file."""
        budget = f"{1e3 * self.latency_budget_s['total']:.1f} ms by the rig's file"
        if self.latency_measured_s is None:
            return f"{budget}; not measured: {self.latency_why}"
        return f"{1e3 * self.latency_measured_s:.1f} ms measured, {budget}"


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Instruments below a heading; nothing without any."""
    if not rows:
        return []
    table = [("instrument", "age", "read in", "missed", ""), *rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in table]


class Lease(Checked):
    """What `arm` gives: to be renewed within `lease_s`, or the output ramps to zero."""

    token: str
    lease_s: float


class Marked(ClockOffsets):
    """A marker as received: its event's number, its time on CLOCK_MONOTONIC, and what to add for
    other clocks.
    """

    number: int
    time_s: float


@dataclass_transform(field_specifiers=(Field,))
class Asked(Checked):
    """What a request says; the client's methods take its fields in this order or by name."""


class Query(Asked, extra="ignore"):
    """What a GET says."""


MOST_TILE_CELLS = 256  # per side: a fraction of a second of a process that waits for all others


class TileRequest(Query):
    """The query of `GET /tile`: a texture of `GET /textures`, the corner with the least x and y,
    and square cells.
    """

    name: Annotated[str, Field(min_length=1, max_length=200)]
    pitch_m: Annotated[FiniteFloat, Field(ge=1e-6, le=0.01)]
    x_m: Annotated[FiniteFloat, Field(ge=-10.0, le=10.0)] = 0.0
    y_m: Annotated[FiniteFloat, Field(ge=-10.0, le=10.0)] = 0.0
    columns: Annotated[int, Field(ge=1, le=MOST_TILE_CELLS)] = MOST_TILE_CELLS
    rows: Annotated[int, Field(ge=1, le=MOST_TILE_CELLS)] = MOST_TILE_CELLS


class Tile(Checked):
    """Friction averaged over each cell, row by row along +y: bytes in base64.

    0 where nothing is asked for, 1 at `cof_low` to 255 at `cof_high`, between which the whole
    texture lies.
    """

    columns: int
    rows: int
    cof_low: float
    cof_high: float
    levels: str


class TextureNames(Checked):
    """What `GET /textures` answers; `scripts` run by the clock and have no picture."""

    textures: list[str]
    scripts: list[str]


class SceneChanged(Checked):
    """What `POST /scene` answers: the number of this change, when render was given it, and how many
    objects there are.

    `rendering` false: the output was switched off, and only `show` brings the scene back.
    """

    number: int
    time_s: float
    objects: int
    rendering: bool

    def __str__(self) -> str:
        now = "" if self.rendering else "; not rendered: show it with haptic scene show"
        return f"scene of {self.objects} object{'s' * (self.objects != 1)}{now}"


class SceneShown(Checked):
    """What `GET /scene` answers: the present scene, null where there is none, and the number of its
    last change.
    """

    number: int
    rendering: bool
    scene: SceneDescription | None


class ModelNames(Checked):
    """What `GET /models` answers."""

    models: list[str]


class Why(Checked):
    """What a diagnosis of what was rendered says, in words and as `haptic diagnose` does.

    `suspects`: the most probable. `more`: what `haptic investigate` could add. `model` and `report`
    are files on the daemon's machine, until the next diagnosis or its end.
    """

    state: Literal["not_asked", "running", "done", "failed"]
    said: str
    rows: int = 0
    verdict: str | None = None
    effects: list[str] = Field(default=[])
    suspects: dict[str, float] = Field(default={})
    more: list[str] = Field(default=[])
    model: str | None = None
    report: str | None = None


class WhyPage(Checked):
    """The whole report with its pictures, HTML that loads nothing."""

    html: str


class Events(Checked):
    """What `GET /events` answers."""

    events: list[Event]


class CarrierRule(Checked):
    """A ripple of friction counts as perceptible below `quiet_above_hz`; `bands_hz`: the edges of
    the bands.
    """

    quiet_above_hz: float
    bands_hz: list[float]


class SurfaceMap(Checked):
    """Friction over frequency and voltage, `cof[frequency][voltage]`, at the usual load, as far as
    the rig may go.

    `limits_v`: by each limit, the highest voltage at each frequency; null where that limit has
    none.
    """

    frequency_hz: list[float]
    voltage_v: list[float]
    cof: list[list[float | None]]
    limits_v: dict[str, list[float | None]]


class TextureMap(Checked):
    """Friction that the present texture asks for, `cof[y][x]`; null where it asks for nothing."""

    x_m: list[float]
    y_m: list[float]
    cof: list[list[float | None]]


class SampleColumns(RootModel[dict[str, Column]]):
    """One list per field of `SAMPLE`, oldest first; null for what is no number."""


class TickSummary(Checked):
    """The ticks since the frame before; None where there were none."""

    count: int
    lateness_median_s: float | None
    lateness_max_s: float | None
    compute_median_s: float | None
    compute_max_s: float | None
    lateness_edges_s: list[float]
    lateness_counts: list[int]


class StateFrame(Checked):
    """One message of the WebSocket `/state`: the status, the newest sample, and how the ticks went.

    `time_s` and `unix_time_s` are now, by the clock of samples and events and by that on the wall.
    `samples`: the columns that were asked for, of all ticks since the frame before.
    """

    time_s: float
    unix_time_s: float
    status: Status
    newest: dict[str, float | int | None] | None
    ticks: TickSummary
    samples: dict[str, Column]


class ErrorContent(Checked):
    """The three things that every error says."""

    code: str
    message: str
    hint: str


class ErrorReport(Checked):
    """Body of every response with a status of 400 and above."""

    error: ErrorContent

    @classmethod
    def of(cls, error: HapticError) -> ErrorReport:
        """The report of one error."""
        return cls(error=ErrorContent(**error.content))
