"""The simulated stage, spoken to by thorlabs-apt-protocol: no code shared with the simulator."""

from __future__ import annotations

import io
import itertools
from typing import Any

import pytest
import thorlabs_apt_protocol as client
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.hw.testing.faulty_stage import FaultyLts150

TO_STAGE = (0x50, 0x01)
COUNTS_PER_MM = 409_600
MM_S = 21_987_328
MM_S2 = 4506.08


class Client:
    """Commands by the independent package; answers as it reads them."""

    def __init__(self, **keywords: Any) -> None:
        self.now_s = 0.0
        self.stage = FaultyLts150(lambda: self.now_s, **keywords)
        self.ask(client.hw_stop_updatemsgs(*TO_STAGE))

    def ask(self, *commands: bytes) -> list[Any]:
        answers = b"".join(self.stage.handle(command) for command in commands)
        return list(client.Unpacker(io.BytesIO(answers), on_error="raise"))

    def status(self) -> Any:
        return self.ask(client.mot_req_statusupdate(*TO_STAGE, 1))[-1]

    def enable(self) -> None:
        self.ask(client.mod_set_chanenablestate(*TO_STAGE, 1, 1))

    def set_speed(self, velocity_mm_s: float, acceleration_mm_s2: float) -> None:
        raw = round(acceleration_mm_s2 * MM_S2), round(velocity_mm_s * MM_S)
        self.ask(client.mot_set_velparams(*TO_STAGE, 1, 0, *raw))

    def home(self) -> None:
        self.enable()
        self.ask(client.mot_move_home(*TO_STAGE, 1))
        self.now_s += 60.0
        assert self.ask(client.mot_req_poscounter(*TO_STAGE, 1))[0].msg == "mot_move_homed"

    def move_to(self, position_mm: float) -> None:
        self.ask(client.mot_move_absolute(*TO_STAGE, 1, round(position_mm * COUNTS_PER_MM)))


def test_after_power_up_it_reports_by_itself_until_told_not_to():
    now_s = 0.0
    stage = FaultyLts150(lambda: now_s)
    reports = list(client.Unpacker(io.BytesIO(stage.handle(client.hw_req_info(*TO_STAGE)))))
    assert [report.msg for report in reports] == ["mot_get_statusupdate", "hw_get_info"]
    now_s = 1.0
    assert stage.handle(client.hw_stop_updatemsgs(*TO_STAGE)) != b""
    now_s = 2.0
    assert stage.handle(client.hw_stop_updatemsgs(*TO_STAGE)) == b""


def test_homing_finds_the_zero():
    rig = Client(start_mm=25.0)
    status = rig.status()
    assert (status.position, status.homed, status.channel_enabled) == (0, False, False)
    rig.enable()
    rig.ask(client.mot_move_home(*TO_STAGE, 1))
    rig.now_s += 1.0
    status = rig.status()
    assert (status.homing, status.homed, status.channel_enabled) == (True, False, True)
    rig.now_s += 30.0
    answers = rig.ask(client.mot_req_statusupdate(*TO_STAGE, 1))
    assert [answer.msg for answer in answers] == ["mot_move_homed", "mot_get_statusupdate"]
    assert (answers[1].position, answers[1].homed, answers[1].homing) == (0, True, False)
    assert rig.stage.position_mm == 0.0


def test_a_move_is_announced_when_complete():
    rig = Client()
    rig.home()
    rig.move_to(12.5)
    rig.now_s += 0.3
    status = rig.status()
    assert status.moving_forward != status.moving_reverse
    rig.now_s += 10.0
    completed, position = rig.ask(client.mot_req_poscounter(*TO_STAGE, 1))
    assert (completed.msg, completed.position) == ("mot_move_completed", 12.5 * COUNTS_PER_MM)
    assert position.position == 12.5 * COUNTS_PER_MM
    rig.ask(client.mot_move_relative(*TO_STAGE, 1, -COUNTS_PER_MM))
    rig.now_s += 10.0
    assert rig.stage.position_mm == pytest.approx(11.5)
    bits = rig.stage.handle(bytes.fromhex("29 04 01 00 50 01"))[-12:]
    assert bits.hex(" ") == "2a 04 06 00 81 50 01 00 00 04 00 80"


def test_a_stage_that_is_not_enabled_does_not_move():
    rig = Client(start_mm=30.0)
    rig.ask(client.mot_move_relative(*TO_STAGE, 1, COUNTS_PER_MM))
    rig.now_s += 10.0
    assert rig.stage.position_mm == 30.0


@pytest.mark.parametrize(("wanted_mm", "reached_mm"), [(500.0, 150.0), (-3.0, 0.0)])
def test_the_travel_ends(wanted_mm, reached_mm):
    rig = Client()
    rig.home()
    rig.move_to(wanted_mm)
    rig.now_s += 60.0
    assert rig.stage.position_mm == reached_mm


@settings(max_examples=60)
@given(
    st.floats(0.1, 150.0),
    st.floats(1.0, 50.0),
    st.floats(1.0, 50.0),
    st.one_of(st.none(), st.floats(0.0, 1.0)),
)
def test_the_motion_obeys_velocity_and_acceleration(
    target_mm, velocity_mm_s, acceleration_mm_s2, stop_after
):
    """The position sampled in time, differentiated twice; a gentle stop somewhere keeps to the same
    limits.
    """
    rig = Client()
    rig.home()
    rig.set_speed(velocity_mm_s, acceleration_mm_s2)
    rig.move_to(target_mm)
    duration_s = target_mm / velocity_mm_s + velocity_mm_s / acceleration_mm_s2
    if (
        target_mm * acceleration_mm_s2 < velocity_mm_s**2
    ):  # a triangle, which never reaches that velocity
        duration_s = 2.0 * (target_mm / acceleration_mm_s2) ** 0.5
    steps = 80
    step_s = duration_s * 1.02 / steps
    seen_mm = [rig.stage.position_mm]
    for i in range(steps):
        if stop_after is not None and i == int(stop_after * steps):
            rig.ask(client.mot_move_stop(*TO_STAGE, 1, 2))
        rig.now_s += step_s
        seen_mm.append(rig.stage.position_mm)
    velocities = [(b - a) / step_s for a, b in itertools.pairwise(seen_mm)]
    accelerations = [(b - a) / step_s for a, b in itertools.pairwise(velocities)]
    assert min(velocities) >= -1e-6
    assert max(velocities) <= velocity_mm_s * (1.0 + 1e-6)
    assert max(map(abs, accelerations)) <= acceleration_mm_s2 * (1.0 + 1e-3) + 1e-6
    assert not rig.stage.moving
    if stop_after is None:
        assert seen_mm[-1] == pytest.approx(target_mm, abs=1e-5)
        assert seen_mm[-4] < seen_mm[-1]  # it was not there early
    else:
        assert seen_mm[-1] <= target_mm + 1e-5


def test_an_obstacle_stays_in_the_way():
    rig = Client()
    rig.home()
    rig.stage.faults.blocked_at_mm = 10.0
    for target_mm in (50.0, 40.0, 10.5):
        rig.move_to(target_mm)
        rig.now_s += 30.0
        assert rig.status().motion_error
        assert rig.stage.position_mm < 10.0
    rig.move_to(2.0)
    rig.now_s += 30.0
    assert rig.status().position == 2 * COUNTS_PER_MM
