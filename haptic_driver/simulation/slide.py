"""A finger sliding over the simulated rig, and how well its friction met the texture.

`render_slide` runs a slide through tick, instruments and plant; `score` compares what the force sensor felt with what
the texture asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_driver.render.texture import Texture
from haptic_driver.render.tick import TickSettings, TickState, tick
from haptic_driver.rig.evidence import OffEvidence
from haptic_driver.rig.slide import TICK_S, Slide, average
from haptic_driver.signals import SLIDING_M_S, WITHIN, Array, FingerSample, FingerState, Mask
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.textures.bands import EDGES_HZ, LEAST_COF, rms_in_bands
from hw.force.sensor import ForceReading


@dataclass(frozen=True)
class SlideRecord:
    """One rendered slide: arrays [n], one entry per tick.

    `target_cof` is the texture under the finger itself, NaN where it asks for nothing; `measured_cof` the force
    sensor's, NaN where it was saturated; `fine_target_cof` and `fine_measured_cof` the same, not averaged over 10 ms;
    `voltage_v` and `frequency_hz` what the simulated amplifier and generator really put out; `feedback_gain` the
    finger's gain as the controller knew it; `rejections` how often the safety gate said no; `off` what was known about
    the output after the end.
    """

    slide: Slide
    target_cof: Array
    measured_cof: Array
    fine_target_cof: Array
    fine_measured_cof: Array
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
    def strokes(self) -> list[slice]:
        """Uninterrupted sliding, at least 20 ms long."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.sliding, [False]]).astype(int)))
        return [slice(a, b) for a, b in edges.reshape(-1, 2).tolist() if b - a >= 20]

    @property
    def relative_error(self) -> Array:
        """(measured - target)/target per tick."""
        return np.asarray(self.measured_cof / self.target_cof - 1.0)


@dataclass(frozen=True)
class Score:
    """How well one slide was rendered; see `haptic demo --json` for the names.

    The shares are of sliding contact time; `share_within_5_percent` counts only reachable targets, NaN without any.
    While the force sensor is saturated (`saturated_time_s`) friction is unknown, and is not judged. `bands`: friction
    asked for and felt (rms) in the bands of frequency that ticks can hold; `band_error`: how far the felt ones are off,
    all together, as a share of what is asked for; NaN where that is nothing.
    """

    share_within_5_percent: float
    cof_error_rms: float
    contact_time_s: float
    sliding_time_s: float
    reachable_share: float
    max_voltage_v: float
    output_on_without_contact_s: float
    saturated_time_s: float
    band_error: float
    bands: list[dict[str, float]]


def render_slide(
    slide: Slide,
    texture: Texture,
    settings: TickSettings,
    bench: SimulatedRig,
    progress: Callable[[int], None] = lambda tick: None,
) -> SlideRecord:
    """Run the slide tick by tick; `progress` is called with every tick's number.

    The rig is connected here and switched off at the end, whatever happens.
    """
    count = slide.time_s.size
    lateral, normal, voltage, frequency, gain, target = (np.empty(count) for _ in range(6))
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
            there = FingerState(time_s, x, 0.0, float(speed[i]), 0.0, float(slide.normal_force_n[i]), True)
            target[i] = texture.cof_under(there)
            reading = rig.read_force()
            lateral[i], normal[i], saturated[i] = reading.lateral_force_n, reading.normal_force_n, reading.saturated
            voltage[i], frequency[i] = bench.instruments.voltage_v, bench.instruments.frequency_hz
            contact[i], reachable[i] = done.finger.in_contact, done.wanted.reachable
            gain[i] = state.controller.estimate.gain
            progress(i)
    finally:
        off = rig.off()
    with np.errstate(divide="ignore", invalid="ignore"):
        measured = np.where(contact & (average(saturated) == 0.0), average(lateral) / average(normal), np.nan)
        fine = np.where(contact & ~saturated, lateral / normal, np.nan)
    return SlideRecord(
        slide=slide,
        target_cof=average(target),
        measured_cof=measured,
        fine_target_cof=target,
        fine_measured_cof=fine,
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


def score(record: SlideRecord) -> Score:
    """Judge a record over its sliding contact time."""
    sliding = record.sliding
    judged = sliding & record.reachable
    error = record.relative_error[judged]
    asked, felt = in_bands(record, record.fine_target_cof), in_bands(record, record.fine_measured_cof)
    roughness = np.sqrt(np.sum(asked**2))
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
        band_error=float(np.sqrt(np.sum((felt - asked) ** 2)) / roughness) if roughness > LEAST_COF else float("nan"),
        bands=[
            {"low_hz": low, "high_hz": high, "asked_cof_rms": a, "felt_cof_rms": f}
            for low, high, a, f in zip(
                EDGES_HZ[:-1].tolist(), EDGES_HZ[1:].tolist(), asked.tolist(), felt.tolist(), strict=False
            )
        ],
    )


def in_bands(record: SlideRecord, cof: Array) -> Array:
    """Root mean square of friction [n] over all strokes, in the bands below half the rate of ticks."""
    whole = int(np.sum(EDGES_HZ[1:] <= 0.5 / TICK_S))
    square = np.zeros(whole)
    strokes = [stroke for stroke in record.strokes if np.isfinite(cof[stroke]).all()]
    for stroke in strokes:
        square += cof[stroke].size * rms_in_bands(cof[stroke], TICK_S, 1.0)[:whole] ** 2
    return np.asarray(np.sqrt(square / max(sum(cof[stroke].size for stroke in strokes), 1)))
