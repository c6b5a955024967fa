"""The simulated SDG: its load trap, its silence about what it clips, and its answers."""

from __future__ import annotations

import pytest

from hw.generator.siglent_sdg.simulator import SimulatedSdg
from tests.hw.instruments import IMMEDIATE


def ask(generator: SimulatedSdg, *lines: str) -> str:
    return generator.handle("".join(f"{line}\n" for line in lines).encode()).decode()


def test_after_reset_the_answer_is_that_of_a_real_one():
    """As public clients have it from an SDG2042X."""
    generator = SimulatedSdg(IMMEDIATE)
    answer = (
        "WVTP,SINE,FRQ,1000HZ,PERI,0.001S,AMP,4V,AMPVRMS,1.414Vrms,OFST,0V,HLEV,2V,LLEV,-2V,PHSE,0"
    )
    assert ask(generator, "*RST", "C1:BSWV?") == f"C1:BSWV {answer}\n"
    assert ask(generator, "C1:OUTP?", "C1:OUTPUT?") == 2 * "C1:OUTP OFF,LOAD,HZ,PLRT,NOR\n"
    assert (
        ask(generator, "C1:BSWV WVTP,DC", "C1:BSWV OFST,1.5", "C1:BSWV?")
        == "C1:BSWV WVTP,DC,OFST,1.5V\n"
    )


@pytest.mark.parametrize(
    ("setting", "shown"),
    [
        ("AMP,30", "AMP,20V"),
        ("OFST,9", "OFST,8V"),
        ("AMP,NONSENSE", "AMP,4V"),
        ("FRQ,2000HZ,AMP,3V", "AMP,3V"),
    ],
)
def test_what_cannot_be_is_clipped_or_ignored_without_a_word(setting, shown):
    generator = SimulatedSdg(IMMEDIATE)
    assert ask(generator, f"C1:BSWV {setting}") == ""
    assert f"{shown}," in ask(generator, "C1:BSWV?")
