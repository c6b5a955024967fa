"""`haptic calibrate-touch` as it is typed, on a simulated screen's events and a user who touches by
a script.
"""

from __future__ import annotations

import datetime
import os
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from haptic_driver.rig.config import load_rig
from haptic_driver.rig.parts.finger_trackers import EvdevFingerConfig
from tests.haptic_driver.commands import said_by
from tests.haptic_driver.lab.measuring.touching import (
    CORNERS,
    MATRIX_M,
    SIX,
    SPAN_RAW,
    NoisyPanel,
    Script,
    SkewPanel,
    User,
    at,
    away,
    ctrl_c,
    drag,
    touches,
)

CONFIGS = Path(__file__).parents[4] / "configs" / "rigs"
DEVICE = "/dev/input/by-id/usb-touch-event"


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HAPTIC_CONFIGS", raising=False)
    write("places.csv", SIX)
    Path("mine.toml").write_text(
        (CONFIGS / "template.toml").read_text(encoding="utf-8"), encoding="utf-8"
    )


def write(name: str, places: list[tuple[float, float]]) -> None:
    Path(name).write_text("\n".join(["x_m,y_m", *(f"{x},{y}" for x, y in places)]) + "\n")


@pytest.fixture
def follow(monkeypatch):
    """Put a screen where the rig's file says one is, and a user in front of it; all of it is closed
    at the end.
    """
    users: list[User] = []

    def begin(
        script: Script, *, slots: int = 10, panel: SkewPanel | None = None, span: int | None = None
    ) -> User:
        user = User(script, slots=slots, panel=panel)
        users.append(user)

        class Device:
            fd, name = user.screen.descriptor, "a touch screen"

            def __init__(self, path: str, *, readonly: bool) -> None:
                assert (path, readonly) == (DEVICE, True)

            def capabilities(self, *, absinfo: bool) -> dict[int, list[int]]:
                return {1: [0x14A], 3: [0x2F, 0x35, 0x36, 0x39] if slots else [0, 1]}

            def absinfo(self, code: int) -> SimpleNamespace:
                high = SPAN_RAW[code in (0x01, 0x36)] if span is None else span
                return SimpleNamespace(value=user.screen.current_slot(), min=0, max=high)

            def close(self) -> None:
                os.close(user.screen.descriptor)
                closed.append(user)

        monkeypatch.setitem(sys.modules, "evdev", SimpleNamespace(InputDevice=Device))
        monkeypatch.setattr("fcntl.ioctl", lambda *_: 0)
        passing = SimpleNamespace(monotonic=user.clock, sleep=user.sleep)
        monkeypatch.setattr("haptic_driver.lab.commands.calibrate_touch.time", passing)
        return user

    closed: list[User] = []
    yield begin
    for user in users:
        user.screen.unplug()
    assert closed == users


COMMAND = ("calibrate-touch", "places.csv", "--rig", "mine.toml")


@pytest.mark.parametrize("slots", [10, 0], ids=["slots", "one finger"])
def test_touching_known_places_gives_the_screens_own_map(follow, slots):
    before = Path("mine.toml").read_bytes()
    follow(touches(SIX), slots=slots)
    said = said_by(*COMMAND)
    np.testing.assert_allclose(np.array(said["matrix_m"])[:, :2], MATRIX_M[:, :2], atol=2e-8)
    np.testing.assert_allclose(np.array(said["matrix_m"])[:, 2], MATRIX_M[:, 2], atol=1e-4)
    assert (said["rig"], said["placeholder"]) == ("mine", False)
    assert said["measured_at"] == datetime.date.today().isoformat()
    assert said["residual_m"] < said["touch_error_m"] < 5e-5
    assert [(place["x_m"], place["y_m"]) for place in said["places"]] == SIX
    assert Path("mine.toml").read_bytes() == before


def test_the_user_is_led_from_place_to_place_and_told_that_nothing_is_energised(haptic, follow):
    script = [away(), drag(0.0, 0.05, 4.0), at(*SIX[0], 0.2), away(), *touches(SIX)]
    follow(script, panel=NoisyPanel())
    done = haptic(*COMMAND)
    assert done.status == 0, done.err
    lines = done.err.splitlines()
    assert lines[0].startswith("Nothing is energised.")
    assert "0.5 s within 20 x 15 counts" in lines[0]
    assert lines[1] == "touch place 1 of 6: x = 20.0 mm, y = 10.0 mm"
    assert lines[2].startswith("  it moves by ")
    assert re.search(r"residual 0\.\d\d mm \(rms\): one touch is off by 0\.\d\d mm", done.out)
    assert "farthest off: place " in done.out


def test_what_it_says_to_paste_makes_a_calibrated_rig(haptic, follow):
    follow(touches(SIX))
    shown = haptic(*COMMAND).out.partition("Put this into [finger_tracker] of mine.toml:\n\n")[2]
    text = Path("mine.toml").read_text(encoding="utf-8")
    tracker, output, rest = text.partition("[output]")
    for line in shown.strip().splitlines():
        key = line.split(" = ")[0]
        tracker, count = re.subn(rf"(?m)^{key} = .*$", line, tracker)
        assert count >= 1, line
    Path("mine.toml").write_text(tracker + output + rest, encoding="utf-8")
    screen = load_rig("mine.toml").finger_tracker
    assert isinstance(screen, EvdevFingerConfig)
    assert screen.placeholder is False
    np.testing.assert_allclose(np.array(screen.matrix_m)[:, :2], MATRIX_M[:, :2], atol=2e-8)


def test_neither_generator_nor_amplifier_is_opened(haptic, follow, monkeypatch):
    def opened(*_: object, **__: object) -> None:
        pytest.fail("a device other than the touch screen was opened")

    monkeypatch.setattr("hw.transport.contract.Transport.open", opened)
    monkeypatch.setattr("socket.socket.connect", opened)
    follow(touches(SIX))
    assert haptic(*COMMAND).status == 0


def test_three_places_are_accepted_and_said_to_check_nothing(haptic, follow):
    write("places.csv", CORNERS[:3])
    follow(touches(CORNERS[:3]))
    assert "nothing checks them" in haptic(*COMMAND).out
    follow(touches(CORNERS[:3]))
    said = haptic(*COMMAND, "--json").said
    assert (said["residual_m"], said["touch_error_m"], said["worst"]) == (None, None, None)


def test_touches_that_disagree_are_no_calibration(refuses, follow):
    follow(touches([*SIX[:2], (0.16, 0.09), *SIX[3:]]))
    error = refuses("touches_disagree", *COMMAND, status=1)
    assert "above 2 mm; farthest off is place 3" in error["message"]
    assert "places.csv" in error["hint"]


def test_a_file_of_places_is_refused_before_anybody_touches(refuses):
    write("places.csv", [(0, 0), (160, 0), (0, 80)])
    assert "places.csv" in refuses("bad_places", *COMMAND)["message"]


def test_a_rig_without_a_touch_screen_is_refused_with_one_that_has_it(refuses):
    error = refuses("no_touch_screen", "calibrate-touch", "places.csv", "--rig", "paper")
    assert 'finger_tracker.kind is "stage"' in error["message"]
    assert "template" in error["hint"]


def test_interrupted_it_writes_nothing(refuses, follow):
    follow([*touches(SIX[:3]), ctrl_c()])
    before = sorted(Path().iterdir())
    error = refuses("interrupted", *COMMAND, status=1)
    assert error["hint"] == "Nothing was energised. Run it again"
    assert sorted(Path().iterdir()) == before


def test_a_screen_that_is_not_there_is_an_error(haptic):
    pytest.importorskip("evdev", reason="evdev is not installed")
    Path("mine.toml").write_text(
        Path("mine.toml").read_text(encoding="utf-8").replace(DEVICE, "/dev/input/none")
    )
    done = haptic(*COMMAND, "--json")
    assert done.status == 1
    assert "/dev/input/none cannot be opened as a touch screen" in done.err


def test_a_screen_without_ranges_needs_a_spread(haptic, refuses, follow):
    follow(touches(SIX), span=0)
    refuses("unknown_span", *COMMAND)
    follow(touches(SIX), span=0)
    assert haptic(*COMMAND, "--spread-raw", "20").status == 0
