"""What a map cannot mean in a trial's signals is corrected by a key and told, or refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.haptic_driver.lab.raw_trials.made import (
    LOAD_N,
    MAP,
    RATE_HZ,
    TIME_S,
    WINDOW_S,
    cut,
    refusal,
    rows,
    signals,
    with_keys,
    write_csv,
    write_npz,
)

FILE = settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
INSIDE = (WINDOW_S[0] < TIME_S) & (WINDOW_S[1] > TIME_S)
# a mean of 250 samples with 0.4 % noise of each of both forces, five standard errors
CLOSE = pytest.approx(0.6, abs=0.6 * 5 * 0.004 * 2**0.5 / 250**0.5 * 1.5)


@FILE
@given(cof=st.floats(0.1, 2.0), noise_n=st.floats(1e-5, 0.05), seed=st.integers(0, 10**6))
def test_a_plain_trial_is_in_no_doubt(tmp_path, cof, noise_n, seed):
    found = cut(write_npz(tmp_path / "t.npz", signals(cof, noise_n, seed)), MAP)
    assert not found.bad
    assert not found.doubted
    # five standard errors of the mean lateral force over the load
    assert found.rows[0]["cof"] == pytest.approx(cof, abs=5 * noise_n * (1 + cof) / LOAD_N / 15)


@FILE
@given(
    levels=st.lists(st.integers(25, 100), min_size=2, max_size=5, unique=True),
    seed=st.integers(0, 10**6),
)
def test_each_burst_is_a_trial_of_its_own_voltage(tmp_path, levels, seed):
    columns, force = signals(0.6, 0.001, seed), 0.4 + 0.002 * np.array(levels)
    whole = {name: np.tile(values, len(levels)) for name, values in columns.items()}
    whole["t"] = np.arange(whole["t"].size) / RATE_HZ
    whole["x"] = 20.0 * whole["t"]
    on = whole["U"] > 0.0
    part = np.repeat(np.arange(len(levels)), TIME_S.size)
    whole["U"] = np.where(on, np.array(levels)[part], 0.0)
    whole["Fx"] = np.where(on, LOAD_N * force[part], LOAD_N * 0.4)
    path = write_npz(tmp_path / "t.npz", whole)
    assert f"comes on {len(levels)} times" in refusal(path, MAP).message
    said = with_keys(voltage_on={"bursts": "each"})
    said["conditions"] = {**MAP["conditions"], "values": {"voltage": max(levels), "frequency": 1}}
    found = rows(path, said)
    # levels are given by two digits of their share of the highest
    assert [row["voltage_v"] for row in found] == pytest.approx(levels, abs=0.5)
    assert [row["cof"] for row in found] == pytest.approx(list(force), rel=0.003)


def test_a_spike_of_the_voltage_moves_no_window(tmp_path):
    columns = signals()
    columns["U"][50:53] = 500.0
    found = cut(write_csv(tmp_path / "t.csv", columns), MAP)
    assert found.rows[0]["cof"] == CLOSE
    assert "a spike at 0.2 s (line 52): passed over" in str(found.rows[0]["doubts"])
    assert found.doubts_said() == ["a spike of the voltage was passed over, in 1 files (t.csv)"]


@FILE
@given(
    value=st.sampled_from([9.9e37, -999.25, -9999.0, 1e6, np.nan, -3.4e38, 25.0]),
    count=st.integers(1, 40),
    at=st.integers(0, 200),
)
def test_a_number_that_stands_for_none_is_refused_or_left_out(tmp_path, value, count, at):
    columns = signals()
    place = int(np.flatnonzero(INSIDE)[0]) + at
    columns["Fx"][place : place + count] = value
    path = write_csv(tmp_path / "t.csv", columns)
    said = refusal(path, MAP).message
    assert f"(line {place + 2})" in said
    assert "lateral_force is " in said
    found = cut(path, with_keys(lateral_force={"outliers": "leave_out"}))
    assert found.rows[0]["cof"] == CLOSE
    assert [doubt.kind for _, doubt in found.doubted] == ["outliers"]


@pytest.mark.parametrize("name", ["Fx", "Fz"])
def test_a_clipped_force_is_refused(tmp_path, name):
    columns = signals(noise_n=0.01)
    columns[name] = np.minimum(columns[name], np.quantile(columns[name][INSIDE], 0.6))
    assert "is clipped at" in refusal(write_csv(tmp_path / "t.csv", columns), MAP).message


def test_what_a_clipped_force_leaves_of_its_noise_is_no_outlier(tmp_path):
    """Where 98 % were at the rail, the rest was "far outside its own noise"."""
    columns = signals(noise_n=0.01)
    columns["Fx"] = np.minimum(columns["Fx"], np.quantile(columns["Fx"][INSIDE], 0.02))
    path = write_csv(tmp_path / "t.csv", columns)
    for how in ("refuse", "leave_out"):
        said = refusal(path, with_keys(lateral_force={"outliers": how})).message
        assert re.search(r"is clipped at \S+ N for 9[789]%", said)


@pytest.mark.parametrize("code", [-9999.0, 32767.0])
def test_a_code_for_no_number_is_no_rail(tmp_path, code):
    columns = signals(noise_n=0.01)
    columns["Fx"][np.flatnonzero(INSIDE)[::9]] = code
    said = refusal(write_csv(tmp_path / "t.csv", columns), MAP).message
    assert f"lateral_force is {code:g}" in said


@FILE
@given(count_n=st.floats(1e-4, 5e-3), rail=st.floats(0.2, 0.99), seed=st.integers(0, 10**6))
def test_a_force_that_is_clipped_in_whole_counts_is_refused(tmp_path, count_n, rail, seed):
    """The rail was as frequent as a count of the noise elsewhere."""
    columns = signals(noise_n=3.0 * count_n, seed=seed)
    columns["Fx"] = count_n * np.round(columns["Fx"] / count_n)
    top = np.quantile(columns["Fx"][INSIDE], 1.0 - rail)
    columns["Fx"] = np.minimum(columns["Fx"], top)
    path = write_npz(tmp_path / "t.npz", columns)
    share = np.mean(columns["Fx"][INSIDE] == top)
    if share > 0.5:
        assert cut(path, MAP).bad


def test_a_force_at_rest_at_an_end_of_its_range_is_told(tmp_path):
    columns, random = signals(noise_n=0.01), np.random.default_rng(1)
    columns["Fx"] = np.minimum(columns["Fx"], 0.25) + 1e-4 * random.standard_normal(TIME_S.size)
    columns["Fz"] = np.minimum(columns["Fz"], 0.4)
    found = cut(write_npz(tmp_path / "t.npz", columns), MAP)
    assert [doubt.kind for _, doubt in found.doubted] == ["clipped", "flat"]


@FILE
@given(count_n=st.floats(0.001, 0.05), seed=st.integers(0, 10**6))
def test_the_counts_of_a_coarse_converter_are_no_outliers(tmp_path, count_n, seed):
    """Most samples of a window were one count, and its neighbours far outside of no noise."""
    columns = signals(noise_n=0.1 * count_n, seed=seed)
    columns["Fx"] = count_n * np.round(columns["Fx"] / count_n)
    found = cut(write_npz(tmp_path / "t.npz", columns), MAP)
    assert not any("outside its own noise" in bad.error.message for bad in found.bad)
    if not found.bad:
        # half a count, and what noise turns of it
        assert found.rows[0]["cof"] == pytest.approx(0.6, abs=0.6 * count_n / LOAD_N + 0.01)


@pytest.mark.parametrize("held", [1, 10, 50])
def test_a_sensor_slower_than_the_card_is_not_clipped(tmp_path, held):
    columns = signals(noise_n=0.01)
    for name in ("Fx", "Fz"):
        columns[name] = np.repeat(columns[name][::held], held)[: TIME_S.size]
    assert not cut(write_csv(tmp_path / "t.csv", columns), MAP).bad


@FILE
@given(
    name=st.sampled_from(["Fx", "Fz"]),
    share=st.floats(0.1, 0.9),
    at=st.floats(0.0, 1.0),
    held=st.sampled_from([1, 2]),
)
def test_a_force_that_stands_still_for_a_part_is_left_out_or_refused(
    tmp_path, name, share, at, held
):
    """The number of the last good sample was averaged with the rest, and nobody was told."""
    columns = signals(noise_n=0.01)
    columns[name] = np.repeat(columns[name][::held], held)[: TIME_S.size]
    places = np.flatnonzero(INSIDE)
    first = places[int(at * (1.0 - share) * places.size)]
    last = min(first + int(share * places.size), places[-1])
    columns[name][first:last] = columns[name][first]
    found = cut(write_npz(tmp_path / "t.npz", columns), MAP)
    if share > 0.22:
        assert "stands still at" in found.bad[0].error.message
    elif share < 0.18 and last - first > 21 * held:  # 20 times what it repeats by itself
        assert [doubt.kind for _, doubt in found.doubted] == ["frozen"]
        assert found.rows[0]["cof"] == pytest.approx(0.6, abs=0.01)


@FILE
@given(count_n=st.floats(0.001, 0.05), noise=st.floats(0.05, 1.0), held=st.sampled_from([1, 3, 20]))
def test_a_coarse_or_slow_force_repeats_and_does_not_stand_still(tmp_path, count_n, noise, held):
    columns = signals(noise_n=noise * count_n)
    columns["Fx"] = count_n * np.round(columns["Fx"] / count_n)
    columns["Fx"] = np.repeat(columns["Fx"][::held], held)[: TIME_S.size]
    found = cut(write_npz(tmp_path / "t.npz", columns), MAP)
    assert not any("stands still" in bad.error.message for bad in found.bad)
    assert not any(doubt.kind == "frozen" for _, doubt in found.doubted)


@FILE
@given(lost=st.floats(0.06, 0.95), at=st.floats(0.0, 1.0))
def test_samples_that_are_missing_are_told_or_refused(tmp_path, lost, at):
    start_s = WINDOW_S[0] + at * (1.0 - lost)
    keep = np.abs(TIME_S - start_s - 0.5 * lost) > 0.5 * lost
    path = write_npz(tmp_path / "t.npz", {n: v[keep] for n, v in signals().items()})
    found = cut(path, MAP)
    said = found.bad[0].error.message if found.bad else str(found.rows[0]["doubts"])
    share = float(said.split("% of window 1")[0].split()[-1]) if "% of" in said else 0.0
    # a step of 4 ms at either end, in whole percent
    assert share == pytest.approx(100 * lost / (WINDOW_S[1] - WINDOW_S[0]), abs=1.3)
    assert bool(found.bad) == (share > 20.0) or abs(share - 20.0) < 1.0


@FILE
@given(turned=st.floats(0.15, 0.85), seed=st.integers(0, 10**6))
def test_a_finger_that_turns_counts_by_its_way(tmp_path, turned, seed):
    turn_s = WINDOW_S[0] + turned
    way = np.where(turn_s > TIME_S, 1.0, -1.0)
    columns = signals(seed=seed)
    columns["Fx"] = way * columns["Fx"]
    columns["x"] = 20.0 * np.cumsum(way) / RATE_HZ
    path = write_csv(tmp_path / "t.csv", columns)
    assert "the finger turns in window 1" in refusal(path, MAP).message
    found = rows(path, with_keys(motion={"turns": "sign"}))
    assert found[0]["cof"] == pytest.approx(0.6, rel=0.01)
    del columns["x"]
    blind = with_keys()
    del blind["columns"]["position"]
    if 0.3 < turned < 0.7:  # by the force alone, where both ways are of some length
        assert "the finger turns" in refusal(write_csv(tmp_path / "t.csv", columns), blind).message


@FILE
@given(bits=st.sampled_from([8, 16, 32]), start=st.floats(0.1, 0.9), back=st.booleans())
def test_a_counter_that_wraps_is_unwrapped(tmp_path, bits, start, back):
    columns, span = signals(), 2**bits
    counts = (-1 if back else 1) * TIME_S * 2.0 * span + start * span
    columns["x"] = np.round(counts) % span
    path = write_npz(tmp_path / "t.npz", columns)
    said = with_keys(position={"unwrap": span}, motion={})
    found = rows(path, said)
    # counts are whole: one of them over the window's way
    assert found[0]["speed_m_s"] == pytest.approx(2e-3 * span, rel=1 / span + 1e-6)
    wraps = np.abs(np.diff(columns["x"])) > span / 2
    if wraps[INSIDE[1:] & INSIDE[:-1]].any():
        error = refusal(path, MAP)
        assert error.code == "doubtful_trial"
        assert "position jumps by" in error.message
        assert f"unwrap = {span}" in error.hint


@FILE
@given(drift_n=st.floats(-0.1, 0.1), zero_n=st.floats(-0.2, 0.2))
def test_a_zero_that_drifts_is_told_and_taken_out(tmp_path, drift_n, zero_n):
    columns = signals(noise_n=0.001)
    free = np.abs(TIME_S - 1.35) > 1.15
    for name in ("Fx", "Fz"):
        columns[name] = np.where(free, 0.0, columns[name])
    columns["Fx"] = columns["Fx"] + zero_n + drift_n * TIME_S / TIME_S[-1]
    path = write_csv(tmp_path / "t.csv", columns)
    found = cut(path, MAP)
    if max(abs(zero_n), abs(zero_n + drift_n)) > 0.02 and not found.bad:
        assert [doubt.kind for _, doubt in found.doubted] == ["zero"]
    mended = cut(path, with_keys(lateral_force={"zero": "linear"}))
    assert mended.rows[0]["cof"] == pytest.approx(0.6, rel=0.01)


@pytest.mark.parametrize("end_s", [1.45, 2.5])
def test_a_window_with_voltage_in_a_part_is_refused(tmp_path, end_s):
    said = with_keys()
    said["windows"] = [{"start_s": 0.3, "end_s": end_s}]
    path = write_csv(tmp_path / "t.csv", signals())
    wanted = "has voltage in a part" if end_s < 1.6 else "the record goes from"
    assert wanted in refusal(path, said).message


@FILE
@given(ahead_s=st.floats(0.1, 2.3), use=st.sampled_from(["row", "offset", "gain"]))
def test_a_baseline_that_reaches_into_a_burst_before_is_refused(tmp_path, ahead_s, use):
    """It is free before the first burst, and stood in the voltage of the one before the second."""
    columns = {name: np.tile(values, 2) for name, values in signals().items()}
    columns["t"] = np.arange(columns["t"].size) / RATE_HZ
    columns["x"] = 20.0 * columns["t"]
    said = with_keys(voltage_on={"bursts": "each"}, motion={})
    said["baseline"] = {"use": use, "start_s": -ahead_s, "end_s": -ahead_s + 0.08}
    said["baseline"] |= {} if use == "row" else {"cof": 0.4}
    path = write_npz(tmp_path / "t.npz", columns)
    found = cut(path, said)
    # the pause is 1.2 s less a sample; the record begins 1 s before the first
    if ahead_s < 0.99:
        # five standard errors of 20 samples before and 250 after, each of 0.6 % of friction
        cofs = [row["cof"] for row in found.rows if row["voltage_v"]]
        assert cofs == pytest.approx([0.6, 0.6], rel=5 * 1.5 * 0.006 * (1 / 20) ** 0.5)
    elif ahead_s > 1.01:
        assert found.bad


def test_voltage_from_the_first_sample_on_is_told(tmp_path):
    columns = signals()
    columns["U"] = columns["U"] + 30.0
    found = cut(write_csv(tmp_path / "t.csv", columns), MAP)
    assert [doubt.kind for _, doubt in found.doubted] == ["from_start"]


def monitored():
    """The map where the voltage was measured at the electrode."""
    said = with_keys(voltage_on={"column": "electrode_voltage"})
    said["columns"]["electrode_voltage"] = said["columns"].pop("voltage")
    return said


@pytest.mark.parametrize("frequency_hz", [100.0, 125.0, 1000.0])
def test_a_carrier_that_is_sampled_too_slowly_is_told(tmp_path, frequency_hz):
    said = monitored()
    values = {"voltage": 75.0 * 2**0.5, "frequency": frequency_hz}
    said["conditions"] = {**MAP["conditions"], "values": values}
    found = cut(write_npz(tmp_path / "t.npz", signals()), said)
    told = [doubt.kind for _, doubt in found.doubted]
    assert told == (["aliased"] if frequency_hz >= RATE_HZ / 2 else [])


@FILE
@given(gain=st.floats(0.01, 0.66) | st.floats(0.67, 1.49) | st.floats(1.51, 100.0))
def test_a_monitor_far_from_what_was_set_is_told(tmp_path, gain):
    columns = signals()
    columns["U"] = columns["U"] * gain * 0.5**0.5
    found = cut(write_npz(tmp_path / "t.npz", columns), monitored())
    told = {doubt.kind for _, doubt in found.doubted}
    assert ("not_as_set" in told) == (not 1 / 1.5 <= gain <= 1.5)


def test_forces_that_no_finger_has_are_told(tmp_path):
    columns = signals()
    columns["Fx"], columns["Fz"] = 1e3 * columns["Fx"], 1e3 * columns["Fz"]
    columns["x"] = 1e3 * columns["x"]
    found = cut(write_npz(tmp_path / "t.npz", columns), MAP)
    assert [doubt.kind for _, doubt in found.doubted] == ["impossible", "impossible"]


def test_friction_after_the_voltage_is_a_row_without_it(tmp_path):
    said = with_keys()
    said["windows"] = [{"after": "off", "start_s": 0.02, "end_s": 0.18}]
    (row,) = rows(write_csv(tmp_path / "t.csv", signals()), said)
    assert row["voltage_v"] == 0.0
    assert row["cof"] == pytest.approx(0.4, rel=0.02)
