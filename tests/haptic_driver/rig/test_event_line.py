"""The section `[event_line]` of a rig's file, and what the doctor says of it."""

from __future__ import annotations

import datetime

import pytest

from haptic_driver.config import parse
from haptic_driver.errors import BadInputError
from haptic_driver.rig.check import Check, CheckStatus, Examination
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.event_lines import (
    ModemLineConfig,
    NiEventLineConfig,
    ParallelPortConfig,
    SimulatedEventLineConfig,
    TriggerBoxConfig,
)
from hw.analog.ni_daq import NiEventLine
from hw.event_line.modem_line import ModemEventLine
from hw.event_line.parallel_port import ParallelPort
from hw.event_line.simulated import SimulatedEventLine, SimulatedTriggerBox
from hw.event_line.trigger_box import TriggerBox
from hw.serving.serial import SerialServer

BOX = TriggerBoxConfig(kind="trigger_box", resource="/dev/ttyUSB0")


def rig_with(**section: object) -> RigConfig:
    said = load_rig("simulated").model_dump() | {"event_line": section}
    return parse(RigConfig, said, "rig.toml")


@pytest.mark.parametrize(
    ("section", "codes", "said"),
    [
        ({"kind": "smoke"}, {}, "smoke"),
        ({"kind": "simulated"}, {"answer": 250}, "answer"),
        ({"kind": "simulated"}, {"touches": 1}, "touches"),
    ],
)
def test_what_a_file_may_not_say(section, codes, said):
    rig = load_rig("simulated").model_dump() | {"event_line": section, "event_codes": codes}
    with pytest.raises(BadInputError, match=said):
        parse(RigConfig, rig, "rig.toml")


def test_each_kind_has_its_driver_and_address():
    made = {
        BOX: TriggerBox,
        ModemLineConfig(kind="modem_line", port="/dev/ttyUSB1"): ModemEventLine,
        NiEventLineConfig(kind="ni", line="Dev1/port0/line0:7"): NiEventLine,
        ParallelPortConfig(kind="parallel_port"): ParallelPort,
    }
    simulated = load_rig("simulated")
    before = simulated.addresses
    for section, kind in made.items():
        line = section.make(Wiring()).device
        assert isinstance(line, kind)
        rig = simulated.model_copy(update={"event_line": section})
        (own,) = set(rig.addresses) - set(before)
        assert own in line.resource
    simulated_line = SimulatedEventLineConfig(kind="simulated").make(Wiring()).device
    assert isinstance(simulated_line, SimulatedEventLine)


def checks_of(section: object) -> list[Check]:
    rig = load_rig("simulated").model_copy(update={"event_line": section})
    today = datetime.date(2024, 6, 1)
    return list(Examination("event line", rig, today).told(rig.event_line.examine))


def test_the_doctor_opens_a_box_and_sends_nothing():
    box = SimulatedTriggerBox()
    with SerialServer(box, framed=False) as server:
        (check,) = checks_of(TriggerBoxConfig(kind="trigger_box", resource=server.path))
    assert check.status is CheckStatus.NOT_VERIFIED
    assert not box.edges
    (check,) = checks_of(BOX.model_copy(update={"resource": "/dev/no-such-port"}))
    assert (check.name, check.status) == ("event line", CheckStatus.FAILED)


def test_the_doctor_says_of_each_other_kind_what_it_could_not_see(tmp_path):
    (modem,) = checks_of(ModemLineConfig(kind="modem_line", port="/dev/ttyUSB1"))
    (card,) = checks_of(NiEventLineConfig(kind="ni", line="Dev1/port0/line0:7"))
    (gone,) = checks_of(ParallelPortConfig(kind="parallel_port", device=str(tmp_path / "gone")))
    (simulated,) = checks_of(SimulatedEventLineConfig(kind="simulated"))
    assert [check.status for check in (modem, card, gone, simulated)] == [
        CheckStatus.NOT_VERIFIED,
        CheckStatus.NOT_VERIFIED,
        CheckStatus.FAILED,
        CheckStatus.OK,
    ]
    assert "haptic mark" in modem.hint
