"""The Python client: a lease that is kept, an output that is off whatever ends the block, and
answers of strangers.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socketserver
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import closing
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest

from haptic_driver.client import HapticClient, LeaseLostError, NoDaemonError
from haptic_driver.daemon.messages import DaemonState, RefusedError
from haptic_driver.errors import BadInputError, HapticError
from tests.haptic_driver.daemon.bench_control import BenchControl, serving
from tests.waiting import HANG_S, until

LONG_S = 5.0  # a lease that a busy machine does not lose


@pytest.fixture
def control():
    return BenchControl()


@pytest.fixture
def socket(control, tmp_path):
    with serving(control, tmp_path):
        yield tmp_path / "d.sock"


@pytest.fixture
def client(socket):
    with HapticClient(socket) as client:
        yield client


def test_a_session_asks_and_leaves_the_output_off(client, control):
    with client.armed(LONG_S) as session:
        assert session.set(0.6).target_cof == 0.6
        assert session.play("linen").texture == "linen"
        assert client.status().output_on is True
        assert session.off().output_on is False
        session.set(0.7)
    assert control.machine.state is DaemonState.IDLE
    assert ("disarm",) in control.calls
    assert not [thread for thread in threading.enumerate() if thread.name == "lease"]


def test_the_pages_address_reaches_the_daemon_as_its_socket_does(control, tmp_path, monkeypatch):
    """Through an SSH tunnel, and from where Python has no Unix sockets."""
    with serving(control, tmp_path, 0) as url, closing(HapticClient(url)) as client:
        monkeypatch.setenv("HAPTIC_SOCKET", url)
        with HapticClient().armed(LONG_S) as session:
            session.set(0.6)
            assert (
                "rendering, output ON (generator says so, 0.1 s ago)\n  rig bench (simulated)"
                in repr(client.status())
            )
        with closing(client.watch()) as frames:
            assert next(frames).status.output_on is False
        assert client.events()
        stranger = HapticClient(url[:-4])
        with pytest.raises(HapticError, match="needs the token"):
            stranger.status()
    with pytest.raises(NoDaemonError, match=r"no daemon answers at http://127\.0\.0\.1:\d+(\n|$)"):
        HapticClient(url)


@pytest.mark.parametrize("said", ["http://127.0.0.1:8470", "http://127.0.0.1:none/page/?token=x"])
def test_an_address_that_is_none_of_a_page_says_how_one_looks(said):
    with pytest.raises(BadInputError) as refused:
        HapticClient(said)
    assert "?token=" in refused.value.hint


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_whatever_ends_the_block_switches_off_and_is_not_hidden(client, control, error):
    def work():
        with client.armed(LONG_S) as session:
            session.set(0.6)
            raise error

    with pytest.raises(error):
        work()
    assert control.machine.state is DaemonState.IDLE


def test_the_lease_is_renewed_for_longer_than_it_lasts(client, control):
    with client.armed(2.0):
        began_s = time.monotonic()
        until(lambda: control.calls.count(("renew",)) >= 3 and time.monotonic() - began_s > 2.5)
        assert client.status().state is DaemonState.ARMED


@pytest.mark.process
def test_a_client_that_dies_loses_its_lease(socket, control):
    program = (
        "import sys, time; from pathlib import Path; from haptic_driver.client import"
        " HapticClient\nwith HapticClient(Path(sys.argv[1])) as client, client.armed(2.0) as"
        " session:\n    session.set(0.6); print('set', flush=True); time.sleep(600)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(socket)], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"set\n"
        assert control.status().output_on is True
        os.kill(process.pid, signal.SIGKILL)
    until(lambda: control.status().output_on is False)
    assert ("disarm",) not in control.calls


def test_a_renewal_that_is_never_answered_does_not_cost_the_lease(client, control, monkeypatch):
    renewed, stuck, over = [], threading.Event(), threading.Event()
    renew = control.renew

    def stick(token):
        renewed.append(token)
        if len(renewed) == 2:
            stuck.set()
            over.wait(HANG_S)
        return renew(token)

    monkeypatch.setattr(control, "renew", stick)
    try:
        with client.armed(1.0) as session:
            assert stuck.wait(HANG_S)
            until(lambda: len(renewed) >= 4)
            assert session.lost is None
    finally:
        over.set()


def test_a_lost_lease_is_told_and_a_new_owner_left_alone(client, control):
    with pytest.raises(LeaseLostError) as lost, client.armed(2.0) as session:  # noqa: PT012
        control.disarm()
        other = control.arm(LONG_S)
        assert session.wait_lost(HANG_S)
    assert lost.value.code == "not_yours"
    assert re.search(r"; it was last renewed \d.* s before$", lost.value.message)
    assert control.machine.state is DaemonState.ARMED
    assert control.renew(other.token) == other


def test_off_without_evidence_is_an_error(client, control):
    control.shown_off = False
    with pytest.raises(HapticError, match="cannot be shown to be off"):
        client.off()
    with pytest.raises(HapticError, match="cannot be shown to be off"), client.armed(LONG_S):
        pass


@pytest.mark.parametrize(
    ("ask", "kind", "code"),
    [
        (lambda c: c.set("token", 0.6), RefusedError, "not_armed"),
        (lambda c: c.set("token", float("nan")), BadInputError, "out_of_range"),
        (lambda c: c.mark("here", {"this": object()}), BadInputError, "bad_request"),
    ],
)
def test_refusals_are_typed(client, ask, kind, code):
    with pytest.raises(kind) as refused:
        ask(client)
    assert refused.value.code == code
    assert refused.value.hint


def test_a_session_records_until_its_lease_is_over(client, control, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with client.armed() as session:
        session.record(Path("run.h5"))
        session.record(None)
    assert [call for call in control.calls if call[0] == "record"] == [
        ("record", str(tmp_path / "run.h5"), session.token),
        ("record", None, session.token),
    ]


# --- answers that are no daemon's, and what is sent as a name or as a path
# -------------------------------------------


class Stranger(BaseHTTPRequestHandler):
    """Answers everything with the same object, and keeps what was asked."""

    heard: list[dict[str, str]]

    def answer(self):
        length = int(self.headers.get("Content-Length", 0))
        self.heard.append(json.loads(self.rfile.read(length) or b"{}"))
        self.send_response(200)
        self.send_header("Content-Length", "13")
        self.end_headers()
        self.wfile.write(b'{"who": "me"}')

    do_GET = do_POST = answer  # noqa: N815 - the names of http.server

    def address_string(self):
        return "somebody"

    def log_message(self, *_):
        pass


@pytest.fixture
def stranger(tmp_path):
    Stranger.heard = []
    with socketserver.ThreadingUnixStreamServer(str(tmp_path / "s.sock"), Stranger) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        with HapticClient(tmp_path / "s.sock") as client:
            yield client
        server.shutdown()
        thread.join()


def test_an_answer_that_is_no_daemons_is_an_error_and_no_traceback(stranger):
    with pytest.raises(HapticError, match="the answer is no Status") as failed:
        stranger.status()
    assert failed.value.code == "bad_answer"


@pytest.mark.parametrize(
    ("asked", "is_path"),
    [
        ("linen", False),
        ("größe", False),
        ("linen.toml", True),
        ("deep/linen", True),
        ("none.toml", False),
    ],
)
def test_a_path_is_sent_whole_and_a_name_as_it_is(stranger, tmp_path, monkeypatch, asked, is_path):
    """A file that happens to have the name of a texture once took its place."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "deep").mkdir()
    for name in ("linen", "linen.toml", "deep/linen"):
        (tmp_path / name).write_text("")
    with pytest.raises(HapticError, match="no Status"):
        stranger.play("token", asked)
    assert Stranger.heard[-1]["name"] == (str(tmp_path / asked) if is_path else asked)


STRANGER = 65534


@pytest.mark.process
@pytest.mark.skipif(os.getuid() != 0, reason="only root can be another user")
@pytest.mark.parametrize(
    ("owner", "above", "is_believed"),
    [
        (0, 0o755, False),  # in a folder of root's
        (STRANGER, 0o755, True),  # root, or a service manager, gave it to that user
        (STRANGER, 0o1777, False),  # somebody else may have made it, as in /tmp
    ],
)
def test_a_program_of_another_user_is_not_believed(tmp_path, owner, above, is_believed):
    """`haptic off` was once answered "idle, output off" by a stranger's program, in a folder of the
    stranger's; root was so too where that folder lay in /tmp.
    """
    tmp_path = Path(tempfile.mkdtemp(dir="/run"))  # only root can write there, as for a service
    path = tmp_path / "theirs" / "d.sock"
    path.parent.mkdir()
    tmp_path.chmod(above)
    os.chown(path.parent, owner, owner)
    path.parent.chmod(0o755 if owner else 0o777)
    listening = f"""
import os, socket, time
os.setuid({STRANGER})
with socket.socket(socket.AF_UNIX) as listener:
    listener.bind({str(path)!r})
    listener.listen()
    print("listens", flush=True)
    time.sleep(1000.0)
"""
    with subprocess.Popen(
        [sys.executable, "-c", listening], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout.readline() == "listens\n"
            if is_believed:
                HapticClient(path).close()
            else:
                with pytest.raises(HapticError) as refused:
                    HapticClient(path)
                assert refused.value.code == "not_yours"
                assert f"user {STRANGER}" in refused.value.message
        finally:
            process.kill()
            shutil.rmtree(tmp_path)
