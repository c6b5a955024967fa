"""A session's recording is bound to its lease: who is killed leaves none running."""

from haptic_driver.client import HapticClient
from haptic_driver.lab.commands.experiment import _recorded
from haptic_driver.lab.psychophysics.data import SessionFiles
from tests.haptic_driver.daemon.bench_control import BenchControl, serving


def test_a_recording_has_the_lease_of_its_session(tmp_path):
    """One of a session that was killed went on for ever, and into the next participant's."""
    control, files = BenchControl(), SessionFiles(tmp_path / "out", "P1", "01", "made")
    with (
        serving(control, tmp_path),
        HapticClient(tmp_path / "d.sock") as client,
        client.armed(60.0) as held,
        _recorded(client, held, files, True),
    ):
        path = str(files.beh / "sub-P1_ses-01_task-made_recording.h5")
        assert control.recording == path
    recorded = [call for call in control.calls if call[0] == "record"]
    assert recorded == [("record", path, held.token), ("record", None, held.token)]
