"""A plan run on a rig: every row through check, safety gate, rig and force sensor, and onto the
disk.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.fidelity.average import Measured, average
from haptic_driver.lab.measuring.bench import Bench
from haptic_driver.lab.measuring.check import Judged, Refusal, check, resolved
from haptic_driver.lab.measuring.contact_area import ContactArea, contact_area
from haptic_driver.lab.measuring.data_file import DataFile, Identity
from haptic_driver.lab.measuring.electrode import mean_reading
from haptic_driver.lab.measuring.plan import Plan, Row, Setting
from haptic_driver.lab.measuring.stroke import sliding_stage
from haptic_driver.lab.measuring.trace import Trace
from haptic_driver.lab.strokes.file import StrokesFile
from haptic_driver.limits import OperatingLimits
from haptic_driver.render import drive, safety
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.rig import Rig, require_verified
from haptic_driver.rig.states import RigState
from haptic_driver.signals import Array
from hw.errors import DeviceError
from hw.generator.settings import Shape
from hw.monitor.contract import ElectrodeReading
from model.touch_model import TouchModel

READING_S = 0.005  # between force readings; longer where sensor or output take longer
READINGS = 10  # of the electrode in a window
LEAST_READINGS = 40  # in a window: fewer say nothing of their own scatter
ATTEMPTS = 3  # at a row whose load was missed, or one of
PASSING = (
    "output_lost",
    "stroke_ended",
)  # what a computer that was busy for a moment does better the next time
SETTLING_STEP_S = 0.05  # while nobody reads
INSTANT_S = 1e-9  # less is a sum of floats


@dataclass(frozen=True)
class Experiment:
    """A plan made ready for one rig: what is measured in which order, and what is not measured and
    why.

    `skipped` counts rows. `points` holds the operating point of every permitted setting.
    """

    plan: Plan
    config: RigConfig
    model: TouchModel
    seed: int
    rows: tuple[Row, ...]
    points: dict[Setting, Judged]
    refusals: tuple[Refusal, ...]
    limits: OperatingLimits

    @property
    def skipped(self) -> int:
        """Rows of the plan that are not measured."""
        return len(self.refusals) * self.plan.repeats * self.plan.sessions

    @property
    def duration_s(self) -> float:
        """How long all rows take, waiting for those that have a time, apart from bringing up the
        voltage.
        """
        clock_s, lasted_s, session = 0.0, 0.0, 0
        for row in self.rows:
            if row.session != session:
                session, lasted_s, clock_s = row.session, lasted_s + clock_s, 0.0
            due_s = 0.0 if row.setting.time_s is None else self.plan.begin_s(row.setting)
            clock_s = max(clock_s, due_s) + self.plan.row_s
        return lasted_s + clock_s

    def identity(self, hidden: str = "") -> Identity:
        """What a data file must have been begun with to be continued; `hidden` is whatever else
        shapes the friction.
        """
        order = [[*row.setting, row.session, row.trial] for row in self.rows]
        timing = [self.plan.settle_s, self.plan.average_s, self.plan.pause_s]
        return Identity(
            plan=self.plan.name,
            plan_hash=hashlib.sha256(json.dumps([order, timing]).encode()).hexdigest(),
            seed=self.seed,
            model=self.model.description.name,
            model_hash=self.model.description.content_hash,
            rig=self.config.name,
            rig_content=json.dumps([self.config.model_dump(mode="json"), hidden], sort_keys=True),
            simulated=self.config.is_computed,
        )


def prepare(
    config: RigConfig, model: TouchModel, plan: Plan, seed: int | None = None
) -> Experiment:
    """Check every setting of `plan` against the rig's limits and fix the order; nothing is opened.

    Finger currents are those that `model` predicts. HapticError for a rig that may not come on,
    BadInputError when nothing is left to measure.
    """
    sliding_stage(config)
    require_verified(config)
    _require_force(config)
    settings = resolved(plan.settings, config, model)
    points, refusals = check([s for s in settings if s.driven], plan, config, model)
    undriven = list({s.without_voltage(): None for s in settings if not s.sweep})
    without, refused = check(undriven, plan, config, model)
    refusals += [refusal for refusal in refused if refusal.setting in settings]
    permitted = [s for s in settings if s in points or s in without]
    _require_one_wiring(permitted)
    if not permitted:
        said = f"plan {plan.name}: rig {config.name} refuses every point, first {refusals[0]}"
        raise BadInputError("all_refused", said, "Choose other points, or another rig")
    seed = plan.seed if seed is None else seed
    judged = points | without
    rows = tuple(row for row in plan.rows(permitted, seed) if row.setting in judged)
    limits = config.sweep_limits()
    return Experiment(plan, config, model, seed, rows, judged, tuple(refusals), limits)


def _require_force(config: RigConfig) -> None:
    """BadInputError where nothing would be measured, or nobody tells when the finger presses."""
    if config.without_force is None:
        return
    said = f"rig {config.name} has no force sensor"
    if config.stage is not None:
        hint = "Add a section [force_sensor]; haptic record keeps current and voltage without one"
        raise BadInputError("no_force_sensor", f"{said}: nobody tells when a finger presses", hint)
    if all(monitor.drives for monitor in config.electrode_monitors):
        hint = "Add a section [force_sensor], or [[electrode_monitors]] for current and voltage"
        raise BadInputError("no_force_sensor", f"{said}, and nothing reads its electrode", hint)


def _require_one_wiring(settings: Sequence[Setting]) -> None:
    """An instrument that drives the electrode itself is wired in the amplifier's place: nothing
    else in its plan.
    """
    by_meter = [s for s in settings if s.by_meter]
    if by_meter and len(by_meter) < len(settings):
        said = (
            f"{len(by_meter)} rows are swept by an instrument that drives the electrode, the others"
            " by the amplifier"
        )
        hint = "Put them into plans of their own, and wire the electrode for each"
        raise BadInputError("two_wirings", said, hint)


def run(
    experiment: Experiment,
    bench: Bench,
    data: DataFile,
    progress: Callable[[int], None] = lambda done: None,
    tell: Callable[[str], None] = lambda what: None,
    strokes: StrokesFile | None = None,
) -> KnownOutput:
    """Measure what `data` does not have yet, row by row, on a bench that has been entered.

    `progress` is called with the number of rows done, `tell` with why a row is measured again. What
    slides is kept in `strokes`, where given. The output is off between rows and when this returns
    or raises, whatever happens; HapticError when it cannot be shown to be off.
    """
    session = 0
    try:
        for number, row in enumerate(experiment.rows[data.done :], start=data.done):
            if row.session != session:
                session = row.session
                bench.begin_session(session, _session_time_s(experiment, data, session))
            _wait_until_due(experiment.plan, bench, row.setting)
            data.append(row, *_measure_at_last(experiment, bench, number, row, tell, strokes))
            progress(data.done)
    finally:
        output = bench.rig.off()
    return _require_off(output)


class MeasuredRow(NamedTuple):
    """The numbers of one row, as far as the rig measures them."""

    measured: Measured
    electrode: ElectrodeReading | None
    area: ContactArea | None


def _measure_at_last(
    experiment: Experiment,
    bench: Bench,
    number: int,
    row: Row,
    tell: Callable[[str], None],
    strokes: StrokesFile | None,
) -> MeasuredRow:
    """A row under its mean load and with its output on all the time, at one of a few attempts."""
    setting, tolerance = row.setting, experiment.plan.load_tolerance
    wanted_n = setting.normal_force_n
    for left in reversed(range(ATTEMPTS)):
        try:
            trace = Trace(bench) if strokes and setting.finger == "sliding" else None
            found = measure_row(experiment, bench, number, row, trace)
        except HapticError as error:
            if not left or error.code not in PASSING or bench.rig.state is not RigState.OFF:
                raise
            tell(f"row {number + 1}: {error.message}; once more")
            continue
        load_n = found.measured.normal_force_n
        if isnan(load_n) or abs(load_n - wanted_n) <= tolerance * wanted_n:
            if found.area is None and bench.camera is not None and setting.finger != "none":
                tell(f"row {number + 1}: no frame of the camera shows the touch")
            if strokes and trace:
                strokes.append(trace.stroke(number + 1, row))
            return found
        missed = f"row {number + 1}: the load was {load_n:.3g} N, not {wanted_n:g} N"
        if left:
            tell(f"{missed}; once more")
    said = f"{missed}, {ATTEMPTS} times"
    raise HapticError(
        "load_missed", said, "Hold the load, or raise the plan's load_tolerance; then --resume"
    )


def _wait_until_due(plan: Plan, bench: Bench, setting: Setting) -> None:
    """A row with a time waits for it, the finger lifted."""
    if (
        setting.time_s is not None
        and (early_s := plan.begin_s(setting) - bench.read_force().time_s) > 0.0
    ):
        bench.step(early_s, 0.0, 0.0)


def measure_row(
    experiment: Experiment, bench: Bench, number: int, row: Row, trace: Trace | None = None
) -> MeasuredRow:
    """What one row gives; the finger is lifted and the output off after. `trace` keeps it whole."""
    plan, setting = experiment.plan, row.setting
    try:
        bench.begin_row(number, row)
        began_s = bench.time_s
        if bench.camera is not None:
            bench.camera.start()
        _run_up(bench, setting, trace)
        _bring_up(experiment, bench, setting, trace)
        _settle(bench, plan, setting, trace)
        settled_s = bench.time_s - began_s
        window, readings = _window(bench, plan, setting, trace)
        ended_s = bench.time_s - began_s
        bench.end_row()
    finally:
        output = bench.rig.off()
    _require_off(output)
    frames = [] if bench.camera is None else bench.camera.frames()  # may wait: nothing is on
    bench.step(plan.pause_s, 0.0, 0.0)
    electrode = mean_reading(readings)
    steady = [frame for frame in frames if settled_s <= frame.time_s <= ended_s]
    area = contact_area(steady, experiment.config.camera)
    without_force = experiment.config.without_force is not None
    if without_force and electrode is None:
        said = f"row {number + 1}, {setting}: the electrode's monitor reads nothing"
        raise HapticError("no_current", said, "Check the monitor's lines and gain; then --resume")
    if setting.sweep or without_force:
        load_n = 0.0 if setting.finger == "none" else float(np.mean(window[:, 2]))
        load_n = nan if without_force else load_n
        swept = Measured(nan, nan, load_n, float(np.mean(window[:, 0])))
        return MeasuredRow(swept, electrode, area)
    measured = average(window[:, 0], window[:, 1], window[:, 2])
    if not measured.valid:
        hint = (
            "Check that the finger slides, and the force sensor's axes: both forces count positive"
        )
        raise HapticError("no_friction", f"row {number + 1}, {setting}: measured {measured}", hint)
    return MeasuredRow(measured, electrode, area)


def _run_up(bench: Bench, setting: Setting, trace: Trace | None) -> None:
    """The finger gathers speed, the output off."""
    for dt_s in _steps(bench, bench.run_up_s, trace):
        bench.step(dt_s, setting.normal_force_n, setting.speed_m_s)
        if trace:
            trace.look()
    bench.up_to_speed()


def _settle(bench: Bench, plan: Plan, setting: Setting, trace: Trace | None) -> None:
    """Friction takes its new value."""
    if trace:
        trace.settles()
    for dt_s in _steps(bench, plan.settle_s, trace):
        _slide(bench, dt_s, setting)
        if trace:
            trace.look()
    if trace:
        trace.steady()


def _steps(bench: Bench, duration_s: float, trace: Trace | None) -> Iterator[float]:
    """What to wait for from look to look until `duration_s` has passed; longer where nobody
    looks.
    """
    step_s = READING_S if trace else SETTLING_STEP_S
    end_s = bench.time_s + duration_s
    while (left_s := end_s - bench.time_s) > INSTANT_S:
        yield min(step_s, left_s)


def _window(
    bench: Bench, plan: Plan, setting: Setting, trace: Trace | None
) -> tuple[Array, list[ElectrodeReading]]:
    """A window of `average_s`: time, lateral and normal force [n, 3], and the electrode where a
    monitor measures it.

    The electrode is read at most `READINGS` times, evenly spread, and for no more than half of the
    window.
    """
    forces: list[tuple[float, float, float]] = []
    electrode: list[ElectrodeReading] = []
    wanted = READINGS if setting.driven and setting.frequency_hz > 0.0 else 0
    begin_s, reading_s = bench.time_s, 0.0
    while (elapsed_s := bench.time_s - begin_s) < plan.average_s - 0.5 * READING_S:
        _slide(bench, READING_S, setting)
        force = bench.read_force()
        if force.saturated:
            raise HapticError(
                "saturated", f"the force sensor is at the end of its range ({force})", "Lower load"
            )
        forces.append((force.time_s, force.lateral_force_n, force.normal_force_n))
        if trace:
            trace.look(force)
        due = len(electrode) < wanted * elapsed_s / plan.average_s and reading_s <= 0.5 * elapsed_s
        if due and (plan.settle_s + elapsed_s) * setting.frequency_hz >= 1.0:
            before_s = bench.time_s
            reading = _electrode(bench, setting)
            reading_s += bench.time_s - before_s
            electrode += [] if reading is None else [reading]
            wanted = 0 if reading is None else wanted
    if len(forces) < LEAST_READINGS and not setting.sweep:
        said = (
            f"only {len(forces)} force readings in {plan.average_s:g} s, {LEAST_READINGS} are"
            " needed"
        )
        raise HapticError(
            "too_few_readings", said, "Raise the plan's average_s; is the computer busy?"
        )
    return np.array(forces), electrode


def _electrode(bench: Bench, setting: Setting) -> ElectrodeReading | None:
    """The electrode's present voltage and current, where a monitor measures the carrier."""
    try:
        return bench.read_electrode(setting)
    except DeviceError as error:
        raise HapticError(
            error.code, f"the electrode's monitor, at {setting}: {error.message}", error.hint
        ) from error


def _slide(bench: Bench, dt_s: float, setting: Setting) -> None:
    """The finger slides on under the output as it is, which is refreshed and looked at."""
    bench.step(dt_s, setting.normal_force_n, setting.speed_m_s)
    bench.rig.hold(bench.time_s)
    if setting.driven and not setting.by_meter and bench.rig.state is not RigState.ON:
        why = "; ".join(event.reason for event in list(bench.rig.events)[-2:])
        raise HapticError(
            "output_lost",
            f"the output went off during {setting}: {why}",
            "Remove the cause, --resume",
        )


def _bring_up(experiment: Experiment, bench: Bench, setting: Setting, trace: Trace | None) -> None:
    """The finger slides, then the voltage rises at the rig's rate, one set point at a time, past
    the last gate.
    """
    output = experiment.config.output
    settings = drive.DriveSettings(output.voltage_rise_v_per_s)
    point, worst = experiment.points[setting]
    _, safe = safety.gate(experiment.limits, safety.INITIAL, point, worst)
    if safe.rejection is not None:
        raise HapticError(
            "refused",
            f"the safety gate refuses {setting}: {safe.rejection}",
            "Check the rig's limits",
        )
    rig: Rig = bench.rig
    if setting.by_meter or not setting.driven:
        return  # the amplifier stays off
    safe = safe._replace(voltage_v=setting.voltage_v)  # the point's is the peak
    state = drive.INITIAL
    while state.voltage_v < safe.voltage_v:
        bench.step(output.setpoint_interval_s, setting.normal_force_n, setting.speed_m_s)
        state, command = drive.drive(settings, state, safe, bench.time_s)
        rig.command(bench.time_s, command, setting.voltage_offset_v, Shape(setting.waveform))
        if trace:
            trace.look()


def _session_time_s(experiment: Experiment, data: DataFile, session: int) -> float:
    """Where the clock of a session stands: 0 at its start, past its last row when it is
    continued.
    """
    plan = experiment.plan
    if data.last_time_s is None or experiment.rows[data.done - 1].session != session:
        return 0.0
    return data.last_time_s + 0.5 * (plan.average_s - READING_S) + plan.pause_s


def _require_off(output: KnownOutput) -> KnownOutput:
    if output.on is not False:
        said = f"the output may still be on: {output}"
        raise HapticError("not_off", said, "Switch the amplifier off by hand")
    return output
