"""What control looks at every 20 ms while the daemon runs; `Daemon` lists all of it in the order in which it looks."""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.orders import Orders
from haptic_driver.daemon.output_pump import OUTPUT_STALE_S
from haptic_driver.daemon.render_process import RenderSettings
from haptic_driver.daemon.targets import Targets
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.render.texture import Script

UNDERRUN_TOLD_S = 1.0  # at most so often: a machine that is too slow makes many
NO_FLAGS = Flag(0)
DRIFT = 0.2  # a change of the finger's gain, relative, that is worth an event


@dataclass
class LeaseWatcher:
    """After render has ramped down for a lost lease: off, idle."""

    orders: Orders
    events: EventLog
    render: RenderSettings

    def watch(self, now_s: float) -> None:
        """Take the lease away when it is over."""
        machine = self.orders.machine
        with self.orders.lock:
            over = machine.armed and now_s > machine.lease_until_s + self.render.ramp_s
        if over:
            self.orders.raise_flag(Flag.LEASE_LOST)
            self.orders.withdraw(machine.disarm)
            self.events.tell("lease", "the lease ran out; output off")


@dataclass
class RenderWatcher:
    """New flags are events, once per arming; a render process that misses ticks or falls silent is a fault."""

    shared: SharedState
    orders: Orders
    events: EventLog
    render: RenderSettings
    arming: int = 0
    told: Flag = NO_FLAGS

    def watch(self, now_s: float) -> None:
        """Look at its newest output."""
        output = self.shared.output.read()
        with self.orders.lock:
            rendering = self.orders.rendering
            if self.arming != self.orders.machine.arming:
                self.arming, self.told = self.orders.machine.arming, NO_FLAGS
            flags = self.orders.flags_of(output)
            new = flags & ~self.told
            self.told |= new
        for name in new.names():
            self.events.tell("flag", name)
        if rendering and Flag.FAULT in flags:
            self.orders.fail(f"render missed {self.render.most_missed} ticks in a row")
        if rendering and now_s - output.time_s > OUTPUT_STALE_S:
            self.orders.fail(f"render has said nothing for {now_s - output.time_s:.2g} s")


@dataclass
class UnderrunWatcher:
    """Gaps of an analog envelope, each time that some have come since they were told last."""

    orders: Orders
    events: EventLog
    told: int = 0
    told_s: float = -math.inf

    def watch(self, now_s: float) -> None:
        """Look at the pump's count."""
        underruns = self.orders.pump.underruns
        if underruns > self.told and now_s - self.told_s >= UNDERRUN_TOLD_S:
            self.told, self.told_s = underruns, now_s
            self.orders.raise_flag(Flag.UNDERRUN)
            self.events.tell("flag", "underrun", underruns=underruns)


@dataclass
class ScriptWatcher:
    """Markers of a script, when they pass."""

    orders: Orders
    targets: Targets
    events: EventLog
    number: int = 0  # of the target that was looked at last
    marked_s: float = -math.inf  # up to when its markers were told

    def watch(self, now_s: float) -> None:
        """Tell those that have passed since the last look."""
        with self.orders.lock:
            rendering, target, number = self.orders.rendering, self.targets.target, self.orders.order.target
        since_s = self.marked_s if number == self.number else -math.inf
        self.number, self.marked_s = number, now_s
        if rendering and isinstance(target, Script):
            for marker in target.markers(since_s, now_s):
                self.events.tell("marker", marker.label, due_s=marker.time_s)


@dataclass
class DriftWatcher:
    """The finger's estimated gain, each time that it is far from what was told last, or from 1 at arming."""

    shared: SharedState
    orders: Orders
    events: EventLog
    arming: int = 0
    told_gain: float = 1.0

    def watch(self, now_s: float) -> None:
        """Look at the newest sample."""
        if self.arming != self.orders.machine.arming:
            self.arming, self.told_gain = self.orders.machine.arming, 1.0
        newest = self.shared.ring.newest(1)
        if not self.orders.rendering or not newest.size or not newest["in_contact"][-1]:
            return
        gain = float(newest["feedback_gain"][-1])
        if abs(gain / self.told_gain - 1.0) > DRIFT:
            self.told_gain = gain
            self.events.tell("drift", f"the finger's gain is {gain:.2f}", gain=gain)
