"""The token that a service keeps, and the unit that it runs by."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_driver.daemon.private_file import kept_token
from haptic_driver.errors import BadInputError, HapticError
from tests.haptic_driver.daemon.waiting import until_ready
from tests.waiting import HANG_S

HAPTIC = Path(sys.executable).with_name("haptic")


def test_a_token_is_made_once_and_kept(tmp_path):
    file = tmp_path / "token"
    token = kept_token(file)
    assert len(token) >= 24
    assert file.stat().st_mode & 0o777 == 0o600
    assert kept_token(file) == token


@pytest.mark.parametrize(
    ("text", "mode", "said"),
    [
        ("a" * 32, 0o644, "only you can read"),
        ("short", 0o600, "holds no token"),
        ("a b" * 12, 0o600, "holds no token"),
        ("a" * 1000, 0o600, "holds no token"),
        ("", 0o600, "holds no token"),
    ],
)
def test_a_file_that_is_no_secret_is_refused(tmp_path, text, mode, said):
    file = tmp_path / "token"
    file.write_text(text)
    os.chmod(file, mode)
    with pytest.raises(BadInputError, match=said) as error:
        kept_token(file)
    assert error.value.code == "bad_token"


def test_what_is_no_file_of_this_user_alone_is_refused_at_once(tmp_path):
    """A pipe held the start for ever; what a link points to is another's to change."""
    os.mkfifo(tmp_path / "pipe", 0o600)
    kept_token(tmp_path / "else")
    (tmp_path / "link").symlink_to(tmp_path / "else")
    (tmp_path / "folder").mkdir(0o700)
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    for name in ("pipe", "link", "folder", "open/token", "no\0name", "pipe/token"):
        with pytest.raises(HapticError):
            kept_token(tmp_path / name)


@pytest.mark.process
def test_a_daemon_has_the_kept_token_and_tells_it_to_no_log(tmp_path):
    token = kept_token(tmp_path / "token")
    words = [HAPTIC, "daemon", "run", "--rig", "simulated", "--socket", tmp_path / "d.sock"]
    words += ["--port", "0", "--token-file", tmp_path / "token"]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        until_ready(running)
        beside_the_socket = (tmp_path / "d.sock.token").read_text().strip()
        running.terminate()
        said, log = running.communicate(timeout=HANG_S)
    assert beside_the_socket == token
    assert token not in said + log
    assert "/page/" in said
    assert kept_token(tmp_path / "token") == token  # it stays


def test_the_sockets_own_token_file_is_no_place_to_keep_one(haptic, tmp_path):
    socket = tmp_path / "d.sock"
    said = haptic(
        "daemon", "run", "--socket", str(socket), "--token-file", f"{socket}.token", "--json"
    ).said
    assert said["error"]["code"] == "bad_token"


def test_the_unit_runs_this_installation_as_its_user(haptic, monkeypatch, tmp_path):
    monkeypatch.setenv("LOGNAME", "ada")
    file = tmp_path / "haptic@.service"
    assert haptic("daemon", "unit", "--out", str(file)).status == 0
    said = file.read_text()
    assert haptic("daemon", "unit", "--out", str(file)).status == 2  # nothing is overwritten
    assert "\nUser=ada\n" in said
    assert f'\nExecStart="{HAPTIC}" daemon run --rig %i ' in said


def test_root_gets_no_unit(haptic, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LOGNAME", "root")
    done = haptic("daemon", "unit", "--json")
    assert json.loads(done.out)["error"]["code"] == "as_root"
    assert done.status == 2
    assert not list(tmp_path.iterdir())
