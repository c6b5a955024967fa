"""A load is wanted until somebody takes it away, and a stage is free if it shows so."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.load import HeldLoad
from haptic_driver.daemon.messages import LoadPhase
from haptic_driver.daemon.orders import Orders
from haptic_driver.rig.config import load_rig
from haptic_driver.simulation.twin import LOAD_STAGE
from tests.haptic_driver.daemon.refusal import refusal
from tests.haptic_driver.rig.load_rig import FACE_M, Finger
from tests.haptic_driver.stand_ins import with_load_stage


def held_load(shared: Any, finger: Finger, orders: Any = None, **section: Any) -> HeldLoad:
    config = with_load_stage(load_rig("simulated"), {"load_stage": "/dev/ttyUSB0"})
    given = {"clear_m": FACE_M - 1e-3, **section}
    changed = config.load_stage.model_copy(update=given)
    config = config.model_copy(update={"simulated": False, "load_stage": changed})
    return HeldLoad(config, shared, orders, EventLog(), lambda: finger.now_s)


def phase(load: HeldLoad) -> LoadPhase:
    status = load.status(None)
    assert status is not None
    return status.phase


def devices(finger: Finger) -> Any:
    return SimpleNamespace(load_stage=finger.stage, watchdog=None, force_sensor=None)


@pytest.mark.parametrize(("way_m", "is_free"), [(-2e-3, True), (-0.5e-3, False), (1e-3, False)])
def test_a_stage_that_stands_elsewhere_at_the_start_may_press(shared, way_m, is_free):
    """A daemon said "free" of a finger under 0.44 N, after the one before was killed."""
    finger = Finger()
    finger.stage.move_to(FACE_M + way_m)
    finger.stage.wait(60.0)
    load = held_load(shared, finger)
    load.exchange(devices(finger))
    assert phase(load) is (LoadPhase.FREE if is_free else LoadPhase.MAY_PRESS)
    load._lift()
    assert phase(load) is LoadPhase.FREE
    assert finger.body.load_n == 0.0
    assert finger.stage.read_status().position_m <= max(FACE_M + way_m, FACE_M - 1e-3)


def test_a_stage_that_somebody_moves_is_free_only_while_it_shows_so(shared):
    """It was "free" by a look of 86 s before."""
    finger = Finger()
    load = held_load(shared, finger)
    load.exchange(devices(finger))
    for way_m, told in ((1e-3, LoadPhase.MAY_PRESS), (-2e-3, LoadPhase.FREE)):
        finger.stage.move_to(FACE_M + way_m)
        finger.stage.wait(60.0)
        load._look()
        assert phase(load) is told
        assert finger.stage.read_status().position_m == pytest.approx(FACE_M + way_m, abs=1e-6)
    finger.instrument.faults.silent = True
    load._look()
    assert phase(load) is LoadPhase.MAY_PRESS


def test_a_stage_that_lifts_too_little_is_lifted_until_it_stands_clear(shared):
    finger = Finger()
    finger.stage.move_to(FACE_M + 1e-3)
    finger.stage.wait(60.0)
    load = held_load(shared, finger, retract_m=0.7e-3)
    load.exchange(devices(finger))
    load._lift()
    assert (phase(load), finger.body.load_n > 0.0) == (LoadPhase.MAY_PRESS, True)
    load._lift()
    load._lift()
    assert (phase(load), finger.body.load_n) == (LoadPhase.FREE, 0.0)


def test_a_stage_that_does_not_answer_or_know_where_it_is_may_press(shared):
    finger = Finger()
    load = held_load(shared, finger, clear_m=LOAD_STAGE.clear_m)
    finger.instrument.faults.silent = True
    load.exchange(devices(finger))
    assert phase(load) is LoadPhase.MAY_PRESS
    finger.instrument.faults.silent = False
    lost = Finger()
    lost.instrument._bits &= ~0x0400  # its reference is gone, as after power-up
    load.exchange(devices(lost))
    load._lift()
    assert phase(load) is LoadPhase.MAY_PRESS


def test_a_rig_that_is_safer_at_rest_is_not_moved(shared):
    finger = Finger()
    finger.stage.move_to(FACE_M + 1e-3)
    finger.stage.wait(60.0)
    load = held_load(shared, finger, when_wrong="stop")
    load.exchange(devices(finger))
    load._lift()
    assert phase(load) is LoadPhase.STOPPED
    assert finger.stage.read_status().position_m == pytest.approx(FACE_M + 1e-3, abs=1e-6)


def orders_of(shared: Any, finger: Finger) -> Orders:
    settings: Any = SimpleNamespace(
        config=load_rig("simulated"), render=SimpleNamespace(period_s=1e-3)
    )
    orders = Orders(settings, shared, EventLog(), lambda: finger.now_s)
    orders.machine.connected()
    return orders


def lose(finger: Finger) -> None:
    finger.now_s += 10.1


TAKEN: dict[str, Callable[[Orders, HeldLoad, Finger], object]] = {
    "off": lambda orders, load, finger: orders.withdraw(orders.machine.off),
    "disarm": lambda orders, load, finger: orders.withdraw(orders.machine.disarm),
    "release": lambda orders, load, finger: load.release(),
    "fault": lambda orders, load, finger: orders.fail("something else is wrong"),
    "lost": lambda orders, load, finger: lose(finger),
}


@pytest.mark.parametrize("how", TAKEN)
def test_no_load_is_wanted_once_somebody_takes_it_away(shared, how):
    finger = Finger()
    orders = orders_of(shared, finger)
    load = held_load(shared, finger, orders)
    token = orders.arm(10.0).token
    load.hold(token, 0.5)
    status = load.status(None)
    assert status is not None
    assert status.target_n == 0.5
    TAKEN[how](orders, load, finger)
    status = load.status(None)
    assert status is not None
    assert status.target_n is None
    if how in ("disarm", "fault"):  # who arms again has asked for none
        if how == "fault":
            orders.reset()
        orders.arm(10.0)
        assert load.status(None) == status


@pytest.mark.parametrize(
    ("newtons", "token", "code"),
    [(0.01, "", "bad_load"), (3.5, "", "bad_load"), (0.5, "another", "not_yours")],
)
def test_a_load_that_cannot_be_is_refused(shared, newtons, token, code):
    finger = Finger()
    orders = orders_of(shared, finger)
    load = held_load(shared, finger, orders)
    held = orders.arm(10.0).token
    assert refusal(load.hold, token or held, newtons).code == code
    status = load.status(None)
    assert status is not None
    assert status.target_n is None


def test_a_rig_without_a_load_stage_refuses(rig_config, shared):
    load = HeldLoad(rig_config, shared, orders_of(shared, Finger()), EventLog(), lambda: 0.0)
    refused = refusal(load.hold, "token", 0.5)
    assert refused.code == "no_load_stage"
    assert "[load_stage]" in refused.hint
    assert load.status(0.5) is None
