"""Orders and what is watched beside them, without a rig: off waits for nobody, and everything is
told once.
"""

import math
import threading
from types import SimpleNamespace

import pytest

from haptic_driver.daemon import watchers
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.judge import MeasuredLatency
from haptic_driver.daemon.loader import Asking
from haptic_driver.daemon.messages import DaemonState, RefusedError
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.daemon.watchers import UNDERRUN_TOLD_S, WATCHERS
from haptic_driver.errors import HapticError
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import NO_OUTPUT, NOT_PLAYED, NOTHING_SENSED
from haptic_driver.render.texture import Script, Step, Uniform
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.states import RigEvent, RigState
from haptic_driver.textures.reach import demand
from tests.clock import ManualClock
from tests.haptic_driver.daemon.ticks import made_tick
from tests.waiting import HANG_S, until

LEASE_S = 0.5
KNOWN_OFF = KnownOutput(False, "generator says off", 0.1)


class Bench:
    """Everything of control but its processes and devices; `switched_off` counts how often the
    actuator was told.
    """

    def __init__(self, config, surface_file):
        self.clock, self.switched_off = ManualClock(100.0), 0
        render = render_settings(config, surface_file)
        settings = DaemonSettings("simulated", "reference", config, surface_file, render)
        self.daemon = daemon = Daemon(settings, self.clock)
        self.shared, self.events, self.targets = daemon.shared, daemon.event_log, daemon.targets
        self.orders, self.watched = daemon._orders, daemon._watched
        rig = SimpleNamespace(state=RigState.OFF, output=KNOWN_OFF)
        self.orders.pump.actuator = SimpleNamespace(
            rig=rig, off=self._off, carrier_hz=math.nan, full_scale_v=0.0, switched=0
        )
        self.latency = MeasuredLatency(0.0375, 0.0004, 0.0375, "")
        self.watched.advice, self.watched.latency = lambda: "do this", lambda: self.latency
        self.orders.machine.connected()

    def _off(self):
        self.switched_off += 1

    def arm(self):
        return self.orders.arm(LEASE_S).token

    def rendered(self, flags=Flag(0)):  # noqa: B008
        """Render has said something now."""
        order = self.orders.order
        self.shared.output.write(
            NO_OUTPUT._replace(
                order=order.number, target=order.target, time_s=self.clock.now_s, flags=int(flags)
            )
        )

    def watch(self, after_s=0.02):
        """The events of one look."""
        before = len(self.events.since(0))
        self.clock.now_s += after_s
        for watch in WATCHERS:
            watch(self.watched, self.clock.now_s)
        return [(event.kind, event.message) for event in self.events.since(before)]


@pytest.fixture
def bench(rig_config, surface_file):
    bench = Bench(rig_config, surface_file)
    yield bench
    bench.daemon.close()


@pytest.mark.parametrize(("contacts", "is_fault"), [(math.nan, False), (1.0, False), (2.0, True)])
def test_a_second_finger_that_the_rigs_figure_does_not_cover_switches_off(
    bench, contacts, is_fault
):
    """It feels the same voltage; the simulated rig's 100 mm2 are those of the model's finger."""
    bench.arm()
    bench.rendered()
    bench.shared.sensed.write(NOTHING_SENSED._replace(contacts=contacts))
    events = bench.watch()
    assert (bench.orders.machine.state is DaemonState.FAULT) == is_fault
    assert bench.switched_off == int(is_fault)
    said = (
        "2 fingers touch the screen, more than 1: limits.touching_area_m2 has the limits hold for"
    )
    assert [message.startswith(said) for kind, message in events if kind == "fault"] == (
        [True] if is_fault else []
    )


def test_switching_off_waits_for_nobody_who_holds_the_lock(bench):
    bench.arm()
    switching = threading.Thread(target=bench.orders.withdraw, args=(bench.orders.machine.disarm,))
    tripping = threading.Thread(
        target=bench.orders.rig_says, args=(RigEvent(0.0, RigState.TRIPPED, "over-current"),)
    )
    with bench.orders.lock:
        tripping.start()
        tripping.join(HANG_S)
        assert not tripping.is_alive()
        switching.start()
        until(lambda: bench.switched_off)
        assert bench.orders.machine.state is DaemonState.ARMED  # what the state says waits
    switching.join(HANG_S)
    assert bench.orders.machine.state is DaemonState.IDLE
    assert ("trip", "over-current") in [
        (event.kind, event.message) for event in bench.events.since(0)
    ]


def test_what_reads_textures_comes_up_while_the_rest_is_started(bench, monkeypatch):
    """The first texture after the start waited seconds for it."""
    begun = []

    def ended():
        begun.append("the rest is awaited")
        raise HapticError("enough", "no rig is here", "")

    daemon = bench.daemon
    monkeypatch.setattr(daemon._loader, "start", lambda: begun.append("loader"))
    monkeypatch.setattr(daemon.supervisor, "start", lambda: begun.append("devices and render"))
    monkeypatch.setattr(daemon.supervisor, "await_all", ended)
    monkeypatch.setattr(daemon.basis, "start", lambda: None)
    monkeypatch.setattr(daemon, "_start_threads", lambda: None)
    monkeypatch.setattr(daemon, "close", lambda: None)  # which the fixture does
    with pytest.raises(HapticError, match="no rig is here"):
        daemon.start()
    assert begun == ["devices and render", "loader", "the rest is awaited"]


class SlowLoader:
    """It reads a texture, and `meanwhile` something else is done."""

    def __init__(self, meanwhile):
        self._meanwhile = meanwhile

    def texture(self, name, reachable_cof):
        self._meanwhile()
        return Asking(Uniform(0.6), demand(Uniform(0.6), reachable_cof), None, 1.0)


@pytest.mark.parametrize("verb", ["off", "disarm"])
def test_a_texture_that_was_being_read_at_off_is_not_rendered_after_it(bench, verb):
    """It took three seconds to be read, after OFF had been answered, and came on then."""
    token = bench.arm()
    moves = bench.orders.machine
    bench.targets._loader = SlowLoader(lambda: bench.orders.withdraw(getattr(moves, verb)))
    with pytest.raises(RefusedError) as refused:
        bench.targets.play(token, "linen", nearest=True)
    assert refused.value.code == {"off": "overtaken", "disarm": "not_armed"}[verb]
    assert not bench.orders.rendering
    bench.targets._loader = SlowLoader(lambda: None)
    bench.targets.play(bench.arm() if verb == "disarm" else token, "linen", nearest=True)
    assert bench.orders.rendering


def test_a_texture_that_is_being_read_as_a_script_ends_is_rendered(bench):
    token = bench.arm()
    script = Script((Step(0.0, Uniform(0.6), "hold", ""), Step(0.1, Uniform(0.6), "hold", "")))
    bench.targets.target = script.started(bench.clock.now_s - 1.0)
    bench.orders.render(token, 1)
    bench.rendered()

    def ends():
        bench.watch()
        assert not bench.orders.rendering

    bench.targets._loader = SlowLoader(ends)
    bench.targets.play(token, "linen", nearest=True)
    assert bench.orders.rendering


def test_a_fault_is_told_before_silent_instruments_have_been_waited_for(bench):
    """With all instruments hanging the daemon was "rendering" for half a minute, with its output
    unknown.
    """
    answers = threading.Event()
    bench.orders.pump.actuator.off = lambda: answers.wait(HANG_S)
    bench.arm()
    failing = threading.Thread(target=bench.orders.fail, args=("the generator does not answer",))
    failing.start()
    until(
        lambda: (
            ("fault", "the generator does not answer")
            in [(e.kind, e.message) for e in bench.events.since(0)]
        )
    )
    assert bench.orders.machine.state is DaemonState.FAULT
    assert failing.is_alive()
    answers.set()
    failing.join(HANG_S)
    assert not failing.is_alive()


def test_a_lease_is_over_after_the_ramp_and_not_before(bench):
    bench.arm()
    bench.rendered()
    assert bench.watch(LEASE_S + bench.watched.render.ramp_s - 0.01) == []
    assert bench.orders.machine.armed
    assert bench.watch(0.02) == [
        ("lease", f"the lease ran out; output {KNOWN_OFF}; the daemon is idle")
    ]
    assert bench.orders.machine.state is DaemonState.IDLE
    assert bench.switched_off == 1
    assert Flag.LEASE_LOST in bench.orders.flags(bench.shared.output.read())


def test_a_flag_is_told_once_per_arming(bench):
    for _ in range(2):
        bench.arm()
        bench.rendered(Flag.OVERRUN)
        assert bench.watch() == [("flag", "overrun")]
        assert bench.watch() == []
        bench.orders.withdraw(bench.orders.machine.disarm)


def test_what_render_flagged_before_it_heard_of_an_arming_does_not_count(bench):
    bench.rendered(Flag.OVERRUN)
    bench.arm()
    assert bench.watch() == []


def test_a_render_process_that_is_silent_while_it_renders_is_a_fault(bench):
    bench.orders.render(bench.arm(), 1)
    bench.rendered()
    assert bench.watch(watchers.SILENT_S - 0.01) == []
    assert bench.watch(0.02)[0][0] == "fault"
    assert bench.orders.machine.state is DaemonState.FAULT
    assert bench.switched_off == 1


def test_underruns_are_told_at_most_once_a_second(bench):
    bench.shared.played.write(NOT_PLAYED._replace(underruns=1))
    assert bench.watch() == [("flag", "underrun")]
    bench.shared.played.write(NOT_PLAYED._replace(underruns=5))
    assert bench.watch(0.5 * UNDERRUN_TOLD_S) == []
    assert bench.watch(0.6 * UNDERRUN_TOLD_S) == [("flag", "underrun")]
    assert bench.watch(2.0 * UNDERRUN_TOLD_S) == []


def test_markers_are_told_once_and_again_when_the_script_begins_anew(bench):
    token = bench.arm()
    for number in (1, 2):
        script = Script(
            (Step(0.0, Uniform(0.6), "hold", "begin"), Step(9.0, Uniform(0.6), "hold", "end"))
        )
        bench.targets.target = script.started(bench.clock.now_s)
        bench.orders.render(token, number)
        bench.rendered()
        due_s = bench.clock.now_s
        assert bench.watch() == [("marker", "begin")]
        assert bench.events.since(0)[-1].data["due_s"] == due_s
        assert bench.watch() == []


def test_a_script_that_has_ended_leaves_the_state_rendering(bench):
    """The page said RENDERING for ever after a script's last step."""
    token = bench.arm()
    script = Script((Step(0.0, Uniform(0.6), "hold", ""), Step(0.1, Uniform(0.6), "hold", "")))
    bench.targets.target = script.started(bench.clock.now_s)
    bench.orders.render(token, 1)
    bench.rendered()
    assert bench.watch(0.09) == []
    assert bench.orders.rendering
    with bench.targets.choosing:  # another target is on its way: it is not switched off
        assert bench.watch(0.02) == []
    assert bench.orders.rendering
    bench.rendered()
    assert bench.watch(0.02) == [
        ("state", f"the script has ended; output {KNOWN_OFF}; the daemon is armed")
    ]
    assert bench.orders.machine.state is DaemonState.ARMED
    assert bench.switched_off > 0
    assert bench.watch(0.02) == []


def test_a_gain_that_is_learnt_in_many_steps_is_told_once_in_five_seconds(bench):
    token = bench.arm()
    bench.orders.render(token, 1)
    told = []
    for tick in range(60):  # from 1 to 12.8 in 7.5 s
        bench.shared.ring.write(made_tick(tick, in_contact=1, feedback_gain=1.0 + 0.2 * tick))
        bench.orders.renew(token)
        bench.rendered()
        told += bench.watch(0.125)
    drifts = [message for kind, message in told if kind == "drift"]
    assert [message.partition(":")[0] for message in drifts] == [
        "the finger's gain is 1.40",
        "the finger's gain is 9.40",
    ]
    assert "--no-feedback shows it" in drifts[0]


def test_ticks_that_come_too_seldom_in_time_are_told_with_cause_and_remedy_and_take_nothing_away(
    bench,
):
    """Statistics warn; consequences trip."""
    token = bench.arm()
    bench.orders.render(token, 0)
    for tick in range(94):
        bench.shared.ring.write(made_tick(tick))
    bench.shared.ring.write(made_tick(99, lateness_s=0.0004))  # 5 of 100 missed: just enough
    bench.rendered()
    assert [event for event in bench.watch() if event[0] == "timing"] == []
    bench.shared.ring.write(made_tick(100, lateness_s=0.0031))
    bench.rendered()
    (told,) = [event for event in bench.watch() if event[0] == "timing"]
    assert (
        told[1]
        == "94% of the last 100 ticks in time; tick 100: render was woken 3.1 ms late: do this"
    )
    bench.rendered()
    assert [event for event in bench.watch() if event[0] == "timing"] == []
    assert bench.orders.rendering


def test_a_latency_far_from_the_rigs_file_is_told_once_per_arming(bench):
    for _ in range(2):
        bench.arm()
        bench.rendered()
        bench.latency = MeasuredLatency(0.0470, 0.0004, 0.0375, "")
        assert bench.watch() == []  # 9.5 ms
        bench.latency = MeasuredLatency(0.0521, 0.0004, 0.0375, "")
        ((kind, said),) = bench.watch()
        assert kind == "latency"
        assert said.startswith("52.1 ms from place to friction, 37.5 ms by the rig's file")
        assert "output.latency_s" in said
        assert bench.watch() == []
        assert Flag.LATENCY in bench.orders.flags(bench.shared.output.read())
        bench.orders.withdraw(bench.orders.machine.disarm)
    numbers = {"measured_s": 0.0521, "error_s": 0.0004, "budget_s": 0.0375}
    assert bench.events.since(0)[-1].data == numbers | {"key": "output.latency_s"}
