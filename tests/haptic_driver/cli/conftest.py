"""An API in this process that commands find by themselves."""

import pytest

from tests.haptic_driver.daemon.bench_control import BenchControl, serving


@pytest.fixture
def control():
    return BenchControl()


@pytest.fixture
def socket(control, tmp_path, monkeypatch):
    """Where an API serves; commands find it by themselves."""
    monkeypatch.setenv("HAPTIC_SOCKET", str(tmp_path / "d.sock"))
    with serving(control, tmp_path):
        yield tmp_path / "d.sock"
