"""What the client makes of an answer that is not a daemon's, and of names and paths."""

import json
import socketserver
import threading
from http.server import BaseHTTPRequestHandler

import pytest

from haptic_driver.client import HapticClient
from haptic_driver.errors import HapticError


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
    [("linen", False), ("linen.toml", True), ("deep/linen", True), ("none.toml", False)],
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
