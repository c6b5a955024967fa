"""Measured data as the workflow reads them, checked before anything is fitted.

A file has a row per condition and repeat. A data set has one per condition, repeat and witness (an
observed quantity): friction, the electrode's current and voltage, and their phases.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.conditions import FINGERS, WAVEFORMS, Conditions
from model.diagnosis.witness import (
    CONTACT_AREA,
    CURRENT,
    CURRENT_PHASE,
    FRICTION,
    VOLTAGE,
    WITNESSES,
    Witness,
    observed,
    stated_std,
)
from model.effects.interventions import BY_INTERVENTION, NOTHING, removed
from model.support.arrays import Array, Mask
from model.support.errors import ModelError, nearest
from model.support.tables import NO_NAMES, Named, Table, read_table

REQUIRED = ("frequency_hz", "voltage_v", "normal_force_n")
OPTIONAL = ("speed_m_s", "time_s", "voltage_offset_v", "humidity_pct", "temperature_c")
MEASURED = {  # a condition that a sensor reads, and the column with what was commanded
    "normal_force_n": "commanded_normal_force_n",
    "speed_m_s": "commanded_speed_m_s",
}
SPREADS = {  # of a witness's standard deviation
    "cof_std": (1e-9, 20.0, ""),
    "current_std_a": (1e-15, 100.0, "A"),
    "current_phase_std_rad": (1e-6, 10.0, "rad"),
    "electrode_voltage_std_v": (1e-9, 1e4, "V"),
    "electrode_voltage_phase_std_rad": (1e-6, 10.0, "rad"),
    "contact_area_std_m2": (1e-12, 1e-2, "m^2"),
}
RANGES = {
    "frequency_hz": (1e-3, 1e9, "Hz"),
    "voltage_v": (0.0, 1e4, "V"),
    "normal_force_n": (1e-3, 100.0, "N"),
    "speed_m_s": (0.0, 10.0, "m/s"),
    "commanded_normal_force_n": (1e-3, 100.0, "N"),
    "commanded_speed_m_s": (0.0, 10.0, "m/s"),
    "time_s": (-1e9, 1e9, "s"),
    "voltage_offset_v": (-1e4, 1e4, "V"),
    **SPREADS,
    **{witness.column: witness.range for witness in WITNESSES},
}
SAME_FRICTION = 0.1  # relative: a mean of ratios is not the ratio of means
LATERAL, LATERAL_STD = "lateral_force_n", "lateral_force_std_n"  # in place of friction
RANGES |= {LATERAL: (-100.0, 100.0, "N"), LATERAL_STD: (1e-9, 100.0, "N")}
OWN = "simulated"  # a column that `haptic measure` writes, and nobody else
WORDS = ("session", "trial", "setting", "waveform", "finger", "intervention", "kramers_kronig")
COLUMNS = (*RANGES, "humidity_pct", "temperature_c", *WORDS)  # all that are read
WANTED = (
    f"Give a CSV with columns {', '.join(REQUIRED)}, cof (or lateral_force_n); optional cof_std,"
    " speed_m_s, time_s, session, trial; of the electrode current_a, current_phase_rad,"
    " electrode_voltage_v, electrode_voltage_phase_rad, finger; of a camera contact_area_m2. For"
    " another name or unit: --column frequency_hz=NAME:UNIT"
)


PHASES = [i for i, witness in enumerate(WITNESSES) if witness.is_phase]


@dataclass(frozen=True)
class Measurements:
    """A data set of n observations: `columns` [n] as floats, `session` [n] as numbers of
    `session_names`.

    Optional columns that the file does not have are absent from `columns`. `effects_on` [n]: the
    observations in which an effect under test is on; None for all of them. `witness` [n]: which of
    `WITNESSES` is observed, None for friction throughout. `row` [n] of the file, None where each
    has its own. `finger` [n] as in `Conditions`. `intervention` [n]: what somebody had done at the
    rig, see `model.effects.interventions`; None for nothing anywhere. `left_out`: rows of spectra
    that the file itself marks as in contradiction with Kramers and Kronig. `least_cof_std`:
    relative; what of friction is known no better from row to row, whatever the scatter says.
    `bad_rows`: what was wrong in rows that were left out on request, a line of the file each.
    `read_as`: columns that count as one of ours, times a factor. `notes`: what is to be told of the
    data beside any result. `setting` [n] and `trial` [n]:
    numbers of what the file calls so, None where it says nothing. `sure`: columns whose unit
    nobody need ask for, since a person said it or this program measured them.
    """

    columns: dict[str, Array]
    session: NDArray[np.intp]
    session_names: tuple[str, ...]
    waveform: NDArray[np.str_] | None
    content_hash: str
    effects_on: Mask | None = None
    witness: NDArray[np.intp] | None = None
    row: NDArray[np.intp] | None = None
    finger: NDArray[np.str_] | None = None
    intervention: NDArray[np.str_] | None = None
    left_out: int = 0
    bad_rows: tuple[str, ...] = ()
    read_as: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    least_cof_std: float = WITNESSES[FRICTION].least_std
    setting: NDArray[np.intp] | None = None
    trial: NDArray[np.intp] | None = None
    sure: frozenset[str] = frozenset()

    @property
    def count(self) -> int:
        return int(self.session.size)

    @property
    def rows(self) -> int:
        """Number of rows of the file."""
        return self.count if self.row is None else int(np.unique(self.row).size)

    def of(self, witness: int) -> Mask:
        """The observations of one witness, by its place in `WITNESSES`."""
        return (
            np.full(self.count, witness == FRICTION)
            if self.witness is None
            else self.witness == witness
        )

    @property
    def witnesses(self) -> list[int]:
        """Those that say anything."""
        return [i for i in range(len(WITNESSES)) if self.of(i).any()]

    @property
    def has_current(self) -> bool:
        """Whether the electrode's current was measured, amount or phase."""
        return bool(self.of(CURRENT).any() or self.of(CURRENT_PHASE).any())

    @property
    def has_area(self) -> bool:
        """Whether a camera saw the touch."""
        return bool(self.of(CONTACT_AREA).any())

    @property
    def observed(self) -> Array:
        """What was observed [n]: logarithms of amounts, phases in rad."""
        return self._by_witness(observed)

    @property
    def stated_std(self) -> Array:
        """Its standard deviation [n] as stated, NaN where the file does not say."""
        return self._by_witness(stated_std)

    def _by_witness(self, say: Callable[[Witness, dict[str, Array]], Array]) -> Array:
        values = np.empty(self.count)
        for i in self.witnesses:
            mine = self.of(i)
            values[mine] = say(
                WITNESSES[i], {name: column[mine] for name, column in self.columns.items()}
            )
        return values

    @property
    def is_phase(self) -> Mask:
        """Observations [n] that are angles."""
        return (
            np.isin(self.witness, PHASES)
            if self.witness is not None
            else np.zeros(self.count, bool)
        )

    def against(self, witness: int) -> Mask:
        """Of the observations of one witness, those that are compared with another of the same row.

        Where a voltage is measured without its phase, the current's phase counts from that voltage.
        """
        mine, known = self.of(witness), WITNESSES[witness]
        others = (
            [known.against, *([WITNESSES[VOLTAGE].column] if known.is_phase else [])]
            if known.against
            else []
        )
        told = [np.isfinite(self.columns[name][mine]) for name in others if name in self.columns]
        return np.asarray(np.any([np.zeros(int(mine.sum()), bool), *told], axis=0))

    @property
    def group(self) -> NDArray[np.intp]:
        """A number per observation, equal for those of one session and witness, which share a
        gain.
        """
        return (
            self.session
            if self.witness is None
            else self.session + len(self.session_names) * self.witness
        )

    @property
    def has_effects_off(self) -> bool:
        """Whether effects under test may be off in some observations."""
        return self.effects_on is not None or self.intervention is not None

    def with_effect(self, name: str) -> Mask:
        """Observations [n] in which an effect under test is on: no intervention had removed it."""
        on = np.ones(self.count, bool) if self.effects_on is None else self.effects_on
        if self.intervention is None:
            return on
        off = [done for done in BY_INTERVENTION if name in removed(done)]
        return np.asarray(on & ~np.isin(self.intervention, off))

    @property
    def sliding(self) -> Mask:
        """Observations [n] of a sliding finger."""
        return np.ones(self.count, bool) if self.finger is None else self.finger == "sliding"

    @property
    def driven(self) -> Mask:
        bias = self.columns.get("voltage_offset_v", np.zeros(self.count))
        return np.asarray((self.columns["voltage_v"] != 0.0) | (bias != 0.0))

    def varies(self, name: str) -> bool:
        """Whether a column is there and takes more than one value (frequency: where driven; speed:
        where sliding).
        """
        if name not in self.columns:
            return False
        chosen = {"frequency_hz": self.driven, "speed_m_s": self.sliding}
        values = self.columns[name][chosen[name]] if name in chosen else self.columns[name]
        return bool(values.size and np.ptp(values) > 0.0)

    def conditions(self) -> Conditions:
        """The rows as the model takes them."""
        c = self.columns
        return Conditions(
            frequency_hz=c["frequency_hz"],
            voltage_v=c["voltage_v"],
            normal_force_n=c["normal_force_n"],
            voltage_offset_v=c.get("voltage_offset_v"),
            waveform=self.waveform,
            speed_m_s=c.get("speed_m_s"),
            time_s=c.get("time_s"),
            finger=self.finger,
        )

    def subset(self, rows: Mask | NDArray[np.intp]) -> Measurements:
        """Some of the rows."""
        chosen: dict[str, Any] = {
            name: None if values is None else values[rows]
            for name, values in vars(self).items()
            if name
            in (
                "session",
                "waveform",
                "effects_on",
                "witness",
                "row",
                "finger",
                "intervention",
                "setting",
                "trial",
            )
        }
        return replace(
            self, columns={name: values[rows] for name, values in self.columns.items()}, **chosen
        )

    def replicate_groups(
        self, apart: bool = True, sessions_apart: bool = True, held: Iterable[str] = MEASURED
    ) -> NDArray[np.intp]:
        """A number per observation, equal for the same session and settings; time and repeat do not
        count.

        `apart`: each witness has groups of its own; `sessions_apart`: each session. `held`:
        measured conditions that count. What the file says was commanded counts in their place.
        """
        keys = ["voltage_v", "voltage_offset_v"]
        if self.setting is None:
            keys += [MEASURED[key] if MEASURED[key] in self.columns else key for key in held]
        settings = [np.where(self.driven, self.columns["frequency_hz"], 0.0)]
        settings += [self.session.astype(float)] if sessions_apart else []
        settings += [] if self.setting is None else [self.setting.astype(float)]
        settings += [self.columns[key] for key in keys if key in self.columns]
        for words in (self.waveform, self.finger, self.intervention):
            if words is not None:
                settings.append(np.unique(words, return_inverse=True)[1].astype(float))
        if self.witness is not None and apart:
            settings.append(self.witness.astype(float))
        _, group = np.unique(np.round(np.stack(settings, axis=1), 12), axis=0, return_inverse=True)
        return group.ravel()


def read_measurements(
    path: Path, leave_out_bad: bool = False, named: Mapping[str, Named] = NO_NAMES
) -> Measurements:
    """Read a data file; BadRowsError names every line and column that is wrong.

    ModelError where the file as a whole is. With `leave_out_bad` those rows are left out and listed
    in `bad_rows`. `named`: what the file calls its columns, by our names. Where it has no `cof`,
    the amount of `lateral_force_n` over the load is friction.
    """
    table = read_table(path, REQUIRED, WANTED, known=COLUMNS, at_once=True, named=named)
    if not table.rows:
        raise ModelError(f"{path}: has no rows", WANTED)
    if len(table.wrong) == len(table.rows):
        raise table.bad_rows()
    found, said = _measurements(table), tuple[str, ...]()
    while table.wrong:
        kept = table.without_wrong()
        if not leave_out_bad or not kept.rows:
            raise table.bad_rows()
        said += table.said_wrong()
        table, found = kept, _measurements(kept)
    notes = (*table.doubted(), *_friction_told(table), *_repeats_told(table))
    said_units = {ours for ours, one in named.items() if one.unit}
    sure = frozenset(COLUMNS if OWN in table.columns else said_units)
    return replace(found, bad_rows=said, read_as=table.notes, notes=notes, sure=sure)


def _repeats_told(table: Table) -> tuple[str, ...]:
    """That rows are alike in every cell, as where one was copied."""
    same = len(table.rows) - len({tuple(row.values()) for row in table.rows})
    if not same:
        return ()
    return (f"{same} of {len(table.rows)} rows repeat another in every cell: each counts",)


def _friction_told(table: Table) -> tuple[str, ...]:
    """That friction is not the lateral force over the load, where all three are there."""
    if not all(_says(table, name) for name in ("cof", LATERAL)):
        return ()
    asked = ("cof", LATERAL, "normal_force_n")
    cof, lateral_n, load_n = (_column(table, name, where_empty=np.nan) for name in asked)
    with np.errstate(divide="ignore", invalid="ignore"):
        wrong = np.flatnonzero(np.abs(np.abs(lateral_n) / load_n / cof - 1.0) > SAME_FRICTION)
    if not wrong.size:
        return ()
    row = int(wrong[0])
    by_force = abs(lateral_n[row]) / load_n[row]
    said = f"{table.where(row)}: cof is {cof[row]:.3g}, lateral force over load {by_force:.3g}"
    return (f"{said}; so in {wrong.size} of {cof.size} rows: cof counts",)


def _measurements(table: Table) -> Measurements:
    """All rows of a table; what is wrong in one is noted in the table, and stands for nothing."""
    waveform = _words(table, "waveform", WAVEFORMS)
    voltage = _column(table, "voltage_v")
    ignored = voltage == 0.0
    if waveform is not None:
        ignored |= waveform == "dc"
    finger = _words(table, "finger", FINGERS)
    columns = {"voltage_v": voltage, "frequency_hz": _column(table, "frequency_hz", ignored)}
    columns["normal_force_n"] = _column(
        table, "normal_force_n", None if finger is None else finger == "none"
    )
    held = None if finger is None else finger != "sliding"
    resting = {"speed_m_s": held, "commanded_speed_m_s": held}
    for name in (*OPTIONAL, *MEASURED.values()):
        if _says(table, name):
            columns[name] = _column(table, name, resting.get(name))
    if finger is not None and (finger == "none").any() and (finger != "none").any():
        touching = finger != "none"
        columns["normal_force_n"][~touching] = np.median(columns["normal_force_n"][touching])
    sessions = table.text("session") if "session" in table.columns else [""] * len(table.rows)
    names, session = np.unique([name or "1" for name in sessions], return_inverse=True)
    done = _words(table, "intervention", (NOTHING, *BY_INTERVENTION))
    rows = Measurements(
        columns,
        session.ravel(),
        tuple(map(str, names)),
        waveform,
        table.content_hash,
        finger=finger,
        intervention=done,
        setting=_labels(table, "setting"),
        trial=_labels(table, "trial"),
    )
    found = _observations(_with_friction(table, rows), rows)
    if found.row is None or not _says(table, "kramers_kronig"):
        return found
    fails = np.array([said == "fails" for said in table.text("kramers_kronig")])[found.row]
    return replace(found.subset(~fails), left_out=int(np.unique(found.row[fails]).size))


def _with_friction(table: Table, rows: Measurements) -> Table:
    """The table with friction of its sliding rows, where it has lateral forces alone."""
    friction = WITNESSES[FRICTION]
    if _says(table, friction.column) or not _says(table, LATERAL):
        return table
    texts = {friction.column: _over_load(table, rows, LATERAL)}
    if _says(table, LATERAL_STD) and not _says(table, friction.std):
        texts[friction.std] = _over_load(table, rows, LATERAL_STD)
    more = [dict(zip(texts, said, strict=True)) for said in zip(*texts.values(), strict=True)]
    return replace(
        table,
        columns=list(dict.fromkeys([*table.columns, *texts])),
        rows=[row | added for row, added in zip(table.rows, more, strict=True)],
    )


def _over_load(table: Table, rows: Measurements, name: str) -> list[str]:
    """Amounts of a force over the load, as text; empty where nothing slides.

    Of a row that is refused already it is 1: one complaint is enough.
    """
    ratio = np.abs(_column(table, name, where_empty=np.nan)) / rows.columns["normal_force_n"]
    texts = [repr(value) if value == value else "" for value in ratio.tolist()]  # noqa: PLR0124 - NaN
    for i in table.wrong:
        texts[i] = "1"
    return [said if slides else "" for said, slides in zip(texts, rows.sliding, strict=True)]


def _observations(table: Table, rows: Measurements) -> Measurements:
    """One observation per row and witness that it has; those of friction come first."""
    given = [witness for witness in WITNESSES if _says(table, witness.column)]
    if not given:
        table.require(WITNESSES[FRICTION].column)
        raise ModelError(
            f"{table.path}: no row says anything of friction, current, voltage or area", WANTED
        )
    columns = dict(rows.columns)
    for name in [name for witness in given for name in (witness.column, witness.std)]:
        if _says(table, name):
            columns[name] = _column(table, name, where_empty=np.nan)
    for witness in given:
        _check_stated(table, columns, witness)
    silent = np.all([np.isnan(columns[witness.column]) for witness in given], axis=0)
    for i in np.flatnonzero(silent).tolist():
        said = (
            f"{table.where(i)}: {given[0].column} is '', not a number, and no other witness speaks"
            " there"
        )
        if not table.rows[i][given[0].column]:
            table.refuse(i, ModelError(said, WANTED, "not_a_number"))
    if given == [WITNESSES[FRICTION]]:
        return replace(rows, columns=columns)
    held = np.zeros(rows.count, bool) if rows.finger is None else rows.finger != "sliding"
    wrong = held & np.isfinite(columns.get("cof", np.full(rows.count, np.nan)))
    for i in np.flatnonzero(wrong).tolist():
        said = f"{table.where(i)}: has a cof, but its finger does not slide"
        table.refuse(i, ModelError(said, "Leave cof empty there: friction is kinetic"))
    alternating = (rows.columns["voltage_v"] != 0.0) & (
        True if rows.waveform is None else rows.waveform != "dc"
    )
    there = {
        i: np.isfinite(columns[witness.column]) & (alternating | (i in (FRICTION, CONTACT_AREA)))
        for i, witness in enumerate(WITNESSES)
        if witness in given
    }
    return stacked(replace(rows, columns=columns), there)


def stacked(rows: Measurements, there: Mapping[int, Mask]) -> Measurements:
    """One observation per row and witness where that is there; those of one witness stand
    together.
    """
    row = np.concatenate([np.flatnonzero(mask) for mask in there.values()])
    witness = np.concatenate([np.full(int(mask.sum()), i, np.intp) for i, mask in there.items()])
    return replace(rows.subset(row), witness=witness, row=row)


def _check_stated(table: Table, columns: dict[str, Array], witness: Witness) -> None:
    """Refuse rows where a standard deviation stands without its value, or friction without one
    that others have.
    """
    if witness.std not in columns:
        return
    has, states = np.isfinite(columns[witness.column]), np.isfinite(columns[witness.std])
    wrong = states & ~has
    if witness is WITNESSES[FRICTION]:
        wrong |= has & ~states
    hint = f"Give {witness.column} and {witness.std} in the same rows"
    for i in np.flatnonzero(wrong).tolist():
        lacks = witness.std if has[i] else witness.column
        said = f"{table.where(i)}: {lacks} is '', not a number"
        if not table.rows[i][lacks]:
            table.refuse(i, ModelError(said, hint, "not_a_number"))


def together(parts: Sequence[tuple[str, Measurements]]) -> Measurements:
    """Several data sets as one, each with its file's name; the sessions of one are never those of
    another.

    ModelError where one has a condition that another lacks: what a row does not say cannot be made
    up. Witnesses may differ, and a standard deviation may be missing with its witness.
    """
    if len(parts) == 1:
        return parts[0][1]
    first_name, first = parts[0]
    for name, data in parts[1:]:
        different = sorted(set(_conditions(first)) ^ set(_conditions(data)))
        if different:
            has, lacks = (first_name, name) if different[0] in first.columns else (name, first_name)
            said = f"{lacks}: has no column {different[0]}, which {has} has"
            raise ModelError(said, "Add the column, or leave it out of every file")
    names: list[str] = []
    sessions, rows = [], []
    for number, (_, data) in enumerate(parts, start=1):
        sessions.append(data.session + len(names))
        rows.append(
            (np.arange(data.count) if data.row is None else data.row)
            + sum(d.rows for _, d in parts[: number - 1])
        )
        names += [f"file {number}, {session}" for session in data.session_names]
    hashes = "".join(data.content_hash for _, data in parts)
    sets = [data for _, data in parts]
    every = dict.fromkeys(name for data in sets for name in data.columns)
    one_witness = all(data.witness is None for data in sets)
    return Measurements(
        {
            name: np.concatenate(
                [data.columns.get(name, np.full(data.count, np.nan)) for data in sets]
            )
            for name in every
        },
        np.concatenate(sessions),
        tuple(names),
        _said([data.waveform for data in sets], [data.count for data in sets], "sine"),
        hashlib.sha256(hashes.encode()).hexdigest(),
        witness=(
            None
            if one_witness
            else np.concatenate(
                [np.zeros(d.count, np.intp) if d.witness is None else d.witness for d in sets]
            )
        ),
        row=None if one_witness else np.concatenate(rows),
        finger=_said([data.finger for data in sets], [data.count for data in sets], "sliding"),
        intervention=_said(
            [data.intervention for data in sets], [data.count for data in sets], NOTHING
        ),
        left_out=sum(data.left_out for data in sets),
        bad_rows=tuple(f"{name}, {said}" for name, data in parts for said in data.bad_rows),
        read_as=tuple(f"{name}: {said}" for name, data in parts for said in data.read_as),
        notes=tuple(f"{name}: {said}" for name, data in parts for said in data.notes),
        setting=_numbers([data.setting for data in sets], [data.count for data in sets]),
        sure=frozenset.intersection(*(data.sure for data in sets)),
        trial=_numbers([data.trial for data in sets], [data.count for data in sets]),
    )


def _conditions(data: Measurements) -> list[str]:
    """The columns that say under which conditions; those of witnesses may be missing."""
    said = {name for witness in WITNESSES for name in (witness.column, witness.std)}
    return [name for name in data.columns if name not in said]


def _said(
    words: Sequence[NDArray[np.str_] | None], counts: Sequence[int], where_unsaid: str
) -> NDArray[np.str_] | None:
    """Columns of words as one; None where none says anything."""
    if all(said is None for said in words):
        return None
    return np.concatenate(
        [
            np.full(count, where_unsaid) if said is None else said
            for said, count in zip(words, counts, strict=True)
        ]
    )


def _numbers(
    labels: Sequence[NDArray[np.intp] | None], counts: Sequence[int]
) -> NDArray[np.intp] | None:
    """Numbers of settings or trials as one column; None unless every data set has them."""
    if any(numbers is None for numbers in labels):
        return None
    parts, before = list[NDArray[np.intp]](), 0
    for numbers, count in zip(labels, counts, strict=True):
        assert numbers is not None
        parts.append(numbers + before)
        before += int(numbers.max()) + 1 if count else 0
    return np.concatenate(parts)


def _labels(table: Table, column: str) -> NDArray[np.intp] | None:
    """A number per row for each text of a column; None where the column says nothing."""
    if not _says(table, column):
        return None
    return np.unique(table.text(column), return_inverse=True)[1].ravel()


def _says(table: Table, name: str) -> bool:
    """Whether a column is there; an optional one that is empty throughout is not."""
    return name in table.columns and any(table.text(name))


def _words(table: Table, column: str, known: tuple[str, ...]) -> NDArray[np.str_] | None:
    """Names [n] of the `known`, the first where nothing is said; None without the column."""
    if not _says(table, column):
        return None
    names = [name.lower() or known[0] for name in table.text(column)]
    for i, name in enumerate(names):
        if name not in known:
            said = f"{table.where(i)}: {column} '{name}' is unknown"
            table.refuse(i, ModelError(said, nearest(name, list(known))))
    return np.array(names)


def _column(
    table: Table, name: str, ignored: Mask | None = None, where_empty: float | None = None
) -> Array:
    """One column [n]; 0 in the rows `ignored`, `where_empty`, if given, in empty cells.

    A cell that is no number within the column's range is refused, and NaN or as it is.
    """
    skipped = np.zeros(len(table.rows), bool) if ignored is None else ignored
    values = np.zeros(len(table.rows))
    for i, text in enumerate(table.text(name)):
        if skipped[i] or _cut(table, i):
            continue
        try:
            values[i] = table.number(i, name) if text or where_empty is None else where_empty
        except ModelError as error:
            table.refuse(i, error)
            values[i] = np.nan
    low, high, unit = RANGES.get(name, (-np.inf, np.inf, ""))
    outside = ~((values >= low) & (values <= high)) & ~np.isnan(values) & ~skipped
    question = "is the unit right?"
    if name == "normal_force_n" and np.all(values[outside] < 0.0):
        question = "give the force that presses as positive: change its sign"
    for i in np.flatnonzero(outside).tolist():
        if not _cut(table, i):
            within = f"{low:g}..{high:g} {unit}".rstrip()
            said = f"{table.where(i)}: {name} = {table.rows[i][name]} is out of range {within}"
            table.refuse(i, ModelError(said, f"It must lie in {within}; {question}"))
    return values


def _cut(table: Table, row: int) -> bool:
    """Whether a row has no cells that could be read by column."""
    return row in table.wrong and not any(table.rows[row].values())
