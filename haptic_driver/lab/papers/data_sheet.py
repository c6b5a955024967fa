"""The data sheet of a rig: what it does to friction, by which screens can be compared.

The sheet has friction contrast, latency, and what a user can be told per second. It follows a
proposal for haptic touch screens (Bernard, Huloux, Wiertlewski, Monnoyer 2023, arXiv:2308.15190;
the abstract was read). The last is found by pointing tasks with people, and is not measured here.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from math import floor, isfinite, log, log10, nan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.set_up import at_turns_of, placement_of
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.lab.papers.document import Block, Document, Figure, Heading, Paragraph, Table
from haptic_driver.lab.papers.sheet_numbers import (
    CONFIDENCE,
    UNKNOWN,
    Number,
    Response,
    cof_in_blocks,
    edge_errors_m,
    gains,
    half_power_hz,
    mean_of,
    noise_n,
    responses,
    touches,
)
from haptic_driver.lab.papers.sheet_passes import (
    EDGE_SPEEDS_M_S,
    HALF_M,
    LEAST,
    LINES_HZ,
    LOAD_N,
    LOADS_N,
    SLOW_M_S,
    SPEED_M_S,
    SPEEDS_M_S,
    SWING,
    TOUCHES,
    Pass,
    Slider,
    middle_of,
    other_passes,
    range_passes,
)
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.placement import BACK_AND_FORTH_HZ, USUAL_SPEED_M_S
from haptic_driver.rig.placement import SPEEDS_M_S as PLACED_M_S
from haptic_driver.signals import Array
from model.analysis.voltage_law import beyond_published
from model.conditions import Conditions, sines
from model.description import ModelDescription
from model.touch_model import TouchModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOW, HIGH = "#1b6ca8", "#d1495b"
READS_WELL = {"s": (1e3, "ms"), "m": (1e6, "µm"), "A rms": (1e3, "mA rms"), "N": (1e3, "mN")}
IN_PERCENT = {"within_touches", "between_touches"}
LINE_STYLES = (":", "-", "--")
MOST_DECIMALS = 6

Samples = NDArray[np.void]
Advance = Callable[[int], None]


@dataclass(frozen=True)
class Measured:
    """What a finger met: passes in order, each with its samples."""

    passes: Sequence[tuple[Pass, Samples]]

    def of(self, what: str, speed_m_s: float | None = None) -> list[Samples]:
        """The samples of one part of the sheet."""
        return [
            samples
            for one, samples in self.passes
            if one.what == what and speed_m_s in (None, one.speed_m_s)
        ]

    def cof(self, what: str, load_n: float = LOAD_N, speed_m_s: float = SPEED_M_S) -> Number:
        """The lowest or the highest friction at a load and speed."""
        return next(
            mean_of(cof_in_blocks(samples))
            for one, samples in self.passes
            if (one.what, one.normal_force_n, one.speed_m_s) == (what, load_n, speed_m_s)
        )


def measure_sheet(slider: Slider, advance: Advance = lambda done: None) -> Measured:
    """Slide all passes; `advance` is called with their number. Raises HapticError, DeviceError."""
    done: list[tuple[Pass, Samples]] = []

    def slide(passes: Sequence[Pass]) -> None:
        for one in passes:
            done.append((one, slider.slide(one)))
            advance(len(done))

    slide(range_passes())
    found = Measured(done)
    slide(other_passes(found.cof("low").value, found.cof("high").value))
    return found


def pass_count() -> int:
    """How many passes a sheet takes."""
    return len(range_passes()) + len(other_passes(0.0, 1.0))


def sheet_facts(
    found: Measured, config: RigConfig, description: ModelDescription, today: datetime.date
) -> dict[str, Any]:
    """All numbers with interval, unit and how they were got; unknown ones are null."""
    return {
        "rig": config.name,
        "simulated": config.simulated,
        "date": today.isoformat(),
        "program": f"haptic-driver {version('haptic-driver')}",
        "model": {"name": description.name, "hash": description.content_hash},
        "model_doubt": _doubt(found, description),
        "interval": CONFIDENCE,
        "current_holds_for": config.operating_limits().holds_for(
            description.values.contact_area_m2
        ),
        "range": list(_range(found)),
        "numbers": {line.name: line.facts for line in _lines(found, config, description)},
        "not_measured": [
            "information that a user takes up per second: needs pointing tasks with people"
        ],
    }


def data_sheet(found: Measured, facts: dict[str, Any]) -> Document:
    """The paper, of one page."""
    simulated = " (simulated)" if facts["simulated"] else ""
    return Document(
        title=f"Data sheet: rig '{facts['rig']}'{simulated}",
        about=(
            f"{facts['date']} · {facts['program']} · driven by model '{facts['model']['name']}',"
            f" {facts['model']['hash'][:12]} · intervals of {100 * facts['interval']:.0f} %"
        ),
        foot=f"rig '{facts['rig']}', {facts['date']}",
        blocks=list(_blocks(found, facts)),
        facts=facts,
    )


def _range(found: Measured) -> Iterator[dict[str, Any]]:
    for load_n in LOADS_N:
        for speed_m_s in SPEEDS_M_S:
            low, high = (found.cof(what, load_n, speed_m_s) for what in ("low", "high"))
            contrast = _contrast(low, high)
            yield {
                "normal_force_n": load_n,
                "speed_m_s": speed_m_s,
                "cof_low": _as_facts(low),
                "cof_high": _as_facts(high),
                "contrast": _as_facts(contrast),
            }


class Line(NamedTuple):
    """One number of the sheet; `name` is its key among the facts."""

    name: str
    number: Number
    unit: str
    what: str
    how: str

    @property
    def facts(self) -> dict[str, Any]:
        return {**_as_facts(self.number), "unit": self.unit, "what": self.what, "how": self.how}


def _lines(found: Measured, config: RigConfig, description: ModelDescription) -> Iterator[Line]:
    yield from _contrast_lines(found)
    for speed_m_s in (SPEED_M_S, SLOW_M_S):
        yield from _step_lines(found, speed_m_s)
    for speed_m_s in EDGE_SPEEDS_M_S:
        yield from _place_lines(found, speed_m_s)
    yield from _placement_lines(config)
    yield Line(
        "bandwidth",
        half_power_hz(*gains(found.of("lines")[0])),
        "Hz",
        f"bandwidth, -3 dB, {_mm_s(SLOW_M_S)}",
        f"sines of {100 * SWING:g} % of the range in time, felt over asked",
    )
    yield from _steadiness_lines(found)
    for name, what, value in zip(
        ("sliding_current", "stuck_current"),
        ("highest touch current, sliding", "the same, all contact without a gap"),
        highest_current_a(found, config, description),
        strict=True,
    ):
        how = "computed by the model at each voltage and carrier that went out"
        yield Line(name, Number(value, nan, nan), "A rms", what, how)


def _contrast_lines(found: Measured) -> Iterator[Line]:
    low, high = found.cof("low"), found.cof("high")
    jnd = load_perception().jnd_friction
    levels = Number(*(1.0 + log(b / a) / log(1.0 + jnd) for a, b in _ends(low, high)))
    how = f"(high - low) / (high + low), {LOAD_N:g} N, {_mm_s(SPEED_M_S)}"
    yield Line("contrast", _contrast(low, high), "", "friction contrast", how)
    how = f"steps of {100 * jnd:g} %, just noticeable as published, from low to high"
    yield Line("levels", levels, "", "levels that can be distinguished", how)


def _step_lines(found: Measured, speed_m_s: float) -> Iterator[Line]:
    at, key = _mm_s(speed_m_s), f"{1e3 * speed_m_s:g}_mm_s"
    how = f"steps between {100 * LEAST:g} % of the range and its end"
    for way in ("rise", "fall"):
        answer = responses(found.of("steps", speed_m_s)[0], rises=way == "rise")
        delay, duration = (
            (UNKNOWN, UNKNOWN) if answer is None else (answer.delay_s, answer.ten_to_ninety_s)
        )
        yield Line(f"{way}_delay_{key}", delay, "s", f"{way}: command to half, {at}", how)
        placed = "mean of those steps, each placed by its half"
        yield Line(f"{way}_time_{key}", duration, "s", f"{way}: 10 to 90 %, {at}", placed)


def _place_lines(found: Measured, speed_m_s: float) -> Iterator[Line]:
    at, key = _mm_s(speed_m_s), f"{1e3 * speed_m_s:g}_mm_s"
    low = found.cof("low").value
    middle = middle_of(low, found.cof("high").value)
    error = mean_of(edge_errors_m(found.of("edges", speed_m_s)[0], low, middle))
    how = f"edges every {1e3 * HALF_M:g} mm: where friction has changed by half"
    yield Line(f"position_error_{key}", error, "m", f"position error, {at}", how)
    latency = Number(*(value / speed_m_s for value in error))
    how = "position error over speed: what the driver leaves of its delay"
    yield Line(f"latency_{key}", latency, "s", f"latency place to friction, {at}", how)


def _placement_lines(config: RigConfig) -> Iterator[Line]:
    """Median at each speed, what 95 % are within at the usual one, and the median beside turns."""

    def line(name: str, what: str, speed_m_s: float, error_m: float, how: str) -> Line:
        key = f"placement_{name}_{1e3 * speed_m_s:g}_mm_s"
        said = f"place of texture off, {what}, {_mm_s(speed_m_s)}"
        return Line(key, Number(error_m, nan, nan), "m", said, how)

    usual_m_s = USUAL_SPEED_M_S
    usual = placement_of(config, usual_m_s)
    how = f"computed for steady strokes, {1e3 * usual.latency_s:.0f} ms late in the mean"
    for speed_m_s in PLACED_M_S:
        median_m = placement_of(config, speed_m_s).median_m
        yield line("median", "median", speed_m_s, median_m, how)
    yield line("95", "95 %", usual_m_s, usual.most_m, how)
    how = f"computed for a sine back and forth at {BACK_AND_FORTH_HZ:g} Hz of that highest speed"
    yield line("turn", "beside turns", usual_m_s, at_turns_of(config, usual_m_s)[0], how)


def _steadiness_lines(found: Measured) -> Iterator[Line]:
    passes = found.of("touch")
    within, between = touches(passes)
    how = "relative deviation of friction, of 0.1 s each"
    yield Line("within_touches", within, "", "repeatability within a touch", how)
    how = f"relative deviation of {TOUCHES} touches, what wanders within taken out"
    yield Line("between_touches", between, "", "repeatability between touches", how)
    how = f"of one reading at constant friction, {LOAD_N:g} N, {_mm_s(SPEED_M_S)}"
    yield Line("noise", noise_n(passes), "N", "noise of lateral force", how)


def _mm_s(speed_m_s: float) -> str:
    return f"{1e3 * speed_m_s:g} mm/s"


def highest_current_a(
    found: Measured, config: RigConfig, description: ModelDescription
) -> tuple[float, float]:
    """Into the sliding finger, and into all contact without a gap that the rig's limits hold for,
    A rms, at all that went out.
    """
    out = np.concatenate([samples for _, samples in found.passes])
    out = out[out["voltage_v"] > 0.0]
    if not out.size:
        return 0.0, 0.0
    loads = np.maximum(np.round(out["normal_force_n"], 1), 0.1)
    conditions = np.unique(np.column_stack([out["frequency_hz"], loads]), axis=0)
    f, n = conditions.T
    v = np.array(
        [
            out["voltage_v"][(out["frequency_hz"] == hz) & (loads == load_n)].max()
            for hz, load_n in conditions
        ]
    )
    touch = TouchModel(description)
    of_one, per_m2, _ = touch.worst_case(sines(f, v, n, SPEED_M_S, 0.0))
    stuck_a = config.operating_limits().stuck_current(of_one, per_m2)
    sliding_a = touch.predict(Conditions(f, v, n)).current_rms_a
    return float(np.nanmax(sliding_a)), float(stuck_a.max())


def _doubt(found: Measured, description: ModelDescription) -> str | None:
    """What published fingers say against the model at the highest voltage that went out."""
    out = np.concatenate([samples for _, samples in found.passes])
    if description.is_published or not out.size:
        return None
    top = out[np.argmax(out["voltage_v"])]
    at = (float(top[name]) for name in ("frequency_hz", "voltage_v", "normal_force_n"))
    return beyond_published(TouchModel(description), *at)


def _ends(low: Number, high: Number) -> list[tuple[float, float]]:
    """Pairs of friction for value, low end and high end of what grows with their ratio."""
    return [(low.value, high.value), (low.high, high.low), (low.low, high.high)]


def _contrast(low: Number, high: Number) -> Number:
    return Number(*((b - a) / (b + a) for a, b in _ends(low, high)))


def _blocks(found: Measured, facts: dict[str, Any]) -> Iterator[Block]:
    yield Heading("Friction range")
    header = ("load", *(f"{1e3 * v:g} mm/s: low, high, contrast" for v in SPEEDS_M_S))
    rows = []
    for load_n in LOADS_N:
        here = [one for one in facts["range"] if one["normal_force_n"] == load_n]
        rows.append((f"{load_n:g} N", *(_range_cell(one) for one in here)))
    yield Table(header, rows, (1, 3, 3, 3))
    yield Figure(
        lambda axes: _draw(axes, found),
        height_mm=58.0,
        caption=(
            f"Left: lowest (blue) and highest (red) friction over load, at {_speeds()} mm/s."
            " Middle: mean answer to a step up (red) and down (blue), from half of the change."
            " Right: felt over asked friction; the dashed line is -3 dB."
        ),
        panels=3,
    )
    yield Heading("Numbers")
    numbers = facts["numbers"].items()
    cells = [(one["what"], *readable(name, one), one["how"]) for name, one in numbers]
    yield Table(("quantity", "value", "interval", "how it was got"), cells, (3.2, 1.3, 2.0, 5.6))
    if (doubt := facts["model_doubt"]) is not None:
        yield Paragraph(f"{doubt[0].upper()}{doubt[1:]}.", small=True)
    yield Paragraph(
        "After a proposal for haptic touch screens (arXiv:2308.15190, abstract read). Not measured:"
        f" {'; '.join(facts['not_measured'])}. Limits of current hold for"
        f" {facts['current_holds_for']}. Feedback was off. Friction is lateral over normal"
        " force; a rate or delay shorter than a tick of 1 ms is that of the reading.",
        small=True,
    )


def _range_cell(one: dict[str, Any]) -> str:
    low, high, contrast = (one[name]["value"] for name in ("cof_low", "cof_high", "contrast"))
    if low is None or high is None:
        return "not known"
    return f"{low:.3f}  {high:.3f}  {contrast:.3f}"


def readable(name: str, one: dict[str, Any]) -> tuple[str, str]:
    """Value and interval of a number among the facts, in a unit that reads well."""
    scale, unit = READS_WELL.get(one["unit"], (1.0, one["unit"]))
    if name in IN_PERCENT:
        scale, unit = 100.0, "%"
    if one["value"] is None:
        return "not known", "-"
    known = [scale * one[key] for key in ("value", "low", "high") if one[key] is not None]
    decimals = _decimals(known)
    value, *interval = (f"{number:.{decimals}f}" if number else "0" for number in known)
    return f"{value} {unit}".strip(), " to ".join(interval) or "-"


def _decimals(known: Sequence[float]) -> int:
    """For three digits of the largest number, and for one of the interval's width."""
    largest = max(abs(number) for number in known)
    width = max(known) - min(known)
    wanted = [2 - floor(log10(largest))] if largest > 0.0 else [0]
    wanted += [-floor(log10(width))] if width > 0.0 else []
    return min(max(*wanted, 0), MOST_DECIMALS)


def _draw(axes: Sequence[Axes], found: Measured) -> None:
    level, step, line = axes
    for speed_m_s, style in zip(SPEEDS_M_S, LINE_STYLES, strict=True):
        for what, color in (("low", LOW), ("high", HIGH)):
            cof = [found.cof(what, load_n, speed_m_s).value for load_n in LOADS_N]
            level.plot(LOADS_N, cof, marker="o", ms=3, ls=style, color=color)
    level.set(xlabel="normal force, N", ylabel="coefficient of friction", ylim=(0.0, None))
    (samples,) = found.of("steps", SPEED_M_S)
    for rises, color in ((True, HIGH), (False, LOW)):
        answer: Response | None = responses(samples, rises)
        if answer is not None:
            share: Array = answer.share if rises else 1.0 - answer.share
            step.plot(1e3 * answer.time_s, share, color=color)
    step.set(xlim=(-30.0, 40.0), xlabel="time, ms", ylabel="share of the change")
    gain, error = gains(found.of("lines")[0])
    line.errorbar(LINES_HZ, gain, 2.0 * error, fmt="o-", ms=3, color="#1a1a1a", elinewidth=0.7)
    line.axhline(np.sqrt(0.5), color="#8a8a8a", ls="--", lw=0.8)
    line.set(xscale="log", xlabel="frequency, Hz", ylabel="felt / asked", ylim=(0.0, None))
    line.xaxis.set_major_formatter("{x:g}")
    for one in axes:
        one.grid(alpha=0.25)


def _speeds() -> str:
    names = dict(zip(LINE_STYLES, ("dotted", "solid", "dashed"), strict=True))
    pairs = zip(SPEEDS_M_S, LINE_STYLES, strict=True)
    return ", ".join(f"{1e3 * speed:g} ({names[style]})" for speed, style in pairs)


def _as_facts(number: Number) -> dict[str, float | None]:
    return {name: _known(value) for name, value in number._asdict().items()}


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None
