"""Output is possible in one state alone, and only the holder of the lease gets there."""

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from haptic_driver.daemon.messages import DaemonState, RefusedError
from haptic_driver.daemon.state_machine import StateMachine
from tests.haptic_driver.daemon.refusal import refusal


def idle():
    machine = StateMachine()
    machine.connected()
    return machine


def test_the_way_to_rendering_and_back():
    machine = StateMachine()
    assert machine.state is DaemonState.DISCONNECTED
    assert refusal(machine.arm, 0.0, 0.5).code == "not_connected"
    machine.connected()
    assert machine.state is DaemonState.IDLE
    lease = machine.arm(0.0, 0.5)
    assert machine.state is DaemonState.ARMED
    machine.render(lease.token, 0.4)
    assert machine.state is DaemonState.RENDERING
    machine.off()
    assert machine.state is DaemonState.ARMED
    machine.render(lease.token, 0.45)
    machine.disarm()
    assert machine.state is DaemonState.IDLE
    assert refusal(machine.render, lease.token, 0.46).code == "not_armed"


def test_only_the_holder_of_a_lease_may_use_it_and_only_in_time():
    machine = idle()
    lease = machine.arm(0.0, 0.5)
    assert refusal(machine.arm, 0.1, 0.5).code == "already_armed"
    assert refusal(machine.render, "guessed", 0.1).code == "not_yours"
    assert refusal(machine.renew, "gu€ssed", 0.1).code == "not_yours"
    assert machine.renew(lease.token, 0.4) == lease
    assert machine.lease_until_s == pytest.approx(0.9)
    machine.render(lease.token, 0.9)
    assert refusal(machine.renew, lease.token, 0.91).code == "lease_expired"
    assert machine.lease_until_s == pytest.approx(0.9)


def test_who_let_a_lease_run_out_is_told_so_afterwards_and_nobody_else():
    """Said was only that the daemon is idle."""
    machine = idle()
    lease = machine.arm(0.0, 0.5)
    machine.run_out(machine.arming - 1)  # of an earlier one
    assert machine.state is DaemonState.ARMED
    machine.run_out(machine.arming)
    assert machine.state is DaemonState.IDLE
    assert refusal(machine.render, lease.token, 9.0).code == "lease_expired"
    assert refusal(machine.render, "guessed", 9.0).code == "not_armed"
    machine.arm(10.0, 0.5)
    assert refusal(machine.render, lease.token, 10.1).code == "not_yours"


def test_who_sends_no_token_is_told_so():
    machine = idle()
    machine.arm(0.0, 0.5)
    told = refusal(machine.render, "", 0.1)
    assert (told.code, told.hint.startswith("send what arm gave")) == ("not_yours", True)


def test_a_fault_ends_the_lease_keeps_its_first_reason_and_is_left_by_reset_alone():
    machine = idle()
    lease = machine.arm(0.0, 0.5)
    machine.render(lease.token, 0.1)
    assert machine.fault("first")
    assert not machine.fault("second")
    assert machine.fault_reason == "first"
    machine.off()
    machine.disarm()
    machine.connected()
    assert machine.state is DaemonState.FAULT
    assert refusal(machine.renew, lease.token, 0.2).code == "not_armed"
    assert refusal(machine.arm, 0.2, 0.5).code == "fault"
    machine.reset()
    assert (machine.state, machine.fault_reason) == (DaemonState.IDLE, None)


class AnyOrder(RuleBasedStateMachine):
    """Whoever calls whatever in whatever order."""

    def __init__(self):
        super().__init__()
        self.machine = idle()
        self.now_s = 0.0
        self.token = None

    def attempt(self, call, *arguments):
        before = (self.machine.state, self.machine.lease_until_s, self.machine.arming)
        try:
            return call(*arguments)
        except RefusedError:
            assert (self.machine.state, self.machine.lease_until_s, self.machine.arming) == before
            return None

    @rule(lease_s=st.floats(0.1, 2.0))
    def arm(self, lease_s):
        lease = self.attempt(self.machine.arm, self.now_s, lease_s)
        if lease is not None:
            assert self.token is None or self.token != lease.token
            self.token = lease.token

    @rule(mine=st.booleans())
    def render(self, mine):
        before = self.machine.state
        allowed = mine and self.machine.armed and self.now_s <= self.machine.lease_until_s
        self.attempt(self.machine.render, self.token if mine and self.token else "x", self.now_s)
        assert self.machine.state is (DaemonState.RENDERING if allowed else before)

    @rule(passed_s=st.floats(0.0, 1.0))
    def wait(self, passed_s):
        self.now_s += passed_s

    @rule()
    def off(self):
        self.machine.off()
        assert self.machine.state is not DaemonState.RENDERING

    @rule()
    def disarm(self):
        self.machine.disarm()
        assert not self.machine.armed

    @rule()
    def fault(self):
        self.machine.fault("something")
        assert self.machine.state is DaemonState.FAULT

    @rule()
    def reset(self):
        self.machine.reset()

    @invariant()
    def a_fault_has_a_reason_and_nothing_else_has(self):
        assert (self.machine.fault_reason is not None) == (self.machine.state is DaemonState.FAULT)

    @invariant()
    def a_lease_is_there_exactly_while_armed(self):
        assert (self.machine.lease_until_s > 0.0) == self.machine.armed


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(max_examples=150, stateful_step_count=20)
