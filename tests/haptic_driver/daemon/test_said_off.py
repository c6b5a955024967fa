"""Whatever says that the output is off says how old that is, and stops saying it in time.

The daemon's own control, unstarted, on a rig of simulated instruments by a clock that tests step.
"""

import math
import random
from contextlib import suppress

import pytest

from haptic_driver.cli import watch
from haptic_driver.cli.control import show_status
from haptic_driver.client import _require_off
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.event_line import EventLineWriter
from haptic_driver.daemon.messages import StateFrame
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.errors import HapticError
from haptic_driver.rig.actuator import make_actuator
from haptic_driver.rig.devices import build_rig
from haptic_driver.rig.evidence import FRESH_S, MONITOR_QUIET_V, Clock
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.event_lines import EventCodes
from haptic_driver.rig.rig import LOOK_S
from haptic_driver.rig.states import RigState
from haptic_driver.signals import DriveCommand
from hw.event_line.simulated import SimulatedEventLine
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.serving.memory import MemoryTransport
from tests.clock import ManualClock
from tests.haptic_driver.stand_ins import BreakableSensor
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument
from tests.hw.testing.tripping_amplifier import TrippingAmplifier

WATCH_S = 0.2  # between looks of the supervisor
BY_HAND = b"APPL:SIN 1000,1.6,0\n"  # 80 V at the electrode


class World:
    """A daemon of a rig where the generator alone can say off."""

    def __init__(self, config, surface_file):
        self.clock = ManualClock(100.0)
        self.amplifier = TrippingAmplifier(100.0, 700.0, enabled=True)
        self.generator = Simulated33220A(IMMEDIATE, listener=self.amplifier.drive)
        self.faults = FaultyInstrument(self.generator, sleep=self.clock.sleep)
        render = render_settings(config, surface_file)
        settings = DaemonSettings("simulated", "reference", config, surface_file, render)
        self.daemon = Daemon(settings, self.clock)
        self.orders = self.daemon._orders
        self.rig = build_rig(
            config,
            MemoryTransport(self.faults, clock=self.clock),
            BreakableSensor(),
            Wiring(fault=self.amplifier.fault_line),
            on_event=self.orders.rig_says,
            clock=Clock(self.clock, self.clock.sleep),
        )
        self.rig.connect()
        self.orders.pump.exchange(make_actuator(config, self.rig))
        self.orders.machine.connected()

    @property
    def electrode_v(self):
        return self.amplifier.drive(self.generator.output())

    def pass_by(self, seconds):
        """Let time pass, with the supervisor's looks; what was said of the output meanwhile."""
        said = []
        for _ in range(round(seconds / WATCH_S)):
            self.clock.sleep(WATCH_S)
            self.look()
            said.append(self.daemon.status().output_on)
        return said

    def look(self):
        """What the supervisor does, and what the daemon makes of it."""
        try:
            self.rig.watch(self.clock.now_s)
        except HapticError as error:
            self.orders.fail(error.message)


@pytest.fixture
def world(rig_config, surface_file):
    made = World(rig_config, surface_file)
    yield made
    made.faults.heal()
    made.daemon.close()


def places(world, capsys):
    """Every place that says off, and whether it does now."""
    daemon, orders, rig = world.daemon, world.orders, world.rig
    status = daemon.status()
    writer = EventLineWriter(
        SimulatedEventLine(),
        0.001,
        EventCodes(),
        daemon.shared.ring,
        lambda: orders.pump.output,
        daemon.event_log,
        lambda: None,
    )
    writer._on = True
    refused = False
    try:
        _require_off(status)
    except HapticError:
        refused = True
    show_status(status, in_short=True)
    short = capsys.readouterr().out
    show_status(status)
    whole = capsys.readouterr().out
    frame = StateFrame.model_construct(status=status)
    return {
        "the rig's state": rig.state is RigState.OFF,
        "the rig": rig.output.on is False,
        "the pump": orders.pump.output.on is False,
        "an event of control": "output off" in orders.said,
        "status": status.output_on is False,
        "its words": status.output_said.startswith("off"),
        "its voltage": status.voltage_v == 0.0,
        "haptic off": not refused,
        "haptic status": "output off" in " ".join(whole.split()),
        "a command in short": "output off" in " ".join(short.split()),
        "haptic watch": "output off" in watch._state(frame).plain,
        "the event line": [due.what for due in writer._seen()] == ["output off"],
    }


def test_every_place_that_says_off_stops_when_nobody_has_looked_for_a_second(world, capsys):
    """A trip was "fault, output off" for as long as one watched, with 80 V on the electrode."""
    assert all(places(world, capsys).values())
    world.clock.sleep(FRESH_S)
    assert all(places(world, capsys).values())
    world.clock.sleep(0.01)
    assert not any(places(world, capsys).values())
    world.rig.watch(world.clock.now_s)
    assert all(places(world, capsys).values())


def test_it_says_who_said_so_and_when(world):
    world.clock.sleep(0.3)
    status = world.daemon.status()
    by = "generator says off, amplifier unknown, no monitor"
    assert status.output_said == f"off ({by}, 0.3 s ago)"
    assert status.output_age_s == pytest.approx(0.3)
    assert str(status).startswith(f"idle, output {status.output_said}\n")


def test_a_generator_that_falls_silent_after_a_trip_is_unknown_and_told(world):
    """It was shown off by its last answer, with 80 V on the electrode."""
    world.generator.handle(BY_HAND)
    world.pass_by(1.2)
    assert world.rig.state is RigState.TRIPPED
    assert world.electrode_v == 0.0
    world.generator.handle(BY_HAND)
    world.faults.inject(Fault.HANG, count=math.inf)
    said = world.pass_by(10.0)
    assert world.electrode_v == pytest.approx(80.0, rel=1e-3)
    assert set(said[round(FRESH_S / WATCH_S) :]) == {None}
    told = [event for event in world.daemon.events(0) if event.kind == "output"]
    assert "generator does not answer" in told[-1].message
    assert world.daemon.status().voltage_v is None
    assert world.daemon.off().output_on is None


def test_a_generator_that_takes_no_off_after_a_trip_is_on(world, monkeypatch):
    handle = world.generator.handle
    deaf = lambda data: handle(data.replace(b"OUTP 0", b"*WAI"))  # noqa: E731
    monkeypatch.setattr(world.faults, "_core", type("Deaf", (), {"handle": staticmethod(deaf)}))
    world.generator.handle(BY_HAND)
    said = world.pass_by(8.0)
    assert world.generator.output().on
    assert set(said[round(FRESH_S / WATCH_S) :]) == {True}


def test_a_trip_while_the_generator_is_silent_is_never_shown_by_an_older_off(world):
    """An OFF from before the arming stood in for six seconds."""
    world.rig.command(world.clock.now_s, DriveCommand(250.0, 80.0, True))
    assert world.rig.state is RigState.ON
    world.faults.inject(Fault.HANG, count=math.inf)
    world.amplifier.trip()
    with pytest.raises(HapticError, match="fault line says fault"):
        world.rig.hold(world.clock.now_s)
    assert world.daemon.status().output_on is None


def test_one_lost_answer_blinds_nobody(world):
    """The next look came 30 s later: a generator switched on by hand was noticed after 28 s."""
    world.pass_by(1.0)
    world.faults.inject(Fault.SILENCE, count=1)
    world.pass_by(1.0)
    assert world.daemon.status().output_on is False
    world.generator.handle(BY_HAND)
    world.pass_by(1.0)
    assert world.rig.state is RigState.TRIPPED
    assert world.electrode_v == 0.0


def test_a_generator_that_answers_again_is_asked_with_every_look_again(world):
    """So too after a reset: it was asked 30 s after its last silence, whatever came between."""
    world.faults.inject(Fault.SILENCE, count=math.inf)
    world.pass_by(3.0)
    assert world.daemon.status().output_on is None
    world.faults.heal()
    world.rig.off()
    world.generator.handle(BY_HAND)
    world.pass_by(LOOK_S + 2 * WATCH_S)
    assert world.rig.state is RigState.TRIPPED


ASKED_S = 0.02  # 50 times a second
LONGEST = 60  # of them are in the time that an answer counts
FAULTS = (
    lambda world, chance: world.generator.handle(BY_HAND),
    lambda world, chance: world.faults.inject(
        chance.choice(list(Fault)), count=chance.choice([1, 2, 5, math.inf]), delay_s=0.3
    ),
    lambda world, chance: world.faults.heal(),
    lambda world, chance: world.rig.off(),
    lambda world, chance: world.rig.reset_trip(),
    lambda world, chance: world.rig.connect(),
    lambda world, chance: world.rig.command(world.clock.now_s, DriveCommand(250.0, 80.0, True)),
)


def test_off_was_true_at_the_instant_that_it_names_through_random_faults(world):
    """Asked 50 times a second; the supervisor's looks come as late as a busy machine lets them."""
    chance, told, wrong = random.Random(5), [], []
    for _ in range(40):
        with suppress(HapticError):
            chance.choice(FAULTS)(world, chance)
        looks_s = 0.0
        for _ in range(chance.randrange(1, 60)):
            world.clock.sleep(ASKED_S)
            if world.clock.now_s >= looks_s:
                looks_s = world.clock.now_s + chance.choice([WATCH_S, WATCH_S, 2.0])
                world.look()
            told.append((world.clock.now_s, world.electrode_v))
            output = world.orders.pump.output
            if output.on is False:
                since_s = world.clock.now_s - output.age_s - ASKED_S
                seen_v = [v for t, v in told[-LONGEST:] if t >= since_s]
                wrong += [output] if min(seen_v) > MONITOR_QUIET_V or output.age_s > 1.0 else []
    assert wrong == []
    assert max(v for _, v in told) > 70.0
