"""A recorded wire log of a whole demo run replays byte for byte; a driver that does otherwise is
found out.
"""

import json

import numpy as np
import pytest

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import render_slide
from haptic_driver.errors import HapticError
from haptic_driver.rig.slide import Slide, synthetic_slide
from haptic_driver.simulation.finger_model import surface_friction
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.textures.library import load_texture
from tests.hw.testing.recording import Recording, Replay, ReplayMismatch


class DrivingReplay(Replay):
    """A replay under which the simulated electrode still sees what is commanded: only the answers
    are the log's.
    """

    def __init__(self, path, generator):
        super().__init__(path)
        self.generator = generator
        self.sent_bytes = 0

    def _send(self, data, deadline_s):
        super()._send(data, deadline_s)
        self.generator.handle(data)
        self.sent_bytes += len(data)


def replaying(path):
    """The replays that are made, and what makes one for the demo."""
    replays = []

    def through(transport, generator):
        replays.append(DrivingReplay(path, generator))
        return replays[0]

    return replays, through


@pytest.fixture(scope="module")
def demo(rig_config, touch, surface_file, limits):
    """The demo's own slide, texture and stages on a rig whose transport goes `through`
    something.
    """
    texture = load_texture("grating", texture_dirs())
    settings = render_settings(rig_config, surface_file)
    friction = surface_friction(surface_file, limits)  # the finger matters less here than its speed

    def run(through, slide=None):
        generators = []
        bench = SimulatedRig(
            rig_config,
            touch,
            wrap=lambda core: generators.append(core) or core,
            friction=friction,
            through=lambda transport: through(transport, generators[0]),
        )
        with bench:
            return render_slide(
                slide or synthetic_slide(), texture, settings, bench, lambda _: None
            )

    return run


@pytest.fixture(scope="module")
def recorded(demo, tmp_path_factory):
    path = tmp_path_factory.mktemp("wire") / "demo.log"
    logs = []

    def record(transport, generator):
        logs.append(Recording(transport, path))
        return logs[0]

    slide = demo(record)
    logs[0].finish()
    assert logs[0].log_error is None
    return path, slide


def test_a_whole_demo_run_replays_byte_for_byte(demo, recorded):
    path, first = recorded
    replays, replay = replaying(path)
    second = demo(replay)
    replays[0].check_finished()
    logged = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()[1:]]
    sent = [event["data"] for event in logged if event["event"] == "sent"]
    assert replays[0].sent_bytes == sum(map(len, sent))
    assert len(sent) > 300  # a set point at least every 20 ms of two strokes
    np.testing.assert_array_equal(first.voltage_v, second.voltage_v)
    assert second.off.on is False
    assert first.max_voltage_v == second.max_voltage_v > 50.0


def test_another_slide_is_found_out_at_its_first_different_byte(demo, recorded):
    path, _ = recorded
    whole = synthetic_slide()
    heavier = Slide(
        "heavier", whole.time_s[:900], whole.position_m[:900], 1.2 * whole.normal_force_n[:900]
    )
    replays, replay = replaying(path)
    with pytest.raises(HapticError, match=r"byte \d+ of the command"):
        demo(replay, heavier)
    with pytest.raises(ReplayMismatch):
        replays[0].check_finished()
