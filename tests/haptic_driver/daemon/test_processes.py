"""One daemon per place; children say that they are ready, and how they ended."""

import os
import signal
import socket
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from haptic_driver.daemon.address import Address
from haptic_driver.daemon.place import Place
from haptic_driver.errors import HapticError
from haptic_driver.processes.child import Child
from tests.waiting import until

LEFT_BEHIND = """
import os, sys
from pathlib import Path
from haptic_driver.daemon.place import Place
place = Place(Path(sys.argv[1]))
os.kill(os.getpid(), 9)
"""


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run" / "daemon.sock"


def test_the_socket_can_be_reached_by_its_user_alone_and_goes_with_the_daemon(path):
    place = Place(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))
    place.close()
    assert not path.exists()


def test_a_second_daemon_at_the_same_place_is_refused_and_leaves_the_first_alone(path):
    place = Place(path)
    with pytest.raises(HapticError) as refused:
        Place(path)
    assert refused.value.code == "already_running"
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))
    place.close()


def test_a_lock_that_is_a_link_or_of_another_user_is_not_followed(path, tmp_path, monkeypatch):
    path.parent.mkdir(mode=0o700)
    aim, lock = tmp_path / "aim", path.with_name("daemon.sock.lock")
    lock.symlink_to(aim)
    with pytest.raises(HapticError) as refused:
        Place(path)
    assert refused.value.code == "no_socket"
    assert not aim.exists()
    lock.unlink()
    lock.touch()
    real = os.fstat
    with monkeypatch.context() as patched:
        patched.setattr(os, "fstat", lambda file: SimpleNamespace(st_uid=real(file).st_uid + 1))
        with pytest.raises(HapticError, match="belongs to another user"):
            Place(path)


@pytest.mark.process
def test_what_a_killed_daemon_left_behind_is_replaced(path):
    killed = subprocess.run([sys.executable, "-c", LEFT_BEHIND, str(path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert path.exists()
    place = Place(path)
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))
    place.close()


def test_a_folder_that_takes_no_files_is_named():
    with pytest.raises(HapticError, match=r"/proc/daemon\.sock: cannot listen there") as refused:
        Place(Path("/proc/daemon.sock"))
    assert refused.value.code == "no_socket"


def test_a_file_that_is_no_socket_is_left_alone(path):
    path.parent.mkdir(mode=0o700)
    path.write_text("precious")
    with pytest.raises(HapticError) as refused:
        Place(path)
    assert refused.value.code == "not_a_socket"
    assert path.read_text() == "precious"


def test_a_folder_in_which_others_may_write_is_refused(path):
    path.parent.mkdir()
    path.parent.chmod(0o777)
    with pytest.raises(HapticError) as refused:
        Place(path)
    assert refused.value.code == "folder_not_private"


def test_the_default_socket_is_in_the_users_own_runtime_folder(monkeypatch, tmp_path):
    monkeypatch.delenv("HAPTIC_SOCKET", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert Address.of(None).path == tmp_path / "haptic" / "daemon.sock"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert f"haptic-{os.getuid()}" in str(Address.of(None).path)


def test_a_daemon_by_its_page_has_its_lease_in_the_users_own_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    address = Address.of("http://127.0.0.1:8470/page/?token=secret")
    assert address.lease_file == tmp_path / "haptic" / "127.0.0.1-8470.lease"
    assert str(address) == "http://127.0.0.1:8470"


@pytest.mark.process
def test_a_child_that_says_nothing_useful_is_ended_and_told_of():
    child = Child("loader", "this", [])  # the module prints a poem
    with pytest.raises(HapticError) as refused:
        child.ready(30.0)
    assert refused.value.code == "not_started"
    assert child.ended is not None


@pytest.mark.process
def test_how_a_child_ended_is_said_in_words(tmp_path):
    child = Child("painter", "json.tool", ["/dev/stdin"])
    assert child.ended is None
    os.kill(child.pid, signal.SIGKILL)
    child.stop()
    assert child.ended == "the painter process was killed by SIGKILL"
    failing = Child("loader", "json.tool", [str(tmp_path / "missing")])
    until(lambda: failing.ended is not None)
    assert "the loader process ended with status" in failing.ended
    failing.stop()


@pytest.mark.process
@pytest.mark.parametrize(
    "module", ["haptic_driver.recording.process", "haptic_driver.daemon.loader"]
)
def test_who_compiles_nothing_starts_without_numba(module):
    code = f"import sys, {module}; sys.exit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], timeout=120, check=True)


def test_a_socket_that_somebody_deleted_is_there_again(tmp_path):
    path = tmp_path / "run" / "daemon.sock"
    place = Place(path)
    path.unlink()
    place.keep()
    place.keep()
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))
        place.listener.accept()[0].close()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    place.close()
    assert sorted(name.name for name in path.parent.iterdir()) == ["daemon.sock.lock"]
