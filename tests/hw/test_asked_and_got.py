"""Every driver, every setting of it, and a device that answers with another value than was asked.

What is computed from a setting must follow the device, or the device is refused. `held` of a driver
lists its settings; each of them has a case here, and a driver without `held` has a reason.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hw
from hw.analog.lines import AnalogInputs
from hw.analog.ni_daq import NiAnalogInputs, NiAnalogOutput, NiCards
from hw.analog.output import AnalogOutput, AnalogOutputSettings
from hw.analog.simulated_output import CardMemory, SimulatedAnalogOutput
from hw.analog.sound_card import SoundCardOutput, SoundSettings
from hw.camera.contract import Camera
from hw.camera.genicam import GenicamCamera, GenicamSettings
from hw.errors import BadReply, DeviceError, InstrumentRejected, LimitExceeded
from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.driver import GeneratorDriver
from hw.generator.keysight.driver import KeysightGenerator
from hw.generator.keysight_33500.driver import Keysight33500
from hw.generator.settings import GeneratorSettings
from hw.generator.siglent_sdg.driver import SiglentSdg
from hw.impedance.e4980a import E4980A, LcrMeter
from hw.monitor.lines import MonitorLines
from hw.monitor.simulated import ElectrodeState, SimulatedLines
from hw.oscilloscope.infiniivision import InfiniiVision, Oscilloscope
from hw.serving.memory import MemoryTransport
from hw.serving.responder import Responder
from hw.stage.lts150 import Lts150, StageSettings
from hw.stage.simulated import SimulatedLts150
from tests.clock import ManualClock
from tests.hw.generator.analog_carrier.bench import Bench as CarrierBench
from tests.hw.generator.kinds import KINDS, SETTINGS, Bench
from tests.hw.testing import genicam, sound_card
from tests.hw.testing.ni_card import constants, install
from tests.hw.testing.simulated_lcr_meter import SimulatedE4980A
from tests.hw.testing.simulated_oscilloscope import SimulatedInfiniiVision

OUTPUT = AnalogOutputSettings(-5.0, 5.0, -5.0, sample_rate_limit_hz=100e3)
LINES = MonitorLines(0.01, 500.0)

NOTHING_TO_COERCE = {
    "NiDigitalInput": "a level is read",
    "NiDigitalOutput": "a level is read back by who sets it",
    "EvdevTouchScreen": "reads what comes",
    "StageFinger": "reads the stage",
    "NetFt": "asks for a stream; scale and rate are of the box's own page",
    "HeartbeatInterlock": "each beat and level is answered",
    "ModemLine": "the level is read back where a wire brings it back",
    "EventLine": "what every kind of line is",
    "ModemEventLine": "a level; no wire brings it back",
    "NiEventLine": "levels are written, and no wire brings them back",
    "ParallelPort": "a byte on its data lines; no wire brings it back",
    "LineIn": "what every kind of line in is",
    "ModemLineIn": "a level is read",
    "NiLineIn": "a level is read",
    "ParallelPortIn": "a level is read",
    "TriggerBoxIn": "reads what comes",
    "SimulatedLineIn": "a trigger box on a pseudo-terminal, which sends when it is told",
    "SimulatedEventLine": "a trigger box on a pseudo-terminal, which keeps its edges",
    "TriggerBox": "takes bytes, and answers none",
    "Watchdog": "a process with its own protocol, which answers",
    "NiCards": "hands on what its cards hold",
    "SimulatedCamera": "draws what it is asked for",
}
NO_DRIVERS = ("hw.transport", "hw.serving", "hw.generator.contract", "hw.generator.dialogue")
NO_DEVICES = {"CardMemory", "NetFtServer", "ScpiLine"}


def drivers() -> dict[str, type[Any]]:
    """What of `hw` can be opened or connected, is no simulator and is no way to a device."""
    found = {}
    for module in pkgutil.walk_packages(hw.__path__, "hw."):
        if module.name.startswith(NO_DRIVERS):
            continue
        for name, kind in inspect.getmembers(importlib.import_module(module.name), inspect.isclass):
            opens = any(hasattr(kind, step) for step in ("open", "connect", "start"))
            if kind.__module__ == module.name and opens and name not in NO_DEVICES:
                found[name] = kind
    return found


def test_every_driver_is_walked_or_says_why_not():
    walked = {"SimulatedAnalogOutput", "NiAnalogInputs", "NiAnalogOutput", "SoundCardOutput"}
    walked |= {
        "AnalogCarrier",
        "InfiniiVision",
        "E4980A",
        "Lts150",
        "GenicamCamera",
        "Agilent33220A",
        "Keysight33500",
        "SiglentSdg",
    }
    unfinished = {AnalogInputs, AnalogOutput, Camera, GeneratorDriver, KeysightGenerator}
    there = {
        name: kind
        for name, kind in drivers().items()
        if kind not in unfinished and not inspect.isabstract(kind)
    }
    assert set(there) == walked | set(NOTHING_TO_COERCE)
    assert all(hasattr(there[name], "held") for name in walked)
    assert {Agilent33220A, Keysight33500, SiglentSdg} <= set(there.values())


class Coercing:
    """Makes another value of what is set: a command as the instrument hears it, or its answer."""

    def __init__(
        self,
        core: Responder,
        heard: dict[str, str] | None = None,
        said: dict[str, str] | None = None,
    ) -> None:
        self._core, self._heard, self._said = core, heard or {}, said or {}

    def handle(self, data: bytes) -> bytes:
        text = data.decode("latin-1")
        for pattern, other in self._heard.items():
            text = re.sub(pattern, other, text)
        answer = self._core.handle(text.encode("latin-1")).decode("latin-1")
        for pattern, other in self._said.items():
            answer = re.sub(pattern, other, answer)
        return answer.encode("latin-1")


# --- cards
# -----------------------------------------------------------------------------------------


def coerce_rate(card: Any) -> None:
    card.timebase_hz = 150e3  # a third of which is more than was asked for


def coerce_buffer(card: Any) -> None:
    card.most_samples = 1000


def coerce_terminal(card: Any) -> None:
    card.terminals = {"DIFF": constants.TerminalConfiguration.RSE}


def coerce_range(card: Any) -> None:
    card.ranges_v = (5.0,)


CARD: dict[str, Callable[[Any], None]] = {
    "sample_rate_hz": coerce_rate,
    "buffer_s": coerce_buffer,
    "terminal of Dev1/ai0": coerce_terminal,
    "range_v of Dev1/ai0": coerce_range,
}
TAKEN_IN = {"sample_rate_hz", "buffer_s"}


def test_the_cases_of_a_card_are_its_settings(monkeypatch):
    install(monkeypatch)
    inputs = NiCards([NiAnalogInputs(["Dev1/ai0"], sample_rate_hz=48e3)])
    inputs.open()
    assert {one.name for one in inputs.held()} == set(CARD)
    inputs.close()


@pytest.mark.parametrize("name", CARD)
def test_a_card_is_taken_at_its_word_or_refused(name, monkeypatch):
    card = install(monkeypatch)
    CARD[name](card)
    inputs = NiAnalogInputs(
        ["Dev1/ai0"], sample_rate_hz=48e3, clock=lambda: card.now_s, sleep=card.advance
    )
    if name not in TAKEN_IN:
        with pytest.raises(InstrumentRejected, match=name) as refused:
            inputs.open()
        assert refused.value.code == "instrument_rejected"
        return
    inputs.open()
    held = {one.name: one for one in inputs.held()}
    assert held[name].as_asked is False
    assert getattr(inputs, name) == held[name].got
    inputs.close()


@pytest.mark.parametrize("kind", ["NiAnalogOutput", "SoundCardOutput", "SimulatedAnalogOutput"])
def test_an_output_plays_at_its_own_rate(kind, monkeypatch):
    install(monkeypatch)
    sound_card.install(monkeypatch)
    monkeypatch.setattr(sound_card.OutputStream, "got_rate_hz", 47_990.0)
    memory, asked_hz = CardMemory(), 48e3
    output: AnalogOutput = {
        "NiAnalogOutput": lambda: NiAnalogOutput("Dev1/ao0", OUTPUT, watch=False),
        "SoundCardOutput": lambda: SoundCardOutput(
            "DAC", OUTPUT, SoundSettings(asked_hz, 5.0, dc_coupled=True), watch=False
        ),
        "SimulatedAnalogOutput": lambda: SimulatedAnalogOutput(
            lambda: memory, OUTPUT, clock=lambda: 0.0, watch=False
        ),
    }[kind]()
    with output:
        got_hz = output.plays_at(asked_hz)
        assert got_hz != asked_hz
        assert next(one for one in output.held() if one.name == "sample_rate_hz").got == got_hz
        output.write(np.full(240, -5.0), got_hz)
        assert output.buffered_s == pytest.approx(240.0 / got_hz, rel=1e-9)
        output.zero()
        with pytest.raises((InstrumentRejected, LimitExceeded), match="sample"):
            output.write(np.full(240, -5.0), asked_hz)


def test_a_sound_cards_latency_is_that_of_its_stream(monkeypatch):
    sound_card.install(monkeypatch)
    monkeypatch.setattr(sound_card.OutputStream, "got_latency_s", 0.06)
    settings = SoundSettings(48e3, 5.0, dc_coupled=True)
    with SoundCardOutput("DAC", OUTPUT, settings, watch=False) as output:
        assert {one.name for one in output.held()} == {"sample_rate_hz", "latency_s"}
        assert output.latency_s == 0.06


def test_the_rate_that_the_card_got_makes_the_frequency():
    """At 48 kS/s the simulated card plays 20 MHz / 417."""
    settings = GeneratorSettings(100.0, 150.0, 100.0, 2e3)
    bench = CarrierBench(settings, 48e3)
    bench.driver.connect()
    bench.driver.set_point(1000.0, 120.0)
    bench.driver.set_output(True)
    bench.pass_s(0.5)
    samples_v, rate_hz = bench.card.recent(bench.clock(), 10_000)
    assert rate_hz == pytest.approx(20e6 / 417)
    rises = np.flatnonzero((samples_v[:-1] < 0.0) & (samples_v[1:] >= 0.0))
    period = (rises[-1] - rises[0]) / (rises.size - 1)
    assert rate_hz / period == pytest.approx(1000.0, rel=2e-4)
    assert next(one for one in bench.driver.held()).as_asked is False


# --- generators
# ------------------------------------------------------------------------------------

OTHERWISE = {
    "OUTP:LOAD": "50",
    "VOLT:UNIT": "VRMS",
    "FUNC": "SQU",
    "AM:STAT": "1",
    "BURS:STAT": "1",
    "OUTP:POL": "INV",
    "OUTP:SYNC": "0",
    "VOLT:RANG:AUTO": "ON",
    "VOLT:LIM:STAT": "0",
    "C1:OUTP LOAD": "50",
    "C1:OUTP PLRT": "INVT",
    "C1:SYNC": "OFF",
    "C1:BSWV WVTP": "SQUARE",
    "C1:BSWV PHSE": "90",
    "C1:MDWV STATE": "ON",
}
_NEVER_SET = ("C1:BSWV PHSE", "C1:MDWV STATE")  # a reset does; the answer is what changes


def coerced(name: str, core: Responder) -> Coercing:
    other = OTHERWISE[name]
    if name in _NEVER_SET:
        key = name.partition(" ")[2]
        return Coercing(core, said={rf"{key},\w+": f"{key},{other}"})
    header, _, key = name.partition(" ")
    wanted = rf"(?<![:\w]){header} {key},\w+" if key else rf"(?<![A-Z]){name} [^;\s]+"
    return Coercing(core, heard={wanted: f"{header} {key},{other}" if key else f"{name} {other}"})


def settings_of(kind: str) -> list[str]:
    bench = Bench(kind)
    bench.connect()
    return [one.name for one in bench.driver.held()]


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in KINDS for name in settings_of(kind)]
)
def test_a_generator_that_makes_another_of_a_setting_is_off_and_refused(kind, name):
    bench = Bench(kind)
    driver = bench.kind.make(MemoryTransport(coerced(name, bench.generator)), SETTINGS)
    with pytest.raises(DeviceError):
        driver.connect()
    assert not bench.generator.output().on


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("pattern", "other"),
    [
        (r"VOLT 2\.4", "VOLT 2.41"),
        (r"FREQ 250", "FREQ 250.1"),
        (r"VOLT:OFFS 0\.5", "VOLT:OFFS 0.51"),
        (r"AMP,2\.4", "AMP,2.41"),
        (r"FRQ,250", "FRQ,250.1"),
        (r"OFST,0\.5", "OFST,0.51"),
    ],
)
def test_a_level_or_frequency_beyond_rounding_is_off_and_refused(kind, pattern, other):
    bench = Bench(kind)
    coercing = Coercing(bench.generator, heard={pattern: other})
    driver = bench.kind.make(MemoryTransport(coercing), SETTINGS)
    driver.connect()
    speaks = ("C1:" in bench.kind.switch_off.decode()) == ("," in other)
    if speaks:
        with pytest.raises(BadReply, match="where"):
            driver.set_point(250.0, 120.0, 50.0)
        assert not bench.generator.output().on


# --- instruments at the electrode
# ------------------------------------------------------------------


def scope_on(core: Responder) -> InfiniiVision:
    clock = ManualClock(0.0)
    return InfiniiVision(
        MemoryTransport(core), Oscilloscope(), LINES, clock=clock, sleep=clock.sleep
    )


def simulated_scope(state: ElectrodeState | None = None) -> SimulatedInfiniiVision:
    return SimulatedInfiniiVision(SimulatedLines(lambda: state, LINES, (1e-4, 1e-4), 2))


def names_of(driver: Any) -> list[str]:
    driver.open()
    return [one.name for one in driver.held()]


def other_than(core: Responder, name: str) -> Coercing:
    """Whatever is set there, the instrument then holds something else."""
    return Coercing(_Answering(core, f"{name}?"))


class _Answering:
    """One question is answered with what nobody asked for."""

    def __init__(self, core: Responder, question: str) -> None:
        self._core, self._question = core, question.encode()

    def handle(self, data: bytes) -> bytes:
        return b"7.5\n" if data.strip() == self._question else self._core.handle(data)


@pytest.mark.parametrize("name", names_of(scope_on(simulated_scope())))
def test_an_oscilloscope_that_makes_another_of_a_setting_is_refused(name):
    with pytest.raises(InstrumentRejected, match=re.escape(name)):
        scope_on(other_than(simulated_scope(), name)).open()


@pytest.mark.parametrize("frequency_hz", [700.0, 3300.0, 17e3])
@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_a_reading_is_of_the_time_base_and_the_range_that_were_got(frequency_hz, scale):
    """The simulator's go in steps of 1, 2, 5; here they are off by more."""
    voltage_v, current_a = 4.9 * np.exp(-0.3j), 2e-5j
    core = simulated_scope(ElectrodeState(frequency_hz, voltage_v, current_a))

    def scaled(match: re.Match[str]) -> str:
        return f"{match[1]} {scale * float(match[2]):.6g}"

    coercing = Coercing(core, heard={r"(:TIM:RANG|:CHAN\d:RANG) (\S+)": scaled})  # type: ignore[dict-item]
    scope = scope_on(coercing)
    scope.open()
    found = scope.read(frequency_hz, 5.0)
    assert found.voltage_v == pytest.approx(voltage_v, rel=5e-3)
    assert found.current_a == pytest.approx(current_a, rel=2e-2)


@pytest.mark.parametrize(
    "name", names_of(E4980A(MemoryTransport(SimulatedE4980A(lambda f: 1e4 + 0j)), LcrMeter()))
)
def test_a_meter_that_makes_another_of_a_setting_is_refused(name):
    core = other_than(SimulatedE4980A(lambda f: 1e4 + 0j), name)
    with pytest.raises((InstrumentRejected, BadReply), match=re.escape(name) + r"|holds 7\.5 V"):
        E4980A(MemoryTransport(core), LcrMeter()).open()


@pytest.mark.parametrize(
    ("pattern", "other"),
    [(r":FREQ:CW 1000", ":FREQ:CW 1010"), (r":VOLT:LEV 1\.4\d+", ":VOLT:LEV 2")],
)
def test_a_meter_at_another_frequency_or_level_gives_no_number(pattern, other):
    core = SimulatedE4980A(lambda f: 1 / (2j * np.pi * f * 1e-9))
    meter = E4980A(MemoryTransport(Coercing(core, heard={pattern: other})), LcrMeter())
    meter.open()
    with pytest.raises(InstrumentRejected, match=r"frequency_hz|level_v_rms"):
        meter.read(1e3, 2.0)
    assert core.voltage_v == 0.0


# --- stage
# -----------------------------------------------------------------------------------------

STAGE = StageSettings(0.0, 0.150, 0.020, 0.020, 0.080, 0.080)


OTHER = {"AcquisitionFrameRate": 12.4, "ExposureTime": 8000.0, "AcquisitionFrameCount": 3}


def features_of() -> list[str]:
    with pytest.MonkeyPatch.context() as patch:
        genicam.install(patch)
        return names_of(GenicamCamera(GenicamSettings("a.cti")))


@pytest.mark.parametrize("name", features_of())
def test_a_camera_that_makes_another_of_a_feature_is_refused(name, monkeypatch):
    device = genicam.install(monkeypatch)
    device.features[name] = genicam.Feature(lambda value: OTHER.get(name, "Continuous"))
    with pytest.raises(InstrumentRejected, match=name):
        GenicamCamera(GenicamSettings("a.cti")).open()


@pytest.mark.parametrize("name", ["velocity_m_s", "acceleration_m_s2"])
def test_a_stage_that_is_slower_than_asked_is_refused(name):
    """It clips at 50 mm/s and 50 mm/s2 and says so."""
    clock = ManualClock(0.0)
    settings = replace(STAGE, **{name: 0.07})  # type: ignore[arg-type]
    transport = MemoryTransport(SimulatedLts150(clock), clock=clock)
    stage = Lts150(transport, settings, clock=clock, sleep=clock.sleep)
    with pytest.raises(BadReply, match="where"):
        stage.connect()
    held = {one.name: one for one in stage.held()}
    assert set(held) == {"velocity_m_s", "acceleration_m_s2"}
    assert held[name].got == pytest.approx(0.05, rel=1e-3)
    assert held[name].as_asked is False
