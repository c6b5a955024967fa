"""The API as independent HTTP and WebSocket clients see it: sockets, tokens, errors, streams,
fuzzing.
"""

from __future__ import annotations

import http.client
import json
import os
import resource
import select
import socket
import stat
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple

import httpx
import numpy as np
import pytest
import schemathesis
from hypothesis import HealthCheck, settings
from schemathesis import checks
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect, unix_connect

from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.web import api, door, security, server
from haptic_driver.daemon.web.api import create_app
from haptic_driver.daemon.web.security import TokenGate, origin_of
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.processes.samples import SAMPLE
from tests.haptic_driver.daemon.bench_control import BenchControl, serving
from tests.waiting import until

HANG_S = 60.0
CHANGES = ["/arm", "/renew", "/set", "/texture", "/off", "/disarm", "/reset", "/record"]


@pytest.fixture
def control():
    return BenchControl()


def client_of(folder, **options):
    """A client on the Unix socket."""
    transport = httpx.HTTPTransport(uds=str(folder / "d.sock"), **options)
    return httpx.Client(transport=transport, base_url="http://haptic")


@pytest.fixture
def unix(control, tmp_path):
    with serving(control, tmp_path), client_of(tmp_path) as client:
        yield client


class Shared(NamedTuple):
    """One API for what must change nothing: over its Unix socket, and over TCP."""

    control: BenchControl
    unix: httpx.Client
    address: str
    token: str


@pytest.fixture(scope="module")
def served_once(tmp_path_factory):
    control, folder = BenchControl(), tmp_path_factory.mktemp("shared")
    with serving(control, folder, 0) as url, client_of(folder) as client:
        base, _, token = url.partition("/page/?token=")
        yield Shared(control, client, base.removeprefix("http://"), token)


@pytest.fixture
def shared(served_once):
    assert served_once.control.machine.state is DaemonState.IDLE
    served_once.control.calls.clear()
    return served_once


def error_of(response):
    body = response.json()
    assert set(body) == {"error"}
    assert set(body["error"]) == {"code", "message", "hint"}
    return response.status_code, body["error"]["code"]


# --- commands and refusals
# -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "verb"), [("GET", "status"), ("POST", "off")])
def test_what_the_program_gets_wrong_is_answered(unix, control, monkeypatch, method, verb):
    def broken(*arguments):
        raise RuntimeError("nobody foresaw it")

    monkeypatch.setattr(control, verb, broken)
    answer = unix.request(method, f"/{verb}")
    assert error_of(answer) == (500, "internal")
    assert "nobody foresaw it" in answer.json()["error"]["message"]


@pytest.mark.parametrize("hangs", [True, False])
def test_an_api_that_does_not_start_is_told(control, tmp_path, monkeypatch, hangs):
    monkeypatch.setattr(server, "START_TIMEOUT_S", 0.0 if hangs else HANG_S)
    answer = (lambda one: until(lambda: one.server.should_exit)) if hangs else lambda one: None
    monkeypatch.setattr(server._Served, "answer", answer)
    with pytest.raises(HapticError) as refused, serving(control, tmp_path):
        pass
    assert refused.value.code == "no_api"


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "code"),
    [
        ("POST", "/set", b'{"cof": 0.6}', 409, "not_armed"),
        ("POST", "/reset", b"", 409, "no_fault"),
        ("POST", "/texture", b'{"name": "linnen"}', 422, "unknown_texture"),
        ("POST", "/set", b'{"cof": NaN}', 422, "out_of_range"),
        ("POST", "/set", b'{"cof": 0.6, "volt": 9}', 422, "bad_request"),
        ("POST", "/set", b"\xff\xfe{", 400, "bad_request"),
        ("POST", "/arm", b"[" * 10_000, 400, "bad_request"),
        ("GET", "/samples?most=0", b"", 422, "out_of_range"),
        ("POST", "/record", b"x" * 20_000, 413, "too_large"),
        ("GET", "/statu", b"", 404, "not_found"),
        ("PUT", "/status", b"", 405, "method_not_allowed"),
    ],
)
def test_what_is_wrong_is_said_and_changes_nothing(shared, method, path, body, status, code):
    answer = shared.unix.request(
        method, path, content=body, headers={"Content-Type": "application/json"}
    )
    assert error_of(answer) == (status, code)
    assert shared.control.machine.state is DaemonState.IDLE


@pytest.mark.parametrize(
    ("path", "asked", "said"),
    [
        ("/set", {"cog": 0.6}, "Did you mean 'cof'?"),
        ("/scene", {"changes": [{"do": "mvoe", "id": "a"}]}, "Did you mean 'move'?"),
        ("/scene", {"changes": [{"do": "move", "id": "a", "xmm": 1}]}, "Did you mean 'x_mm'?"),
    ],
)
def test_a_slip_of_the_pen_is_answered_by_the_nearest_word(shared, path, asked, said):
    answer = shared.unix.post(path, json=asked)
    assert answer.status_code == 422
    assert answer.json()["error"]["hint"].startswith(said)


def test_anothers_lease_is_forbidden(unix, control):
    unix.post("/arm", json={"lease_s": 5.0})
    assert error_of(unix.post("/set", json={"cof": 0.6}, headers={"X-Haptic-Lease": "mine"})) == (
        403,
        "not_yours",
    )
    assert control.machine.state is DaemonState.ARMED


def test_a_body_without_a_length_is_limited_too(shared):
    def endless():
        for _ in range(100):
            yield b" " * 1000

    assert error_of(shared.unix.post("/record", content=endless())) == (413, "too_large")


def test_a_near_miss_is_offered_the_path(shared):
    assert "Did you mean '/status'?" in shared.unix.get("/statu").json()["error"]["hint"]


def test_off_does_not_wait_for_requests_that_hang(control, tmp_path):
    release = threading.Event()
    control.renew = lambda token: release.wait(HANG_S)
    with (
        serving(control, tmp_path),
        client_of(tmp_path, limits=httpx.Limits(max_connections=None)) as client,
    ):
        hanging = [
            threading.Thread(target=client.post, args=("/renew",), kwargs={"timeout": HANG_S})
            for _ in range(60)
        ]
        for thread in hanging:
            thread.start()
        try:
            assert client.post("/off", timeout=HANG_S / 2).json()["output_on"] is False
        finally:
            release.set()
            for thread in hanging:
                thread.join()


# --- OFF before everything
# -------------------------------------------------------------------------------------


def said_at(stream):
    """The status and the error or state of the one response at a socket, which is closed behind
    it.
    """
    stream.settimeout(HANG_S)
    answer = http.client.HTTPResponse(stream)
    answer.begin()
    said = json.loads(answer.read())
    return answer.status, said.get("state") or said["error"]["code"]


def at_unix(tmp_path):
    stream = socket.socket(socket.AF_UNIX)
    stream.connect(str(tmp_path / "d.sock"))
    return stream


def authority(url):
    return httpx.URL(url).netloc.decode()


def at_port(url):
    return socket.create_connection(("127.0.0.1", httpx.URL(url).port), timeout=HANG_S)


def credentials(url):
    return f"Host: {authority(url)}\r\nAuthorization: Bearer {url.partition('?token=')[2]}\r\n"


def test_off_does_not_wait_for_its_body(control, tmp_path):
    with serving(control, tmp_path), at_unix(tmp_path) as stream:
        control.arm(5.0)
        stream.sendall(b"POST /disarm HTTP/1.1\r\nHost: haptic\r\nContent-Length: 1000\r\n\r\n")
        assert said_at(stream) == (200, "idle")
    assert control.machine.state is DaemonState.IDLE


def test_off_is_heard_where_all_connections_are_taken(control, tmp_path, monkeypatch):
    """Half a request takes none of those that the API has; 64 streams take all of them."""
    monkeypatch.setattr(door, "HEAD_TIMEOUT_S", HANG_S)
    status, off = (
        f"{what} HTTP/1.1\r\nHost: haptic\r\n\r\n" for what in ("GET /status", "POST /off")
    )
    with ExitStack() as open_ones, serving(control, tmp_path):
        for _ in range(door.MOST_WAITING):
            open_ones.enter_context(at_unix(tmp_path)).sendall(b"GET /sta")
        with at_unix(tmp_path) as stream:
            stream.sendall(status.encode())
            assert said_at(stream) == (200, "idle")
        for _ in range(server.MOST_AT_ONCE):
            stream = unix_connect(str(tmp_path / "d.sock"), "ws://haptic/events")
            open_ones.enter_context(stream).recv(HANG_S)
        for asked, said in ((status, (503, "busy")), (off, (200, "idle"))):
            with at_unix(tmp_path) as stream:
                stream.sendall(asked.encode())
                assert said_at(stream) == said


@pytest.mark.parametrize("at", ["socket", "port"])
def test_off_is_heard_while_the_event_loop_hangs(control, tmp_path, monkeypatch, at):
    """At the very address whose web server does nothing any more."""
    stuck, release = threading.Event(), threading.Event()

    async def stick(self, scope, receive, send):
        stuck.set()
        release.wait(HANG_S)

    monkeypatch.setattr(security.OneRequest, "__call__", stick)
    with serving(control, tmp_path, 0) as url, ExitStack() as ending:
        ending.callback(release.set)
        streams = [at_unix(tmp_path) if at == "socket" else at_port(url) for _ in range(2)]
        head = credentials(url) if at == "port" else "Host: haptic\r\n"
        for stream, line in zip(streams, ("GET /status", "POST /off"), strict=True):
            ending.enter_context(stream).sendall(f"{line} HTTP/1.1\r\n{head}\r\n".encode())
            assert stuck.wait(HANG_S)
        assert said_at(streams[1]) == (200, "idle")


def test_off_is_heard_while_strangers_crowd_the_port(control, tmp_path, monkeypatch):
    """With an event loop of the port that does nothing else any more."""
    stuck, release = threading.Event(), threading.Event()

    def stick(self, connection):
        stuck.set()
        release.wait(HANG_S)

    monkeypatch.setattr(TokenGate, "_refused", stick)
    with (
        serving(control, tmp_path, 0) as url,
        socket.create_connection(("127.0.0.1", httpx.URL(url).port)) as stream,
    ):
        stream.sendall(b"GET /status HTTP/1.1\r\nHost: x\r\n\r\n")
        assert stuck.wait(HANG_S)
        with at_unix(tmp_path) as lane:
            lane.sendall(b"POST /off HTTP/1.1\r\nHost: haptic\r\n\r\n")
            try:
                assert said_at(lane) == (200, "idle")
            finally:
                release.set()


def test_what_a_door_could_not_do_is_done_with_its_next_turn(control, tmp_path, monkeypatch):
    """Without memory any step may fail, and the system tells only once that something was said."""
    hear, failures = door.Door._hear, [MemoryError(), MemoryError()]

    def fail_first(self, caller):
        if failures:
            raise failures.pop()
        hear(self, caller)

    monkeypatch.setattr(door.Door, "_hear", fail_first)
    with serving(control, tmp_path), at_unix(tmp_path) as stream:
        stream.sendall(b"POST /off HTTP/1.1\r\nHost: haptic\r\n\r\n")
        assert said_at(stream) == (200, "idle")
    assert failures == []


WRITTEN = [
    "/off/",
    "/off/?why=1&x=/",
    "http://haptic/off",
    "HTTP://127.0.0.1:80/off/?x",
    "/disarm/",
]


@pytest.mark.parametrize("target", WRITTEN)
def test_off_is_off_however_its_request_is_written(control, tmp_path, target):
    """In its lane, where the headers are not waited for; and at the port, where they hold the
    token.
    """
    with serving(control, tmp_path, 0) as url:
        control.arm(5.0)
        with at_unix(tmp_path) as stream:
            stream.sendall(f"POST {target} HTTP/1.1\r\n".encode())
            assert said_at(stream)[0] == 200
        with at_port(url) as stream:
            stream.sendall(
                f"POST {target} HTTP/1.1\r\n{credentials(url)}Content-Length: 0\r\n\r\n".encode()
            )
            assert said_at(stream)[0] == 200
    word = "disarm" if "disarm" in target else "off"
    assert [call[0] for call in control.calls if call[0] != "arm"] == [word, word]


@pytest.mark.parametrize(
    "target", ["/offside", "/off/x", "//off", "/status?/off", "http://haptic", "/x/off"]
)
def test_what_only_looks_like_off_is_not(shared, target):
    assert shared.unix.request(
        "POST", "http://haptic", extensions={"target": target.encode()}
    ).status_code in (404, 405)
    assert shared.control.calls == []


@pytest.mark.parametrize(("stream", "word"), [("/state", "off"), ("/events", "disarm")])
def test_off_goes_over_a_stream_that_is_open(control, tmp_path, stream, word):
    """However crowded the port is, an open WebSocket needs no new connection."""
    with serving(control, tmp_path, 0) as url:
        token = url.partition("?token=")[2]
        with connect(f"ws://{authority(url)}{stream}?token={token}") as open_stream:
            control.arm(5.0)
            open_stream.send("something else")
            open_stream.send(word)
            assert until(lambda: [call[0] for call in control.calls if call[0] != "arm"]) == [word]


def test_a_new_connection_is_heard_whoever_has_taken_all_others(control, tmp_path, monkeypatch):
    """The oldest stranger makes room; those who have shown the token stay."""
    monkeypatch.setattr(door, "HEAD_TIMEOUT_S", HANG_S)
    with ExitStack() as open_ones, serving(control, tmp_path, 0) as url:
        token = url.partition("?token=")[2]
        stream = connect(f"ws://{authority(url)}/state?token={token}")
        known = open_ones.enter_context(stream)
        strangers = [open_ones.enter_context(at_port(url)) for _ in range(door.MOST_WAITING + 50)]
        for stranger in strangers:
            with suppress(ConnectionError):
                stranger.sendall(b"GET /status HTTP/1.1\r\nHost:")
        with at_port(url) as stream:
            stream.sendall(
                f"POST /off HTTP/1.1\r\n{credentials(url)}Content-Length: 0\r\n\r\n".encode()
            )
            assert said_at(stream) == (200, "idle")
        assert json.loads(known.recv(HANG_S))["status"]["state"] == "idle"


CROWD = """
import collections, socket, sys

open_ones = collections.deque()
while True:
    stranger = socket.socket()
    stranger.setblocking(False)
    stranger.connect_ex(("127.0.0.1", int(sys.argv[1])))
    try:
        stranger.send(sys.argv[2].encode())
    except OSError:
        pass
    open_ones.append(stranger)
    if len(open_ones) > 900:
        open_ones.popleft().close()
"""


CROWDS = {
    "silent": "",
    "half a request": "GET /status HTTP/1.1\r\nHost:",
    "a request": "GET /status HTTP/1.1\r\nHost: x\r\n\r\n",
    "a wrong token": "GET /status?token=x HTTP/1.1\r\nHost: x\r\n\r\n",
}


@pytest.mark.soak  # a race with an attacker: on a starved machine it needs patience
@pytest.mark.parametrize("sent", CROWDS.values(), ids=CROWDS)
def test_off_gets_through_a_crowd_at_the_port_by_new_connections(control, tmp_path, sent):
    """A stranger opens connections as fast as it can; 20 of 20 are heard, of which once there were
    5.
    """
    with serving(control, tmp_path, 0) as url:
        crowd = subprocess.Popen([sys.executable, "-c", CROWD, str(httpx.URL(url).port), sent])
        try:
            for _ in range(20):
                with at_port(url) as stream:
                    head = f"POST /off HTTP/1.1\r\n{credentials(url)}Content-Length: 0\r\n\r\n"
                    stream.sendall(head.encode())
                    assert said_at(stream) == (200, "idle")
        finally:
            crowd.kill()
            crowd.wait()


def test_a_port_without_descriptors_comes_back(control, tmp_path):
    with serving(control, tmp_path, 0) as url, socket.socket() as stream:
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        refused, pause = threading.Event(), door.Door._make_room

        def told(self, now_s):
            refused.set()
            pause(self, now_s)

        with pytest.MonkeyPatch.context() as meanwhile:
            meanwhile.setattr(door.Door, "_make_room", told)
            resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
            try:
                stream.connect(("127.0.0.1", httpx.URL(url).port))
                assert refused.wait(HANG_S)
            finally:
                resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            stream.sendall(
                f"POST /off HTTP/1.1\r\n{credentials(url)}Content-Length: 0\r\n\r\n".encode()
            )
            assert said_at(stream) == (200, "idle")


def test_off_is_answered_while_50_streams_wait_for_their_frames(control, tmp_path):
    """Frames take two threads, however many sockets want them; all others were taken once, and OFF
    came late.
    """
    inside, release, most = [], threading.Event(), []

    def hang(since_tick, most_samples):
        inside.append(1)
        most.append(len(inside))
        release.wait(HANG_S)
        inside.pop()
        return BenchControl.samples(control, since_tick, most_samples)

    control.samples = hang
    with ExitStack() as open_ones, serving(control, tmp_path), client_of(tmp_path) as client:
        open_ones.callback(release.set)
        for _ in range(50):
            open_ones.enter_context(unix_connect(str(tmp_path / "d.sock"), "ws://haptic/state"))
        until(lambda: len(inside) == api.FRAME_THREADS)
        assert client.get("/status", timeout=HANG_S / 2).json()["state"] == "idle"
        assert client.post("/off", timeout=HANG_S / 2).json()["output_on"] is False
        assert len(inside) == max(most) == api.FRAME_THREADS


def test_a_stream_that_nobody_reads_is_cut(control, tmp_path, monkeypatch):
    monkeypatch.setattr(door, "UNREAD_S", 0.1)
    monkeypatch.setattr(control, "samples", lambda since_tick, most: np.zeros(most, SAMPLE))
    columns = "&".join(f"column={name}" for name in SAMPLE.names)
    with (
        serving(control, tmp_path),
        at_unix(tmp_path) as unread,
        unix_connect(str(tmp_path / "d.sock"), "ws://haptic/state") as read,
    ):
        upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        asked = f"GET /state?period_s=0.02&{columns} HTTP/1.1\r\nHost: haptic\r\n{upgrade}{key}\r\n"
        unread.sendall(asked.encode())
        ended = select.poll()
        ended.register(unread, 0)
        until(lambda: ended.poll(0))  # hung up, with what was queued still unread
        assert json.loads(read.recv(HANG_S))["status"]["state"] == "idle"


@pytest.mark.parametrize("sent", [b"", b"GET /status HTTP/1.1\r\nHost:"])
def test_half_open_requests_are_ended(shared, monkeypatch, sent):
    monkeypatch.setattr(door, "HEAD_TIMEOUT_S", 0.2)
    host, _, port = shared.address.partition(":")
    stream = socket.create_connection((host, int(port)), timeout=HANG_S)
    with stream, suppress(ConnectionError):  # ended while something was still on its way
        stream.sendall(sent)
        assert stream.recv(1) == b""


def test_a_body_that_does_not_come_is_given_up(control, tmp_path, monkeypatch):
    monkeypatch.setattr(security, "BODY_TIMEOUT_S", 0.1)
    with serving(control, tmp_path), at_unix(tmp_path) as stream:
        stream.sendall(b"POST /record HTTP/1.1\r\nHost: haptic\r\nContent-Length: 1000\r\n\r\n{")
        assert said_at(stream) == (408, "too_late")


def test_connections_to_the_port_are_limited(control, tmp_path, monkeypatch):
    monkeypatch.setattr(door, "HEAD_TIMEOUT_S", HANG_S)
    most, more = door.MOST_WAITING, 40
    with ExitStack() as open_ones, serving(control, tmp_path, 0) as url:
        address = ("127.0.0.1", httpx.URL(url).port)
        streams = [
            open_ones.enter_context(socket.create_connection(address)) for _ in range(most + more)
        ]
        ended = until(lambda: len(found := select.select(streams, [], [], 0)[0]) >= more and found)
        assert len(ended) == more


def test_streams_count_and_outlast_the_timeout_of_headers(control, tmp_path, monkeypatch):
    monkeypatch.setattr(door, "HEAD_TIMEOUT_S", 0.4)
    with (
        serving(control, tmp_path),
        unix_connect(str(tmp_path / "d.sock"), "ws://haptic/state") as stream,
    ):
        until_s = time.monotonic() + 0.6
        while time.monotonic() < until_s:
            assert json.loads(stream.recv(HANG_S))["status"]["state"] == "idle"


# --- sockets and tokens
# ----------------------------------------------------------------------------------------


def test_socket_and_token_file_are_this_users_alone(control, tmp_path):
    before = os.umask(0)
    try:
        with serving(control, tmp_path, 0) as url:
            for name in ("d.sock", "d.sock.token"):
                assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600
            assert (tmp_path / "d.sock.token").read_text().strip() == url.partition("token=")[2]
    finally:
        os.umask(before)
    assert not list(tmp_path.glob("d.sock.token"))


def test_it_listens_on_loopback_alone(shared):
    port = int(shared.address.split(":")[1])
    states = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = {row[1] for row in states if row[3] == "0A" and row[1].endswith(f":{port:04X}")}
    assert listening == {f"0100007F:{port:04X}"}


def ask(address, method, path, **headers):
    connection = http.client.HTTPConnection(address, timeout=HANG_S)
    try:
        connection.putrequest(method, path, skip_host=True)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.putheader("Content-Length", "0")
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


@pytest.mark.parametrize(
    ("headers", "status", "code"),
    [
        ({}, 401, "no_token"),
        ({"Authorization": "Bearer wrong"}, 401, "no_token"),
        ({"Authorization": "Basic {token}"}, 401, "no_token"),
        ({"Authorization": "Bearer {token}", "Host": "evil.example"}, 403, "bad_host"),
        ({"Authorization": "Bearer {token}", "Origin": "http://evil.example"}, 403, "bad_origin"),
        ({"Authorization": "Bearer {token}", "Origin": "http://["}, 403, "bad_origin"),
        ({"Authorization": "Bearer {token}", "Origin": "http://localhost:1"}, 403, "bad_origin"),
    ],
)
def test_strangers_over_tcp_change_nothing(shared, headers, status, code):
    address, token = shared.address, shared.token
    port = address.split(":")[1]
    filled = {
        name: value.format(token=token, port=port)
        for name, value in ({"Host": "127.0.0.1:{port}"} | headers).items()
    }
    for path in [*CHANGES, "/none"]:
        said = ask(address, "POST", path, **filled)
        assert (said[0], said[1]["error"]["code"]) == (status, code)
    assert shared.control.calls == []


def test_pages_of_an_allowed_origin_may_use_the_api_with_the_token_alone(control, tmp_path):
    lab, evil = "http://localhost:5173", "http://evil.example"
    with serving(control, tmp_path, 0, origins=frozenset({origin_of(lab + "/app?x")})) as url:
        base, _, token = url.partition("/page/?token=")
        wanted = {"Access-Control-Request-Method": "POST"}
        asked = httpx.options(base + "/arm", headers={"Origin": lab, **wanted})
        assert asked.headers["access-control-allow-origin"] == lab
        may = {"Authorization": f"Bearer {token}"}
        said = httpx.get(base + "/status", headers={"Origin": lab, **may})
        assert said.headers["access-control-allow-origin"] == lab
        assert httpx.get(base + "/status", headers={"Origin": lab}).status_code == 401
        assert httpx.get(base + "/status", headers={"Origin": evil, **may}).status_code == 403
        channel = base.replace("http", "ws") + f"/commands?token={token}"
        with connect(channel, origin=lab) as line:
            line.send('{"verb": "status"}')
            assert json.loads(line.recv(HANG_S))["answer"]["state"] == "idle"
        with pytest.raises(InvalidStatus), connect(channel, origin=evil):
            pass


@pytest.mark.parametrize("page", ["file:///app.html", "http://["])
def test_what_is_no_address_of_pages_is_no_origin(page):
    with pytest.raises(BadInputError, match="no address of pages"):
        origin_of(page)


def test_the_page_is_open_but_nothing_else(control, tmp_path):
    page = tmp_path / "page"
    page.mkdir()
    (page / "index.html").write_text("<title>haptic</title>")
    with serving(control, tmp_path, 0, page=page) as url:
        base, _, token = url.partition("/page/?token=")
        assert "haptic" in httpx.get(base + "/", follow_redirects=True).text
        assert "default-src 'self'" in httpx.get(base + "/page/").headers["content-security-policy"]
        assert httpx.get(base + "/page/../status").status_code == 401
        assert httpx.get(base + "/page/%2e%2e/d.sock.token").status_code == 404
        assert httpx.post(base + "/page/").status_code == 401
        assert (
            httpx.get(base + "/status", headers={"Authorization": f"Bearer {token}"}).status_code
            == 200
        )


# --- streams
# ------------------------------------------------------------------------------------------------


def test_the_state_stream_sums_up_ticks(unix, tmp_path):
    with unix_connect(str(tmp_path / "d.sock"), "ws://haptic/state") as stream:
        first, second = (json.loads(stream.recv(HANG_S)) for _ in range(2))
    assert first["status"]["state"] == "idle"
    assert first["newest"]["lateness_s"] == 1.0
    assert first["newest"]["measured_cof"] is None
    assert first["ticks"]["count"] == 4  # tick 0 is not after tick 0
    assert first["ticks"]["lateness_median_s"] == pytest.approx((15e-6 + 3e-3) / 2)
    counts = dict(
        zip(first["ticks"]["lateness_edges_s"], first["ticks"]["lateness_counts"], strict=True)
    )
    assert {edge: count for edge, count in counts.items() if count} == {10e-6: 2, 2e-3: 1, 5e-3: 1}
    assert second["ticks"]["count"] == 1
    assert first["samples"] == {}


def test_the_state_stream_brings_the_columns_that_are_asked_for_of_all_ticks(unix, tmp_path):
    asked = "ws://haptic/state?period_s=0.02&column=tick&column=measured_cof&column=mood"
    with unix_connect(str(tmp_path / "d.sock"), asked) as stream:
        first, second = (json.loads(stream.recv(HANG_S))["samples"] for _ in range(2))
    assert first.keys() == second.keys() == {"tick", "measured_cof"}
    assert len(first["tick"]) == len(first["measured_cof"]) == 4
    assert second["tick"][0] > first["tick"][-1]
    assert first["measured_cof"][-1] is None
    with (
        pytest.raises(InvalidStatus),
        unix_connect(str(tmp_path / "d.sock"), "ws://haptic/state?period_s=0"),
    ):
        pass


def test_events_come_once_each_and_in_order(unix, control, tmp_path):
    with unix_connect(str(tmp_path / "d.sock"), "ws://haptic/events?since=0") as stream:
        assert json.loads(stream.recv(HANG_S))["kind"] == "state"
        unix.post("/arm", json={"lease_s": 5.0})
        control.fail("by hand")
        said = [json.loads(stream.recv(HANG_S)) for _ in range(2)]
    assert [event["number"] for event in said] == [2, 3]
    assert said[1]["message"] == "by hand"
    assert [e["number"] for e in unix.get("/events", params={"since": 2}).json()["events"]] == [3]


@pytest.mark.parametrize("stream", ["/state", "/events"])
def test_streams_over_tcp_need_token_and_origin(shared, stream):
    address, token = shared.address, shared.token
    for query, origin in (("", None), (f"?token={token}", "http://evil.example")):
        with pytest.raises(InvalidStatus), connect(f"ws://{address}{stream}{query}", origin=origin):
            pass
    with connect(f"ws://{address}{stream}?token={token}", origin=f"http://{address}") as messages:
        assert json.loads(messages.recv(HANG_S))


def test_serving_ends_with_streams_open(control, tmp_path):
    with ExitStack() as streams:
        with serving(control, tmp_path):
            stream = streams.enter_context(
                unix_connect(str(tmp_path / "d.sock"), "ws://haptic/state")
            )
            stream.recv(HANG_S)
        with pytest.raises(ConnectionClosed):  # noqa: PT012
            while True:
                stream.recv(HANG_S)
    assert not (tmp_path / "d.sock").exists()


# --- fuzzing
# ------------------------------------------------------------------------------------------------


FUZZED = BenchControl()
schema = schemathesis.openapi.from_asgi("/openapi.json", create_app(FUZZED))
checks.load_all_checks()
CHECKS = checks.CHECKS.get_by_names(
    [
        "not_a_server_error",
        "status_code_conformance",
        "content_type_conformance",
        "response_schema_conformance",
    ]
)


@schema.parametrize()
@settings(max_examples=10, derandomize=True, suppress_health_check=list(HealthCheck))
def test_whatever_is_sent_no_5xx_and_no_output_without_a_lease(case):
    case.call_and_validate(checks=CHECKS)
    assert FUZZED.machine.state in (
        DaemonState.IDLE,
        DaemonState.ARMED,
    )  # rendering takes the token of the lease
