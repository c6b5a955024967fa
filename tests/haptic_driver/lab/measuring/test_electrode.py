"""Plans with sweeps, biases, waveforms and times, run on a simulated rig whose finger is the
model's.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from haptic_driver.lab.measuring.bench import Scatter, SimulatedBench
from haptic_driver.lab.measuring.plan import Setting
from haptic_driver.lab.measuring.run import Experiment, prepare
from haptic_driver.rig.parts.electrode_monitors import E4980AConfig
from haptic_driver.rig.states import RigState
from hw.impedance.e4980a import E4980A, LcrMeter
from hw.monitor.contract import ElectrodeReading
from hw.serving.memory import MemoryTransport
from model.conditions import Conditions
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.measuring.test_plan import plan_of
from tests.haptic_driver.lab.measuring.test_run import measured as run_on
from tests.haptic_driver.lab.refusal import refused
from tests.hw.testing.simulated_lcr_meter import SimulatedE4980A

SWEEP = """
name = "witness"
settle_s = 0.1
average_s = 0.25
pause_s = 0.0
[[sweep]]
frequency_hz = [10.0, 100.0, 2e3, 3e4, 1e6]
finger = ["none", "resting", "sliding"]
"""
ONE = """
name = "one"
frequency_hz = 250.0
voltage_v = 75.0
normal_force_n = 0.5
speed_m_s = 0.02
"""
STRAY_F = 300e-12  # of the shipped rig's leads
STILL = Scatter(0.0, 0.02, area_wobble=0.0, session_area=0.0)


def measured(
    experiment: Experiment, out: Path, bench: SimulatedBench | None = None
) -> list[dict[str, str]]:
    """The rows, by a bench without scatter between sessions where none is given."""
    run_on(experiment, out, STILL, bench)
    return rows_of(out)


def test_a_sweep_reads_what_the_model_says_of_the_electrode(config, model, tmp_path):
    experiment = prepare(config, model, plan_of(tmp_path, SWEEP))
    bench = SimulatedBench(config, model, seed=1, scatter=STILL)
    rows = measured(experiment, tmp_path / "data.csv", bench)
    assert [row["finger"] for row in rows] == ["none"] * 5 + ["resting"] * 5 + ["sliding"] * 5
    assert bench.simulated.amplifier.max_voltage_v == pytest.approx(5.0, rel=1e-3)
    z = []
    for row in rows:
        f, v = float(row["frequency_hz"]), float(row["voltage_v"])
        finger, load_n = row["finger"], float(row["normal_force_n"])
        said = model.predict(
            Conditions(
                np.array([f]),
                np.array([v]),
                np.array([load_n or 0.5]),
                speed_m_s=np.array([float(row["speed_m_s"])]),
                finger=np.array([finger]),
            )
        )
        current = said.electrode_current_a[0] + 2j * np.pi * f * STRAY_F * v
        found = float(row["current_a"]) * np.exp(1j * float(row["current_phase_rad"]))
        z.append(abs(found - current) / float(row["current_std_a"]) / np.sqrt(2))
        assert abs(found - current) < 0.02 * abs(current) + 4 * float(row["current_std_a"])
        assert float(row["electrode_voltage_v"]) == pytest.approx(
            v, abs=1e-3 * v + 4 * float(row["electrode_voltage_std_v"])
        )
        assert row["cof"] == row["cof_std"] == ""
        assert float(row["measured_normal_force_n"]) == pytest.approx(load_n, abs=0.01)
    assert 0.3 < np.sqrt(np.mean(np.square(z))) < 2.0  # the stated error is the error


def test_a_bias_and_a_waveform_reach_the_electrode_and_the_data(config, model, tmp_path):
    blocks = (
        '[[points]]\nvoltage_offset_v = -40.0\n[[points]]\nwaveform = ["square", "dc"]\nvoltage_v ='
        " 8.0\n"
    )
    slowly = {
        "randomise": False,
        "settle_s": 0.4,
        "average_s": 0.25,
    }  # another function takes the generator 0.1 s
    plan = plan_of(
        tmp_path, ONE.replace("250.0", "20.0").replace("75.0", "30.0") + blocks
    ).model_copy(update=slowly)
    seen = []

    class Watched(SimulatedBench):
        def read_force(self):  # type: ignore[no-untyped-def]
            seen.append((self.simulated.instruments.stimulus(), self.simulated.amplifier.voltage_v))
            return super().read_force()

    experiment = prepare(config, model, plan)
    rows = measured(experiment, tmp_path / "data.csv", Watched(config, model, seed=1))
    there = {
        (round(f), round(v, 1), round(offset), wave, round(peak))
        for (f, v, offset, wave), peak in seen
    }
    assert there == {(20, 30.0, -40, "sine", 70), (20, 8.0, 0, "square", 8), (0, 8.0, 0, "dc", 8)}
    told = [(row["voltage_offset_v"], row["waveform"]) for row in rows]
    assert told == [("-40", "sine"), ("0", "square"), ("0", "dc")]
    assert float(rows[1]["electrode_voltage_v"]) == pytest.approx(8.0 * 4 / np.pi, rel=1e-2)


@pytest.mark.parametrize(
    ("limits", "points", "said"),
    [
        (
            {"direct_voltage_v": 0.0},
            "voltage_offset_v = 20.0",
            "exceeds limits.direct_voltage_v, 0 V",
        ),
        ({}, "voltage_offset_v = 100.0", "175 V is outside"),
        ({}, "voltage_v = 0.0\nvoltage_offset_v = 30.0", "a direct voltage alone"),
        ({}, 'waveform = "dc"\nvoltage_offset_v = 5.0', "no voltage_offset_v"),
        ({}, 'waveform = "square"', "harmonics take"),
    ],
)
def test_what_a_bias_or_a_waveform_may_not_do_is_refused(
    config, model, tmp_path, limits, points, said
):
    limited = config.model_copy(update={"limits": config.limits.model_copy(update=limits)})
    with refused("all_refused", "refuses every point", said):
        prepare(limited, model, plan_of(tmp_path, ONE + "[[points]]\n" + points))


def test_a_generator_that_makes_sines_only_is_asked_for_nothing_else(config, model, tmp_path):
    siglent = config.waveform_generator.model_copy(update={"model": "siglent_sdg"})
    text = (
        'name = "p"\nfrequency_hz = 10.0\nvoltage_v = 8.0\nnormal_force_n = 0.5\nspeed_m_s ='
        ' 0.02\nwaveform = "square"'
    )
    with refused("all_refused", "siglent_sdg, makes no waveform square"):
        prepare(
            config.model_copy(update={"waveform_generator": siglent}),
            model,
            plan_of(tmp_path, text),
        )


def test_a_sweep_asks_for_no_more_than_the_limits_allow(config, model, tmp_path):
    plan = plan_of(tmp_path, SWEEP.replace("finger", "voltage_v = 50.0\nfinger"))
    experiment = prepare(config, model, plan)
    assert experiment.refusals == ()
    voltages = {row.setting.frequency_hz: row.setting.voltage_v for row in experiment.rows}
    assert voltages[10.0] == 50.0
    for f, v in voltages.items():
        stuck_a = model.predict(
            Conditions(np.array([f]), np.array([v]), np.array([0.5]))
        ).stuck_current_rms_a[0]
        limit_a = np.exp(
            np.interp(np.log(f), *np.log(np.array(config.limits.contact_current_a_rms)).T)
        )
        assert (
            v == 50.0
            or 0.9
            < max(stuck_a / limit_a, 2 * np.pi * f * v / 370e6, 2e-9 * np.pi * f * v / 0.1)
            < 1.0
        )


def test_what_no_monitor_tells_is_refused(config, model, tmp_path):
    slow = config.model_copy(update={"electrode_monitors": config.electrode_monitors[:1]})
    experiment = prepare(slow, model, plan_of(tmp_path, SWEEP))
    assert {r.setting.frequency_hz for r in experiment.refusals} == {3e4, 1e6}
    assert "no monitor of this rig's file tells 30000 Hz" in experiment.refusals[0].reason
    blind = config.model_copy(update={"electrode_monitors": []})
    with refused("all_refused"):
        prepare(blind, model, plan_of(tmp_path, SWEEP))


def test_rows_with_a_time_are_measured_then(config, model, tmp_path):
    text = (
        'name = "clock"\nfrequency_hz = 250.0\nvoltage_v = 75.0\nnormal_force_n = 0.5\nspeed_m_s ='
        " 0.02\nsessions = 2\n"
    )
    plan = plan_of(tmp_path, text + "[[points]]\n[[points]]\ntime_s = [4.0, 30.0]\n")
    rows = measured(prepare(config, model, plan), tmp_path / "data.csv")
    times = [float(row["time_s"]) for row in rows]
    for session in (times[:3], times[3:]):
        assert session[1:] == pytest.approx(
            [4.0, 30.0], abs=0.1
        )  # the voltage rises at the beginning of a row


LCR = {"kind": "e4980a", "resource": "TCPIP::192.168.0.8::5025::SOCKET", "voltage_limit_v": 1.5}


def test_a_meter_that_drives_the_electrode_sweeps_in_a_plan_of_its_own(config, model, tmp_path):
    metered = config.model_copy(
        update={"electrode_monitors": [E4980AConfig(**LCR), *config.electrode_monitors]}
    )
    plan = plan_of(tmp_path, SWEEP.replace("[10.0, ", "["))
    experiment = prepare(metered, model, plan)
    assert all(row.setting.by_meter and row.setting.voltage_v <= 1.5 for row in experiment.rows)
    with refused("two_wirings", "by the amplifier"):
        prepare(metered, model, plan_of(tmp_path, SWEEP))  # the meter begins at 20 Hz
    assert metered.electrode_monitor(250.0) == 1  # friction is never read by it
    assert metered.electrode_monitor(250.0, sweep=True) == 0


class Metered(SimulatedBench):
    """A simulated rig whose electrode an LCR meter sweeps."""

    def read_electrode(self, setting: Setting) -> ElectrodeReading | None:
        assert self.rig.state is RigState.OFF
        assert self.simulated.instruments.voltage_v == 0.0
        return self.meter.read(setting.frequency_hz, setting.voltage_v)

    def __enter__(self) -> Metered:
        super().__enter__()
        self.lcr = SimulatedE4980A(lambda f: complex(1.0 / (1e-6 + 2j * np.pi * f * 300e-12)))
        self.meter = E4980A(MemoryTransport(self.lcr), LcrMeter(voltage_limit_v=1.5))
        self.meter.open()
        return self


class SlowlyRead(SimulatedBench):
    """Its monitor takes a second."""

    def read_electrode(self, setting: Setting) -> ElectrodeReading | None:
        self.simulated.instruments.time_s += 1.0
        return super().read_electrode(setting)


def test_a_monitor_that_is_slow_leaves_a_sweep_few_forces(config, model, tmp_path):
    experiment = prepare(config, model, plan_of(tmp_path, SWEEP))
    rows = measured(experiment, tmp_path / "data.csv", SlowlyRead(config, model, seed=1))
    assert len(rows) == 15
    assert all(row["current_a"] for row in rows)


def test_the_amplifier_stays_off_while_the_meter_sweeps(config, model, tmp_path):
    metered = config.model_copy(update={"electrode_monitors": [E4980AConfig(**LCR)]})
    plan = plan_of(tmp_path, SWEEP.replace("[10.0, ", "["))
    experiment = prepare(metered, model, plan)
    bench = Metered(config, model, seed=1)
    rows = measured(experiment, tmp_path / "data.csv", bench)
    assert bench.simulated.amplifier.max_voltage_v == 0.0
    assert bench.lcr.voltage_v == 0.0
    for row in rows:
        admittance = 1e-6 + 2j * np.pi * float(row["frequency_hz"]) * 300e-12
        found = float(row["current_a"]) / float(row["electrode_voltage_v"])
        assert found == pytest.approx(abs(admittance), rel=5e-3)
        assert float(row["current_phase_rad"]) == pytest.approx(np.angle(admittance), abs=5e-3)
