"""`haptic arm`, `set`, `texture play`, `off`, `disarm`, `status`, `record`, and `reset` against an
API.
"""

import json
import os
import re
import select
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from haptic_driver.cli.control import lease_file
from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import AgreementCell, DaemonState, RefusedError
from tests.haptic_driver.commands import said_by
from tests.haptic_driver.daemon.bench_control import FIDELITY
from tests.waiting import HANG_S, until

SCRIPT = Path(sys.executable).with_name("haptic")
STATUS_KEYS = {
    "state",
    "simulated",
    "texture",
    "target_cof",
    "measured_cof",
    "frequency_hz",
    "voltage_v",
    "output_on",
    "ticks",
    "overruns",
    "flags",
}


@pytest.fixture
def armed(control, socket):
    """As `haptic arm` leaves it."""
    lease = control.arm(60.0)
    token = socket.with_name("d.sock.lease")
    token.write_text(lease.token)
    return lease


@pytest.mark.usefixtures("socket")
def test_without_arming_it_says_how_to_arm(refuses, control):
    assert "haptic arm" in refuses("not_armed", "set", "0.6", status=1)["hint"]
    assert control.calls == []


def test_status_has_the_keys_of_the_contract(haptic, socket):
    said = said_by("status")
    assert set(said) >= STATUS_KEYS
    assert (said["state"], said["output_on"]) == ("idle", False)
    shown = haptic("status")
    assert "idle, output off (generator says so" in shown.out


def test_status_says_how_well_it_renders_and_how_late(haptic, socket, control):
    control.fidelity = FIDELITY
    said = said_by("status")
    assert said["fidelity"]["share_within_5_percent"] == 0.97
    assert (said["latency_measured_s"], said["latency_why"]) == (None, "nobody has looked yet")
    control.latency = {"latency_measured_s": 0.0123, "latency_error_s": 0.0002}
    shown = haptic("status").out
    assert FIDELITY.said[0] in shown
    assert "latency 12.3 ms measured, 10.0 ms by the rig's file" in shown


def test_set_play_off_disarm(haptic, armed, control):
    assert said_by("set", "0.6")["target_cof"] == 0.6
    shown = haptic("status").out
    assert "output ON" in shown
    assert "within reach 0.50 to 0.90" in shown
    assert "lease held by somebody" in shown
    assert said_by("texture", "play", "linen")["texture"] == "linen"
    assert said_by("off")["state"] == "armed"
    assert said_by("disarm")["state"] == "idle"
    assert control.machine.state is DaemonState.IDLE


@pytest.mark.process
@pytest.mark.parametrize("detach", [[], ["--detach"]])
def test_a_second_arm_by_the_holder_says_so_and_is_no_error(haptic, armed, detach):
    """The lease is the first one's, and so is its end."""
    held = said_by("arm", *detach, "--lease", "5")
    assert (held["state"], held["lease_s"]) == ("armed already", 60.0)
    assert "armed already" in haptic("arm", *detach).out
    assert said_by("status")["state"] == "armed"


@pytest.mark.parametrize("token", ["another", None])
def test_arming_what_somebody_else_holds_is_refused(refuses, armed, socket, token):
    path = socket.with_name("d.sock.lease")
    path.write_text(token) if token else path.unlink()
    refuses("already_armed", "arm", status=1)


@pytest.mark.process
def test_a_detached_arm_has_renewed_before_it_returns(socket, control):
    """However late the keeper is: a lease that it has never renewed may have run out when the next
    command comes.
    """
    may_renew, renew = threading.Event(), control.renew

    def late(token):
        may_renew.wait(HANG_S)
        return renew(token)

    control.renew = late
    with subprocess.Popen(
        [SCRIPT, "arm", "--detach", "--lease", "30", "--json"], stdout=subprocess.PIPE
    ) as caller:
        until(lambda: any(call[0] == "arm" for call in control.calls))
        time.sleep(0.5)  # for the mistake to show; what is right does not depend on it
        assert not select.select([caller.stdout], [], [], 0)[0]
        may_renew.set()
        assert json.loads(caller.stdout.readline())["state"] == "armed"
    assert ("renew",) in control.calls
    control.disarm()


@pytest.mark.process
@pytest.mark.usefixtures("socket")
def test_detached_arm_fails_as_arm_does(refuses):
    """Bad input exits with 2 from a process of its own too."""
    refuses("out_of_range", "arm", "--detach", "--lease", "0.001")


def test_a_slip_of_the_hand_is_refused_and_nearest_insists(refuses, armed):
    refuses("unreachable", "set", "7")
    assert said_by("status")["output_on"] is False
    assert said_by("set", "7", "--nearest")["target_cof"] == 7.0


def test_off_that_cannot_be_shown_fails(haptic, refuses, armed, control):
    control.shown_off = False
    for command in ("off", "disarm"):
        refuses("not_off", command, status=1)
    assert "UNKNOWN" in haptic("status").out


def test_record_and_reset(haptic, socket, control, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert said_by("record", "run.h5")["recording"] == str(tmp_path / "run.h5")
    assert said_by("record", "--stop")["recording"] is None
    control.fail("by [hand]")
    assert "by [hand]" in haptic("status").out
    assert said_by("reset")["state"] == "idle"


def test_a_marker_goes_to_the_daemon_as_it_was_given(haptic, socket, control):
    before_s = time.monotonic()
    marked = said_by("mark", "trial 7", "--data", '{"level": 0.1, "side": ["left"]}')
    assert before_s <= marked["time_s"] <= time.monotonic()
    assert f"marker {marked['number'] + 1}" in haptic("mark", "again").out
    assert control.calls == [
        ("mark", "trial 7", {"level": 0.1, "side": ["left"]}),
        ("mark", "again", {}),
    ]


def test_arm_holds_the_lease_for_a_time(socket, control):
    held = said_by("arm", "--for", "0.3")
    assert (held["state"], held["lease_s"]) == ("armed", 0.5)
    assert re.fullmatch(r"haptic arm, process \d+", control.holders[-1])
    assert control.machine.state is DaemonState.IDLE
    assert not Path(held["token_file"]).exists()


@pytest.fixture
def holder(socket):
    """`haptic arm` in a process of its own, armed."""
    command = [SCRIPT, "arm", "--lease", "5", "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        held = json.loads(process.stdout.readline())
        assert stat.S_IMODE(Path(held["token_file"]).stat().st_mode) == 0o600
        yield process
        process.kill()


def test_a_holder_that_ends_late_leaves_the_next_ones_token(socket):
    """Once the others were told that nobody had armed."""
    with HapticClient(socket) as client, lease_file(client.address, "mine"):
        assert client.address.lease_file.read_text() == "mine\n"
        client.address.lease_file.write_text("another's")
    assert client.address.lease_file.read_text() == "another's"


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_disarms(holder, socket, control, number):
    assert said_by("set", "0.6")["output_on"] is True
    holder.send_signal(number)
    assert holder.wait(HANG_S) == 0
    assert control.machine.state is DaemonState.IDLE
    assert not socket.with_name("d.sock.lease").exists()


@pytest.mark.process
def test_disarm_ends_arm_and_a_fault_fails_it(haptic, holder, control):
    control.fail("by hand")
    assert holder.wait(HANG_S) == 1
    assert "by hand" in holder.stderr.read()
    haptic("reset")
    with subprocess.Popen(
        [SCRIPT, "arm", "--lease", "5", "--json"], stdout=subprocess.PIPE
    ) as second:
        assert b"armed" in second.stdout.readline()
        assert said_by("disarm")["state"] == "idle"
        assert second.wait(HANG_S) == 0


@pytest.mark.process
def test_detached_arm_lives_as_long_as_its_caller(socket, control):
    script = f"{SCRIPT} arm --detach --lease 5 --json; read line"
    with subprocess.Popen(
        ["sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as caller:
        assert json.loads(caller.stdout.readline())["state"] == "armed"
        assert control.status().state is DaemonState.ARMED
        os.kill(caller.pid, signal.SIGKILL)
    until(lambda: ("disarm",) in control.calls)


def test_a_lease_that_ran_out_is_a_failure_before_the_daemon_has_ramped_down(
    haptic, socket, control, monkeypatch
):
    def expired(token):
        raise RefusedError("lease_expired", "the lease has run out", "arm again")

    monkeypatch.setattr(control, "renew", expired)
    done = haptic("arm", "--for", "20", "--json")
    assert done.status == 1
    assert "the lease ran out before it was renewed" in done.err


def test_agreement_is_a_line_per_condition_with_a_sign_per_cell(haptic, socket, control):
    cells = [
        ("frequency_hz", 100.0, 215.0, -0.06),
        ("frequency_hz", 215.0, 464.0, 0.03),
        ("speed_m_s", 0.03, 0.06, 0.01),
    ]
    control.agreement = [
        AgreementCell(axis=axis, low=low, high=high, share=share, weight=1e4)
        for axis, low, high, share in cells
    ]
    control.disagreement = "6 % less friction than expected at 100..215 Hz, since 14:03"
    said = haptic("status").out
    assert "agreement, frequency: ▼ + (100 to 464 Hz)" in said
    assert "agreement, speed: · (0.03 to 0.06 m/s)" in said
    assert control.disagreement in said


def test_adapting_is_switched_on_and_off(haptic, socket, control):
    assert "adapting: no refit yet" in haptic("adapt", "on").out
    assert said_by("adapt", "off")["adaptation"] is None
    assert control.calls.index(("adapt", True)) < control.calls.index(("adapt", False))
    assert haptic("adapt", "perhaps").status == 2


def test_a_model_or_a_texture_may_be_called_on_or_off(haptic, armed, control):
    """Once such a name became true or false, and a traceback."""
    assert haptic("texture", "play", "on", "--json").said["error"]["code"] == "unknown_texture"
    assert haptic("use", "off", "--json").said["error"]["code"] == "not_idle"
    assert {("play", "on"), ("use_model", "off")} <= set(control.calls)


def test_why_says_what_is_missing_and_how_to_use_it(haptic, socket, control):
    found = haptic("why", "--minutes", "5")
    assert ("why", 5.0) in control.calls
    assert "Skin hydration is missing from the model" in found.out
    assert "haptic investigate could add what tells this from that" in found.out
    assert "haptic use other" in found.out
    assert said_by("why")["effects"] == ["skin_hydration"]


def test_a_colour_photograph_plays_in_one_command(haptic, armed, control, tmp_path, monkeypatch):
    photo = tmp_path / "photo.jpg"
    colours = np.linspace(0, 255, 60 * 80 * 3).astype(np.uint8).reshape(60, 80, 3)
    Image.fromarray(colours).save(photo)
    texture = str(photo.with_suffix(".toml"))
    monkeypatch.setattr(control, "textures", lambda: [texture])
    done = haptic("texture", "from-image", photo, "--width-mm", "60", "--play", "--json")
    assert done.status == 0, done.err
    assert ("play", texture) in control.calls
    assert control.status().texture == texture
