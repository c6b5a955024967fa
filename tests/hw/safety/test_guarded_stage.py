"""The watchdog and a load stage: a driver killed while it presses, for real."""

from __future__ import annotations

import subprocess
import sys
import time
from math import inf

import pytest

import hw.safety.watchdog
from hw.errors import DeviceDisconnected
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.safety.guarded_stage import GuardedStage
from hw.safety.watchdog import Watchdog, WatchdogSettings
from hw.serving.serial import SerialServer
from hw.serving.tcp import TcpServer
from hw.stage.letting_go import Mounting
from hw.stage.lts150 import Lts150, StageSettings
from hw.transport.resource import make_transport
from tests import systemd
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument
from tests.hw.testing.faulty_stage import FaultyLts150
from tests.waiting import HANG_S, exists, until

pytestmark = [pytest.mark.timeout(2 * HANG_S), pytest.mark.realtime]

SETTINGS = StageSettings(0.0, 0.15, 0.05, 0.05, 0.05, 0.05)
PRESSED_MM = 6.0
CLEAR_MM = 4.0
DRIVER = """
import sys, time
from hw.safety.guarded_stage import GuardedStage
from hw.safety.watchdog import Watchdog, WatchdogSettings
from hw.stage.lts150 import Lts150
from hw.transport.resource import make_transport
guarded = GuardedStage.from_text(sys.argv[1])
generator = sys.argv[2] or None
dog = Watchdog(WatchdogSettings(generator, load_stage=guarded))
dog.start()
stage = Lts150(make_transport(guarded.resource, rtscts=True), guarded.settings)
stage.connect()
dog.press()
if sys.argv[3] == "lifted":
    dog.lifted()
print("pressing", dog.pid, flush=True)
if generator:
    dog.beat()
while True:
    if generator:
        dog.beat()
    time.sleep(0.02)
"""


class Bench:
    """A homed stage that presses, and a generator that is on."""

    def __init__(self) -> None:
        self.stage = FaultyLts150(time.monotonic, start_mm=0.0)
        self.generator = Simulated33220A(IMMEDIATE)
        self.generator.handle(b"OUTP ON\n")
        self.faults = FaultyInstrument(self.generator)
        self._servers = SerialServer(self.stage, framed=False), TcpServer(self.faults)

    def __enter__(self) -> Bench:
        for server in self._servers:
            server.start()
        driver = Lts150(make_transport(self.resource, rtscts=True), SETTINGS)
        driver.connect()
        driver.home()
        driver.wait(10.0)
        driver.move_to(1e-3 * PRESSED_MM)
        driver.wait(10.0)
        driver.close()
        return self

    def __exit__(self, *_: object) -> None:
        for server in self._servers:
            server.close()

    @property
    def resource(self) -> str:
        return self._servers[0].resource

    def guarded(self, retracts: bool = True) -> GuardedStage:
        return GuardedStage(self.resource, SETTINGS, Mounting(1, 1e-3 * CLEAR_MM), retracts)

    def killed(
        self, guarded: GuardedStage, *, generator: bool, said: str = "pressed", silent: bool = False
    ) -> int:
        """Start a driver that presses, and kill it; the process id of its watchdog, which outlives
        it. `silent`: so are then its instruments.
        """
        resource = self._servers[1].resource if generator else ""
        driver = subprocess.Popen(
            [sys.executable, "-c", DRIVER, guarded.as_text(), resource, said],
            stdout=subprocess.PIPE,
            text=True,
        )
        with driver:
            assert driver.stdout is not None
            word, pid = driver.stdout.readline().split()
            assert word == "pressing"
            if silent:
                self.stage.faults.silent = True
                self.faults.inject(Fault.HANG, count=inf)
            driver.kill()
        return int(pid)


@pytest.fixture
def bench():
    with Bench() as found:
        yield found


@pytest.mark.parametrize("generator", [True, False])
def test_a_killed_driver_leaves_a_finger_that_is_free_and_an_output_that_is_off(bench, generator):
    bench.killed(bench.guarded(), generator=generator)
    until(lambda: bench.stage.position_mm <= CLEAR_MM + 1e-3 and not bench.stage.moving)
    if generator:
        until(lambda: not bench.generator.output().on)


def test_a_stage_that_is_safer_at_rest_is_stopped(bench):
    """In the middle of a slow move, as the driver's last would be."""
    guarded = bench.guarded(retracts=False)
    driver = Lts150(make_transport(bench.resource, rtscts=True), SETTINGS)
    driver.connect()
    driver.set_velocity(1e-3, 0.05)
    driver.move_to(0.1)
    make_free(driver)
    bench.killed(guarded, generator=False)
    until(lambda: not bench.stage.moving)
    assert PRESSED_MM < bench.stage.position_mm < 90.0


def test_one_that_had_let_go_is_left_where_it_is(bench):
    bench.killed(bench.guarded(), generator=True, said="lifted")
    until(lambda: not bench.generator.output().on)
    assert bench.stage.position_mm == PRESSED_MM
    assert not bench.stage.moving


def test_a_stage_that_answers_late_is_tried_again_beside_a_generator_that_is_silent(bench):
    """It was tried again when the watchdog had given up the generator, after a minute."""
    bench.killed(bench.guarded(), generator=True, silent=True)
    time.sleep(1.5)
    bench.stage.faults.silent = False
    until(lambda: bench.stage.position_mm <= CLEAR_MM + 1e-3)
    assert bench.generator.output().on


@pytest.mark.parametrize("hung", [False, True])
def test_the_service_manager_leaves_the_watchdog_its_time(bench, hung):
    """With the unit once shipped systemd killed it 3 ms after its driver: 128 V for 24 s, and a
    finger that was pressed for longer.
    """
    watchdog = bench.killed(bench.guarded(), generator=True, silent=True)
    systemd.send_when_main_is_dead([watchdog], hung=hung)
    time.sleep(0.5)
    assert bench.generator.output().on
    bench.faults.heal()
    bench.stage.faults.silent = False
    until(lambda: not bench.generator.output().on)
    until(lambda: bench.stage.position_mm <= CLEAR_MM + 1e-3)
    until(lambda: not exists(watchdog))


def test_a_stage_that_is_not_there_is_refused_at_the_start():
    guarded = GuardedStage("/dev/nothing-here", SETTINGS, Mounting(1, 0.0), True)
    watchdog = Watchdog(WatchdogSettings(None, load_stage=guarded))
    with pytest.raises(DeviceDisconnected, match="does not answer"):
        watchdog.start()
    with pytest.raises(DeviceDisconnected, match="nothing would lift the finger"):
        watchdog.press()


def test_text_that_is_no_stage_is_refused():
    with pytest.raises(ValueError, match="load stage"):
        GuardedStage.from_text('{"resource": "/dev/tty"}')


def make_free(driver: Lts150) -> None:
    """Hang up without stopping the move."""
    driver._transport.close()


def test_its_process_is_told_the_stage():
    guarded = GuardedStage("/dev/ttyS0", SETTINGS, Mounting(-1, 0.12, 4e-3), True)
    for generator in (None, "TCPIP::127.0.0.1::5025::SOCKET"):
        settings = WatchdogSettings(generator, load_stage=guarded)
        assert hw.safety.watchdog._parse(settings.arguments()) == settings
