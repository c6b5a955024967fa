"""The whole daemon on simulated instruments: what its callers are promised, checked at the
simulated electrode.
"""

import math
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from base64 import b64decode
from contextlib import suppress

import numpy as np
import pytest

from haptic_driver.config import find_config
from haptic_driver.daemon import recordings, supervision
from haptic_driver.daemon.messages import DaemonState, TileRequest
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.shared_memory import RING_SAMPLES
from haptic_driver.recording.read import read_run
from hw.amplifier.served_lines import ServedLines
from hw.transport.tcp import TcpTransport
from tests.haptic_driver.daemon.refusal import refusal
from tests.haptic_driver.daemon.waiting import LEASE_S, keep_rendering, lose_the_client, reset
from tests.waiting import exists, until

pytestmark = pytest.mark.process  # and real time where a test says so

DAEMON_RIG = "simulated"


@pytest.fixture
def electrode_v(history):
    """The voltage at the electrode now."""
    return lambda: history()[-1][1]


@pytest.mark.realtime
def test_friction_follows_its_target_through_bytes_and_back(daemon, electrode_v):
    lease = daemon.arm(LEASE_S)
    assert daemon.status().state is DaemonState.ARMED
    assert electrode_v() == 0.0
    for cof in (0.60, 0.68):
        daemon.targets.set(lease.token, cof)
        status = daemon.status()
        assert (status.state, status.target_cof) == (DaemonState.RENDERING, cof)
        keep_rendering(daemon, lease.token, lambda: electrode_v() > 10.0)

        def settled(cof=cof):
            found = daemon.samples(0, 300)
            sliding = np.isfinite(found["measured_cof"]) & (found["target_cof"] == cof)
            return (
                sliding.sum() > 250
                and abs(found["measured_cof"][sliding].mean() / cof - 1.0) < 0.05
            )

        keep_rendering(daemon, lease.token, settled)
    status = daemon.status()
    assert status.simulated
    low, high = status.reachable_cof
    assert 0.4 < low < 0.68 < high
    assert 1e-6 < status.current_rms_a < 0.5e-3  # below the limit for the public
    assert (status.target_cof, status.texture) == (0.68, None)
    status = daemon.off()
    assert electrode_v() == 0.0
    assert (status.state, status.output_on) == (DaemonState.ARMED, False)


def test_arming_waits_for_sensors_that_a_busy_machine_keeps_silent_for_a_moment(
    daemon, settings, monkeypatch
):
    read, silent = daemon.shared.sensed.read, iter([True] * 5)
    monkeypatch.setattr(
        daemon.shared.sensed,
        "read",
        lambda: read()._replace(force_time_s=0.0) if next(silent, False) else read(),
    )
    assert daemon.supervisor.silent() == "the force sensor is silent"
    ready = daemon.supervisor.refuse_unless_ready
    assert refusal(ready, settings, DaemonState.IDLE).code == "not_ready"
    daemon.arm(LEASE_S)
    assert daemon.status().state is DaemonState.ARMED


def test_a_friction_far_out_of_reach_is_refused_with_the_range_and_nothing_comes_on(
    daemon, electrode_v, tmp_path, monkeypatch
):
    """7 for 0.7, at one load: that of the simulated finger differs from moment to moment."""
    lease = daemon.arm(LEASE_S)
    low, high = reachable = daemon.basis.settings.render.tick.controller.reachable(0.5)
    monkeypatch.setattr(daemon.targets, "reach", lambda: (0.5, reachable))
    for cof in (7.0, 1.25 * high, 0.85 * low):
        with pytest.raises(
            BadInputError, match=r"far out of reach: 0\.\d+ to 1\.\d+ at 0\.\d+ N"
        ) as error:
            daemon.targets.set(lease.token, cof)
        assert error.value.code == "unreachable"
        assert "give nearest" in error.value.hint
    assert daemon.status().state is DaemonState.ARMED
    assert electrode_v() == 0.0
    mostly_far = tmp_path / "far.toml"
    mostly_far.write_text('kind = "uniform"\ncof = 4.0\n')
    with pytest.raises(BadInputError, match=r"most of .*far\.toml, 4 to 4, is far out of reach"):
        daemon.targets.play(lease.token, str(mostly_far))
    assert refusal(daemon.targets.set, "mine", 7.0).code == "not_yours"  # and is not told the range
    assert electrode_v() == 0.0
    daemon.targets.set(lease.token, 0.93 * low)
    assert daemon.status().state is DaemonState.RENDERING
    daemon.targets.set(lease.token, 7.0, nearest=True)
    assert daemon.status().target_cof == 7.0


@pytest.mark.realtime
def test_off_is_off_at_once_and_stays_so_until_asked_again(daemon, electrode_v, monkeypatch):
    """Once the page said "output off" and 71.64 V in one line."""
    lease = daemon.arm(LEASE_S)
    for _ in range(3):
        daemon.targets.set(lease.token, 0.65)
        keep_rendering(daemon, lease.token, lambda: electrode_v() > 1.5)
        last = daemon.shared.output.read()
        daemon.off()
        assert electrode_v() == 0.0
        time.sleep(0.02)
        assert electrode_v() == 0.0
    with monkeypatch.context() as late:
        late.setattr(daemon.shared.output, "read", lambda: last._replace(voltage_v=71.64))
        status = daemon.status()
    assert (status.output_on, status.voltage_v, status.frequency_hz) == (False, 0.0, None)


@pytest.mark.realtime
def test_a_lost_client_takes_the_output_to_zero_and_the_lease_away(daemon, electrode_v):
    lease = lose_the_client(daemon, lambda: electrode_v() > 10.0)
    assert electrode_v() == 0.0
    assert refusal(daemon.renew, lease.token).code == "lease_expired"  # as who held it is told
    assert "lease_lost" in daemon.status().flags
    until(lambda: any(event.kind == "lease" for event in daemon.events(0)))  # told after the state
    daemon.arm(LEASE_S)
    assert daemon.status().flags == []


@pytest.mark.realtime
@pytest.mark.soak
def test_another_fingers_model_is_used_from_then_on(daemon, settings, surface_file, tmp_path):
    """One for a skin held off the screen by half a micrometre; the finger, which is not, feels more
    than it expects.
    """
    reference = find_config("reference", "models").read_text()
    finger = tmp_path / "finger.toml"
    finger.write_text(re.sub(r"(gap_offset_m += {) value = 0.0,", r"\1 value = 0.5e-6,", reference))
    began = daemon.events(0)[-1].number
    other = build_surface(load_model(str(finger)), settings.config.operating_limits())
    for name, expected, is_more in ((str(finger), other, True), ("reference", surface_file, False)):
        status = daemon.use_model(name)
        assert (status.state, status.model) == (DaemonState.IDLE, name)
        assert status.surface_hash == expected.content_hash
        assert np.nanmax(np.array(daemon.surface_map()["cof"], float)) == pytest.approx(
            np.nanmax(expected.cof[:, :, 2]), rel=0.01
        )
        lease = daemon.arm(LEASE_S)
        assert refusal(daemon.use_model, "reference").code == "not_idle"
        daemon.targets.set(lease.token, 0.65)

        def learnt(is_more=is_more):
            """The finger's gain over a second of sliding: above 1 with one model, about 1 with the
            other.
            """
            gain = daemon.samples(0, 1000)["feedback_gain"][-300:]
            return (
                (gain > 1.05).all()
                if is_more
                else (np.abs(gain - 1.0) < 0.05).all() and gain.std() > 0.0
            )

        keep_rendering(daemon, lease.token, learnt)
        daemon.disarm()
    observer = until(
        lambda: exists(daemon.pids["observer"]) and daemon.pids["observer"]
    )  # begun in a thread
    assert not daemon.use_model("reference", 150.0, feedback=False).feedback
    assert daemon.pids["observer"] == observer  # the same finger on another carrier
    lease = daemon.arm(2.0)
    daemon.targets.set(lease.token, 0.65)
    keep_rendering(daemon, lease.token, lambda: daemon.status().frequency_hz == 150.0)
    keep_rendering(
        daemon, lease.token, lambda: set(daemon.samples(0, 100)["feedback_gain"]) == {1.0}
    )
    daemon.disarm()
    assert daemon.use_model("reference").feedback
    with pytest.raises(BadInputError, match="nobody"):
        daemon.use_model("nobody")
    assert daemon.status().model == "reference"
    assert not [event for event in daemon.events(began) if event.kind == "fault"]


def test_nothing_is_read_for_who_may_not_ask_or_while_it_is_refused(daemon, monkeypatch):
    """Clients without a lease once delayed OFF by 8.5 s; a model that was refused tripped the
    rig.
    """
    monkeypatch.setattr(daemon._loader, "_ask", lambda *asked: pytest.fail(f"read {asked}"))
    assert refusal(daemon.targets.play, "guessed", "linen").code == "not_armed"
    daemon.arm(LEASE_S)
    assert refusal(daemon.targets.play, "guessed", "linen").code == "not_yours"
    assert refusal(daemon.use_model, "reference").code == "not_idle"


def test_a_model_that_is_refused_leaves_the_daemon_as_it_was(daemon, tmp_path):
    (tmp_path / "finger.toml").write_text("a = " + "[" * 100_000)
    with pytest.raises(BadInputError, match="not valid TOML"):
        daemon.use_model(str(tmp_path / "finger.toml"))
    assert daemon.arm(LEASE_S).token


def test_running_out_of_file_descriptors_is_survived(daemon, monkeypatch):
    """What died is tried again until descriptors are there again, and the daemon says what is in
    the way.
    """
    monkeypatch.setattr(supervision, "RETRY_S", 0.1)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    try:
        os.kill(daemon.pids["render"], signal.SIGKILL)
        until(lambda: "cannot be started again: OSError: [Errno 24]" in daemon.supervisor.missing)
        assert daemon.status().state is DaemonState.FAULT
        assert "Too many open files" in refusal(daemon.reset).message
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    until(lambda: not daemon.supervisor.missing)
    assert daemon.reset().state is DaemonState.IDLE


@pytest.mark.parametrize(
    "how", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.soak)]
)
def test_render_that_goes_while_the_instruments_come_back_comes_back_too(daemon, monkeypatch, how):
    """Each waited for the other for as long as the daemon lived."""
    monkeypatch.setattr(supervision, "RETRY_S", 0.1)
    monkeypatch.setattr(supervision, "HEARD_S", 3.0)
    os.kill(daemon.pids["instruments"], signal.SIGKILL)
    until(lambda: daemon.supervisor.missing)
    render = daemon.pids["render"]
    os.kill(render, how)
    until(lambda: not daemon.supervisor.missing, lambda: daemon.supervisor.missing)
    assert daemon.pids["render"] != render
    reset(daemon)


def test_a_marker_stands_in_the_recording_with_the_way_to_wall_time(daemon, tmp_path):
    """Of two bytes a letter 130 are 260."""
    assert refusal(daemon.record, str(tmp_path / f"{'é' * 130}.h5")).code == "name_too_long"
    daemon.record(str(tmp_path / "run.h5"))
    assert refusal(daemon.use_model, "reference").code == "recording"
    before_s = time.time()
    marked = daemon.mark("trial 7", {"level": 0.1, "order": [1, 2]})
    after_s = time.time()
    daemon.record(None)
    run = read_run(tmp_path / "run.h5")
    assert run.attributes["model"] == "reference"
    assert run.attributes["calibration_ids"]["amplifier"] == "simulation, 2024-01-01"
    (marker,) = [event for event in run.events if event.kind == "marker"]
    assert (marker.message, marker.data) == ("trial 7", {"level": 0.1, "order": [1, 2]})
    assert (marker.number, marker.time_s) == (marked.number, marked.time_s)
    slack_s = 1e-3  # the offset is measured some microseconds before, and clocks are steered
    for offset_s in (marked.wall_offset_s, run.attributes["wall_offset_s"]):
        assert before_s - slack_s <= marker.time_s + offset_s <= after_s + slack_s
    assert (
        math.isnan(run.attributes["lsl_offset_s"])
        == (marked.lsl_offset_s is None)
        == ("pylsl" not in sys.modules)
    )


def recording_events(daemon, since):
    return [event.message for event in daemon.events(since) if event.kind == "recording"]


@pytest.mark.realtime
@pytest.mark.soak
def test_ticks_that_a_stopped_recorder_loses_are_said_in_status_events_and_file(daemon, tmp_path):
    """4,134 ticks were once missing from a run that said it was complete."""
    path, since = tmp_path / "run.h5", max(event.number for event in daemon.events(0))
    daemon.record(str(path))
    until(lambda: read_run(path).samples.size)
    recorder = daemon.pids["recorder"]
    begun = daemon.shared.ring.position
    os.kill(recorder, signal.SIGSTOP)
    try:
        until(lambda: daemon.shared.ring.position > begun + RING_SAMPLES + 1000)
    finally:
        os.kill(recorder, signal.SIGCONT)
    fault = until(lambda: daemon.status().recording_fault)
    assert re.match(rf"\d{{3,}} ticks are missing in {path}", fault)
    assert daemon.status().recording == str(path)
    assert fault in until(
        lambda: [said for said in recording_events(daemon, since) if "missing" in said]
    )
    assert refusal(daemon.record, None).message == f"the recording is not whole: {fault}"
    assert any(said == f"ended, not whole: {fault}" for said in recording_events(daemon, since))
    run = read_run(path)
    assert f"{run.attributes['samples_lost']:.0f} ticks are missing" in fault
    assert (run.attributes["complete"], run.attributes["why_incomplete"]) == (False, fault[:240])
    jump = np.diff(run.samples["tick"].astype(np.int64)).max() - 1
    assert jump >= run.attributes["samples_lost"]
    assert daemon.status().recording_fault is None


@pytest.mark.realtime
def test_a_recording_ends_with_the_lease_of_who_asked_for_it(daemon, tmp_path, monkeypatch):
    """`haptic experiment run --record` that was killed left it running for ever."""
    monkeypatch.setattr(recordings, "AFTER_LEASE_S", 0.2)
    since = max(event.number for event in daemon.events(0))
    lease = daemon.arm(1.0)
    daemon.record(str(tmp_path / "run.h5"), lease.token)
    keep_rendering(daemon, lease.token, lambda: read_run(tmp_path / "run.h5").samples.size)
    assert daemon.status().recording is not None
    until(lambda: daemon.status().recording is None)  # nobody renews any more
    until(lambda: f"ended: {tmp_path / 'run.h5'}" in recording_events(daemon, since))
    assert "ends, since the lease with which it was begun is over" in recording_events(
        daemon, since
    )
    assert read_run(tmp_path / "run.h5").attributes["complete"] is True


def test_a_recording_without_a_lease_goes_on_and_is_not_stopped_by_another(
    daemon, tmp_path, monkeypatch
):
    monkeypatch.setattr(recordings, "AFTER_LEASE_S", 0.0)
    lease = daemon.arm(LEASE_S)
    daemon.record(str(tmp_path / "run.h5"))
    daemon.disarm()
    daemon.record(None, lease.token)
    assert daemon.status().recording == str(tmp_path / "run.h5")
    daemon.record(None)
    assert refusal(daemon.record, str(tmp_path / "other.h5"), lease.token).code == "not_yours"
    assert not (tmp_path / "other.h5").exists()


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 16 MB that is at its end after a minute of recording."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", disk], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("may not mount a file system here")
    yield disk
    subprocess.run(["umount", "--lazy", disk], check=True)


@pytest.mark.realtime
def test_a_full_disk_is_told_rendering_goes_on_and_recording_resumes(
    daemon, small_disk, electrode_v, monkeypatch
):
    """Once the daemon said "recording" for ever, of a file that said it was complete and was
    not.
    """
    monkeypatch.setattr(recordings, "SPACE_BYTES", 2 << 20)
    monkeypatch.setattr(recordings, "LOOK_S", 0.1)
    ballast = small_disk / "ballast"
    path = small_disk / "run.h5"
    since = max(event.number for event in daemon.events(0))
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.6)
    daemon.record(str(path))
    keep_rendering(daemon, lease.token, lambda: read_run(path).samples.size > 500)
    with suppress(OSError):  # the recorder may have taken what was free
        ballast.write_bytes(
            b"x" * (shutil.disk_usage(small_disk).free & ~4095)
        )  # not a byte is free now
    keep_rendering(daemon, lease.token, lambda: daemon.status().recording_fault)
    status = daemon.status()
    assert (status.state, status.recording) == (DaemonState.RENDERING, None)
    assert "No space left on device" in status.recording_fault
    keep_rendering(
        daemon, lease.token, lambda: electrode_v() > 10.0
    )  # zero, for a moment, where a busy machine was late
    assert any(
        "No space left" in event.message
        for event in daemon.events(since)
        if event.kind == "recording"
    )
    first = read_run(path)
    assert first.attributes["complete"] is False
    assert "No space left on device" in first.attributes["why_incomplete"]
    assert (np.diff(first.samples["tick"].astype(np.int64)) > 0).all()
    assert np.isfinite(first.samples["time_s"]).all()
    ballast.unlink()
    keep_rendering(daemon, lease.token, lambda: daemon.status().recording)
    assert daemon.status().recording == str(small_disk / "run-2.h5")
    keep_rendering(daemon, lease.token, lambda: read_run(small_disk / "run-2.h5").samples.size)
    with pytest.raises(
        HapticError, match=r"No space left on device.*then into .*run-2\.h5"
    ) as failed:
        daemon.record(None)
    assert failed.value.code == "recording_failed"
    assert read_run(small_disk / "run-2.h5").attributes["complete"] is True
    status = daemon.status()
    assert (status.recording, status.recording_fault) == (None, None)


@pytest.mark.realtime
def test_beside_a_force_sensor_current_and_monitors_are_in_samples_and_status(daemon):
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.7)

    def agrees():
        """Both monitors with the command, once it has risen: they look seldom."""
        last = daemon.samples(0, 1)
        monitors_v = [last[name] for name in ("electrode_voltage_v", "monitor_voltage_v")]
        told = np.isfinite(last["current_a"]) & np.isfinite(last["measured_cof"])
        return told.all() and np.allclose(monitors_v, last["voltage_v"], rtol=0.1)

    keep_rendering(daemon, lease.token, agrees)
    made = daemon.samples(0, 100)
    assert np.isnan(made["estimated_cof"]).all()
    until(lambda: daemon.status().normal_force_n)
    status = daemon.status()
    assert status.estimated_cof is None
    assert status.normal_force_n == pytest.approx(0.5, rel=0.2)
    assert 0.0 < status.position_x_m < daemon.basis.settings.config.screen.width_m


def test_textures_are_swapped_while_they_play_and_can_be_drawn(daemon):
    lease = daemon.arm(LEASE_S)
    assert {"grating", "sandpaper", "steps"} <= set(daemon.textures())
    for name in ("grating", "sandpaper", "linen", "steps", "grating"):
        daemon.targets.play(lease.token, name)
        status = daemon.status()
        assert (status.state, status.texture) == (DaemonState.RENDERING, name)
        daemon.renew(lease.token)
    drawn = daemon.texture_map()
    assert np.shape(drawn["cof"]) == (len(drawn["y_m"]), len(drawn["x_m"]))
    x = np.array(drawn["x_m"])
    grating = np.array(drawn["cof"])[0]
    assert np.ptp(grating[x < 0.02]) > 0.02


def test_a_texture_of_the_library_can_be_looked_at_without_keeping_who_plays_one(daemon):
    asked = TileRequest(name="fine_grating", pitch_m=1e-4, columns=100, rows=2)
    tile = daemon.tile(asked)
    levels = np.frombuffer(b64decode(tile.levels), np.uint8).reshape(2, 100)
    assert np.abs(np.fft.rfft(levels[0]))[1:].argmax() + 1 == 10  # of 1 mm, over 10 mm
    assert (tile.cof_low, tile.cof_high) == pytest.approx((0.58, 0.72))
    assert daemon.pids["painter"] != daemon.pids["loader"]


def test_the_limits_that_are_drawn_are_those_that_are_kept(daemon, surface_file):
    """The least of them forbids what the surface file marks as forbidden, by code of its own."""
    drawn = daemon.surface_map()
    assert np.shape(drawn["cof"]) == (len(drawn["frequency_hz"]), len(drawn["voltage_v"]))
    lowest_v = np.min(
        [[np.inf if v is None else v for v in one] for one in drawn["limits_v"].values()], axis=0
    )
    load = int(np.abs(surface_file.normal_force_n - 0.5).argmin())
    for hz, most_v in zip(drawn["frequency_hz"], lowest_v, strict=True):
        allowed = surface_file.within_limits[
            int(np.argmin(np.abs(surface_file.frequency_hz - hz))), :, load
        ]
        marked_v = surface_file.voltage_v[np.flatnonzero(allowed)[-1]]
        assert most_v <= marked_v + np.diff(surface_file.voltage_v)[0]


def test_samples_and_events_are_told_once(daemon):
    last = int(daemon.samples(0, 1)["tick"][0])
    until(lambda: daemon.status().ticks > last + 20)
    more = daemon.samples(last, 50)
    assert len(more) >= 10
    assert np.all(more["tick"] > last)
    assert np.all(np.diff(more["tick"].astype(int)) >= 1)
    daemon.arm(LEASE_S)
    events = daemon.events(0)
    assert [event.number for event in events] == list(
        range(events[0].number, events[0].number + len(events))
    )
    assert daemon.events(events[-1].number) == []
    assert len(daemon.events(events[-2].number)) == 1


def test_a_trip_of_the_amplifier_is_a_fault_until_it_is_reset(daemon, electrode_v):
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.65)
    keep_rendering(daemon, lease.token, lambda: electrode_v() > 10.0)
    lines = ServedLines(TcpTransport.from_resource(daemon.supervisor.endpoints["amplifier_lines"]))
    lines.write(False)  # somebody presses the E-stop
    lines.close()
    until(lambda: daemon.status().state is DaemonState.FAULT)
    assert electrode_v() == 0.0
    status = daemon.status()
    assert "enable line" in status.fault
    assert "tripped" in status.flags
    assert refusal(daemon.renew, lease.token).code == "not_armed"
    assert refusal(daemon.arm, 1.0).code == "fault"
    assert daemon.reset().state is DaemonState.IDLE
    assert daemon.status().fault is None
