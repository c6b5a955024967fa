"""A finger sliding over the rig, and how well its friction met the texture.

`Slide` is what the finger does, made up or recorded; `render_slide` runs it through tick, instruments and plant;
`score` compares what the force sensor felt with what the texture asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.files import bad_input
from haptic_driver.render.texture import Texture
from haptic_driver.render.tick import TickSettings, TickState, tick
from haptic_driver.rig import OffEvidence
from haptic_driver.signals import FingerSample
from haptic_driver.simulated_rig import SimulatedRig
from hw.force_sensor import ForceReading
from model.support.tables import Table, read_table

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TICK_S = 0.001
SLIDING_M_S = 0.002  # below, a finger rests and kinetic friction is not defined
AVERAGE_S = 0.010  # window over which force readings are averaged, centred
WITHIN = 0.05  # of the target
COLUMNS = ("time_s", "position_m", "normal_force_n")
LARGEST = {"position_m": 10.0, "normal_force_n": 50.0}  # beyond, the unit must be wrong


@dataclass(frozen=True)
class Slide:
    """What a finger does: arrays [n], evenly spaced by TICK_S; `position_m` along x."""

    name: str
    time_s: Array
    position_m: Array
    normal_force_n: Array

    @property
    def speed_m_s(self) -> Array:
        """Speed along x, over a window of 10 ms against the resolution of the encoder."""
        return np.asarray(np.gradient(_average(self.position_m), TICK_S))


@dataclass(frozen=True)
class SlideRecord:
    """One rendered slide: arrays [n], one entry per tick.

    `target_cof` is the texture under the finger itself, NaN where it asks for nothing; `measured_cof` the force
    sensor's, NaN where it was saturated; `voltage_v` and `frequency_hz` what the simulated amplifier and generator
    really put out; `feedback_gain` the finger's gain as the controller knew it; `rejections` how often the safety gate
    said no; `off` what was known about the output after the end.
    """

    slide: Slide
    target_cof: Array
    measured_cof: Array
    voltage_v: Array
    frequency_hz: Array
    in_contact: Mask
    reachable: Mask
    off_screen: Mask
    saturated: Mask
    feedback_gain: Array
    max_voltage_v: float
    rejections: int
    off: OffEvidence

    @property
    def sliding(self) -> Mask:
        """Where friction can be judged: in contact, sliding, and a texture underneath."""
        moving = np.abs(self.slide.speed_m_s) >= SLIDING_M_S
        return np.asarray(self.in_contact & moving & np.isfinite(self.target_cof) & np.isfinite(self.measured_cof))

    @property
    def relative_error(self) -> Array:
        """(measured - target)/target per tick."""
        return np.asarray(self.measured_cof / self.target_cof - 1.0)


@dataclass(frozen=True)
class Score:
    """How well one slide was rendered; see `haptic demo --json` for the names.

    The shares are of sliding contact time; `share_within_5_percent` counts only reachable targets, NaN without any.
    While the force sensor is saturated (`saturated_time_s`) friction is unknown, and is not judged.
    """

    share_within_5_percent: float
    cof_error_rms: float
    contact_time_s: float
    sliding_time_s: float
    reachable_share: float
    max_voltage_v: float
    output_on_without_contact_s: float
    saturated_time_s: float


def synthetic_slide() -> Slide:
    """Two strokes of 80 mm, there and back, at up to 50 mm/s under about 0.5 N, with a lift in between."""
    time = np.arange(0.0, 6.4, TICK_S)
    there, back = _stroke(time, 0.6, 2.2), _stroke(time, 3.7, 2.2)
    press = _stroke(time, 0.3, 0.15) - _stroke(time, 2.95, 0.15) + _stroke(time, 3.4, 0.15) - _stroke(time, 6.05, 0.15)
    load = press * (0.50 + 0.06 * np.sin(2.0 * np.pi * 0.9 * time))
    return Slide("synthetic slide", time, 0.080 * (there - back), load)


def _stroke(time: Array, start_s: float, duration_s: float) -> Array:
    """0 to 1 with least jerk."""
    x = np.clip((time - start_s) / duration_s, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x * x))


def read_slide(path: Path) -> Slide:
    """A recorded slide: CSV with `time_s, position_m, normal_force_n`, rising in time; resampled to the tick."""
    wanted = f"Give a CSV with columns {', '.join(COLUMNS)}, time rising, at least 10 rows"
    with bad_input():
        read = read_table(path, COLUMNS, wanted)
        table = np.column_stack([_numbers(read, column) for column in COLUMNS])
    if len(table) < 10:
        raise BadInputError("bad_slide", f"{path}: has {len(table)} rows", wanted)
    backwards = np.flatnonzero(np.diff(table[:, 0]) <= 0.0)
    if backwards.size:
        where = read.where(int(backwards[0]) + 1)
        raise BadInputError("bad_slide", f"{where}: time_s does not rise", wanted)
    if table[-1, 0] - table[0, 0] < 10 * TICK_S:
        raise BadInputError("bad_slide", f"{path}: lasts less than {10 * TICK_S:g} s; is time_s in seconds?", wanted)
    if table[-1, 0] - table[0, 0] > 3600.0:
        raise BadInputError("bad_slide", f"{path}: lasts longer than an hour; is time_s in seconds?", wanted)
    if table[:, 2].max() <= 0.0:
        raise BadInputError(
            "bad_slide", f"{path}: normal_force_n is never above 0: the finger never touches",
            "Give the force that presses on the screen, in N, as positive",
        )  # fmt: skip
    time = np.arange(table[0, 0], table[-1, 0], TICK_S)
    position, force = (np.interp(time, table[:, 0], table[:, i]) for i in (1, 2))
    return Slide(path.name, time, position, force)


def _numbers(table: Table, column: str) -> Array:
    values = table.numbers(column)
    too_large = np.flatnonzero(np.abs(values) > LARGEST.get(column, np.inf))
    if too_large.size:
        i = int(too_large[0])
        said = f"{table.where(i)}: {column} = {values[i]:g} is out of range"
        raise BadInputError("bad_slide", said, f"Give at most {LARGEST[column]:g} in SI units")
    return values


def render_slide(
    slide: Slide, texture: Texture, settings: TickSettings, bench: SimulatedRig, progress: Callable[[int], None]
) -> SlideRecord:
    """Run the slide tick by tick; `progress` is called with every tick's number.

    The rig is connected here and switched off at the end, whatever happens.
    """
    count = slide.time_s.size
    lateral, normal, voltage, frequency, gain = (np.empty(count) for _ in range(5))
    contact, reachable, saturated = (np.zeros(count, bool) for _ in range(3))
    speed = slide.speed_m_s
    state = TickState()
    rig = bench.rig
    try:
        rig.connect()
        for i in range(count):
            time_s, x = float(slide.time_s[i]), float(slide.position_m[i])
            state, done = tick(settings, state, _sample(time_s, x, rig.read_force()))
            rig.command(time_s, done.command)
            bench.step(TICK_S, float(slide.normal_force_n[i]), float(speed[i]))
            reading = rig.read_force()
            lateral[i], normal[i], saturated[i] = reading.lateral_force_n, reading.normal_force_n, reading.saturated
            voltage[i], frequency[i] = bench.voltage_v, bench.frequency_hz
            contact[i], reachable[i] = done.finger.in_contact, done.wanted.reachable
            gain[i] = state.controller.estimate.gain
            progress(i)
    finally:
        off = rig.off()
    target = np.asarray(texture.cof_at(slide.position_m, np.zeros(count)), dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        measured = np.where(contact & (_average(saturated) == 0.0), _average(lateral) / _average(normal), np.nan)
    return SlideRecord(
        slide=slide,
        target_cof=_average(target),
        measured_cof=measured,
        voltage_v=voltage,
        frequency_hz=frequency,
        in_contact=contact,
        reachable=reachable,
        off_screen=slide.normal_force_n < 0.5 * settings.finger.contact_off_n,
        saturated=saturated,
        feedback_gain=gain,
        max_voltage_v=bench.amplifier.max_voltage_v,
        rejections=state.safety.rejections,
        off=off,
    )


def _sample(time_s: float, position_m: float, felt: ForceReading) -> FingerSample:
    """What the tick is told; no lateral force where the sensor cannot be trusted."""
    lateral_n = float("nan") if felt.saturated else felt.lateral_force_n
    return FingerSample(time_s, position_m, 0.0, felt.normal_force_n, lateral_n)


def _average(values: Array | Mask) -> Array:
    """Centred moving average over AVERAGE_S; the ends use what there is."""
    half = round(AVERAGE_S / TICK_S / 2)
    total = np.concatenate([[0.0], np.cumsum(values)])
    i = np.arange(values.size)
    low, high = np.maximum(i - half, 0), np.minimum(i + half + 1, values.size)
    return np.asarray((total[high] - total[low]) / (high - low))


def score(record: SlideRecord) -> Score:
    """Judge a record over its sliding contact time."""
    sliding = record.sliding
    judged = sliding & record.reachable
    error = record.relative_error[judged]
    return Score(
        share_within_5_percent=float(np.mean(np.abs(error) <= WITHIN)) if judged.any() else float("nan"),
        cof_error_rms=float(np.sqrt(np.mean((error * record.target_cof[judged]) ** 2)))
        if judged.any()
        else float("nan"),
        contact_time_s=float(record.in_contact.sum() * TICK_S),
        sliding_time_s=float(sliding.sum() * TICK_S),
        reachable_share=float(judged.sum() / sliding.sum()) if sliding.any() else float("nan"),
        max_voltage_v=record.max_voltage_v,
        output_on_without_contact_s=float(((record.voltage_v > 0.0) & record.off_screen).sum() * TICK_S),
        saturated_time_s=float(record.saturated.sum() * TICK_S),
    )
