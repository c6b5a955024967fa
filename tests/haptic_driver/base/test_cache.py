import os
import stat

import pytest

from haptic_driver.base.cache import cache_dir, code_cache


def test_environment_decides_in_this_order(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("HAPTIC_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_dir() == tmp_path / "home" / ".cache" / "haptic-driver"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_dir() == tmp_path / "xdg" / "haptic-driver"
    monkeypatch.setenv("HAPTIC_CACHE_DIR", str(tmp_path / "own"))
    assert cache_dir() == tmp_path / "own"


def test_empty_variables_count_as_absent(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("HAPTIC_CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert cache_dir() == tmp_path / ".cache" / "haptic-driver"


def mode(path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_machine_code_is_kept_where_nobody_else_can_write_whatever_the_umask(monkeypatch, tmp_path):
    monkeypatch.setenv("HAPTIC_CACHE_DIR", str(tmp_path))
    before = os.umask(0)
    try:
        assert code_cache() == tmp_path / "kernels"
    finally:
        os.umask(before)
    assert mode(tmp_path / "kernels") == 0o700


def test_a_folder_that_others_could_write_to_is_closed(monkeypatch, tmp_path):
    monkeypatch.setenv("HAPTIC_CACHE_DIR", str(tmp_path))
    (tmp_path / "kernels").mkdir(mode=0o777)
    (tmp_path / "kernels").chmod(0o777)
    assert mode(code_cache()) == 0o700


@pytest.mark.parametrize("foreign", ["owner", "link", "file"])
def test_a_folder_of_somebody_else_is_not_used(monkeypatch, tmp_path, foreign):
    """Machine code runs without being looked at."""
    monkeypatch.setenv("HAPTIC_CACHE_DIR", str(tmp_path))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    if foreign == "link":
        (tmp_path / "kernels").symlink_to(elsewhere)
    if foreign == "file":
        (tmp_path / "kernels").write_text("in the way")
    if foreign == "owner":
        own = os.getuid()
        monkeypatch.setattr(os, "getuid", lambda: own + 1)
    assert code_cache().parent != tmp_path
