"""The SDG driver by exact bytes; answers in the form of Siglent's programming guide (PG02, 3.3 and
3.4).
"""

from __future__ import annotations

import pytest

from hw.errors import BadReply, LimitExceeded
from hw.generator.settings import GeneratorSettings
from hw.generator.siglent_sdg.driver import SiglentSdg
from hw.generator.siglent_sdg.gate import SiglentGate
from hw.serving.memory import MemoryTransport

SETTINGS = GeneratorSettings(100.0, 300.0, 10.0, 10e3)
IDENTITY = (b"*IDN?\n", b"Siglent Technologies,SDG2042X,SDG2XCAX1R1234,2.01.01.35R3B2\n")
OFF = (b"C1:OUTP?\n", b"C1:OUTP OFF,LOAD,HZ,PLRT,NOR\n")
ON = (b"C1:OUTP?\n", b"C1:OUTP ON,LOAD,HZ,PLRT,NOR\n")
PLAIN = (b"C1:MDWV?\n", b"C1:MDWV STATE,OFF\n")
RESET = [(line, b"") for line in (b"C1:OUTP OFF\n", b"*RST\n", b"C1:OUTP OFF\n")] + [OFF]


def told(*lines: bytes) -> list[tuple[bytes, bytes]]:
    return [(line + b"\n", b"") for line in lines]


def wave(frequency: bytes, amplitude: bytes, offset: bytes = b"0") -> tuple[bytes, bytes]:
    return (
        b"C1:BSWV?\n",
        b"C1:BSWV"
        b" WVTP,SINE,FRQ,%bHZ,PERI,0.001S,AMP,%bV,AMPVRMS,1.414Vrms,"
        b"OFST,%bV,HLEV,2V,LLEV,-2V,PHSE,0\n" % (frequency, amplitude, offset),
    )


SET_UP = [
    *RESET,
    *told(
        b"C1:OUTP LOAD,HZ",
        b"C1:OUTP PLRT,NOR",
        b"C1:SYNC ON",
        b"C1:BSWV AMP,0.004",
        b"C1:BSWV OFST,0",
        b"C1:BSWV WVTP,SINE",
        b"C1:BSWV FRQ,10",
    ),
    wave(b"10", b"0.004"),
    OFF,
    PLAIN,
    (b"C1:SYNC?\n", b"C1:SYNC ON\n"),
]

READY = ("*RST", "C1:OUTP LOAD,HZ", "C1:BSWV AMP,0.004", "C1:BSWV OFST,0", "C1:BSWV WVTP,SINE")
PASSES = ("C1:BSWV AMP,6", "C1:BSWV FRQ,250", "C1:BSWV AMP,0.004", "C1:OUTP OFF", "C1:BSWV?")
UNCLEAR = (b"C1:OUTP MAYBE,LOAD,HZ,PLRT,NOR\n", b"\n", b"OFF\n", b"C2:OUTP OFF,LOAD,HZ,PLRT,NOR\n")


class Script:
    def __init__(self, *pairs: tuple[bytes, bytes]) -> None:
        self.pairs = list(pairs)

    def handle(self, data: bytes) -> bytes:
        asked, answer = self.pairs.pop(0)
        assert data == asked
        return answer


def connected(*pairs: tuple[bytes, bytes]) -> tuple[SiglentSdg, Script]:
    script = Script(IDENTITY, *RESET, *SET_UP, *pairs)
    driver = SiglentSdg(MemoryTransport(script), SETTINGS)
    driver.connect()
    return driver, script


def test_one_setting_per_line_and_all_of_it_read_back():
    driver, script = connected(
        *told(b"C1:BSWV OFST,0.5", b"C1:BSWV FRQ,250", b"C1:BSWV AMP,2.4"),
        wave(b"250", b"2.4", b"0.5"),
        OFF,
        PLAIN,
        wave(b"250", b"2.4", b"0.5"),
        OFF,
        PLAIN,
        *told(b"C1:OUTP ON"),
        ON,
        *told(b"C1:BSWV AMP,1.2", b"C1:BSWV FRQ,260"),
        wave(b"260", b"1.2", b"0.5"),
        ON,
        PLAIN,
        *told(b"C1:BSWV AMP,0.004", b"C1:BSWV OFST,0", b"C1:OUTP OFF"),
        OFF,
    )
    driver.set_point(250.0, 120.0, 50.0)
    driver.set_output(True)
    driver.set_point(260.0, 60.0, 50.0)
    assert driver.off() is True
    assert not script.pairs


@pytest.mark.parametrize(
    "answers",
    [
        [wave(b"250", b"4.8"), OFF, PLAIN],  # clipped, or rescaled
        [wave(b"250", b"2.4"), (b"C1:OUTP?\n", b"C1:OUTP OFF,PLRT,INVT,LOAD,HZ\n"), PLAIN],
        [wave(b"250", b"2.4"), OFF, (b"C1:MDWV?\n", b"C1:MDWV AM,STATE,ON,MDSP,SINE\n")],
        [(b"C1:BSWV?\n", b"C1:BSWV WVTP,DC,OFST,1.2V\n"), OFF, PLAIN],
        [(b"C1:BSWV?\n", b"nonsense\n")],
    ],
)
def test_what_reads_back_otherwise_is_switched_off(answers):
    calm = told(b"C1:BSWV AMP,0.004", b"C1:BSWV OFST,0", b"C1:OUTP OFF")
    driver, script = connected(*told(b"C1:BSWV FRQ,250", b"C1:BSWV AMP,2.4"), *answers, *calm, OFF)
    with pytest.raises(BadReply):
        driver.set_point(250.0, 120.0)
    assert not script.pairs


@pytest.mark.parametrize(
    ("shown", "accepted"),
    [
        (b"C1:SYNC ON\n", True),  # what users of an SDG2042X found
        (b"C1:SYNC ON,TYPE,CH1\n", True),  # what the programming guide says
        (b"C1:SYNC OFF\n", False),
        (b"C1:SYNC ON,TYPE,CH2\n", False),
    ],
)
def test_sync_is_switched_on_after_a_reset_and_must_be_of_this_channel(shown, accepted):
    calm = told(b"C1:BSWV AMP,0.004", b"C1:BSWV OFST,0", b"C1:OUTP OFF")
    script = Script(IDENTITY, *RESET, *SET_UP[:-1], (b"C1:SYNC?\n", shown), *calm, OFF)
    driver = SiglentSdg(MemoryTransport(script), SETTINGS)
    if accepted:
        driver.connect()
        return
    with pytest.raises(BadReply, match="Sync"):
        driver.connect()
    assert not script.pairs


@pytest.mark.parametrize("reply", UNCLEAR)
def test_an_unclear_answer_is_never_off(reply):
    calm = told(b"C1:BSWV AMP,0.004", b"C1:BSWV OFST,0", b"C1:OUTP OFF")
    driver, _ = connected(*calm, (b"C1:OUTP?\n", reply), *calm[2:], (b"C1:OUTP?\n", reply))
    assert driver.off() is None


@pytest.mark.parametrize("message", PASSES)
def test_what_keeps_the_limit_passes_the_gate(message):
    gate = SiglentGate(SETTINGS)
    for line in (*READY, message):
        gate.check(line.encode() + b"\n")


@pytest.mark.parametrize(
    "message",
    [
        *(
            "C1:BSWV AMP,6.001",
            "C1:BSWV AMP,1E9",
            "C1:BSWV AMP,NAN",
            "C1:BSWV OFST,3.1",
            "C1:BSWV HLEV,1",
            "c1:outp on",
        ),
        *(
            "C2:OUTP ON",
            "C1:OUTP LOAD,50",
            "C1:BSWV WVTP,SQUARE",
            "C1:BSWV WVTP,SINE,AMP,20",
            "C1:BSWV AMP,2VRMS",
        ),
        *(
            "c1:outp on",
            "C1:MDWV STATE,ON",
            "C1:OUTP ON,LOAD,50",
            "C1:BSWV AMPDBM,3",
            "C1:OUTP ON\nC1:BSWV AMP,20",
            "",
        ),
    ],
)
def test_what_does_not_is_held_back(message):
    gate = SiglentGate(SETTINGS)
    for line in READY:
        gate.check(line.encode() + b"\n")
    with pytest.raises(LimitExceeded, match="last gate"):
        gate.check(message.encode() + b"\n")


def test_levels_wait_for_a_reset_and_an_open_load():
    for lines in (READY[:1], READY[1:4], ()):
        gate = SiglentGate(SETTINGS)
        for line in lines:
            gate.check(line.encode() + b"\n")
        for line in ("C1:BSWV AMP,1", "C1:OUTP ON"):
            with pytest.raises(LimitExceeded):
                gate.check(line.encode() + b"\n")
