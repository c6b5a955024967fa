"""An API in this process that commands find by themselves."""

import pytest

from tests.haptic_driver.daemon.bench_control import BenchControl, serving
from tests.haptic_driver.lab.refusal import refuses

__all__ = ["refuses"]


@pytest.fixture(scope="package")
def served(tmp_path_factory):
    """One for all, and where it serves."""
    control, folder = BenchControl(), tmp_path_factory.mktemp("served")
    with serving(control, folder):
        yield control, folder / "d.sock"


@pytest.fixture
def control(served):
    """Idle and as it was at first."""
    control, socket = served
    control.begin_anew()
    socket.with_name("d.sock.lease").unlink(missing_ok=True)
    return control


@pytest.fixture
def socket(served, control, monkeypatch):
    """Where the API serves; commands find it by themselves."""
    monkeypatch.setenv("HAPTIC_SOCKET", str(served[1]))
    return served[1]
