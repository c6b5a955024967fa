"""The token that a service keeps, and the unit that it runs by."""

import json
import os
import sys

import pytest

from haptic_driver.daemon.private_file import kept_token
from haptic_driver.errors import BadInputError
from tests.haptic_driver.daemon.bench_control import BenchControl, serving


def test_a_token_is_made_once_and_kept(tmp_path):
    file = tmp_path / "token"
    token = kept_token(file)
    assert len(token) >= 24
    assert file.stat().st_mode & 0o777 == 0o600
    assert kept_token(file) == token


@pytest.mark.parametrize(
    ("text", "mode", "said"),
    [
        ("a" * 32, 0o644, "others may read"),
        ("short", 0o600, "holds no token"),
        ("a b" * 12, 0o600, "holds no token"),
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
    assert str(file) in error.value.hint


@pytest.mark.process
def test_the_page_has_the_kept_token_again(tmp_path):
    token = kept_token(tmp_path / "token")
    for _ in range(2):
        with serving(BenchControl(), tmp_path, 0, token=token) as url:
            assert url.endswith(f"?token={token}")


def test_the_unit_runs_this_installation_as_its_user(haptic, monkeypatch, tmp_path):
    monkeypatch.setenv("LOGNAME", "ada")
    file = tmp_path / "haptic@.service"
    assert haptic("daemon", "unit", "--out", str(file)).status == 0
    said = file.read_text()
    assert haptic("daemon", "unit", "--out", str(file)).status == 2  # nothing is overwritten
    assert "\nUser=ada\n" in said
    assert f"\nExecStart={os.path.dirname(sys.executable)}/haptic daemon run --rig %i " in said


def test_root_gets_no_unit(haptic, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LOGNAME", "root")
    done = haptic("daemon", "unit", "--json")
    assert json.loads(done.out)["error"]["code"] == "as_root"
    assert done.status == 2
    assert not list(tmp_path.iterdir())
