"""A scene on the daemon: changed as one, off stays off, refused as textures are, and replayed."""

import math
import re
import runpy
import time
from contextlib import chdir, closing
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.cli.main import main
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.verbs import SceneChange
from haptic_driver.daemon.web.server import serve
from haptic_driver.errors import BadInputError
from haptic_driver.lab.scene_replay import SceneReplay
from haptic_driver.recording.read import read_run
from tests.waiting import until

pytestmark = pytest.mark.process  # and real time where a test says so

DAEMON_RIG = "simulated"
EXAMPLE = Path(__file__).parents[3] / "examples" / "5_drag_an_object.py"
LEASE_S = 20.0
CIRCLE = {"kind": "circle", "radius_mm": 8.0}
BOX = {"kind": "rectangle", "width_mm": 200.0, "height_mm": 120.0}
KEY = {"do": "add", "id": "key", "shape": CIRCLE, "origin_mm": [30.0, 30.0], "cof": 0.7}
EVERYWHERE = {"do": "background", "cof": 0.55}


@pytest.fixture
def change(daemon):
    """Changes of the scene, by whoever has armed."""
    token = daemon.arm(LEASE_S).token

    def changed(*changes, **options):
        asked = SceneChange.model_validate({"changes": list(changes)}).changes
        return daemon.targets.change_scene(token, asked, **options)

    return changed


def scene(daemon):
    return daemon.targets.scene_shown().scene


def test_the_first_change_renders_and_off_stays_off_until_somebody_shows_it(daemon, change):
    assert change(EVERYWHERE, KEY).rendering
    assert daemon.status().state is DaemonState.RENDERING
    assert daemon.status().texture == "scene"
    daemon.off()
    assert not change({"do": "move", "id": "key", "x_mm": 40.0, "y_mm": 20.0}).rendering
    assert not change(KEY | {"id": "linen", "cof": None, "texture": "linen"}).rendering
    assert daemon.status().state is DaemonState.ARMED
    assert daemon.status().output_on is False
    assert change(show=True).rendering
    assert [each.id for each in scene(daemon).object] == ["key", "linen"]
    assert scene(daemon).object[0].origin_mm == [40.0, 20.0]


@pytest.mark.realtime
def test_several_changes_are_one_for_the_ticks(daemon, change):
    """Two boxes that change places: whoever sees but one of them moved is asked for another
    friction.
    """
    first = {"do": "add", "id": "a", "shape": BOX, "origin_mm": [50.0, 30.0], "cof": 0.62}
    other = {"do": "add", "id": "b", "shape": BOX, "origin_mm": [450.0, 300.0], "cof": 0.66}
    change({"do": "background", "cof": 0.9}, first, other)
    here, there = (50.0, 30.0), (450.0, 300.0)
    until(lambda: daemon.shared.output.read().target == daemon._orders.order.target)
    begun = daemon.shared.output.read().tick
    for k in range(150):
        places = (here, there) if k % 2 else (there, here)
        moves = [
            {"do": "move", "id": name, "x_mm": x_mm, "y_mm": y_mm}
            for name, (x_mm, y_mm) in zip("ab", places, strict=True)
        ]
        change(*moves)
        time.sleep(0.003)
    asked = daemon.samples(begun, 1 << 14)["asked_cof"]
    assert set(np.round(asked[np.isfinite(asked)], 6)) == {0.62, 0.66}


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (KEY, "object_exists"),
        ({"do": "move", "id": "kex", "x_mm": 1.0, "y_mm": 1.0}, "unknown_object"),
        (KEY | {"id": "b", "cof": None, "texture": "linnen"}, "unknown_texture"),
        (KEY | {"id": "b", "cof": None, "texture": "steps"}, "bad_script"),
        (KEY | {"id": "b", "cof": 4.0}, "unreachable"),
        (KEY | {"id": "b", "origin_mm": [-9.0, 30.0]}, "off_screen"),
        ({"do": "move", "id": "key", "x_mm": 650.0, "y_mm": 30.0}, "off_screen"),
        (
            KEY | {"id": "b", "shape": {"kind": "mask", "file": "/no.png", "width_mm": 9.0}},
            "file_not_found",
        ),
    ],
)
def test_what_cannot_be_changes_nothing(daemon, change, wrong, code):
    change(EVERYWHERE, KEY)
    before = scene(daemon)
    with pytest.raises(BadInputError) as refusal:
        change({"do": "move", "id": "key", "x_mm": 35.0, "y_mm": 30.0}, wrong)
    assert refusal.value.code == code
    assert refusal.value.hint
    assert scene(daemon) == before
    change({"do": "move", "id": "key", "x_mm": 36.0, "y_mm": 30.0})  # and it goes on


def test_a_file_is_a_scene_whose_objects_can_be_moved_until_another_target_ends_it(
    daemon, tmp_path, change
):
    (tmp_path / "keys.toml").write_text(
        'kind = "scene"\nbackground = { cof = 0.6 }\n[[object]]\nid = "key"\ncof = 0.7\n'
        'shape = { kind = "circle", radius_mm = 4.0 }\norigin_mm = [20.0, 20.0]\n'
    )
    daemon.targets.play(daemon._orders.machine._lease.token, str(tmp_path / "keys.toml"))
    change({"do": "move", "id": "key", "x_mm": 60.0, "y_mm": 20.0})
    assert scene(daemon).object[0].origin_mm == [60.0, 20.0]
    x_m, cof = daemon.texture_map()["x_m"], daemon.texture_map()["cof"]
    row = np.array(cof[20])  # at 20.5 mm
    assert np.mean(np.array(x_m)[row == 0.7]) == pytest.approx(0.060, abs=1e-3)
    daemon.targets.set(daemon._orders.machine._lease.token, 0.6)
    assert scene(daemon) is None
    assert daemon.texture_map()["cof"][0][0] == 0.6


@pytest.fixture
def socket(daemon, tmp_path, monkeypatch):
    """Where the command line finds the daemon, and that somebody has armed."""
    path = tmp_path / "d" / "daemon.sock"
    with closing(Place(path)) as place, serve(daemon, place):
        monkeypatch.setenv("HAPTIC_SOCKET", str(path))
        yield path


@pytest.mark.realtime
def test_the_example_drags_an_object_records_and_exports(daemon, socket, tmp_path, capsys):
    folder = tmp_path / "example"
    folder.mkdir()
    with chdir(folder):
        runpy.run_path(str(EXAMPLE))
    assert daemon.status().output_on is False
    rows = int(re.search(r"(\d+) ticks in drag.csv", capsys.readouterr().out)[1])
    assert rows >= 3000 - 10  # of 1 ms, in 180 moves at 60 per second; some may be missed
    with (folder / "drag.csv").open() as table:
        assert sum(1 for _ in table) == rows + 1
    replay = SceneReplay(read_run(folder / "drag.h5"))
    assert len(replay.moments) == 181  # the scene as it was when the recording began
    last = {each.id: each.origin_mm for each in replay.moments[-1].scene.object}
    assert last["key"] == [50 + 20 * math.cos(179 / 30), 30 + 10 * math.sin(179 / 30)]
    assert last["bar"] == [60.0, 48.0]


@pytest.mark.realtime
def test_a_recording_is_replayed_with_the_scene_as_it_was(daemon, change, tmp_path, capsys):
    change(EVERYWHERE, KEY | {"cof": None, "texture": "linen"})
    path = tmp_path / "run.h5"
    daemon.record(path)
    for k in range(120):
        turn = 0.1 * k
        place = {"x_mm": 50.0 + 20.0 * math.cos(turn), "y_mm": 30.0 + 5.0 * math.sin(turn)}
        change({"do": "move", "id": "key", **place}, {"do": "turn", "id": "key", "rotation_deg": k})
        time.sleep(0.01)
    daemon.off()
    daemon.record(None)
    replay = SceneReplay(read_run(path))
    assert replay.differing == []
    samples, again = replay.run.samples, replay.asked_cof()
    known = np.isfinite(samples["asked_cof"]) & np.isfinite(again)
    assert known.sum() > 200
    assert np.mean(np.abs(samples["asked_cof"] - again)[known] < 1e-9) > 0.9
    # On a busy machine a tick may begin between the note of a change's time and the change itself.
    began_s = (samples["time_s"] + samples["lateness_s"])[known]
    at = np.searchsorted([moment.time_s for moment in replay.moments], began_s, side="right") - 1
    for tick, moment in zip(samples[known], at.tolist(), strict=True):
        near = replay.moments[max(moment - 1, 0) : moment + 2]
        place = float(tick["output_x_m"]), float(tick["output_y_m"])
        could = [replay.scene_at(each.time_s).cof_at(*place) for each in near if each.scene]
        assert min(abs(tick["asked_cof"] - cof) for cof in could) < 1e-9
    assert main(["scene", "replay", str(path), "--at", "0", "--out", str(tmp_path / "x.toml")]) == 0
    assert main(["texture", "check", str(tmp_path / "x.toml")]) == 0
    assert "scene" in capsys.readouterr().out
