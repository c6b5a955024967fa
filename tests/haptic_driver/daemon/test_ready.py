"""What keeps a real rig from being armed, though all of it is there."""

import pytest

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from tests.haptic_driver.daemon.refusal import refusal


def refused(config, surface_file):
    """The refusal of a daemon that was never started, and that has heard from everybody."""
    render = render_settings(config, surface_file)
    settings = DaemonSettings("real", "reference", config, surface_file, render)
    daemon = Daemon(settings)
    daemon.supervisor.missing, daemon.supervisor.silent = "", lambda: ""
    try:
        return refusal(daemon.supervisor.refuse_unless_ready, settings, DaemonState.IDLE)
    finally:
        daemon.close()


@pytest.fixture
def real(rig_config):
    return rig_config.model_copy(update={"simulated": False})


def test_what_nobody_vouches_for_is_listed(real, surface_file):
    limits, amplifier = (
        section.model_copy(update={"measured_by": ""}) for section in (real.limits, real.amplifier)
    )
    unsigned = real.model_copy(update={"limits": limits, "amplifier": amplifier})
    found = refused(unsigned, surface_file)
    assert found.code == "unverified"
    assert "limits.measured_by" in found.message
    assert "amplifier.measured_by" in found.message


def test_fingers_that_the_rigs_figure_does_not_cover(real, surface_file, monkeypatch):
    """What is covered is in `test_readings.py`; while it is armed, in `test_watchers.py`."""
    monkeypatch.setattr(DaemonSettings, "not_covered", lambda self, sensed: "2 fingers touch")
    found = refused(real, surface_file)
    assert (found.code, found.message) == ("not_covered", "2 fingers touch")


def test_a_machine_without_real_time_scheduling(real, surface_file):
    assert refused(real, surface_file).code == "no_real_time"
