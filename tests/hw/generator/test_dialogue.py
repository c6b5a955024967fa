"""One line of the dialogue with a generator: what is checked, and what the gate forgets when it
fails.
"""

from __future__ import annotations

import pytest

from hw.errors import BadReply, DeviceTimeout, InstrumentRejected, LimitExceeded
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.contract import generator_kind
from hw.generator.dialogue import ScpiDialogue
from hw.generator.keysight.gate import KeysightGate
from hw.generator.settings import GeneratorSettings
from hw.serving.memory import MemoryTransport
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument

READY = ["OUTP 0", "*RST", "OUTP:LOAD INF", "VOLT:UNIT VPP", "VOLT 1"]


class Bench:
    def __init__(self) -> None:
        self.line = FaultyInstrument(Simulated33220A(IMMEDIATE))
        self.dialogue = ScpiDialogue(
            MemoryTransport(self.line),
            KeysightGate(GeneratorSettings(100.0, 300.0, 10.0, 10e3)),
            1.0,
        )
        self.dialogue.open()
        self.dialogue.command(READY, [])


def test_the_gate_believes_what_was_answered():
    assert float(Bench().dialogue.command(["VOLT 2"], ["VOLT?"])[0]) == 2.0


def test_after_a_garbled_answer_the_gate_believes_nothing():
    bench = Bench()
    bench.line.inject(Fault.GARBAGE)
    with pytest.raises(BadReply):
        bench.dialogue.command(["VOLT 2"], ["VOLT?"])
    with pytest.raises(LimitExceeded, match="not known"):
        bench.dialogue.command(["VOLT 2"], ["VOLT?"])


def test_after_a_rejection_the_gate_believes_nothing():
    bench = Bench()
    with pytest.raises(InstrumentRejected, match="-222"):
        bench.dialogue.command(["FREQ 1E9"], [])
    with pytest.raises(LimitExceeded, match="not known"):
        bench.dialogue.command(["VOLT 2"], [])


@pytest.mark.parametrize("text", ["", "0x10", "nan", "9E999"])
def test_what_is_no_finite_number_is_a_bad_reply(text):
    bench = Bench()
    with pytest.raises(BadReply, match="where a number was expected"):
        bench.dialogue.number(text)
    with pytest.raises(LimitExceeded, match="not known"):
        bench.dialogue.command(["VOLT 2"], [])


class Asleep:
    def handle(self, data: bytes) -> bytes:
        return b""


@pytest.mark.parametrize("kind", ["agilent_33220a", "siglent_sdg"])
def test_a_device_that_is_slow_to_wake_names_the_key_that_gives_it_time(kind):
    settings = GeneratorSettings(100.0, 300.0, 10.0, 10e3, reply_timeout_s=0.25)
    driver = generator_kind(kind).make(MemoryTransport(Asleep()), settings)
    with pytest.raises(DeviceTimeout) as caught:
        driver.identify()
    assert caught.value.hint.endswith("raise reply_timeout_s, now 0.25")
