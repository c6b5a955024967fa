"""`haptic watch`: JSON lines in a pipe, and a picture that says what matters."""

import json
import os

from rich.console import Console

from haptic_driver.cli.watch import picture, sparkline
from haptic_driver.daemon.messages import LoadPhase, LoadStatus
from haptic_driver.daemon.web.frames import state_frame


def test_watch_in_a_pipe_is_json_lines(haptic, socket):
    done = haptic("watch", "--for", "0.2")
    assert done.status == 0
    frames = [json.loads(line) for line in done.out.splitlines()]
    assert frames
    assert all(frame["status"]["rig"] == "bench" for frame in frames)


def shown(*frames):
    """What the picture of these frames says."""
    with open(os.devnull, "w") as nowhere:
        console = Console(width=120, record=True, file=nowhere)
        console.print(picture(list(frames)))
        return console.export_text()


def frame_of(control):
    return state_frame(control.status(), control.samples(0, 10))


def test_the_watch_picture_says_what_matters(control):
    lease = control.arm(60.0)
    control.set(lease.token, 0.6)
    frame = frame_of(control)
    control.shown_off = False
    control.fail("by hand")
    fault = state_frame(control.status(), control.samples(0, 10)[:0])
    assert "output ON" in shown(frame)
    assert "fault: by hand" in shown(frame, fault)
    assert "UNKNOWN" in shown(fault)


def test_sparkline():
    assert sparkline([0.0, None, 0.5, 1.0, 2.0, -1.0], 0.0, 1.0) == "▁ ▅██▁"


def test_the_watch_picture_says_what_a_load_stage_does(control):
    assert "load" not in shown(frame_of(control))
    control.load = LoadStatus(phase=LoadPhase.HOLD, target_n=0.5, load_n=0.4871, depth_m=0.012)
    assert "hold 0.5 N, 0.49 N measured" in shown(frame_of(control))
