"""Plans: what a file may say, how many rows it makes, in which order."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.measuring.plan import Plan, Setting, load_plan, write_plan

GRID = """
name = "grid"
frequency_hz = [60.0, 125.0, 250.0]
voltage_v = [50.0, 75.0]
normal_force_n = [0.25, 0.5]
speed_m_s = 0.02
"""


def plan_of(folder: Path, text: str) -> Plan:
    path = folder / "plan.toml"
    path.write_text(text)
    return load_plan(str(path))


def refused(folder: Path, text: str) -> BadInputError:
    with pytest.raises(BadInputError) as caught:
        plan_of(folder, text)
    assert "plan.toml" in caught.value.message
    return caught.value


@pytest.mark.parametrize(
    ("name", "settings", "rows"),
    [
        ("paper", 10, 99),
        ("voltage_frequency", 25, 171),
        ("speed_load_time", 36, 288),
        ("full", 168, 728),
    ],
)
def test_shipped_plans_have_the_rows_they_promise(name, settings, rows):
    plan = load_plan(name)
    assert len(plan.settings) == settings
    assert len(plan.rows(plan.settings, plan.seed)) == rows


def test_the_papers_plan_has_its_frequencies():
    plan = load_plan("paper")
    assert [s.frequency_hz for s in plan.settings] == [1, 10, 50, 100, 250, 500, 1e3, 1e4, 1e5, 1e6]
    assert {s[1:4] for s in plan.settings} == {(75.0, 0.5, 0.02)}
    without = [r for r in plan.rows(plan.settings, 1) if r.setting.voltage_v == 0.0]
    assert Counter(r.session for r in without) == {1: 3, 2: 3, 3: 3}


def test_points_take_what_they_do_not_say_from_the_lists(tmp_path):
    points = (
        "[[points]]\nvoltage_v = 60.0\nfrequency_hz = [10.0, 20.0]\n[[points]]\nspeed_m_s = 0.05\n"
    )
    plan = plan_of(tmp_path, GRID + points)
    assert len(plan.settings) == 2 * 2 + 3 * 2 * 2
    assert Setting(10.0, 60.0, 0.25, 0.02) in plan.settings
    assert Setting(60.0, 50.0, 0.5, 0.05) in plan.settings


def test_zero_volts_is_one_setting_whatever_the_frequency(tmp_path):
    plan = plan_of(tmp_path, GRID.replace("[50.0, 75.0]", "[0.0, 75.0]"))
    off = [s for s in plan.settings if s.voltage_v == 0.0]
    assert off == [Setting(0.0, 0.0, load_n, 0.02) for load_n in (0.25, 0.5)]


def test_the_order_is_random_and_the_same_for_the_same_seed(tmp_path):
    plan = plan_of(tmp_path, GRID + "repeats = 2\nsessions = 2\n")
    order = plan.rows(plan.settings, 7)
    assert order == plan.rows(plan.settings, 7)
    assert order != plan.rows(plan.settings, 8)
    assert sorted(order) == sorted(plan.rows(plan.settings, 8))
    assert [r.setting for r in order[:24]] != [r.setting for r in order[24:]]  # sessions differ


def test_rows_without_voltage_come_before_every_so_many_at_the_same_load_and_speed(tmp_path):
    plan = plan_of(tmp_path, GRID + "voltage_off_every = 5\nsessions = 2\n")
    rows = plan.rows(plan.settings, 1)
    for session in (1, 2):
        settings = [r.setting for r in rows if r.session == session]
        off = [i for i, s in enumerate(settings) if s.voltage_v == 0.0]
        assert off == [0, 6, 12]
        assert all(settings[i] == settings[i + 1].without_voltage() for i in off)
    assert len(rows) == len(set(rows))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GRID + "voltage_of_every = 3", "voltage_off_every"),
        (GRID + "[[points]]\nvoltage = 3.0", "voltage_v"),
    ],
)
def test_an_unknown_key_offers_the_nearest(tmp_path, text, said):
    error = refused(tmp_path, text)
    assert error.code == "unknown_key"
    assert said in error.hint


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (GRID.replace("[50.0, 75.0]", "[50.0, -1.0]"), "voltage_v.1"),
        ('name = "nothing"', "frequency_hz"),
        (GRID.replace("speed_m_s = 0.02\n", ""), "speed_m_s"),
        (GRID + "average_s = 0.1", "average_s"),
        (GRID + "[[points]]\n[[points]]\nvoltage_v = 2e3", "[[points]] 2: voltage_v"),
        (GRID + "repeats = 1000\nsessions = 1000", "12000000 rows"),
    ],
)
def test_a_bad_value_names_its_key(tmp_path, text, key):
    error = refused(tmp_path, text)
    assert error.code == "bad_config"
    assert key in error.message


def test_bad_files_and_names_are_named(tmp_path):
    assert refused(tmp_path, "name = ").code == "bad_toml"
    with pytest.raises(BadInputError, match="no such file"):
        load_plan(str(tmp_path / "missing.toml"))


SWEEP = """
name = "witness"
[[sweep]]
frequency_hz = { low = 10.0, high = 1e4, per_decade = 2 }
normal_force_n = [0.25, 1.0]
finger = ["none", "resting", "sliding"]
"""


def test_a_sweep_is_a_spectrum_for_each_finger_and_load(tmp_path):
    plan = plan_of(tmp_path, SWEEP)
    expected_hz = [10.0, 31.6, 100.0, 316.0, 1e3, 3160.0, 1e4]
    spectra = [("none", 0.0, 0.0), ("resting", 0.25, 0.0), ("resting", 1.0, 0.0)]
    spectra += [("sliding", 0.25, 0.02), ("sliding", 1.0, 0.02)]
    assert [(s.finger, s.normal_force_n, s.speed_m_s, s.frequency_hz) for s in plan.settings] == [
        (*spectrum, f) for spectrum in spectra for f in expected_hz
    ]
    assert all(s.sweep and s.voltage_v == 5.0 for s in plan.settings)


def test_sweeps_come_last_in_their_own_order_and_without_rows_of_no_voltage(tmp_path):
    grid = GRID + "sessions = 2\nrepeats = 2\nvoltage_off_every = 4\n"
    plan = plan_of(tmp_path, grid + SWEEP.replace('name = "witness"', ""))
    rows = [row for row in plan.rows(plan.settings, 1) if row.session == 2]
    swept = [row.setting for row in rows if row.setting.sweep]
    assert [row.setting for row in rows][-len(swept) :] == swept
    assert swept == [s for s in plan.settings if s.sweep] * 2
    assert len(rows) == len(swept) + 24 + 6


def test_a_bias_another_waveform_and_a_time_are_settings(tmp_path):
    points = (
        '[[points]]\nvoltage_offset_v = [-30.0, 30.0]\n[[points]]\nwaveform = ["square", "dc"]\n'
    )
    plan = plan_of(tmp_path, GRID + points)
    assert Setting(60.0, 50.0, 0.25, 0.02, -30.0) in plan.settings
    assert Setting(60.0, 50.0, 0.25, 0.02, 0.0, "square") in plan.settings
    assert {s.frequency_hz for s in plan.settings if s.waveform == "dc"} == {0.0}
    assert Setting(60.0, 50.0, 0.5, 0.0, -30.0).peak_v == 80.0
    assert Setting(0.0, 50.0, 0.5, 0.0, -30.0, "dc").peak_v == 20.0


def test_what_has_a_time_begins_when_it_is_due(tmp_path):
    timed = (
        "[[points]]\n[[points]]\nfrequency_hz = 250.0\nvoltage_v = 75.0\ntime_s = [5.0, 20.0,"
        " 600.0]\n"
    )
    plan = plan_of(tmp_path, GRID + timed)
    clock_s, began = 0.0, {}
    for row in plan.rows(plan.settings, 1):
        if row.setting.time_s is not None:
            clock_s = max(clock_s, plan.begin_s(row.setting))
            began[row.setting] = clock_s
        clock_s += plan.row_s
    for setting, begin_s in began.items():
        if setting.normal_force_n == 0.25:  # the first of the two with the same time
            assert begin_s - plan.begin_s(setting) == pytest.approx(0.0, abs=plan.row_s)
    assert [s.time_s for s in began] == [5.0, 5.0, 20.0, 20.0, 600.0, 600.0]


def test_what_has_a_time_is_repeated_like_the_rest(tmp_path):
    """It was measured once, however often the plan repeats."""
    plan = plan_of(tmp_path, GRID + "repeats = 3\n[[points]]\ntime_s = [5.0, 60.0]\n")
    rows = plan.rows(plan.settings, 1)
    assert [row.setting.time_s for row in rows].count(60.0) == 3 * len(plan.settings) / 2
    assert {row.trial for row in rows} == {1, 2, 3}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("low = 10.0", "low = 1e5", "low must be below high"),
        ('"resting", ', '"pressing", ', "finger"),
        ("[[sweep]]", "[[sweep]]\nvoltage_v = 150.0", "voltage_v"),
        ("[[sweep]]", "[[sweep]]\ntime_s = 1.0", "time_s"),
    ],
)
def test_a_bad_sweep_names_its_key(tmp_path, old, new, said):
    assert said in refused(tmp_path, SWEEP.replace(old, new)).message


@pytest.mark.parametrize("intervention", ["none", "wipe"])
def test_a_written_plan_is_the_same_plan(tmp_path, intervention):
    settings = (
        Setting(250.0, 75.0, 0.5, 0.02),
        Setting(0.0, 0.0, 0.25, 0.04),
        Setting(20.0, 30.0, 0.5, 0.02, voltage_offset_v=-40.0, time_s=30.0),
        Setting(0.0, 30.0, 0.5, 0.02, waveform="dc"),
        Setting(1e3, 5.0, 0.5, 0.0, finger="resting", sweep=True),
        Setting(1e3, 5.0, 0.5, 0.02, finger="sliding", sweep=True),
        Setting(1e4, 2.5, 0.0, 0.0, finger="none", sweep=True),
    )
    prepared = tuple(setting._replace(intervention=intervention) for setting in settings)
    about = 'to tell "a" from b'
    plan = Plan(name="n", about=about, settings=prepared, repeats=3, intervention=intervention)
    write_plan(tmp_path / "next.toml", plan)
    assert load_plan(str(tmp_path / "next.toml")) == plan
