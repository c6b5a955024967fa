"""A trial -> where voltage and motion are, its windows, and a row of measured data for each."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import hypot, isfinite, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.fidelity.average import WINDOW_COLUMNS, average
from haptic_driver.files import bad_input
from haptic_driver.lab.force_signal import FEWEST, SLIDES
from haptic_driver.lab.importers.strokes import speed_over
from haptic_driver.lab.raw_trials.columns import Source, open_columns
from haptic_driver.lab.raw_trials.look import Doubt, Span, look_at
from haptic_driver.lab.raw_trials.quantities import Quantities, given_roles, quantities
from haptic_driver.lab.raw_trials.trial_map import (
    QUANTITIES,
    TEXTS,
    Baseline,
    Conditions,
    TrialMap,
    VoltageMark,
    Window,
)
from haptic_driver.signals import Array, Mask
from model.support.tables import read_table
from model.support.text import numbers
from model.support.units import PEAK_OF_RMS, is_rms, to_si

COLUMNS = (
    *WINDOW_COLUMNS,
    "setting",
    "commanded_normal_force_n",
    "commanded_speed_m_s",
    "voltage_offset_v",
    "waveform",
    "electrode_voltage_v",
    "file",
    "doubts",
)
BASELINE = "baseline"
MOST = 4000  # samples whose correlation is looked at; more are averaged in blocks
MOVING = 0.2  # of the greatest speed, where the map says none
# of the greatest voltage, where the map says none; below, attraction is a twenty-fifth
ON = 0.2
ENDS = 0.01  # of a record: what a straight line for zero goes through
PEAK = {"peak": 1.0, "peak_to_peak": 0.5}
Row = dict[str, str | float]


@dataclass(frozen=True)
class Trial:
    """A trial: its quantities, what was set, and when voltage and motion were there.

    `bursts`: all stretches with voltage, of which `voltage` is this trial's. `usable` [n]: samples
    that count. `doubts`: what a look at its signals leaves to be told.
    """

    found: Quantities
    conditions: Mapping[str, str | float]
    voltage: Span | None
    bursts: tuple[Span, ...]
    moving: Mask
    motion: Span
    spans: tuple[Span, ...]
    usable: Mask
    doubts: tuple[Doubt, ...]

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self.found.path

    @property
    def columns(self) -> Mapping[str, Array]:
        """Columns [n] in SI by role."""
        return self.found.columns


def tabled(said: Conditions, folder: Path) -> dict[str, dict[str, str]]:
    """The lines of the table of conditions by file; empty where the map names none."""
    if said.table is None:
        return {}
    with bad_input("bad_map"):
        table = read_table(folder / said.table, ("file",), "A column file, and those of conditions")
    found: dict[str, dict[str, str]] = {}
    for i, row in enumerate(table.rows):
        if row["file"] in found:
            wrong = f"{table.where(i)}: {row['file']} stands more than once"
            raise BadInputError("bad_map", wrong, "Keep the row that holds")
        found[row["file"]] = row
    return found


def conditions_of(
    path: Path, said: Conditions, table: Mapping[str, Mapping[str, str]]
) -> dict[str, str | float]:
    """What was set in a trial, in SI; BadInputError where the map does not say it."""
    texts: dict[str, str | float] = dict(said.values)
    if said.table is not None:
        row = table.get(path.name, table.get(path.stem))
        if row is None:
            raise BadInputError("bad_trial", f"{path}: {said.table} has no row for it")
        texts |= {name: cell for name, cell in row.items() if cell and name != "file"}
    for pattern in said.patterns:
        match = re.search(pattern, path.name)
        if match is None:
            raise BadInputError("bad_trial", f"{path}: its name has nothing like {pattern}")
        texts |= {name: text for name, text in match.groupdict().items() if text is not None}
    found: dict[str, str | float] = {}
    for name, text in texts.items():
        if name in TEXTS:
            found[name] = str(text).lower() if name == "waveform" else str(text)
        elif name in QUANTITIES:
            found[name] = _quantity(path, name, text, said)
    return found | _amplitude(path, found, said)


def _quantity(path: Path, name: str, text: str | float, said: Conditions) -> float:
    if name not in said.units:
        hint = f"Give conditions.units.{name}"
        raise BadInputError("unknown_unit", f"{path}: {name} has no unit", hint)
    where = f"conditions.units.{name}"
    factor = to_si(name, said.units[name], where)
    cell = re.sub(r"(?<=\d)p(?=\d)", ".", str(text))
    value = float(numbers(f"{path}: {name}", [cell])[0])
    if not isfinite(value):
        raise BadInputError("bad_trial", f"{path}: {name} is '{text}', not a number")
    return factor * value


def _amplitude(
    path: Path, found: Mapping[str, str | float], said: Conditions
) -> dict[str, str | float]:
    """The set voltage as an amplitude at the electrode; a name that says none is refused."""
    if "voltage" not in found:
        hint = "Give voltage in conditions: patterns, table or values; the frequency too"
        raise BadInputError("bad_trial", f"{path}: nothing says its voltage", hint)
    voltage = float(found["voltage"])
    waveform = str(found.get("waveform", "sine"))
    if waveform not in PEAK_OF_RMS:
        known = ", ".join(PEAK_OF_RMS)
        raise BadInputError("bad_trial", f"{path}: waveform '{waveform}' is none of {known}")
    if voltage and waveform != "dc" and "frequency" not in found:
        raise BadInputError("bad_trial", f"{path}: nothing says its frequency")
    factor = PEAK_OF_RMS[waveform] if said.voltage_is == "rms" else PEAK[said.voltage_is]
    if is_rms(said.units["voltage"]):  # its factor is that of a sine
        factor *= PEAK_OF_RMS[waveform] / PEAK_OF_RMS["sine"]
    return {"voltage": voltage * factor * said.voltage_scale}


def read_trials(
    source: Source, said: TrialMap, conditions: Mapping[str, str | float], *, may_turn: bool = False
) -> list[Trial]:
    """A file as a trial, or one for each burst of its voltage where the map says so.

    `may_turn`: the finger's way is of use in both directions.

    BadInputError says what in it is not as the map says, or cannot be meant by it.
    """
    found = _with_zero(quantities(source, said), said)
    time_s = found.columns["time"]
    whole = Span("record", float(time_s[0]), float(time_s[-1]))
    moving = _moving(found.columns, said)
    if not moving.any():
        raise BadInputError("bad_trial", f"{found.path}: nothing moves in it")
    motion = Span("motion", float(time_s[moving][0]), float(time_s[moving][-1]))
    if said.motion is not None and said.motion.turns == "sign":
        found = _against_the_way(found)
    trial = Trial(found, conditions, None, (), moving, motion, (), moving, ())
    if said.voltage_on is None or not conditions["voltage"]:
        return [_looked_at(trial, said, may_turn)]
    bursts = _bursts(found, said.voltage_on, conditions, whole)
    trial = replace(trial, bursts=tuple(burst["voltage"] for burst in bursts))
    return [_looked_at(replace(trial, **burst), said, may_turn) for burst in bursts]


def opened(path: Path, said: TrialMap) -> Source:
    """The columns of a file by the names of a map."""
    names = [c.name for c in given_roles(said).values() if isinstance(c.name, str)]
    return open_columns(path, said.file, names)


def _looked_at(trial: Trial, said: TrialMap, may_turn: bool) -> Trial:
    spans = _spans(trial, said)
    usable, doubts = look_at(trial.found, spans, trial.moving, said, may_turn=may_turn)
    doubts = (*trial.doubts, *_aliased(trial), *doubts)
    return replace(trial, spans=spans, usable=usable, doubts=doubts)


def _aliased(trial: Trial) -> list[Doubt]:
    """A doubt where the electrode's voltage is sampled too slowly for its frequency."""
    set_hz = float(trial.conditions.get("frequency", 0.0)) if trial.voltage is not None else 0.0
    rate_hz = 1.0 / float(np.median(np.diff(trial.columns["time"])))
    if "electrode_voltage" not in trial.columns or rate_hz > 2.0 * set_hz:
        return []
    told = f"electrode_voltage of {set_hz:g} Hz is sampled at {rate_hz:.6g} Hz"
    return [Doubt("aliased", f"{told}: its amplitude is not known")]


def _with_zero(found: Quantities, said: TrialMap) -> Quantities:
    """The columns whose zero is a straight line from the first samples to the last."""
    columns = dict(found.columns)
    time_s = columns["time"]
    count = max(FEWEST, round(ENDS * time_s.size))
    for role, wanted in given_roles(said).items():
        if wanted.zero == "linear":
            ends = [columns[role][:count].mean(), columns[role][-count:].mean()]
            at_s = [time_s[:count].mean(), time_s[-count:].mean()]
            slope = (ends[1] - ends[0]) / (at_s[1] - at_s[0])
            columns[role] = columns[role] - ends[0] - slope * (time_s - at_s[0])
    return replace(found, columns=columns)


def _against_the_way(found: Quantities) -> Quantities:
    """The lateral force counted against the finger's way."""
    way = np.sign(speed_of(found.columns))
    lateral_n = found.columns["lateral_force"] * np.where(way == 0.0, 1.0, way)
    return replace(found, columns={**found.columns, "lateral_force": lateral_n})


def _bursts(
    found: Quantities, mark: VoltageMark, conditions: Mapping[str, str | float], whole: Span
) -> list[dict[str, Any]]:
    """When the voltage is on, for each time that it is, and what that says of the trial."""
    if mark.column is None:
        assert mark.start_s is not None
        end_s = whole.end_s if mark.end_s is None else mark.end_s
        return [{"voltage": Span("voltage", mark.start_s, end_s)}]
    frequency_hz = float(conditions.get("frequency", 0.0))
    spans, levels, doubts = on_stretches(found, mark, 1.0 / frequency_hz if frequency_hz else 0.0)
    if len(spans) == 1:
        return [{"voltage": spans[0], "doubts": doubts}]
    if mark.bursts == "one":
        when = ", ".join(f"{span.start_s:.4g}" for span in spans)
        said = f"{found.path}: the voltage comes on {len(spans)} times, at {when} s"
        hint = 'For a trial each: voltage_on.bursts = "each"; else a threshold_v, or start_s'
        raise BadInputError("doubtful_trial", said, hint)
    shares = [float(f"{level / max(levels):.2g}") for level in levels]
    set_v = float(conditions["voltage"])
    return [
        {
            "voltage": span,
            "conditions": {**conditions, "voltage": share * set_v},
            "doubts": (*doubts, Doubt("burst", _burst_said(i, len(spans), share))),
        }
        for i, (span, share) in enumerate(zip(spans, shares, strict=True), start=1)
    ]


def _burst_said(number: int, count: int, share: float) -> str:
    level = "" if share == 1.0 else f", at {share:.0%} of the highest level"
    return f"burst {number} of {count}{level}"


def on_stretches(
    found: Quantities, mark: VoltageMark, period_s: float
) -> tuple[list[Span], list[float], tuple[Doubt, ...]]:
    """When a column exceeds its threshold, its level meanwhile, and spikes that are passed over.

    What falls below for less than a period of the carrier, or for FEWEST samples, is on.
    """
    assert mark.column is not None
    known = np.flatnonzero(np.isfinite(found.columns[mark.column]))
    amount, time_s = (np.abs(found.columns[name][known]) for name in (mark.column, "time"))
    top_v = float(np.partition(amount, -FEWEST)[-FEWEST]) if amount.size >= FEWEST else 0.0
    threshold_v = mark.threshold_v or ON * top_v
    above = np.flatnonzero(amount > threshold_v)
    stretches = list[Array]()
    if above.size:
        hold_s = max(period_s, FEWEST * float(np.median(np.diff(time_s))))
        is_off = (np.diff(time_s[above]) > hold_s) & (np.diff(above) > 1)
        stretches = np.split(above, np.flatnonzero(is_off) + 1)
    spikes = [part for part in stretches if part.size < FEWEST]
    long = [part for part in stretches if part.size >= FEWEST]
    if not long:
        said = f"{found.path}: {mark.column} never exceeds {threshold_v:g} V for {FEWEST} samples"
        raise BadInputError("bad_trial", said, "Is threshold_v right, and gain?")
    places = [found.place(int(known[part[0]])) for part in spikes]
    doubts = [Doubt("spike", f"{mark.column} has a spike at {at}: passed over") for at in places]
    if long[0][0] == 0:
        told = f"{mark.column} is above {threshold_v:.3g} V from the first sample on"
        doubts.append(Doubt("from_start", f"{told}: when it came on is not known"))
    spans = [Span("voltage", float(time_s[p[0]]), float(time_s[p[-1]])) for p in long]
    return spans, [float(np.sqrt(np.mean(amount[p] ** 2))) for p in long], tuple(doubts)


def _moving(columns: Mapping[str, Array], said: TrialMap) -> Mask:
    time_s, mark = columns["time"], said.motion
    if mark is None:
        return np.ones(time_s.size, bool)
    if mark.start_s is not None:
        end_s = np.inf if mark.end_s is None else mark.end_s
        return np.asarray((time_s >= mark.start_s) & (time_s <= end_s))
    speed = np.abs(speed_of(columns))
    least = mark.least_speed_m_s or MOVING * float(np.percentile(speed, 95.0))
    return np.asarray(speed >= max(least, 1e-12))


def speed_of(columns: Mapping[str, Array]) -> Array:
    """Speed [n] of a trial that has a column of it, or one of the position."""
    if "speed" in columns:
        return columns["speed"]
    return speed_over(columns["time"], columns["position"])


def load_of(trial: Trial) -> Array:
    """The load [n] of a trial, measured or set; BadInputError where nothing says it."""
    if "normal_force" in trial.columns:
        return trial.columns["normal_force"]
    if "normal_force" in trial.conditions:
        return np.full(trial.moving.size, float(trial.conditions["normal_force"]))
    raise BadInputError("bad_trial", f"{trial.path}: nothing says its load")


def _spans(trial: Trial, said: TrialMap) -> tuple[Span, ...]:
    """The windows in the trial's time; of a trial without voltage the whole motion is one."""
    if not trial.conditions["voltage"] and any(w.after != "motion" for w in said.windows):
        return (Span("window 1", trial.motion.start_s, trial.motion.end_s),)
    windows = [_placed(f"window {i}", w, trial) for i, w in enumerate(said.windows, start=1)]
    if said.baseline is None or (trial.voltage is None and said.baseline.after != "motion"):
        return tuple(windows)
    return (_placed(BASELINE, said.baseline, trial), *windows)


def _placed(name: str, window: Window, trial: Trial) -> Span:
    if window.after == "motion":
        zero_s = trial.motion.start_s
    else:
        assert trial.voltage is not None
        zero_s = trial.voltage.start_s if window.after == "on" else trial.voltage.end_s
    return Span(name, zero_s + window.start_s, zero_s + window.end_s)


def rows_of(trial: Trial, said: TrialMap, number: int) -> list[Row]:
    """A row for each window; BadInputError where one holds too little, or no friction."""
    before, rows = None, list[Row]()
    for span in trial.spans:
        row, is_on = _row(trial, span, _within(trial, span), number), _is_on(trial, span)
        if span.name == BASELINE and said.baseline is not None and said.baseline.use != "row":
            before = row
            continue
        if trial.voltage is None and said.baseline is not None and said.baseline.use != "row":
            before = before or row  # without voltage all of it is the baseline
        if not is_on:
            offset: Row = {"voltage_offset_v": 0.0} if row["voltage_offset_v"] != "" else {}
            row |= {"voltage_v": 0.0, "electrode_voltage_v": "", **offset}
        if before is not None and said.baseline is not None:
            row |= _against(row, before, said.baseline)
        if not float(row["cof"]) > 0.0:
            word = f"{trial.path}: friction is {row['cof']:.3g} in {span.name}"
            raise BadInputError(
                "bad_trial", word, "Are sign, offset and unit of both forces right?"
            )
        rows.append(row)
    return rows


def _is_on(trial: Trial, span: Span) -> bool:
    """Whether the voltage is on throughout a stretch, or not at all; BadInputError for a part, and
    for a baseline with voltage.
    """
    if trial.voltage is None:
        return span.name != BASELINE
    late_s = 1.5 * float(np.median(np.diff(trial.columns["time"])))
    for on in trial.bursts:
        if span.end_s <= on.start_s + late_s or span.start_s >= on.end_s - late_s:
            continue
        is_all = span.start_s >= on.start_s - late_s and span.end_s <= on.end_s + late_s
        if is_all and span.name != BASELINE:
            return True
        part = "has voltage" if is_all else "has voltage in a part"
        said = f"{_place_of(trial, span)} {part}: on from {on.start_s:.4g} to {on.end_s:.4g} s"
        hint = "Choose a window in which it is on or off throughout"
        hint = "Choose one before the voltage" if span.name == BASELINE else hint
        raise BadInputError("doubtful_trial", said, hint)
    return False


def _against(row: Row, before: Row, said: Baseline) -> Row:
    """Friction and its standard error of a row against those before voltage."""
    assert said.cof is not None
    cof, std = float(row["cof"]), float(row["cof_std"])
    cof_before, std_before = float(before["cof"]), float(before["cof_std"])
    if said.use == "offset":
        loads = float(before["normal_force_n"]) / float(row["normal_force_n"])
        error = hypot(std, loads * std_before)
        return {"cof": said.cof + cof - loads * cof_before, "cof_std": error}
    if cof_before <= 0.0:
        raise BadInputError("bad_trial", f"{row['file']}: friction before voltage is not positive")
    found = said.cof * cof / cof_before
    return {"cof": found, "cof_std": abs(found) * hypot(std / cof, std_before / cof_before)}


def inside(trial: Trial, span: Span) -> Mask:
    """The samples [n] of a stretch; BadInputError where the record does not hold all of it."""
    time_s = trial.columns["time"]
    found = np.asarray((time_s >= span.start_s) & (time_s <= span.end_s))
    record = f"the record goes from {time_s[0]:.4g} to {time_s[-1]:.4g} s"
    if span.start_s < time_s[0] or span.end_s > time_s[-1] or found.sum() < FEWEST:
        said = f"{_place_of(trial, span)} holds {int(found.sum())} samples; {record}"
        raise BadInputError("bad_trial", said, "Is the file whole, and the window right?")
    return found


def _within(trial: Trial, span: Span) -> Mask:
    """The samples of a stretch that slide; BadInputError where too few of them do."""
    every = inside(trial, span)
    moving = every & trial.moving & trial.usable
    if moving.sum() < max(SLIDES * every.sum(), FEWEST):
        said = f"{_place_of(trial, span)} slides for {moving.sum() / every.sum():.0%} of the time"
        raise BadInputError("bad_trial", said)
    return np.asarray(moving)


def _place_of(trial: Trial, span: Span) -> str:
    return f"{trial.path}: {span.name}, {span.start_s:.4g} to {span.end_s:.4g} s,"


def _row(trial: Trial, span: Span, chosen: Mask, number: int) -> Row:
    columns, set_to = trial.columns, trial.conditions
    lateral_n = _thinned(columns["lateral_force"][chosen])
    normal_n = _thinned(load_of(trial)[chosen])
    if np.mean(normal_n) <= 0.0:
        said = f"{trial.path}: the load is {np.mean(normal_n):.3g} N in {span.name}"
        raise BadInputError("bad_trial", said, "Is sign of columns.normal_force right?")
    measured = average(_thinned(columns["time"][chosen]), lateral_n, normal_n)
    zero_s = trial.voltage.start_s if trial.voltage is not None else trial.motion.start_s
    by_column = "speed" in columns or "position" in columns
    speed: str | float = (
        float(np.mean(np.abs(speed_of(columns)[chosen]))) if by_column else set_to.get("speed", "")
    )
    row: Row = dict.fromkeys(COLUMNS, "")
    row |= {
        "frequency_hz": set_to.get("frequency", ""),
        "voltage_v": set_to["voltage"],
        "normal_force_n": measured.normal_force_n,
        "cof": measured.cof,
        "cof_std": measured.cof_std,
        "speed_m_s": speed,
        "time_s": measured.time_s - zero_s,
        "session": set_to.get("session", "1"),
        "trial": set_to.get("trial", str(number)),
        "setting": set_to.get("setting", _setting(set_to)),
        "commanded_normal_force_n": set_to.get("normal_force", ""),
        "commanded_speed_m_s": set_to.get("speed", ""),
        "voltage_offset_v": set_to.get("voltage_offset", ""),
        "waveform": set_to.get("waveform", ""),
        "file": trial.path.name,
        "doubts": "; ".join(doubt.said for doubt in trial.doubts),
    }
    if "electrode_voltage" in columns and set_to["voltage"]:
        root = sqrt(float(np.mean(columns["electrode_voltage"][chosen] ** 2)))
        row["electrode_voltage_v"] = root * PEAK_OF_RMS[str(set_to.get("waveform", "sine"))]
    return row


def _setting(set_to: Mapping[str, str | float]) -> str:
    """What was commanded, as a name that repeats share."""
    parts = [f"{set_to[name]:g} {unit}" for name, unit in _SHOWN.items() if name in set_to]
    return ", ".join([*parts, *([str(set_to["waveform"])] if "waveform" in set_to else [])])


_SHOWN = {"frequency": "Hz", "voltage": "V", "normal_force": "N", "speed": "m/s"}


def _thinned(values: Array) -> Array:
    """Means of equal blocks, where there are more than MOST values."""
    block = -(-values.size // MOST)
    blocks = values[: values.size // block * block].reshape(-1, block)
    return np.asarray(blocks.mean(axis=1))
