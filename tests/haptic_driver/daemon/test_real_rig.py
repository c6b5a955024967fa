"""The daemon on a rig's file that names real resources: its own drivers, on instruments served over
their own wires.
"""

import math
import os
import signal
from contextlib import suppress

import pytest

from haptic_driver.daemon import supervision
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.instruments import connect
from haptic_driver.daemon.messages import DaemonState, RefusedError
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.errors import BadInputError
from haptic_driver.rig.parts.finger_trackers import NoFingerTracker
from haptic_driver.rig.parts.generators import WatchdogConfig
from haptic_driver.simulation.twin import LOAD_STAGE
from hw.serving.tcp import TcpServer
from tests.haptic_driver.daemon.refusal import refusal
from tests.haptic_driver.daemon.test_load import press
from tests.haptic_driver.daemon.waiting import LEASE_S, reset
from tests.haptic_driver.stand_ins import living_rig, with_load_stage
from tests.hw.testing.faulty_net_ft import FaultyNetFt, RdtFault
from tests.waiting import until

pytestmark = pytest.mark.process

CLEAR_M = LOAD_STAGE.face_m - 0.5e-3
RESTING = 1.0  # well above what a finger that has not slid yet is trusted to feel


@pytest.fixture(scope="module")
def served(rig_config, touch):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("haptic_driver.simulation.instruments.NetFtServer", FaultyNetFt)
        with living_rig(rig_config, touch) as rig:
            yield rig


@pytest.fixture(scope="module")
def real_config(rig_config, served):
    return served.config


@pytest.fixture(scope="module")
def settings(served, surface_file):
    """With a load stage near the finger."""
    config = with_load_stage(served.config, served.endpoints)
    near = config.load_stage.model_copy(update={"clear_m": CLEAR_M})
    config = config.model_copy(update={"load_stage": near})
    render = render_settings(config, surface_file)
    return DaemonSettings("served", "reference", config, surface_file, render, allow_no_rt=True)


@pytest.fixture(scope="module")
def running(settings, served):
    """In the end it is closed while it renders and presses: it knows that the output is off, and
    has lifted the finger.
    """
    daemon = Daemon(settings)
    daemon.start()
    # the finger's place is known from here on, and it presses
    daemon.supervisor.instruments.devices.stage.home()
    until(lambda: daemon.shared.sensed.read().touching)
    yield daemon
    press(daemon)
    assert served.load_stage.position_mm > 1e3 * LOAD_STAGE.face_m
    assert daemon.close().on is False
    assert served.load_stage.position_mm == pytest.approx(1e3 * CLEAR_M, abs=0.01)
    assert not served.load_stage.moving
    assert served.amplifier.voltage_v == 0.0
    assert not served.generator.output().on
    served.instruments.generator_server.close()  # a test has put another there


# --- what a file may say or leave out; before the daemon, as the instruments take one driver each
# ----------------


def test_a_rig_whose_finger_nobody_tracks_is_refused(real_config):
    with pytest.raises(BadInputError) as refused:
        connect(
            real_config.model_copy(update={"finger_tracker": NoFingerTracker()}), lambda event: None
        )
    assert refused.value.code == "no_finger_tracker"


def test_a_rig_may_say_that_it_has_no_watchdog(real_config):
    config = real_config.model_copy(update={"watchdog": WatchdogConfig(generator="none")})
    assert config.unverified == []
    instruments = connect(config, lambda event: None)
    try:
        assert instruments.watchdog_pid is None
        instruments.check_watchdog()
        instruments.restart_watchdog()
        assert instruments.actuator.name == "setpoints over SCPI"
    finally:
        assert instruments.close().on is False


# --- the daemon
# --------------------------------------------------------------------------------------------------


def test_a_target_reaches_the_electrode_and_off_takes_it_away(daemon, served):
    status = daemon.status()
    assert (status.state, status.simulated, status.output_on) == (DaemonState.IDLE, True, False)
    assert set(daemon.pids) == {"render", "watchdog", "loader", "observer"}
    render(daemon, served)
    assert served.interlock.closed
    status = daemon.status()
    assert (status.output_on, status.actuator) == (True, "setpoints over SCPI")
    low_hz, high_hz = daemon.basis.settings.config.limits.frequency_hz
    assert low_hz <= status.frequency_hz <= high_hz
    status = daemon.off()
    assert served.amplifier.voltage_v == 0.0
    assert (status.state, status.output_on, status.frequency_hz) == (DaemonState.ARMED, False, None)


def test_a_generator_that_goes_is_a_fault_and_one_that_comes_back_renders_again(daemon, served):
    render(daemon, served)
    server = served.instruments.generator_server
    server.close()
    until(lambda: daemon.status().state is DaemonState.FAULT)
    assert served.amplifier.voltage_v == 0.0  # by the interlock box
    status = daemon.status()
    assert server.resource in status.fault
    assert status.frequency_hz is None
    assert "generator does not answer, amplifier disabled" in status.fault
    assert refusal(daemon.arm, 1.0).code == "fault"
    served.instruments.generator_server = TcpServer(served.generator, server.port)
    served.instruments.generator_server.start()
    reset(daemon)
    render(daemon, served)
    daemon.off()
    assert served.amplifier.voltage_v == 0.0


def render(daemon, served):
    """Ask for friction until there is voltage; anew after a fault: the instruments share this
    process.
    """

    def there():
        with suppress(RefusedError):  # a fault since its status was asked for
            match daemon.status().state:
                case DaemonState.FAULT:
                    daemon.reset()
                case DaemonState.IDLE:
                    daemon.targets.set(daemon.arm(LEASE_S).token, RESTING)
        return served.amplifier.voltage_v > 20.0

    until(there, daemon.status)


def test_sensors_that_fall_silent_are_connected_anew(daemon, served, monkeypatch):
    monkeypatch.setattr(supervision, "RETRY_S", 0.1)
    before = daemon.supervisor.instruments
    served.instruments.force_box.inject(RdtFault.SILENCE, count=math.inf)
    until(lambda: daemon.status().state is DaemonState.FAULT)
    assert "sent no usable record" in daemon.status().fault
    until(lambda: daemon.supervisor.instruments is None)
    assert daemon.status().output_on is None  # nobody to ask
    assert refusal(daemon.reset).code == "cause_remains"
    served.instruments.force_box.heal()
    until(lambda: daemon.supervisor.instruments is not None)
    reset(daemon)
    assert daemon.supervisor.instruments is not before
    assert daemon.status().output_on is False
    # The finger pressed meanwhile: once its load became the sensor's zero, and nothing was rendered
    # any more.
    until(lambda: daemon.shared.sensed.read().normal_force_n > 0.4)
    assert any("reset to go on" in event.message for event in daemon.events(0))
    render(daemon, served)


def test_a_watchdog_that_dies_is_started_again(daemon):
    before = daemon.pids["watchdog"]
    os.kill(before, signal.SIGKILL)
    until(lambda: daemon.status().state is DaemonState.FAULT)
    reset(daemon)
    assert daemon.pids["watchdog"] != before
