"""`haptic daemon run` on the simulated rig, used through its socket as a user would."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import DaemonState, RefusedError
from haptic_driver.errors import BadInputError, HapticError
from tests.waiting import HANG_S, until

SCRIPT = Path(sys.executable).with_name("haptic")
LONG_S = 60.0  # a lease that a busy machine does not lose


@pytest.fixture(scope="module")
def announced(tmp_path_factory):
    """What the daemon says when it is ready."""
    folder = tmp_path_factory.mktemp("daemon")
    command = [SCRIPT, "daemon", "run", "--rig", "simulated", "--port", "0", "--json", "--socket", folder / "d.sock"]
    with (
        open(folder / "log.txt", "w+") as log,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True) as process,
    ):
        try:
            said = json.loads(process.stdout.readline())
            assert set(said) == {"socket", "page"}, said
            yield said
            process.send_signal(signal.SIGTERM)
            assert process.wait(HANG_S) == 0, log.seek(0) or log.read()  # the output is known to be off
        finally:
            process.kill()
    assert [path.name for path in folder.glob("d.sock*")] == ["d.sock.lock"]


@pytest.fixture
def client(announced):
    with HapticClient(Path(announced["socket"])) as client:
        yield client
        client.disarm()


def test_a_friction_is_rendered_and_switched_off(client):
    with client.armed(LONG_S) as session:
        assert client.status().output_on is False
        session.set(0.65)
        until(lambda: client.status().output_on)
        assert client.off().state is DaemonState.ARMED
    status = client.status()
    assert (status.state, status.output_on, status.simulated) == (DaemonState.IDLE, False, True)
    told = [event.kind for event in client.events()]
    assert told.count("target") == 1
    ticks = client.samples(most=500)
    assert ticks.size
    assert (ticks["tick"][1:] > ticks["tick"][:-1]).all()
    assert client.textures()
    assert next(client.watch()).ticks.count > 0


def test_a_lost_client_ends_idle_and_off(client):
    lease = client.arm(1.0)
    with suppress(HapticError):  # a busy machine may be too late even for that
        client.set(lease.token, 0.65)
    until(lambda: client.status().state is DaemonState.IDLE)
    assert client.status().output_on is False
    with pytest.raises(RefusedError):
        client.renew(lease.token)


@pytest.mark.parametrize("name", ["linnen", "\x00", "/", "~", "a\nb"])
def test_what_is_no_texture_is_bad_input(client, name):
    with client.armed(LONG_S) as session, pytest.raises(BadInputError):
        session.play(name)


def test_tcp_opens_to_the_token_alone(announced):
    base, _, token = announced["page"].partition("/page/?token=")
    assert httpx.get(base + "/status").status_code == 401
    status = httpx.get(base + "/status", headers={"Authorization": f"Bearer {token}"}, timeout=HANG_S)
    assert status.json()["rig"] == "simulated"
