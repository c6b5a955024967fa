"""A recording as measured data: stretches of even sliding, each some rows as `haptic measure` would
have written them.

Even means that load, speed and carrier hardly change; the voltage may, as fast as a texture wants
it. Friction follows it with a first-order lag of the way slid, and attraction goes with its square:
so the square is lagged in the same way, and the samples of a stretch with about the same lagged
square are a row. Strokes are trials; after a pause, or in another run, a session begins.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.experiments.average import Measured, average, standard_error
from haptic_driver.experiments.data_file import row_texts
from haptic_driver.experiments.plan import Row, Setting
from haptic_driver.files import bad_input, write_rows
from haptic_driver.processes.samples import Flag
from haptic_driver.recording.read import Run, read_run, run_names
from haptic_driver.render.feedback import FeedbackSettings
from haptic_driver.signals import SETTLED_M, Array, Mask
from model.diagnosis.data import Measurements, read_measurements, together

ENDINGS = (".h5", ".hdf5")
# samples that are averaged before it is asked whether a condition is steady: sensors are noisy
STEP = 10
SHORTEST_S = 0.1  # of a row: enough samples to tell how they remember one another
LONGEST_S = 1.0
SHARED_S = 1.0  # of a row's own scatter: so much counts what all rows say about the noise
# after another carrier: set points come 10 ms late, and friction needs 20 ms at SLOWEST_M_S
SETTLING_S = 0.05
TIMING_S = {"envelope": 0.001, "set_point": 0.010}  # so much early or late may the drive be
LATER = (-1.0, 1.0, 2.0, 3.0)  # by how many of these it may be felt later than its budget says
PLAINLY = 0.9  # of the scatter about the budget's timing: another one leaves less
UNNOTICED_S = 0.2  # so long may an output have been without voltage before that is noticed
SLOWEST_M_S = 0.003
CUTOFF_PER_M = FeedbackSettings(0.0).cutoff_hz_per_m_s
GAP_S = 0.005  # without a sample, or longer: another stroke
PAUSE_S = 5.0  # between strokes, or longer: another session
LARGEST_CHANGE = np.array([[0.10], [0.30], [1e-6]])  # of load, speed, carrier, within one stretch
ONE_POWER = 0.08  # a change of the voltage squared, relative, that is none
NO_POWER_V2 = 1.0
BINS = 5  # rows of a stretch, evenly spaced in the voltage squared, besides the one without voltage
UNSURE = (
    0.16  # of a stretch's highest voltage squared: where timing matters more, a sample says little
)


class Recorded(NamedTuple):
    """One row that a recording gave."""

    row: Row
    measured: Measured


def read_data(paths: Sequence[Path], rows: Path | None = None) -> Measurements:
    """Files of measured data (CSV) and recordings (HDF5), by their endings, as one data set.

    What the recordings were cut into is kept in the file `rows`. BadInputError for what cannot be
    used.
    """
    recordings = [path for path in paths if path.suffix.lower() in ENDINGS]
    tables = [path for path in paths if path not in recordings]
    if rows is not None and not recordings:
        said = "--rows is for what a recording was cut into, and no recording is given"
        raise BadInputError("usage", said, "Leave it out, or give a file that haptic record wrote")
    if rows is not None and rows.exists():
        raise BadInputError("file_exists", f"{rows}: exists already", "Give another --rows")
    with TemporaryDirectory() as folder, bad_input("bad_data"):
        parts = []
        if recordings:
            cut = rows or Path(folder) / "rows.csv"
            write_recorded(recordings, cut)
            parts.append((", ".join(map(str, recordings)), read_measurements(cut)))
        return together([*parts, *((str(path), read_measurements(path)) for path in tables)])


def write_recorded(recordings: Sequence[Path], out: Path) -> int:
    """Write the rows of recordings to a CSV with the columns of `haptic measure`; returns how many.

    BadInputError for what is no recording, and where nothing in one is steady.
    """
    texts: list[dict[str, str]] = []
    sessions = 0
    for path in recordings:
        before = len(texts)
        for name in run_names(path):
            run = read_run(path, name)
            rows = cut(run)
            simulated = bool(run.attributes["simulated"])
            for row, measured in rows:
                numbered = row._replace(session=sessions + row.session)
                texts.append(row_texts(numbered, measured, simulated=simulated))
            sessions += rows[-1].row.session if rows else 0
        if len(texts) == before:
            said = (
                f"{path}: no {SHORTEST_S:g} s of sliding in it under a steady load, speed and"
                " voltage"
            )
            raise BadInputError(
                "nothing_steady",
                said,
                "Record even strokes at one friction after another: haptic set",
            )
    write_rows(out, texts)
    return len(texts)


def cut(run: Run) -> list[Recorded]:
    """The rows of one run, in order of time; sessions and strokes with any count from 1. Times are
    since its start.
    """
    found: list[Recorded] = []
    if run.samples.size < 2:
        return found
    strokes = list(_strokes(run.samples, run.attributes["latency_budget_s"]["total"] + SETTLING_S))
    if not strokes:
        return found
    drive, lasted_s = _drive(run, _later_s(run, strokes)), []
    session, stroke, ended_s, start_s = 1, 0, -np.inf, float(run.samples["time_s"][0])
    for part in strokes:
        samples, during = run.samples[part], drive.during(part)
        windows = _windows(samples, during)
        rows = [row for window in windows for row in _rows(samples[window], during.during(window))]
        good = [row for row in rows if row[1].valid]
        if not good:
            continue
        stroke += 1
        if found and samples["time_s"][0] - ended_s > PAUSE_S:
            session, stroke = session + 1, 1
        ended_s = float(samples["time_s"][-1])
        for setting, measured, row_s in good:
            since = measured._replace(time_s=measured.time_s - start_s)
            found.append(Recorded(Row(setting, session, stroke), since))
            lasted_s.append(row_s)
    return _with_shared_noise(found, np.array(lasted_s))


def _with_shared_noise(rows: list[Recorded], lasted_s: Array) -> list[Recorded]:
    """The rows with errors that also rest on the noise of the others.

    Where a row lasts a few correlation times, its scatter says little about the error of its mean.
    So the relative variance of a mean over one second is drawn to that of all rows together, which
    counts as SHARED_S.
    """
    if not rows:
        return rows
    own = lasted_s * np.array([(m.cof_std / m.cof) ** 2 for _, m in rows])
    shared = float(np.sum(lasted_s * own) / np.sum(lasted_s))
    variance = (lasted_s * own + SHARED_S * shared) / (lasted_s + SHARED_S) / lasted_s
    stds = np.sqrt(variance).tolist()
    return [
        row._replace(measured=row.measured._replace(cof_std=std * row.measured.cof))
        for row, std in zip(rows, stds, strict=True)
    ]


class _Drive(NamedTuple):
    """What the forces of each sample answer to [n]: carrier, the least and the most of it since
    SETTLING_S, and lagged voltage squared with what its timing may change of it: anything where a
    reading only repeats the last.
    """

    carrier_hz: Array
    least_hz: Array
    most_hz: Array
    power_v2: Array
    unsure_v2: Array

    def during(self, part: slice | Mask) -> _Drive:
        return _Drive(*(values[part] for values in self))


def _later_s(run: Run, strokes: Sequence[slice]) -> float:
    """How much later than by its budget the drive was felt; 0 where friction does not plainly say
    so.
    """
    timing_s, cof = _timing_s(run), run.samples["measured_cof"].astype(np.float64)
    at_budget = _scatter(cof, _power_v2(run, 0.0), strokes)
    scatters = {
        later * timing_s: _scatter(cof, _power_v2(run, later * timing_s), strokes)
        for later in LATER
    }
    best_s = min(scatters, key=scatters.__getitem__)
    return best_s if scatters[best_s] < PLAINLY * at_budget else 0.0


def _scatter(cof: Array, power_v2: Array, strokes: Sequence[slice]) -> float:
    """The friction squared that a line over the voltage squared leaves in each stroke: least at the
    right timing.
    """
    left = 0.0
    for part in strokes:
        y, x = (values[part] - values[part].mean() for values in (cof, power_v2))
        left += float(y @ y - (y @ x) ** 2 / max(x @ x, NO_POWER_V2))
    return left


def _timing_s(run: Run) -> float:
    return TIMING_S["envelope" if "envelope" in run.attributes["latency_budget_s"] else "set_point"]


def _felt(run: Run, later_s: float) -> NDArray[np.intp]:
    """Which sample's command each sample feels."""
    samples = run.samples
    if "asked_time_s" in (samples.dtype.names or ()):
        acts_s, felt_s = np.maximum.accumulate(samples["asked_time_s"]), samples["felt_time_s"]
    else:  # a recording of before they were written down; as the daemon's own feedback had it
        latency = run.attributes["latency_budget_s"]
        acts_s = samples["time_s"] + latency["total"] - latency["sensor"] - latency["tick"]
        felt_s = samples["time_s"]
    place: NDArray[np.intp] = np.searchsorted(acts_s + later_s, felt_s, side="right") - 1
    return np.maximum(place, 0)


def _power_v2(run: Run, later_s: float) -> Array:
    """The lagged voltage squared of what is felt."""
    samples, time_s = run.samples, run.samples["time_s"]
    speed_m_s = np.nan_to_num(samples["speed_m_s"].astype(np.float64))
    voltage_v = samples["voltage_v"][_felt(run, later_s)]
    return _lagged(voltage_v**2, speed_m_s * np.diff(time_s, prepend=time_s[0]))


def _drive(run: Run, later_s: float) -> _Drive:
    """The commands as many seconds ago as they take to be felt, and `later_s`; at 0 V the carrier
    is the last or the first one.
    """
    from scipy.ndimage import (  # noqa: PLC0415 - slow to import
        maximum_filter1d,
        minimum_filter1d,
        uniform_filter1d,
    )

    samples, place = run.samples, _felt(run, later_s)
    time_s, step_s = samples["time_s"], float(np.median(np.diff(samples["time_s"])))
    driven = np.flatnonzero(samples["voltage_v"][place] > 0.0)
    carrier_hz = np.zeros(time_s.size)
    if driven.size:
        last = np.maximum(np.searchsorted(driven, np.arange(time_s.size), side="right") - 1, 0)
        carrier_hz = samples["frequency_hz"][place][driven[last]]
    look_back = STEP + round(SETTLING_S / step_s)
    origin = (look_back - 1) // 2  # which makes the last sample the one that is asked about
    least_hz, most_hz = (
        f(carrier_hz, look_back, origin=origin) for f in (minimum_filter1d, maximum_filter1d)
    )
    power_v2 = _power_v2(run, later_s)
    around = 1 + 2 * round(_timing_s(run) / step_s)
    unsure_v2 = maximum_filter1d(power_v2, around) - minimum_filter1d(power_v2, around)
    if (
        "envelope" in run.attributes["latency_budget_s"]
    ):  # early as often as late: valleys are felt less deep
        power_v2 = uniform_filter1d(power_v2, around)
    power_v2[power_v2 < NO_POWER_V2] = 0.0
    forces_n = np.stack([samples[name] for name in ("normal_force_n", "lateral_force_n")])
    repeated = np.all(
        np.diff(forces_n, prepend=np.nan) == 0.0, axis=0
    )  # control was late: a reading of before
    unsure_v2[repeated] = np.inf
    return _Drive(carrier_hz, least_hz, most_hz, power_v2, unsure_v2)


def _lagged(values: Array, way_m: Array) -> Array:
    """`values` [n] after a first-order lag of the way [n] that each lasts: so friction follows
    attraction.
    """
    shares = -np.expm1(-2.0 * np.pi * CUTOFF_PER_M * way_m)
    steps = zip(values.tolist(), shares.tolist(), strict=True)
    return np.array(
        [
            y
            for y, _ in accumulate(
                steps, lambda last, new: (last[0] + new[1] * (new[0] - last[0]), 0.0)
            )
        ]
    )


def _strokes(samples: NDArray[np.void], settling_s: float) -> Iterator[slice]:
    """Where the finger slides without a break or a turn, and friction is known: of what was out all
    the time.

    Before the first sample nobody knows; what was commanded is felt within `settling_s`.
    """
    unmeasured = int(
        Flag.SATURATED_SENSOR | Flag.FRICTION_FROM_CURRENT
    )  # both stay up until the next arming
    usable = np.isfinite(samples["measured_cof"]) & (samples["flags"] & unmeasured == 0)
    usable &= (samples["in_contact"] > 0) & (samples["speed_m_s"] >= SLOWEST_M_S)
    time_s = samples["time_s"]
    usable &= time_s >= time_s[0] + settling_s
    lost_s = time_s[(samples["voltage_v"] > 0.0) & (samples["output_on"] == 0)]
    usable &= np.searchsorted(lost_s, time_s - settling_s) == np.searchsorted(
        lost_s, time_s + UNNOTICED_S
    )
    gap = np.diff(samples["time_s"], prepend=samples["time_s"][0]) > GAP_S
    turn = np.diff(np.sign(samples["lateral_force_n"]), prepend=0.0) != 0.0
    for piece in _pieces(usable, gap | turn):
        way_m = np.cumsum(samples["speed_m_s"][piece] * np.gradient(samples["time_s"][piece]))
        start = piece.start + int(np.searchsorted(way_m, SETTLED_M))
        if piece.stop - start >= STEP:
            yield slice(start, piece.stop)


def _pieces(usable: Mask, breaks: Mask) -> list[slice]:
    """Runs of at least two usable places, none with a break after its first."""
    ends = np.flatnonzero(np.diff(usable, prepend=False, append=False))
    found = []
    for start, stop in zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True):
        inner = (start + 1 + np.flatnonzero(breaks[start + 1 : stop])).tolist()
        edges = [start, *inner, stop]
        found += [slice(a, b) for a, b in pairwise(edges) if b - a > 1]
    return found


def _windows(samples: NDArray[np.void], drive: _Drive) -> list[slice]:
    """The even stretches of one stroke: each as long as it stays even, up to LONGEST_S."""
    steps = samples.size // STEP
    whole, last = slice(steps * STEP), slice(STEP - 1, steps * STEP, STEP)
    step_s = STEP * float(np.mean(np.diff(samples["time_s"])))
    touch = [
        samples[name][whole].reshape(steps, STEP).mean(axis=1)
        for name in ("normal_force_n", "speed_m_s")
    ]
    least, most = (
        np.stack([*touch, carrier_hz[last]]) for carrier_hz in (drive.least_hz, drive.most_hz)
    )
    longest = max(round(LONGEST_S / step_s), 1)
    found, start = [], 0
    while start < steps:
        ahead = slice(start, start + 2 * longest)
        low, high = (
            np.minimum.accumulate(least[:, ahead], axis=1),
            np.maximum.accumulate(most[:, ahead], axis=1),
        )
        steady = np.all(high - low <= LARGEST_CHANGE * high, axis=0)
        count = steady.size if steady.all() else int(np.argmin(steady))
        if count > longest:  # in halves, rather than with a short rest that says little
            count = count // 2
        if count * step_s >= SHORTEST_S - 0.5 * step_s:
            found.append(slice(start * STEP, (start + count) * STEP))
        start += max(count, 1)
    return found


def _rows(samples: NDArray[np.void], drive: _Drive) -> list[tuple[Setting, Measured, float]]:
    """The rows of one stretch, each with how long it lasted in all; one row where the voltage
    hardly changes.

    The errors rest on the scatter of the whole stretch about its rows.
    """
    step_s = float(np.mean(np.diff(samples["time_s"])))
    sure = drive.unsure_v2 <= max(UNSURE * drive.power_v2.max(), NO_POWER_V2)
    samples, drive = samples[sure], drive.during(sure)
    power_v2, most_v2 = drive.power_v2, drive.power_v2.max(initial=NO_POWER_V2)
    changes = most_v2 - power_v2.min(initial=most_v2) > ONE_POWER * most_v2
    place = np.ceil(BINS * power_v2 / most_v2) if changes else np.zeros(power_v2.size)
    parts = [part for k in np.unique(place) if np.count_nonzero(part := place == k) >= STEP]
    lateral_n, load_n = np.abs(samples["lateral_force_n"]), samples["normal_force_n"]
    means = [average(samples["time_s"][part], lateral_n[part], load_n[part]) for part in parts]
    if not means:
        return []
    rows_v2 = np.array([np.mean(power_v2[part]) for part in parts])
    cof = np.interp(power_v2, rows_v2, [mean.cof for mean in means])
    error = standard_error((lateral_n - cof * load_n) / np.mean(load_n))
    found = []
    for part, mean, row_v2 in zip(parts, means, rows_v2, strict=True):
        count = int(np.count_nonzero(part))
        voltage_v = float(np.sqrt(row_v2))
        frequency_hz = float(drive.carrier_hz[-1]) if voltage_v > 0.0 else 0.0
        told = (
            frequency_hz,
            voltage_v,
            mean.normal_force_n,
            float(np.mean(samples["speed_m_s"][part])),
        )
        frequency_hz, voltage_v, normal_force_n, speed_m_s = (
            float(f"{value:.6g}") for value in told
        )
        setting = Setting(frequency_hz, voltage_v, normal_force_n, speed_m_s)
        found.append(
            (
                setting,
                mean._replace(cof_std=error * float(np.sqrt(power_v2.size / count))),
                count * step_s,
            )
        )
    return found
