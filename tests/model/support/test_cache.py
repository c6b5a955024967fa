from pathlib import Path

from model.support.cache import cache_dir


def test_environment_decides_in_this_order(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("HAPTIC_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_dir() == tmp_path / "home" / ".cache" / "haptic-driver"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_dir() == tmp_path / "xdg" / "haptic-driver"
    monkeypatch.setenv("HAPTIC_CACHE_DIR", str(tmp_path / "own"))
    assert cache_dir() == tmp_path / "own"


def test_empty_variables_count_as_absent(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("HAPTIC_CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert cache_dir() == tmp_path / ".cache" / "haptic-driver"


def test_asking_for_the_folder_creates_nothing(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("HAPTIC_CACHE_DIR", str(tmp_path / "own"))
    assert isinstance(cache_dir(), Path)
    assert list(tmp_path.iterdir()) == []
