"""Simulated twins of a real rig, and the file that points at them."""

from dataclasses import replace

import pytest

from haptic_driver.lab.measuring.plan import Plan, Setting
from haptic_driver.lab.measuring.run import prepare
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.parts.amplifiers import AmplifierConfig
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.simulation.twin import copy_of, file_of, pressing, reached, twin_of
from tests.haptic_driver.config_texts import CONFIGS, changed

TEMPLATE = (CONFIGS / "rigs" / "template.toml").read_text(encoding="utf-8")
LOAD_STAGE = """kind = "lts150"
resource = "/dev/ttyUSB9"
travel_m = [0.0, 0.1]
clear_m = 0.03
when_wrong = "retract"
higher_presses = false"""
ENDPOINTS = {
    "waveform_generator": "TCPIP::127.0.0.1::41001::SOCKET",
    "interlock": "ASRL/tmp/box/tty::INSTR",
    "interlock_tcp": "TCPIP::127.0.0.1::41002::SOCKET",
    "stage": "ASRL/tmp/stage/tty::INSTR",
    "load_stage": "ASRL/tmp/load/tty::INSTR",
    "force_sensor": "127.0.0.1:41003",
    "finger_tracker": "127.0.0.1:41004",
}


@pytest.fixture
def mine(tmp_path):
    """A real rig with everything that can be served, and some that cannot."""
    path = tmp_path / "mine.toml"
    text = changed(
        TEMPLATE,
        ('[load_stage]\nkind = "none"', f"[load_stage]\n{LOAD_STAGE}"),
        ("# interlock = ", "interlock = "),
    )
    path.write_text(text, encoding="utf-8")
    return load_rig(str(path))


def test_the_file_that_is_written_is_the_rig_where_it_is_served(mine, tmp_path):
    twin, _ = twin_of(mine)
    path = tmp_path / "copy.toml"
    path.write_text(file_of(reached(twin, ENDPOINTS)), encoding="utf-8")
    copy = load_rig(str(path))
    assert not copy.simulated
    assert copy.is_computed
    assert sorted(copy.addresses) == sorted(
        where for name, where in ENDPOINTS.items() if name != "interlock_tcp"
    )
    assert copy.watchdog is not None
    assert copy.watchdog.generator == ENDPOINTS["waveform_generator"]
    assert copy.watchdog.interlock == ENDPOINTS["interlock_tcp"]
    assert copy.name == "mine"
    for same in ("limits", "safety", "output", "finger", "controller", "screen"):
        assert getattr(copy, same) == getattr(mine, same)
    assert copy.amplifier.gain_v_per_v == mine.amplifier.gain_v_per_v


def test_what_is_measured_on_a_twin_says_that_it_is_computed(mine, touch):
    """Its file is signed by the rig's owner, and its rows looked like the rig's."""
    twin, _ = twin_of(mine)
    setting = Setting(250.0, 75.0, 0.5, 0.02)
    plan = Plan(name="one", settings=[setting], voltage_off_every=0)
    experiment = prepare(load_rig("simulated"), touch, plan)
    assert replace(experiment, config=twin).identity().simulated
    assert not replace(experiment, config=mine).identity().simulated


class OwnAmplifier(AmplifierConfig):
    """One of somebody's own kind."""

    def make(self, wiring):
        pytest.fail("the amplifier was reached")


def test_nothing_of_a_simulated_copy_reaches_hardware(mine, touch):
    """Neither a kind of one's own nor a line of a card is opened for it."""
    said = mine.amplifier.model_dump() | {"kind": "own", "fault_line": "Dev1/port0/line0"}
    own = mine.model_copy(update={"amplifier": OwnAmplifier(**said)})
    with SimulatedRig(own, touch, envelope=True) as bench:
        assert bench.config.amplifier.gain_v_per_v == mine.amplifier.gain_v_per_v
        assert bench.config.amplifier.fault_line is None
        assert bench.left_out == twin_of(own)[1]


def test_a_simulated_rig_is_its_own_copy():
    config = load_rig("simulated")
    assert copy_of(config) == (config, [])


def test_what_cannot_be_served_is_told_and_left_out(mine):
    twin, left_out = twin_of(mine)
    assert left_out == [
        "analog_inputs: no simulator of kind ni",
        "analog_output: no simulator of kind ni",
        "electrode_monitors.0: no simulator of kind card",
        "event_line: no simulator of kind trigger_box",
        "line_in: no simulator of kind modem_line",
    ]
    assert not any(section.channels for _, section in twin.devices)


def test_no_rig_is_left_without_what_measures_force():
    twin, left_out = twin_of(load_rig("paper"))
    assert left_out[-1] == "force_sensor: no simulator of kind ni; a Net F/T box stands in"
    copy = reached(twin, ENDPOINTS)
    assert copy.addresses_of("force_sensor") == [ENDPOINTS["force_sensor"]]
    assert copy.interlock is not None
    assert copy.interlock.kind == "none"  # as the rig has it


def test_a_load_stage_presses_its_twin_the_way_it_presses_the_finger(mine):
    section = pressing(mine)
    assert section.mounting() == mine.load_stage.mounting()
    assert 0.0 < section.clear_m - section.face_m < section.reach_m  # lower positions press
