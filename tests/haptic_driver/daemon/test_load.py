"""The daemon holds a load on the simulated paper rig: its own loop, on a stage and a force sensor
behind their wires.
"""

import os
import signal
import threading
import time
from contextlib import closing, suppress

import numpy as np
import pytest

from haptic_driver.cli.control import lease_file
from haptic_driver.cli.load_by_daemon import hold as hold_by_daemon
from haptic_driver.client import HapticClient
from haptic_driver.config import find_config
from haptic_driver.daemon.messages import DaemonState, LoadPhase
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.daemon.web.server import serve
from haptic_driver.errors import HapticError
from haptic_driver.public.connection import Rig
from haptic_driver.rig.config import load_rig
from hw.amplifier.served_lines import ServedLines
from hw.errors import DeviceError
from hw.force.net_ft import NetFt, NetFtSettings
from hw.force.net_ft_server import SCALE
from hw.force.sensor import ForceAxes
from hw.transport.tcp import TcpTransport
from tests.haptic_driver.config_texts import changed
from tests.haptic_driver.daemon.refusal import refusal
from tests.haptic_driver.daemon.waiting import STOOD_STILL, reset
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.realtime

DAEMON_RIG = "near"

LOAD_N, TRIP_N = 0.5, 0.75
# A finger that is half a millimetre away, and a stage that homes at once.
FAR = "stiffness_n_per_m = 700.0"
NEAR = FAR, f"clear_m = 1.5e-3\nface_m = 2e-3\n{FAR}"
LIFTED_N = 0.02  # seven times the noise of the sensor
# What a machine that stood still for 0.1 s, or for a second, makes the daemon say.
LATE = ("the force sensor", "did not answer in time", *STOOD_STILL)


def near_rig(folder):
    text = find_config("simulated-paper", "rigs").read_text()
    path = folder / "near.toml"
    path.write_text(changed(text, NEAR))
    return str(path)


@pytest.fixture(scope="module")
def settings(surface_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("near")
    rig = near_rig(folder)
    config = load_rig(rig)
    render = render_settings(config, surface_file)
    record = folder / "record.txt"
    return DaemonSettings(rig, "reference", config, surface_file, render, amplifier_record=record)


def is_late(said):
    return any(reason in (said or "") for reason in LATE)


def in_reason(load):
    return load.phase is LoadPhase.HOLD and load.load_n == pytest.approx(LOAD_N, rel=0.1)


def press(daemon, lease_s=60.0):
    """Armed, the load held and friction rendered; begun again where the machine stood still."""
    while True:
        with suppress(HapticError):
            return begin(daemon, lease_s)
        fault = daemon.status().fault
        assert fault is None or is_late(fault), fault
        daemon.disarm()


# A stage that was closed while it homed does not know where it is, and clears by homing.
AT_REST = LoadPhase.FREE, LoadPhase.STOPPED, LoadPhase.MAY_PRESS


def begin(daemon, lease_s):
    until(lambda: not daemon.supervisor.missing and not daemon.supervisor.silent())
    if daemon.status().state is DaemonState.FAULT:
        daemon.reset()
    until(lambda: daemon.status().load.phase in AT_REST)
    lease = daemon.arm(lease_s)
    daemon.hold_load(lease.token, LOAD_N)
    until(lambda: daemon.renew(lease.token) and in_reason(daemon.status().load))
    daemon.targets.set(lease.token, 0.65)
    until(lambda: daemon.renew(lease.token) and daemon.status().output_on)
    return lease


def rendered(daemon, ticks):
    """The lease, and so many samples under a load that was held all the time."""
    while True:
        lease, begun = press(daemon), daemon.shared.ring.position
        with suppress(HapticError):
            while daemon.shared.ring.position - begun < ticks:
                daemon.renew(lease.token)
                time.sleep(0.02)
            return lease, daemon.shared.ring.newest(ticks)
        assert is_late(daemon.status().fault)


def until_lifted(daemon):
    until(lambda: daemon.status().load.phase is LoadPhase.FREE, lambda: daemon.status().load)
    until(lambda: (load_n := daemon.status().load.load_n) is not None and load_n < LIFTED_N)


# First of all: later the finger is in the stage's holder.
def test_until_the_stage_moves_the_load_is_that_of_the_slide(daemon):
    status = until(lambda: (found := daemon.status()).load.load_n > 0.3 and found)
    assert status.load.phase is LoadPhase.FREE


def test_a_load_is_held_while_friction_is_rendered_and_not_said_to_be_while_it_changes(daemon):
    """A sample of a second is a whole beat of the finger's pulse."""
    lease, samples = rendered(daemon, 1000)
    assert samples["normal_force_n"].mean() == pytest.approx(LOAD_N, rel=0.05)
    assert samples["normal_force_n"].max() < TRIP_N
    assert np.all(samples["in_contact"] == 1)
    assert "load stage: hold 0.5 N" in str(daemon.status())
    status = daemon.hold_load(lease.token, 0.6)  # the stage has not moved yet
    assert status.load.phase is not LoadPhase.HOLD
    assert status.load.target_n == 0.6 or is_late(status.fault)
    until(lambda: (load_n := daemon.status().load.load_n) is not None and load_n < LIFTED_N)
    daemon.disarm()
    until_lifted(daemon)


def test_a_lost_lease_lifts_the_finger(daemon):
    """Whatever else takes the load away is in `test_free_stage.py`."""
    press(daemon, lease_s=1.0)
    until_lifted(daemon)
    assert daemon.status().output_on is False


def test_off_in_the_approach_ends_it(daemon):
    while approach(daemon) is not LoadPhase.APPROACH:  # the machine stood still
        daemon.disarm()
        reset(daemon)
    assert daemon.off().load.target_n is None
    until_lifted(daemon)
    assert daemon.status().state in (DaemonState.ARMED, DaemonState.FAULT)


def approach(daemon):
    """The phase after `clearing`, of a load that is asked for anew."""
    until(lambda: daemon.status().load.phase is LoadPhase.FREE)
    lease = daemon.arm(60.0)
    daemon.hold_load(lease.token, LOAD_N)
    before = LoadPhase.FREE, LoadPhase.CLEARING

    def after():
        status = daemon.status()
        phase = status.load.phase
        return phase if phase not in before or status.state is DaemonState.FAULT else None

    return until(after)


def test_off_waits_for_no_stage_that_hangs_and_says_what_still_presses(daemon, monkeypatch):
    """Another holds its line, as an answer that does not come does. On a rig that is safer at rest
    the finger is still pressed then; another load lifts first.
    """
    load = daemon.supervisor.load
    section = load._section.model_copy(update={"when_wrong": "stop"})
    monkeypatch.setattr(load, "_section", section)
    press(daemon)
    daemon.off()
    until(lambda: daemon.status().load.phase is not LoadPhase.LETTING_GO)
    status = daemon.status()
    assert status.load.phase is LoadPhase.STOPPED
    assert status.load.load_n > LIFTED_N
    assert status.output_on is False
    monkeypatch.undo()
    daemon.disarm()
    was_late = True
    while was_late:
        press(daemon)
        with daemon.supervisor.instruments.devices.load_stage._undisturbed():
            status = daemon.off()
            was_late = status.state is DaemonState.FAULT
            assert status.output_on is False
            assert was_late or status.load.phase is LoadPhase.LETTING_GO
            assert was_late or status.load.load_n > LIFTED_N
        until_lifted(daemon)


def test_two_commands_with_one_lease_do_not_let_go_of_each_others_load(daemon, tmp_path):
    place = Place(tmp_path / "d.sock")
    with closing(place), serve(daemon, place), HapticClient(place.path) as client:
        lease = press(daemon)
        before = daemon.events(0)[-1].number
        asks = threading.Thread(target=lambda: other_load(daemon, lease.token, before))
        with lease_file(client.address, lease.token):
            asks.start()
            error = refusal(hold_by_daemon, client, LOAD_N, None)
        asks.join()
    fault = daemon.status().fault
    assert error.code == "load_taken_over" or is_late(fault)
    assert daemon.status().load.target_n == 0.6 or is_late(fault)


def other_load(daemon, token, before):
    """Ask for it once the command has asked for its own."""
    until(lambda: [event for event in daemon.events(before) if event.kind == "load"])
    daemon.hold_load(token, 0.6)


def test_a_finger_that_thrusts_is_let_go_and_is_a_fault(daemon, history):
    press(daemon)
    lines = TcpTransport.from_resource(daemon.supervisor.endpoints["amplifier_lines"])
    with closing(ServedLines(lines)):
        lines.open()
        lines.query(b"THRUST 0.6e-3\n", HANG_S)  # 0.5 N becomes 0.9 N
        until(lambda: daemon.status().state is DaemonState.FAULT)
        until_lifted(daemon)
        lines.query(b"THRUST 0\n", HANG_S)
    fault = daemon.status().fault
    assert "its limit 0.75 N" in fault or is_late(fault)
    assert daemon.status().output_on is False
    assert history()[-1][1] == 0.0


def test_the_command_holds_by_the_daemon_until_it_is_over(daemon, haptic, tmp_path):
    place = Place(tmp_path / "d.sock")
    hold = ["load", "hold", "0.5", "--seconds", "0.5", "--socket", place.path, "--json"]
    with closing(place), serve(daemon, place):
        while (done := haptic(*hold)).status:
            assert is_late(done.said["error"]["message"])
            reset(daemon)
        released = haptic("load", "release", "--socket", place.path, "--json")
        with Rig(HapticClient(place.path)) as rig, rig.armed():
            assert rig.hold_load(LOAD_N).load.target_n == LOAD_N
            assert rig.release_load().load.target_n is None
    assert done.said["mean_load_n"] == pytest.approx(LOAD_N, rel=0.1)
    assert released.said["load"]["phase"] == "free"
    assert released.said["state"] == "idle"


def test_a_reset_at_once_after_a_fault_presses_nobody(daemon):
    lease = press(daemon)
    daemon.supervisor._orders.fail("something else is wrong")
    assert refusal(daemon.hold_load, lease.token, LOAD_N).code == "not_armed"
    daemon.reset()
    assert daemon.status().load.target_n is None
    until_lifted(daemon)
    assert daemon.status().output_on is False


def test_a_watchdog_that_dies_while_the_stage_presses_lets_go(daemon):
    press(daemon)
    os.kill(daemon.pids["watchdog"], signal.SIGKILL)
    until(lambda: daemon.status().state is DaemonState.FAULT)
    until_lifted(daemon)
    assert daemon.status().output_on is False


# Last in this module's daemon: its instruments are connected anew when a sensor stays silent.
def test_a_silent_sensor_lets_go(daemon):
    """Another program takes the sensor's stream away, and looks on."""
    press(daemon)
    with closing(other_reader(daemon.supervisor.endpoints)) as box:
        until(lambda: daemon.status().state is DaemonState.FAULT)
        assert "the force sensor" in daemon.status().fault
        until(lambda: box.read().normal_force_n < LIFTED_N)
    assert daemon.status().output_on is False


def other_reader(endpoints):
    host, port = endpoints["force_sensor"].split(":")
    box = NetFt(NetFtSettings(host, SCALE, ForceAxes("-z", "x"), port=int(port), timeout_s=1.0))
    box.open()
    return box


@pytest.mark.soak
def test_a_killed_control_process_leaves_the_finger_lifted(killable_daemon, tmp_path):
    """The instruments outlive it by some seconds, in which the watchdog lifts: by the sensor."""
    daemon = killable_daemon(near_rig(tmp_path), str(LOAD_N))
    pids = daemon.await_output()
    loads = []
    daemon.process.send_signal(signal.SIGKILL)
    assert pids["control"] == daemon.process.pid
    with suppress(DeviceError), closing(other_reader(daemon.report["endpoints"])) as box:
        while True:
            loads.append(box.read().normal_force_n)
            time.sleep(0.005)
    assert len(loads) > 50
    assert max(loads) < TRIP_N
    assert max(loads[-20:]) < LIFTED_N
    assert daemon._zero_s() < float("inf")
