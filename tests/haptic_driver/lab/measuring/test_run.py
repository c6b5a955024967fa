"""Plans run on a simulated rig: data, limits, interruptions, hidden effects."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab.measuring.bench import Scatter, SimulatedBench
from haptic_driver.lab.measuring.data_file import COLUMNS, DataFile, meta_path
from haptic_driver.lab.measuring.plan import Plan, Row, Setting, load_plan
from haptic_driver.lab.measuring.run import ATTEMPTS, READING_S, Experiment, prepare, run
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.states import RigState
from haptic_driver.simulation.finger_model import with_hidden
from hw.force.sensor import ForceReading
from model.diagnosis.data import read_measurements
from model.effects import BY_NAME
from model.touch_model import TouchModel
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.refusal import refused

SAME_FINGER = Scatter(session_gain=0.0)
HIDDEN = {"series_resistance": {"resistance_ohm": 3e6}}


def small_plan(**changes: Any) -> Plan:
    """Eight settings, two of them beyond the shipped rig's limits; rows are short, simulated time
    costs time.
    """
    plan = load_plan("paper")
    frequencies = {100.0, 250.0, 10e3, 1e6}
    settings = [s for s in plan.settings if s.frequency_hz in frequencies]
    settings += [s._replace(normal_force_n=1.0, speed_m_s=0.05) for s in settings]
    small = {"settings": tuple(settings), "repeats": 2, "sessions": 2, "voltage_off_every": 3}
    small |= {"settle_s": 0.2, "average_s": 0.5}
    return plan.model_copy(update=small | changes)


def grid(**changes: Any) -> Plan:
    """Every frequency and voltage of a plan once in a session, in short rows."""
    short = {"repeats": 1, "settle_s": 0.2, "average_s": 0.5}
    return load_plan("voltage_frequency").model_copy(update=short | changes)


def hiding(config: RigConfig, hide: dict[str, dict[str, float]]) -> RigConfig:
    return config.model_copy(
        update={"simulation": config.simulation.model_copy(update={"hide": hide})}
    )


def measured(
    experiment: Experiment,
    out: Path,
    scatter: Scatter | None = None,
    bench: SimulatedBench | None = None,
    tell: Callable[[str], None] = lambda what: None,
) -> SimulatedBench:
    """The bench on which it was measured: a simulated one where none is given."""
    bench = bench or SimulatedBench(
        experiment.config, experiment.model, seed=experiment.seed, scatter=scatter
    )
    with DataFile.create(out, experiment.identity()) as data, bench:
        run(experiment, bench, data, tell=tell)
    return bench


def failed(experiment: Experiment, bench: SimulatedBench, out: Path, code: str) -> DataFile:
    """The file of a measurement that ends with that error, and with the output off."""
    kept = DataFile.create(out, experiment.identity())
    with kept as data, bench, refused(code, kind=HapticError):
        run(experiment, bench, data)
    assert bench.simulated.amplifier.voltage_v == 0.0
    return data


def residuals(path: Path, model: TouchModel) -> np.ndarray:
    data = read_measurements(path)
    c = data.columns
    return np.asarray((c["cof"] - model.predict(data.conditions()).cof) / c["cof_std"])


def settings_of(path: Path) -> list[tuple[str, ...]]:
    return [
        tuple(row[c] for c in ("frequency_hz", "voltage_v", "normal_force_n", "session", "trial"))
        for row in rows_of(path)
    ]


def test_waiting_until_it_is_time_counts_as_measuring(config, model):
    """In each of two sessions; it counted only the rows."""
    settings = tuple(Setting(100.0, 75.0, 0.5, 0.02, time_s=time_s) for time_s in (5.0, 300.0))
    experiment = prepare(config, model, Plan(name="late", settings=settings, repeats=2, sessions=2))
    after_the_second_s = (
        0.5 * experiment.plan.average_s + experiment.plan.pause_s + experiment.plan.row_s
    )
    assert experiment.duration_s == pytest.approx(2 * (300.0 + after_the_second_s))


def test_data_have_the_contracts_columns_and_units(config, model, tmp_path):
    experiment = prepare(config, model, small_plan())
    measured(experiment, tmp_path / "data.csv")
    rows = rows_of(tmp_path / "data.csv")
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == len(experiment.rows) == 2 * (8 + 3)
    for row, expected in zip(rows, experiment.rows, strict=True):
        assert tuple(float(row[c]) for c in expected.setting._fields[:5]) == expected.setting[:5]
        assert (row["waveform"], row["finger"]) == ("sine", "sliding")
        assert (int(row["session"]), int(row["trial"]), row["simulated"]) == (
            expected.session,
            expected.trial,
            "true",
        )
        assert 0.4 < float(row["cof"]) < 0.8
        assert 0.003 < float(row["cof_std"]) / float(row["cof"]) < 0.04
    for session in ("1", "2"):
        times = np.array([float(row["time_s"]) for row in rows if row["session"] == session])
        assert times[0] < 2.0  # the clock starts with the session
        np.testing.assert_allclose(
            np.diff(times), experiment.duration_s / len(rows), atol=0.02
        )  # and the voltage rises
    assert [row["session"] for row in rows] == ["1"] * 11 + ["2"] * 11


def test_friction_agrees_with_the_model_within_its_stated_error(config, model, tmp_path):
    measured(prepare(config, model, grid(sessions=1)), tmp_path / "data.csv", SAME_FINGER)
    z = residuals(tmp_path / "data.csv", model)
    assert 0.6 < np.mean(z**2) < 1.6
    assert abs(np.mean(z)) < 4.0 / np.sqrt(z.size)
    c = read_measurements(tmp_path / "data.csv").columns
    assert 0.01 < np.median(c["cof_std"] / c["cof"]) < 0.03


def test_refused_points_are_reported_with_reasons_and_never_energised(config, model, tmp_path):
    limits = config.limits.model_copy(update={"voltage_v": 80.0})
    config = config.model_copy(update={"limits": limits})
    plan = small_plan()
    beyond = tuple(plan.settings[0]._replace(voltage_v=v, frequency_hz=60.0) for v in (120.0, 0.5))
    plan = plan.model_copy(update={"settings": plan.settings + beyond})
    experiment = prepare(config, model, plan)
    reasons = {(r.setting.frequency_hz, r.setting.voltage_v): r.reason for r in experiment.refusals}
    assert len(experiment.refusals) == 6
    assert experiment.skipped == 6 * 2 * 2
    assert "worst-case finger current" in reasons[10e3, 75.0]
    assert "slew" in reasons[1e6, 75.0]
    assert "80 V peak" in reasons[60.0, 120.0]
    assert "generator can make" in reasons[60.0, 0.5]
    bench = measured(experiment, tmp_path / "data.csv")
    assert bench.simulated.amplifier.max_voltage_v == pytest.approx(75.0, rel=1e-3)
    assert {row["frequency_hz"] for row in rows_of(tmp_path / "data.csv")} == {"0", "100", "250"}


def test_the_output_is_on_for_rows_with_voltage_only_and_held_through_each(config, model, tmp_path):
    """Settling and averaging take longer than the lease; each step refreshes it, on the clock that
    commands.
    """
    plan = small_plan(sessions=1, repeats=1, settle_s=1.0, average_s=0.5)
    experiment = prepare(config, model, plan)
    bench = SimulatedBench(config, model, seed=1)
    between: list[float] = []

    def note(done: int) -> None:
        between.append(bench.simulated.instruments.voltage_v)

    with DataFile.create(tmp_path / "data.csv", experiment.identity()) as data, bench:
        assert run(experiment, bench, data, note).on is False
    assert between == [0.0] * len(experiment.rows)
    driven = sum(row.setting.voltage_v > 0.0 for row in experiment.rows)
    # and the ramp up
    assert bench.simulated.amplifier.output_on_s == pytest.approx(driven * 1.5, abs=0.2)
    assert "not refreshed" not in {event.reason[:13] for event in bench.rig.events}


class Stop(BaseException):
    """Stands for whatever ends a program."""


def test_a_killed_measurement_resumes_to_the_same_rows(config, model, tmp_path):
    experiment = prepare(config, model, small_plan())
    whole, killed = tmp_path / "whole.csv", tmp_path / "killed.csv"
    measured(experiment, whole)
    bench = SimulatedBench(config, model, seed=experiment.seed)

    def stop(done: int) -> None:
        if done == 7:
            raise Stop

    with pytest.raises(Stop), DataFile.create(killed, experiment.identity()) as data, bench:
        run(experiment, bench, data, stop)
    assert bench.simulated.instruments.voltage_v == 0.0
    with killed.open("a") as file:
        file.write("100,75,0.5,0.6")  # of a row that was being written
    with DataFile.resume(killed, experiment.identity(), experiment.rows) as data:
        assert data.done == 7
        with SimulatedBench(config, model, seed=experiment.seed, first_row=data.done) as rest:
            run(experiment, rest, data)
    assert settings_of(killed) == settings_of(whole)
    assert [row["time_s"] for row in rows_of(killed)] == [row["time_s"] for row in rows_of(whole)]
    cofs = [[float(row["cof"]) for row in rows_of(path)] for path in (killed, whole)]
    ratio = np.divide(*cofs)
    np.testing.assert_allclose(ratio, 1.0, atol=0.01)  # the same finger; the sensor's noise is new
    assert not np.all(ratio[7:] == 1.0)


def test_a_saturated_sensor_stops_the_measurement(config, model, tmp_path):
    simulation = config.simulation.model_copy(update={"force_range_n": 0.4})
    experiment = prepare(config.model_copy(update={"simulation": simulation}), model, small_plan())
    with pytest.raises(HapticError, match="end of its range"):
        measured(experiment, tmp_path / "data.csv")


def test_resume_refuses_another_plan_seed_rig_or_model(config, model, tmp_path):
    out = tmp_path / "data.csv"
    experiment = prepare(config, model, small_plan())
    DataFile.create(out, experiment.identity()).__exit__(None, None, None)
    output = config.output.model_copy(update={"setpoint_interval_s": 0.02})
    others = {
        "plan": prepare(config, model, small_plan(pause_s=9.0)),
        "seed": prepare(config, model, small_plan(), seed=5),
        "rig": prepare(config.model_copy(update={"output": output}), model, small_plan()),
        "model": prepare(
            config,
            with_hidden(model, {"velocity_dependent_friction": {"exponent": 0.1}}),
            small_plan(),
        ),
    }
    hidden = prepare(hiding(config, HIDDEN), model, small_plan())
    identities = [(what, other.identity(), other.rows) for what, other in others.items()]
    identities.append(("another rig", hidden.identity(), hidden.rows))
    finger = experiment.identity("def friction(): ...")
    for what, *other in [*identities, ("another rig", finger, experiment.rows)]:
        with pytest.raises(BadInputError, match=what):
            DataFile.resume(out, *other)


def test_resume_refuses_a_file_that_is_not_the_plans(config, model, tmp_path):
    out = tmp_path / "data.csv"
    experiment = prepare(config, model, small_plan())
    measured(experiment, out)
    text = out.read_text().splitlines(keepends=True)
    for lines, said in (
        ([*text[:3], text[4], *text[4:]], "line 4"),
        ([*text, text[-1]], "23 rows"),
        ([",".join(COLUMNS[:-2]) + "\n"], "has columns"),
        (None, "did not write it"),
    ):
        if lines is None:
            meta_path(out).unlink()
        else:
            out.write_text("".join(lines))
        with pytest.raises(BadInputError, match=said):
            DataFile.resume(out, experiment.identity(), experiment.rows)


def test_a_file_is_never_overwritten_unasked(config, model, tmp_path):
    out = tmp_path / "data.csv"
    out.write_text("precious\n")
    experiment = prepare(config, model, small_plan())
    with pytest.raises(BadInputError, match="exists already"):
        DataFile.create(out, experiment.identity())
    assert out.read_text() == "precious\n"
    with DataFile.create(out, experiment.identity(), force=True):
        assert out.read_text() == ",".join(COLUMNS) + "\n"
    with pytest.raises(HapticError, match="cannot be written"):
        DataFile.create(out / "data.csv", experiment.identity())
    with DataFile.create(tmp_path / "made" / "data.csv", experiment.identity()) as data:
        assert data.done == 0
    with pytest.raises(BadInputError, match="is a folder"):
        DataFile.create(tmp_path, experiment.identity(), force=True)


@pytest.mark.soak
def test_a_hidden_effect_changes_the_data_and_leaves_no_trace_in_the_files(config, model, tmp_path):
    secret = hiding(config, HIDDEN)
    plain, hidden = prepare(config, model, small_plan()), prepare(secret, model, small_plan())
    assert plain.points == hidden.points  # the check knows the nominal model only
    measured(plain, tmp_path / "plain.csv", SAME_FINGER)
    measured(hidden, tmp_path / "hidden.csv", SAME_FINGER)
    assert np.mean(residuals(tmp_path / "plain.csv", model) ** 2) < 1.6
    assert np.mean(residuals(tmp_path / "hidden.csv", model) ** 2) > 3.0
    assert np.mean(residuals(tmp_path / "hidden.csv", with_hidden(model, HIDDEN)) ** 2) < 1.6
    metas = [
        json.loads(meta_path(tmp_path / f"{name}.csv").read_text()) for name in ("plain", "hidden")
    ]
    differ = {key for key in metas[0] if metas[0][key] != metas[1][key]}
    assert metas[0].keys() == metas[1].keys()
    assert differ == {"salt", "rig_hash"}  # as they do between any two files
    for path in tmp_path.iterdir():
        for word in ("series", "resist", "ohm", "hid"):
            assert word not in path.read_text().lower().replace("hidden.csv", "")
    again = tmp_path / "again.csv"
    measured(plain, again, SAME_FINGER)
    assert json.loads(meta_path(again).read_text())["rig_hash"] != metas[0]["rig_hash"]
    assert again.read_text() == (tmp_path / "plain.csv").read_text()


def test_speed_and_time_reach_the_hidden_effects(config, model, tmp_path):
    hide = {
        "velocity_dependent_friction": {"exponent": 0.3},
        "contact_ageing": {"share": 0.3, "time_constant_s": 20.0},
    }
    experiment = prepare(hiding(config, hide), model, small_plan())
    measured(experiment, tmp_path / "data.csv", SAME_FINGER)
    assert np.mean(residuals(tmp_path / "data.csv", model) ** 2) > 10.0
    assert np.mean(residuals(tmp_path / "data.csv", with_hidden(model, hide)) ** 2) < 1.6


@pytest.mark.parametrize(
    ("hide", "said", "hint"),
    [
        ({"series_resistanse": {}}, "no effect 'series_resistanse'", "series_resistance"),
        ({"series_resistance": {"resistance": 1.0}}, "no parameter 'resistance'", "resistance_ohm"),
        ({"series_resistance": {}}, "resistance_ohm is missing", "ohm"),
        ({"series_resistance": {"resistance_ohm": -1.0}}, "is -1.0", "ohm"),
    ],
)
def test_what_cannot_be_hidden_is_named(config, model, hide, said, hint):
    with refused("bad_hide", said, hint=hint):
        SimulatedBench(hiding(config, hide), model, seed=1)


class Straying(SimulatedBench):
    """The finger presses with another load than it should in the first `missed` rows that are
    begun.
    """

    missed = 0
    begun = 0

    def begin_row(self, number: int, row: Row) -> None:
        super().begin_row(number, row)
        self.begun += 1

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        super().step(dt_s, normal_force_n * (0.7 if self.begun <= self.missed else 1.0), speed_m_s)


def test_a_row_whose_load_was_missed_is_measured_again(config, model, tmp_path):
    experiment = prepare(config, model, small_plan(sessions=1, repeats=1))
    bench, told = Straying(config, model, seed=1), list[str]()
    bench.missed = ATTEMPTS - 1
    measured(experiment, tmp_path / "data.csv", bench=bench, tell=told.append)
    wanted = experiment.rows[0].setting.normal_force_n
    assert told == [f"row 1: the load was {0.7 * wanted:.3g} N, not {wanted:g} N; once more"] * (
        ATTEMPTS - 1
    )
    for row in rows_of(tmp_path / "data.csv"):
        assert float(row["measured_normal_force_n"]) == pytest.approx(
            float(row["normal_force_n"]), rel=0.01
        )
    assert bench.begun == len(experiment.rows) + ATTEMPTS - 1


def test_a_load_missed_again_and_again_is_no_row(config, model, tmp_path):
    experiment = prepare(config, model, small_plan())
    bench = Straying(config, model, seed=1)
    bench.missed = 1000
    data = failed(experiment, bench, tmp_path / "data.csv", "load_missed")
    assert (data.done, bench.begun) == (0, ATTEMPTS)


def test_a_sensor_too_slow_for_the_window_is_named(config, model, tmp_path):
    class Slow(SimulatedBench):
        def read_force(self) -> ForceReading:
            self.simulated.instruments.time_s += 0.1
            return super().read_force()

    experiment = prepare(config, model, small_plan())
    bench = Slow(config, model, seed=1)
    assert failed(experiment, bench, tmp_path / "data.csv", "too_few_readings").done == 0


class Dozing(SimulatedBench):
    """The computer stands still once, for longer than the lease, while the output is on."""

    dozed = False

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        super().step(dt_s, normal_force_n, speed_m_s)
        if self.rig.state is RigState.ON and not self.dozed:
            self.dozed = True
            self.simulated.instruments.time_s += 1.0


def test_a_row_whose_output_went_off_once_is_measured_again(config, model, tmp_path):
    experiment = prepare(config, model, small_plan(sessions=1, repeats=1))
    told: list[str] = []
    bench = Dozing(config, model, seed=1)
    measured(experiment, tmp_path / "data.csv", bench=bench, tell=told.append)
    assert len(rows_of(tmp_path / "data.csv")) == len(experiment.rows)
    [said] = told
    assert re.fullmatch("row 2: the output went off.* not refreshed.*; once more", said)


class Jumping(SimulatedBench):
    """Settles in steps longer than the lease: nobody refreshes the output meanwhile."""

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        super().step(dt_s, normal_force_n, speed_m_s)
        self.simulated.instruments.time_s += 1.0 if dt_s > READING_S else 0.0


def test_a_row_whose_output_was_lost_is_not_a_row(config, model, tmp_path):
    experiment = prepare(config, model, small_plan())
    bench = Jumping(config, model, seed=1)
    failed(experiment, bench, tmp_path / "stalled.csv", "output_lost")
    assert all(float(row["voltage_v"]) == 0.0 for row in rows_of(tmp_path / "stalled.csv"))


def test_a_hidden_effect_need_not_say_what_is_usual(model):
    """A slew limit is a hard one where its sharpness is not given."""
    hidden = with_hidden(model, {"amplifier_slew_limit": {"slew_rate_v_per_s": 1e6}})
    (limit,) = hidden.description.effects
    assert limit == BY_NAME["amplifier_slew_limit"](slew_rate_v_per_s=1e6)
