"""Whether there may be output: the state machine, and what each of its moves means to render and to
the pump.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from itertools import count

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.messages import SOMEBODY, DaemonState, Lease
from haptic_driver.daemon.output_pump import OutputPump
from haptic_driver.daemon.set_up import DaemonSettings
from haptic_driver.daemon.state_machine import StateMachine
from haptic_driver.daemon.timing import ENOUGH, RECENT_TICKS, timing_of
from haptic_driver.errors import message_of
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import NO_ORDER, Output, SharedState
from haptic_driver.rig.states import RigEvent, RigState


class Orders:
    """The daemon's state, the order by which render knows it, the pump's gate, and the flags since
    arming.

    `lock` is of the machine, the order and the flags; it is never held over I/O.
    """

    def __init__(
        self,
        settings: DaemonSettings,
        shared: SharedState,
        events: EventLog,
        clock: Callable[[], float],
    ) -> None:
        self.lock = threading.RLock()
        self.machine = StateMachine()
        self.order = NO_ORDER
        output = settings.config.output
        self.pump = OutputPump(
            shared,
            output.setpoint_interval_s,
            output.linger_s,
            lambda error: self.fail(message_of(error)),
            clock,
        )
        self._simulated = settings.config.simulated
        self._period_s = settings.render.period_s
        self._shared = shared
        self._events = events
        self._clock = clock
        self.withdrawn = 0  # another number whenever somebody has begun to switch off, and has
        self.overtaken = 0  # likewise, but not where a script ends: what is asked then goes on
        self._withdrawals = count(1)
        self._armed_at = 0  # the first order of the present arming
        self._flags = Flag(0)

    @property
    def rendering(self) -> bool:
        """Whether there may be voltage."""
        return self.machine.state is DaemonState.RENDERING

    @property
    def said(self) -> str:
        """What is known of the output, and the state, in words."""
        return f"output {self.pump.output}; the daemon is {self.machine.state}"

    def beat(self) -> None:
        """Say that control is alive."""
        with self.lock:
            self._order_now()

    def arm(self, lease_s: float, holder: str = SOMEBODY) -> Lease:
        """Idle -> armed, without flags."""
        with self.lock:
            lease = self.machine.arm(self._clock(), lease_s, holder)
            self._flags = Flag(0)
            self._order_now()
            self._armed_at = self.order.number
        return lease

    def renew(self, token: str) -> Lease:
        """The lease counts from now again."""
        with self.lock:
            lease = self.machine.renew(token, self._clock())
            self._order_now()
        return lease

    def render(self, token: str, target: int) -> None:
        """Armed or rendering -> rendering, of the target of that number."""
        with self.lock:
            self.machine.render(token, self._clock())
            self._order_now(target)
            self.pump.open(self.order.number)

    def use_target(self, token: str, target: int) -> None:
        """Render goes on with the target of that number, where it renders at all."""
        with self.lock:
            self.machine.renew(token, self._clock())
            self._order_now(target)

    def use_surface(self, number: int) -> None:
        """Render goes by the surface of that number from its next tick on."""
        with self.lock:
            self._order_now(surface=number)

    def withdraw(self, move: Callable[[], object], *, overtakes: bool = True) -> None:
        """Off now; then the state says so, and a command that was on its way meanwhile is
        undone. `overtakes`: what was asked before, and is not rendered yet, never is.
        """
        self._count(overtakes)
        self.pump.off()
        with self.lock:
            self._count(overtakes)
            move()
            self.pump.close()
            self._order_now()
        self.pump.undo_late_command()

    def _count(self, overtakes: bool) -> None:
        self.withdrawn = next(self._withdrawals)
        if overtakes:
            self.overtaken = self.withdrawn

    def fail(self, reason: str) -> None:
        """Fault, and off: where instruments are silent it takes seconds to learn that nobody knows
        whether it is.
        """
        if self.machine.state is DaemonState.FAULT:
            return
        reason += self._excuse()
        with self.lock:
            news = self.machine.fault(reason)
            self._flags |= Flag.FAULT
            self.pump.close()
            self._order_now()
        if news:
            self._events.tell("fault", reason)
        self.pump.off()
        self.pump.undo_late_command()

    def _excuse(self) -> str:
        """Of simulated instruments: that this machine was late, which on a rig would be no fault of
        the instruments.
        """
        if not self._simulated:
            return ""
        found = timing_of(self._shared.ring.newest(RECENT_TICKS), self._period_s)
        if found.in_time is None or found.in_time >= ENOUGH:
            return ""
        return (
            f" (this machine was late meanwhile: {found.in_time:.0%} of the last {RECENT_TICKS}"
            " ticks in time)"
        )

    def reset(self) -> None:
        """Fault -> idle, without flags."""
        with self.lock:
            self.machine.reset()
            self._flags = Flag(0)

    def rig_says(self, event: RigEvent) -> None:
        """A trip is a flag and an event; an output that went off by itself, or may not have, is an
        event.
        """
        if event.state is RigState.TRIPPED:
            self._flags |= Flag.TRIPPED  # without the lock: who switches off waits for nobody
            self._events.tell("trip", event.reason)
        elif event.state is RigState.UNKNOWN:
            self._events.tell("output", event.reason)

    def raise_flag(self, flag: Flag) -> None:
        """It stays up until the next arming."""
        with self.lock:
            self._flags |= flag

    def has_raised(self, flag: Flag) -> bool:
        """Whether it is up since arming, other than by render."""
        return flag in self._flags

    def flags(self, output: Output) -> Flag:
        """All that are up; render's alone in `flags_of`."""
        return self._flags | self.flags_of(output)

    def flags_of(self, output: Output) -> Flag:
        """What render flags, unless it has not heard of the present arming yet."""
        return Flag(output.flags) if output.order >= self._armed_at else Flag(0)

    def _order_now(self, target: int | None = None, surface: int | None = None) -> None:
        """Tell render what holds now; a new number when it is something else than before."""
        order = self.order._replace(
            arming=self.machine.arming,
            rendering=self.rendering,
            target=self.order.target if target is None else target,
            surface=self.order.surface if surface is None else surface,
        )
        if order != self.order:
            order = order._replace(number=order.number + 1)
        self.order = order._replace(lease_until_s=self.machine.lease_until_s, beat_s=self._clock())
        self._shared.order.write(self.order)
