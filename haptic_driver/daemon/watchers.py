"""What control looks at every 20 ms while the daemon runs: functions, listed last in the order in
which they look.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.judge import MeasuredLatency
from haptic_driver.daemon.orders import Orders
from haptic_driver.daemon.render_process import RenderSettings
from haptic_driver.daemon.supervision import LIFT_HINT
from haptic_driver.daemon.targets import Targets
from haptic_driver.daemon.timing import ENOUGH, RECENT_TICKS, timing_of
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import Sensed, SharedState
from haptic_driver.render.texture import Script

SILENT_S = 0.5  # as long as the watchdog waits for the driver
UNDERRUN_TOLD_S = 1.0  # at most so often: a machine that is too slow makes many
TIMING_TOLD_S = 10.0  # the same
DRIFT_TOLD_S = 5.0  # the same: while it is learnt it moves many times
DRIFT = 0.2  # a change of the finger's gain, relative, that is worth an event
LATENCY_KEY = "output.latency_s"  # of the rig's file
NO_FLAGS = Flag(0)


@dataclass
class Watched:
    """What is looked at, and what was reported of it.

    Flags and the finger's gain since `arming`, gaps of an envelope, markers of target number
    `target` up to `marked_s`.
    """

    shared: SharedState
    orders: Orders
    targets: Targets
    events: EventLog
    render: RenderSettings
    advice: Callable[[], str]
    latency: Callable[[], MeasuredLatency]
    not_covered: Callable[[Sensed], str | None]
    arming: int = 0
    flags: Flag = NO_FLAGS
    gain: float = 1.0
    drift_s: float = -inf
    underruns: int = 0
    underrun_s: float = -inf
    timing_s: float = -inf
    target: int = 0
    marked_s: float = -inf


def lease(watched: Watched, now_s: float) -> None:
    """After render has ramped down for a lost lease: off, idle."""
    orders = watched.orders
    with orders.lock:
        over = orders.machine.armed and now_s > orders.machine.lease_until_s + watched.render.ramp_s
        arming = orders.machine.arming
    if over:
        orders.raise_flag(Flag.LEASE_LOST)
        orders.withdraw(partial(orders.machine.run_out, arming))
        watched.events.tell("lease", f"the lease ran out; {orders.said}")


def contacts(watched: Watched, now_s: float) -> None:
    """A second finger feels the same voltage: what the limits do not hold for is a fault."""
    orders = watched.orders
    if orders.machine.armed and (why := watched.not_covered(watched.shared.sensed.read())):
        orders.fail(f"{why}; {LIFT_HINT}")


def render(watched: Watched, now_s: float) -> None:
    """New flags are events, once per arming; a render process that ends a tick by an error or stays
    silent is a fault.

    Its last output is taken away before that (the pump's `OUTPUT_STALE_S`), and is there again if
    render was only late.
    """
    orders, output = watched.orders, watched.shared.output.read()
    with orders.lock:
        if watched.arming != orders.machine.arming:
            watched.arming, watched.flags, watched.gain = orders.machine.arming, NO_FLAGS, 1.0
        rendering, flags = orders.rendering, orders.flags_of(output)
        new = flags & ~watched.flags
        watched.flags |= new
    for name in new.names():
        watched.events.tell("flag", name)
    if rendering and Flag.FAULT in flags:
        orders.fail("render ended with an error; its log says which")
    if rendering and now_s - output.time_s > SILENT_S:
        orders.fail(f"render has said nothing for {now_s - output.time_s:.2g} s")


def underruns(watched: Watched, now_s: float) -> None:
    """Gaps of an analog envelope since the last report of some."""
    count = watched.shared.played.read().underruns
    if count > watched.underruns and now_s - watched.underrun_s >= UNDERRUN_TOLD_S:
        watched.underruns, watched.underrun_s = count, now_s
        watched.orders.raise_flag(Flag.UNDERRUN)
        watched.events.tell("flag", "underrun", underruns=count)


def timing(watched: Watched, now_s: float) -> None:
    """While there may be output, ticks that come too seldom in time: what was late, and what to
    do.
    """
    if not watched.orders.rendering or now_s - watched.timing_s < TIMING_TOLD_S:
        return
    found = timing_of(watched.shared.ring.newest(RECENT_TICKS), watched.render.period_s)
    if found.in_time is not None and found.in_time < ENOUGH:
        watched.timing_s = now_s
        said = (
            f"{found.in_time:.0%} of the last {RECENT_TICKS} ticks in time; {found.last_cause}:"
            f" {watched.advice()}"
        )
        watched.events.tell("timing", said, in_time=found.in_time)


def script(watched: Watched, now_s: float) -> None:
    """Markers of a script, when they pass; at its end the output goes off."""
    orders = watched.orders
    with orders.lock:
        rendering, target, number = orders.rendering, watched.targets.target, orders.order.target
    since_s = watched.marked_s if number == watched.target else -inf
    watched.target, watched.marked_s = number, now_s
    if rendering and isinstance(target, Script):
        for marker in target.markers(since_s, now_s):
            watched.events.tell("marker", marker.label, due_s=marker.time_s)
        if now_s >= target.end_s:
            _end_script(watched, number)


def _end_script(watched: Watched, number: int) -> None:
    """Off and armed, unless somebody hands over another target just now."""
    orders = watched.orders
    if watched.targets.choosing.acquire(blocking=False):
        try:
            if orders.order.target == number:
                orders.withdraw(orders.machine.off, overtakes=False)
                watched.events.tell("state", f"the script has ended; {orders.said}")
        finally:
            watched.targets.choosing.release()


def drift(watched: Watched, now_s: float) -> None:
    """The finger's estimated gain where it is far from the last report, or from 1 at arming; at
    most every 5 s.
    """
    newest = watched.shared.ring.newest(1)
    if not watched.orders.rendering or not newest.size or not newest["in_contact"][-1]:
        return
    gain = float(newest["feedback_gain"][-1])
    if abs(gain / watched.gain - 1.0) > DRIFT and now_s - watched.drift_s >= DRIFT_TOLD_S:
        watched.gain, watched.drift_s = gain, now_s
        said = f"the finger's gain is {gain:.2f}: feedback closes what the model lacks"
        watched.events.tell("drift", f"{said}; haptic use MODEL --no-feedback shows it", gain=gain)


def latency(watched: Watched, now_s: float) -> None:
    """A latency that is surely another than the rig's file says, once per arming."""
    orders, found = watched.orders, watched.latency()
    if not found.is_far_off or orders.has_raised(Flag.LATENCY):
        return
    orders.raise_flag(Flag.LATENCY)
    measured_ms, budget_ms = 1e3 * (found.measured_s or 0.0), 1e3 * found.budget_s
    said = f"{measured_ms:.1f} ms from place to friction, {budget_ms:.1f} ms by the rig's file: "
    numbers = {"measured_s": found.measured_s, "error_s": found.error_s, "budget_s": found.budget_s}
    watched.events.tell("latency", f"{said}look at {LATENCY_KEY} there", key=LATENCY_KEY, **numbers)


WATCHERS: tuple[Callable[[Watched, float], None], ...] = (
    lease,
    contacts,
    render,
    underruns,
    timing,
    script,
    drift,
    latency,
)
