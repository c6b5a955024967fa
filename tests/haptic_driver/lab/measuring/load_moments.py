"""Something goes wrong at a random moment of `haptic measure` on a rig that presses a finger.

`failed` is in simulated time, with the drivers of a real rig; `killed` is a process that measures
on served instruments in real time, killed, whose watchdog outlives it. Both tell what the finger
felt at most, what it feels at the end, and whether the output is off.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from haptic_driver.errors import HapticError
from haptic_driver.lab.measuring.bench import SimulatedBench
from haptic_driver.lab.measuring.data_file import DataFile
from haptic_driver.lab.measuring.plan import Plan, Setting
from haptic_driver.lab.measuring.run import prepare, run
from haptic_driver.lab.measuring.simulated_stages import SimulatedStageBench
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.simulation import pressed_finger
from haptic_driver.simulation.served import ServedRig
from hw.errors import DeviceTimeout
from hw.force.sensor import ForceReading
from model.touch_model import TouchModel
from tests.haptic_driver.config_texts import changed, served_rig_text
from tests.haptic_driver.stand_ins import living_rig
from tests.hw.testing.faulty_stage import FaultyLts150
from tests.waiting import until

LIMIT_N = 3.0
FAILURES = ("pulled", "deaf", "silent", "frozen", "saturated", "thrust", "ctrl-c")
LASTS_S = 4.5  # of a row of simulated time, from when the stage is told to press
THRUST_M_S = 20e-3  # of a finger that presses by itself
THRUST_M = 1.5e-3
AFTER_S = 5.0  # the finger is looked at for so long after


COMMAND = "import sys; from haptic_driver.cli.main import main; sys.exit(main(sys.argv[1:]))"
CLEAR_MM = 11.5  # the skin is at 12
STAGES = f"""
[stage]
resource = "{{stage}}"
travel_m = [0.0, 0.07]
velocity_m_s = 0.05
acceleration_m_s2 = 0.05
velocity_limit_m_s = 0.05
acceleration_limit_m_s2 = 0.05
[load_stage]
kind = "lts150"
resource = "{{load_stage}}"
travel_m = [0.0, 0.15]
higher_presses = true
clear_m = {1e-3 * CLEAR_MM}
when_wrong = "retract"
"""


class Moment(NamedTuple):
    """What failed and when, the highest load and the last, N, and whether the output is off."""

    what: str
    time_s: float
    highest_n: float
    last_n: float
    is_off: bool
    said: str

    def __str__(self) -> str:
        off = "off" if self.is_off else "ON"
        loads = f"at most {self.highest_n:.2f} N, at the end {self.last_n:.2f} N, output {off}"
        return f"{self.what} at {self.time_s:.2f} s: {loads}; {self.said}"

    @property
    def safe(self) -> bool:
        return max(self.highest_n, self.last_n) < LIMIT_N and self.is_off


def one_row() -> Plan:
    """One row at 75 V, so that most of the time is under load."""
    row = Setting(250.0, 75.0, 0.5, 0.02)
    return Plan(
        name="moment",
        settings=(row,),
        randomise=False,
        repeats=1,
        sessions=1,
        voltage_off_every=0,
        settle_s=0.75,
        average_s=1.0,
        pause_s=0.5,
    )


def _near(config: RigConfig) -> RigConfig:
    """The finger half a millimetre away, and a stage that is quick: a moment is in a row."""
    assert config.stage is not None
    quick = {"velocity_m_s": 0.05, "acceleration_m_s2": 0.05}
    near = {"face_m": config.load_stage.clear_m + 0.5e-3}
    return config.model_copy(
        update={
            "stage": config.stage.model_copy(update=quick),
            "load_stage": config.load_stage.model_copy(update=near),
        }
    )


class _Failing:
    """A force sensor that fails in a way from a moment on."""

    def __init__(self, bench: SimulatedStageBench, what: str) -> None:
        self._bench, self._what = bench, what
        self._sensor = bench.world.simulated.force_sensor
        self._read = self._sensor.read
        self._last: ForceReading | None = None
        self._sensor.read = self.read  # type: ignore[method-assign]
        self.failing = self.failed = False

    def read(self) -> ForceReading:
        if not self.failing:
            self._last = self._read()
            return self._last
        if self._what == "ctrl-c":
            self.failing = False
            raise KeyboardInterrupt
        if self._what == "silent":
            raise DeviceTimeout("the sensor is silent", "")
        if self._what == "frozen" and self._last is not None:
            return self._last
        return self._read()._replace(saturated=self._what == "saturated")


def failed(model: TouchModel, out: Path, what: str, moment_s: float) -> Moment:
    """What happens when `what` goes wrong so long after the row has begun."""
    config = _near(load_rig("simulated-paper"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pressed_finger, "SimulatedLts150", FaultyLts150)
        bench = SimulatedStageBench(config, one_row(), SimulatedBench(config, model, seed=1))
    simulated = bench.world.simulated
    sensor, pressed = _Failing(bench, what), simulated.world.pressed
    assert pressed is not None
    pressing = pressed.stage
    assert isinstance(pressing, FaultyLts150)
    vary, loads, begun = simulated.varies, [0.0], list[float]()

    def lived(dt_s: float) -> None:
        if bench._load is not None and not begun:
            begun.append(simulated.time_s)
        ago_s = simulated.time_s - begun[0] - moment_s if begun else -1.0
        if ago_s >= 0.0 and not sensor.failed:
            sensor.failed = sensor.failing = True
        pressing.faults.hung_up = what == "pulled" and ago_s >= 0.0
        pressing.faults.silent = what == "deaf" and ago_s >= 0.0
        if what == "thrust" and 0.0 <= ago_s < THRUST_M / THRUST_M_S:
            pressed.thrust_m += THRUST_M_S * dt_s
        vary(dt_s)
        loads.append(simulated.world.load_n)

    simulated.varies = lived
    experiment = prepare(config, model, one_row())
    said = "measured"
    try:
        with bench, DataFile.create(out, experiment.identity(), force=True) as data:
            run(experiment, bench, data)
    except (HapticError, KeyboardInterrupt) as error:
        said = str(error) or type(error).__name__
    simulated.sleep(AFTER_S)
    is_off = simulated.amplifier.voltage_v == 0.0
    is_off &= not simulated.instruments.generator.output().on
    return Moment(what, moment_s, max(loads), loads[-1], is_off, said)


class Served:
    """A rig on its wires, and a process that measures on it."""

    def __init__(self, rig: ServedRig, folder: Path) -> None:
        self.rig, self._folder = rig, folder
        self.highest_n = 0.0
        assert rig.world.pressed is not None
        lives = rig.world.pressed.step

        def noted(dt_s: float, friction_n: float, attraction_n: float) -> float:
            now_n = lives(dt_s, friction_n, attraction_n)
            self.highest_n = max(self.highest_n, now_n)
            return now_n

        rig.world.pressed.step = noted  # type: ignore[method-assign]
        patient = ('kind = "box"', 'kind = "box"\nreply_timeout_s = 0.1')  # as long as it may
        text = changed(served_rig_text(rig.endpoints), patient) + STAGES.format(**rig.endpoints)
        (folder / "mine.toml").write_text(text)
        (folder / "one.toml").write_text(
            'name = "one"\nfrequency_hz = 250.0\nvoltage_v = 75.0\nnormal_force_n = 0.5\n'
            "speed_m_s = 0.02\nsettle_s = 0.75\naverage_s = 1.0\nrepeats = 3\n"
        )

    def killed(self, moment_s: float, sent: int = signal.SIGKILL) -> Moment:
        """A process that measures, killed so long after its load stage has begun to approach."""
        stage, self.highest_n = self.rig.load_stage, 0.0
        arguments = ["measure", "--rig", str(self._folder / "mine.toml"), "--yes", "--force"]
        arguments += ["--plan", str(self._folder / "one.toml")]
        arguments += ["--out", str(self._folder / "data.csv")]
        process = subprocess.Popen(
            [sys.executable, "-c", COMMAND, *arguments], stderr=subprocess.PIPE, text=True
        )
        with process:
            assert process.stderr is not None
            until(lambda: stage.position_mm > CLEAR_MM + 0.05 or process.poll() is not None)
            time.sleep(moment_s)
            ended = process.poll() is not None  # on a busy machine a rig may answer too late
            process.send_signal(sent)
            said = "had ended: " + process.stderr.read().strip() if ended else ""
        until(self._let_go, lambda: f"the stage is at {stage.position_mm} mm")
        last_n = self.rig.instruments.plant.normal_force_n
        is_off = self.rig.amplifier.voltage_v == 0.0 and not self.rig.generator.output().on
        return Moment("killed", moment_s, self.highest_n, last_n, is_off, said)

    def _let_go(self) -> bool:
        free = self.rig.instruments.plant.normal_force_n == 0.0
        moving = self.rig.load_stage.moving or self.rig.stage.moving  # the stroke may go on
        return free and not moving and not self.rig.generator.output().on


@contextmanager
def serving(config: RigConfig, model: TouchModel, folder: Path) -> Iterator[Served]:
    with living_rig(config, model) as rig:
        yield Served(rig, folder)


def moments(count: int, seed: int) -> list[tuple[str, float]]:
    """So many failures in turn, each at a random moment of a row."""
    chance = random.Random(seed)
    return [(FAILURES[i % len(FAILURES)], chance.uniform(0.0, LASTS_S)) for i in range(count)]
