"""A plan run on a rig: every row through check, safety gate, rig and force sensor, and onto the disk."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np

from haptic_driver.config import RigConfig
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.experiments.average import Friction, friction
from haptic_driver.experiments.bench import Bench
from haptic_driver.experiments.check import Refusal, check
from haptic_driver.experiments.data_file import DataFile, Identity
from haptic_driver.experiments.plan import Plan, Row, Setting
from haptic_driver.limits import OperatingLimits
from haptic_driver.render import drive, safety
from haptic_driver.rig import OffEvidence, Rig, RigState
from haptic_driver.signals import OperatingPoint
from model.touch_model import TouchModel

READING_S = 0.005  # between force readings
SETTLING_STEP_S = 0.05  # while waiting nothing is read


@dataclass(frozen=True)
class Experiment:
    """A plan made ready for one rig: what is measured in which order, and what is not measured and why.

    `skipped` counts rows. `points` holds the operating point of every permitted setting.
    """

    plan: Plan
    config: RigConfig
    model: TouchModel
    seed: int
    rows: tuple[Row, ...]
    points: dict[Setting, OperatingPoint]
    refusals: tuple[Refusal, ...]
    limits: OperatingLimits

    @property
    def skipped(self) -> int:
        """Rows of the plan that are not measured."""
        return len(self.refusals) * self.plan.repeats * self.plan.sessions

    @property
    def duration_s(self) -> float:
        """How long all rows take, apart from bringing up the voltage."""
        return len(self.rows) * (self.plan.settle_s + self.plan.average_s + self.plan.pause_s)

    def identity(self, hidden: str = "") -> Identity:
        """What a data file must have been begun with to be continued; `hidden` is whatever else shapes the friction."""
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
            simulated=self.config.simulated,
        )


def prepare(config: RigConfig, model: TouchModel, plan: Plan, seed: int | None = None) -> Experiment:
    """Check every setting of `plan` against the rig's limits and fix the order; nothing is opened.

    Finger currents are those that `model` predicts. BadInputError when nothing is left to measure.
    """
    points, refusals = check([s for s in plan.settings if s.voltage_v > 0.0], config, model)
    without, _ = check(list({s.without_voltage(): None for s in plan.settings}), config, model)
    permitted = [s for s in plan.settings if s in points or s in without]
    if not permitted:
        raise BadInputError(
            "all_refused", f"plan {plan.name}: rig {config.name} refuses every point, first {refusals[0]}",
            "Choose other points, or another rig",
        )  # fmt: skip
    seed = plan.seed if seed is None else seed
    rows = tuple(plan.rows(permitted, seed))
    limits = config.operating_limits()
    return Experiment(plan, config, model, seed, rows, points | without, tuple(refusals), limits)


def run(
    experiment: Experiment, bench: Bench, data: DataFile, progress: Callable[[int], None] = lambda done: None
) -> OffEvidence:
    """Measure what `data` does not have yet, row by row; `progress` is called with the number of rows done.

    The output is off between rows and when this returns or raises, whatever happens; HapticError when it cannot be
    shown to be off.
    """
    rig = bench.rig
    session = 0
    try:
        rig.connect()
        for number, row in enumerate(experiment.rows[data.done :], start=data.done):
            if row.session != session:
                session = row.session
                bench.begin_session(session, _session_time_s(experiment, data, session))
            bench.begin_row(number)
            measured, time_s = measure_row(experiment, bench, row)
            data.append(row, measured, time_s)
            progress(data.done)
    finally:
        evidence = rig.off()
    return _require_off(evidence)


def measure_row(experiment: Experiment, bench: Bench, row: Row) -> tuple[Friction, float]:
    """Friction of one row and the time at the middle of its window; the finger is lifted and the output off after."""
    plan, setting = experiment.plan, row.setting
    count = round(plan.average_s / READING_S)
    try:
        _bring_up(experiment, bench, setting)
        steps = ceil(plan.settle_s / SETTLING_STEP_S)
        for _ in range(steps):
            _slide(bench, plan.settle_s / steps, setting)
        window = np.empty((count, 3))
        for i in range(count):
            _slide(bench, READING_S, setting)
            reading = bench.rig.read_force()
            if reading.saturated:
                raise HapticError("saturated", f"the force sensor is at the end of its range ({reading})", "Lower load")
            window[i] = reading.time_s, reading.lateral_force_n, reading.normal_force_n
    finally:
        evidence = bench.rig.off()
    _require_off(evidence)
    bench.step(plan.pause_s, 0.0, 0.0)
    measured = friction(window[:, 1], window[:, 2])
    if not measured.valid:
        raise HapticError(
            "no_friction", f"{row}: measured {measured}", "Check the force sensor and that the finger slides"
        )
    return measured, float(np.mean(window[:, 0]))


def _slide(bench: Bench, dt_s: float, setting: Setting) -> None:
    """The finger slides on under the output as it is, which is refreshed and looked at."""
    bench.step(dt_s, setting.normal_force_n, setting.speed_m_s)
    bench.rig.hold(bench.time_s)
    if setting.voltage_v > 0.0 and bench.rig.state is not RigState.ON:
        why = "; ".join(event.reason for event in list(bench.rig.events)[-2:])
        raise HapticError("output_lost", f"the output went off during {setting}: {why}", "Remove the cause, --resume")


def _bring_up(experiment: Experiment, bench: Bench, setting: Setting) -> None:
    """The finger slides, then the voltage rises at the rig's rate, one set point at a time, past the last gate."""
    output = experiment.config.output
    settings = drive.DriveSettings(output.voltage_rise_v_per_s)
    _, safe = safety.gate(experiment.limits, safety.INITIAL, experiment.points[setting])
    if safe.rejection is not None:
        raise HapticError("refused", f"the safety gate refuses {setting}: {safe.rejection}", "Check the rig's limits")
    rig: Rig = bench.rig
    state = drive.INITIAL
    while state.voltage_v < safe.voltage_v:
        bench.step(output.setpoint_interval_s, setting.normal_force_n, setting.speed_m_s)
        state, command = drive.drive(settings, state, safe, bench.time_s)
        rig.command(bench.time_s, command)


def _session_time_s(experiment: Experiment, data: DataFile, session: int) -> float:
    """Where the clock of a session stands: 0 at its start, past its last row when it is continued."""
    plan = experiment.plan
    if data.last_time_s is None or experiment.rows[data.done - 1].session != session:
        return 0.0
    return data.last_time_s + 0.5 * (plan.average_s - READING_S) + plan.pause_s


def _require_off(evidence: OffEvidence) -> OffEvidence:
    if evidence.output_on is not False:
        raise HapticError("not_off", f"the output may still be on: {evidence}", "Switch the amplifier off by hand")
    return evidence
