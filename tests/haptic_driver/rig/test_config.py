"""What a rig's file may say of real devices: contradictions, nearest keys inside variants, and what
keeps it off.
"""

import datetime
import re
import tomllib
from pathlib import Path

import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.rig.check import Examination
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.doctor import examinations
from haptic_driver.rig.parts.force_sensors import NiForceSensorConfig
from haptic_driver.rig.tick_settings import finger_settings
from tests.haptic_driver.config_texts import CONFIGS, SIMULATED, changed

RIGS = CONFIGS / "rigs"
TEMPLATE = (RIGS / "template.toml").read_text(encoding="utf-8")
VOUCHED = 'measured_by = "A. Student"\nmeasured_at = 2025-06-01'


def rig_file(tmp_path, *changes, content=TEMPLATE):
    path = tmp_path / "bench.toml"
    path.write_text(changed(content, *changes), encoding="utf-8")
    return str(path)


def refused(path):
    with pytest.raises(BadInputError) as error:
        load_rig(path)
    assert error.value.code in ("bad_config", "unknown_key")
    return error.value


def test_the_template_holds_every_key_but_those_of_other_variants():
    """A key that is added to the file's description has to be explained in the template."""
    said = tomllib.loads(TEMPLATE)
    config = load_rig("template")
    for name, section in config:
        if not hasattr(type(section), "model_fields"):
            continue
        explained = {
            key
            for key in type(section).model_fields
            if f"{key} = " in TEMPLATE or f"{key}." in TEMPLATE
        }
        explained |= (
            {"model", "hide"} if name == "simulation" else set()
        )  # of a simulation, told in its own files
        explained |= {"velocity_time_constant_s"} if name == "finger" else set()  # of older files
        assert set(type(section).model_fields) - explained - {"modulation_input"} == set(), name
        assert set(said.get(name, {})) <= set(type(section).model_fields)


@pytest.mark.parametrize("name", ["paper", "template", "small-computer"])
def test_shipped_rigs_of_hardware_stay_off_until_somebody_measured(name):
    assert "limits.measured_by and measured_at" in load_rig(name).unverified
    assert "amplifier.measured_by and measured_at" in load_rig(name).unverified


def test_filled_in_nothing_is_left_open(tmp_path):
    content = TEMPLATE.replace('measured_by = ""', VOUCHED)
    assert load_rig(rig_file(tmp_path, content=content)).unverified == []


@pytest.mark.parametrize(
    "half",
    ['measured_by = "A. Student"', "measured_at = 2025-06-01", VOUCHED.replace("A. Student", " ")],
)
def test_half_a_voucher_is_none(tmp_path, half):
    content = TEMPLATE.replace('measured_by = ""', half)
    assert len(load_rig(rig_file(tmp_path, content=content)).unverified) == 4


@pytest.mark.parametrize(
    ("name", "following", "plainly"),
    [
        ("watchdog", "[force_sensor]", 'generator = "none"'),
        ("interlock", "[watchdog]", 'kind = "none"'),
    ],
)
def test_no_word_about_a_watchdog_or_an_interlock_keeps_a_rig_off(
    tmp_path, name, following, plainly
):
    section = TEMPLATE[TEMPLATE.index(f"[{name}]") : TEMPLATE.index(following)]
    assert any(name in what for what in load_rig(rig_file(tmp_path, (section, ""))).unverified)
    said = rig_file(tmp_path, (section, f"[{name}]\n{plainly}\n"))
    assert not any(name in what for what in load_rig(said).unverified)


RESOURCE = 'resource = "TCPIP::192.168.0.5::5025::SOCKET"'
MODEL = 'model = "agilent_33220a"'
WATCHDOG = 'generator = "TCPIP::192.168.0.5::5025::SOCKET"'
USB = "USB0::0x0957::0x0407::MY44000001::0::INSTR"


@pytest.mark.parametrize(
    "resource", [USB, "ASRL/dev/ttyUSB7::INSTR", "GPIB0::10::INSTR", "/dev/ttyUSB7"]
)
def test_a_connection_that_the_driver_holds_is_refused_to_the_watchdog(tmp_path, resource):
    shared = rig_file(
        tmp_path, (RESOURCE, f'resource = "{resource}"'), (WATCHDOG, f'generator = "{resource}"')
    )
    assert "connection of its own" in refused(shared).message
    own = rig_file(tmp_path, (RESOURCE, f'resource = "{resource}"'))
    assert load_rig(own).waveform_generator.resource == resource


def test_no_word_about_how_much_contact_the_limits_hold_for_keeps_a_real_rig_off(tmp_path):
    """A figure that nobody has seen would be one touch: a hand carries up to 6.8 times as much."""
    said = ("touching_area_m2 = 471e-6", "")
    silent = load_rig(rig_file(tmp_path, said))
    assert [what for what in silent.unverified if "touching_area_m2" in what]
    assert silent.operating_limits().touching_area_m2 == 0.0
    assert load_rig(rig_file(tmp_path)).operating_limits().touching_area_m2 == 471e-6


def test_a_file_that_smooths_velocity_is_read_as_one_that_does_not(tmp_path):
    older = changed(SIMULATED, ("[finger]", "[finger]\nvelocity_time_constant_s = 0.010"))
    (tmp_path / "older.toml").write_text(older)
    old, now = load_rig(str(tmp_path / "older.toml")), load_rig("simulated")
    assert finger_settings(old, 0.0) == finger_settings(now, 0.0)
    for rig, told in ((old, ["finger"]), (now, [])):
        name, examine = next(examinations(rig))
        checks = Examination(name, rig, datetime.date(2026, 1, 1)).told(examine)
        assert [
            c.name for c in checks if "velocity_time_constant_s is not used" in c.message
        ] == told


def test_no_watchdog_can_take_a_sound_card(tmp_path):
    """It was refused at the daemon's start alone."""
    old, new = "TCPIP::192.168.0.5::5025::SOCKET", "card:sound:hw:1,0/0"
    error = refused(rig_file(tmp_path, (f'generator = "{old}"', f'generator = "{new}"')))
    assert f"watchdog.generator: {new} is a sound card" in error.message


def test_the_interlocks_port_is_not_the_watchdogs(tmp_path):
    old = '# interlock = "TCPIP::192.168.0.6::4000::SOCKET"'
    error = refused(rig_file(tmp_path, (old, 'interlock = "/dev/ttyUSB0"')))
    assert "watchdog.interlock: /dev/ttyUSB0 is held by the driver" in error.message


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            MODEL,
            'model = "keysight_33500b"',
            "did you mean 'keysight_33500'? Installed: agilent_33220a, ",
        ),
        (MODEL, 'model = "siglent_sdg"', "siglent_sdg is not modulated from outside by its driver"),
        ("period_s = 0.5", "period_s = 0.4", "watchdog.period_s 0.4 is below safety.lease_s 0.5"),
        ("zero_level_v = -5.0", "zero_level_v = 0.0", "at 0 V the amplitude is half"),
        ("monitor_window_s = 0.02", "monitor_window_s = 0.002", "would miss the peak"),
        ("monitor_window_s = 0.02", "monitor_window_s = 0.2", "not below safety.settle_s"),
        ("[10.0, 8e3] ", "[10.0, 10e3] ", "let it end at 8000, or sample at 25000 or faster"),
        ("voltage_v = 100.0", "voltage_v = 800.0", "above amplifier.voltage_limit_v"),
        (RESOURCE, 'resource = "simulated"', "disagree about whether this rig is simulated"),
        ('kind = "net_ft"', 'kind = "simulated"', "force_sensor"),
        ('kind = "net_ft"', 'kind = "netft"', "force_sensor.kind is 'netft'"),
        ('kind = "evdev" ', "", "finger_tracker.kind is missing"),
        ('terminal = "DIFF" ', 'terminals = {"Dev1/ai5" = "RSE"} ', "Dev1/ai5 is read by nothing"),
        ('current_monitor = "Dev1/ai7"', 'current_monitor = "Dev3/ai0"', "clocks of their own"),
        (RESOURCE, 'resource = "card:ni:Dev1/ao0"', "agilent_33220a makes its carrier itself"),
        (RESOURCE, 'resource = "card:dt:0"', "'dt' is no card that is installed"),
    ],
)
def test_what_cannot_be_is_named(tmp_path, old, new, words):
    error = refused(rig_file(tmp_path, (old, new)))
    assert words in error.message
    assert error.hint


def test_a_channel_without_a_card_is_refused(tmp_path):
    section = TEMPLATE[TEMPLATE.index("[analog_inputs]") : TEMPLATE.index("[interlock]")]
    assert "no section [analog_inputs]" in refused(rig_file(tmp_path, (section, ""))).message


def test_the_calibration_file_is_looked_for_beside_the_rigs_file():
    sensor = load_rig("paper").force_sensor
    assert isinstance(sensor, NiForceSensorConfig)
    assert Path(sensor.calibration_file).resolve() == RIGS / "mini40.cal"


def test_a_simulated_rig_has_no_real_devices(tmp_path):
    content = SIMULATED + '[watchdog]\ngenerator = "TCPIP::h::1::SOCKET"\n'
    assert (
        "watchdog: a simulated rig has no such real device"
        in refused(rig_file(tmp_path, content=content)).message
    )


@pytest.mark.parametrize(
    "section",
    [
        "interlock",
        "force_sensor",
        "analog_output",
        "finger_tracker",
        "camera",
        "load_stage",
        "event_line",
        "line_in",
    ],
)
def test_nothing_is_nothing_on_any_rig(tmp_path, section):
    """A simulated rig without a force sensor was once refused as real."""
    content = f'{SIMULATED}\n[{section}]\nkind = "none"\n'
    assert getattr(load_rig(rig_file(tmp_path, content=content)), section).kind == "none"


def test_a_stage_is_simulated_where_the_rig_is(tmp_path):
    stage = TEMPLATE[TEMPLATE.index("[stage]") : TEMPLATE.index("[load_stage]")]
    assert (
        "stage.resource disagree" in refused(rig_file(tmp_path, content=SIMULATED + stage)).message
    )
    told = re.sub(r'resource = "[^"]*"', 'resource = "simulated"', stage)
    assert load_rig(rig_file(tmp_path, content=SIMULATED + told)).stage is not None
    real = TEMPLATE.replace(stage, told)
    assert "stage.resource disagree" in refused(rig_file(tmp_path, content=real)).message


@pytest.mark.parametrize("monitor", ["voltage_monitor", "current_monitor"])
def test_one_monitor_on_a_card_is_enough_to_limit_the_carrier(tmp_path, monitor):
    other = "current" if monitor == "voltage_monitor" else "voltage"
    electrode = TEMPLATE[TEMPLATE.index("[[electrode_monitors]]") : TEMPLATE.index("[interlock]")]
    without = [
        (electrode, ""),
        (f'{other}_monitor = "Dev1/ai{6 if other == "voltage" else 7}"', ""),
        ("[10.0, 8e3] ", "[10.0, 10e3] "),
    ]
    assert "monitors" in refused(rig_file(tmp_path, *without)).message
    neither = [*without, (f'{monitor} = "Dev1/ai{7 if other == "voltage" else 6}"', "")]
    assert load_rig(rig_file(tmp_path, *neither)).limits.frequency_hz == [10.0, 10e3]


def test_the_electrodes_monitor_on_a_card_needs_both_lines(tmp_path):
    error = refused(rig_file(tmp_path, ('current_monitor = "Dev1/ai7"', "")))
    assert "name both, and the card" in error.message


def test_the_first_monitor_that_tells_a_carrier_reads_it():
    rig = load_rig("simulated")
    told = {0.4: None, 0.5: 0, 8e3: 0, 8.1e3: 1, 2e6: 1, 2.1e6: None}
    assert {f: rig.electrode_monitor(f) for f in told} == told
    card = load_rig("template")
    assert [card.electrode_monitor(f) for f in (0.4, 0.5, 8e3, 8.1e3)] == [None, 0, 0, None]


def test_a_faster_monitor_widens_what_may_be_swept_and_nothing_else(tmp_path):
    scope = (
        '[[electrode_monitors]]\nkind = "infiniivision"\nresource ='
        ' "TCPIP::192.168.0.7::5025::SOCKET"\n'
    )
    path = rig_file(
        tmp_path, ("[10.0, 8e3] ", "[10.0, 1e6] "), ("[interlock]\n", scope + "[interlock]\n")
    )
    rig = load_rig(path)
    assert rig.operating_limits().frequency_high_hz == 8e3
    assert rig.sweep_limits().frequency_high_hz == 1e6
    assert (rig.electrode_monitor(8e3), rig.electrode_monitor(1e6)) == (0, 1)


CARRIER = (RIGS / "simulated-carrier.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("peak_v = 10.0", "peak_v = 1.0", "limits.voltage_v 150 is beyond"),
        ("sample_rate_hz = 50e3", "sample_rate_hz = 44.1e3", "let it end at 2205"),
        ("[waveform_generator.carrier]", "[output.carrier]", "output.carrier"),
        ('model = "analog_carrier"', 'model = "siglent_sdg"', "makes its carrier itself"),
        ("[output]", '[analog_output]\nkind = "none"\n\n[output]', None),
    ],
)
def test_a_carrier_of_samples_fits_its_card_and_the_rigs_limits(tmp_path, old, new, words):
    path = rig_file(tmp_path, (old, new), content=CARRIER)
    if words is None:
        assert load_rig(path).waveform_generator.carrier.peak_v == 10.0
    else:
        assert words in refused(path).message


def test_a_channel_may_be_wired_otherwise(tmp_path):
    path = rig_file(tmp_path, ('terminal = "DIFF" ', 'terminals = {"Dev1/ai6" = "RSE"} '))
    card = load_rig(path).analog_inputs
    assert [card.terminal_of(name) for name in ("Dev1/ai6", "Dev1/ai7")] == ["RSE", "DIFF"]
