"""Noise in levels: rows, trials and settings, on data whose levels are known."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.levels import (
    levels,
    loads_are_measured,
    rows_in_order,
    settings,
    trials,
    trials_are_touches,
)
from model.diagnosis.noise import noise_of
from model.diagnosis.where import neighbour_correlation

FREQUENCIES_HZ = (50.0, 250.0, 1000.0)
VOLTAGES_V = (60.0, 100.0, 140.0)


def measured(
    row_std: float = 0.01,
    trial_std: float = 0.12,
    load_std: float = 0.05,
    drift: float = 0.0,
    seed: int = 3,
) -> Measurements:
    """Five trials of four rows at nine settings, each trial under a load of its own."""
    chance = np.random.default_rng(seed)
    rows = []
    for frequency_hz in FREQUENCIES_HZ:
        for voltage_v in VOLTAGES_V:
            for _ in range(5):
                load_n = 0.5 * np.exp(load_std * chance.standard_normal())
                gain = np.exp(trial_std * chance.standard_normal())
                for time_s in (1.0, 1.5, 2.0, 2.65):
                    level = 0.4 + 2e-5 * voltage_v**2 / load_n + drift * np.exp(-time_s)
                    noise = np.exp(row_std * chance.standard_normal())
                    cof = level * gain * noise
                    rows.append((frequency_hz, voltage_v, load_n, cof, time_s))
    names = ("frequency_hz", "voltage_v", "normal_force_n", "cof", "time_s")
    columns = dict(zip(names, np.array(rows).T, strict=True))
    count = len(rows)
    digest = hashlib.sha256(columns["cof"].tobytes()).hexdigest()
    return Measurements(columns, np.zeros(count, np.intp), ("1",), None, digest)


def of(data: Measurements):
    return levels(data, data.observed, np.ones(data.count))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("row_std", "trial_std"), [(0.01, 0.12), (0.03, 0.06)])
def test_rows_and_trials_scatter_as_they_were_made(row_std, trial_std, seed):
    found = of(measured(row_std, trial_std, seed=seed))
    assert found.has_trials
    # Five standard deviations of a variance with so many degrees of freedom, and the difference
    # of loads that no slope takes away.
    assert found.row.variance == pytest.approx(row_std**2, rel=5 * (2 / found.row.degrees) ** 0.5)
    of_means = trial_std**2 + row_std**2 / 4
    assert found.trial.variance == pytest.approx(of_means, rel=5 * (2 / found.trial.degrees) ** 0.5)


def test_what_the_trials_of_a_setting_share_over_time_is_no_noise():
    still, drifting = of(measured()), of(measured(drift=0.4))
    assert drifting.row.variance < 2.0 * still.row.variance


def test_measured_loads_repeat_one_another_where_they_are_near():
    data = measured()
    assert loads_are_measured(data)
    assert np.unique(trials(data)).size == 45
    assert np.unique(settings(data)).size < 20  # nine where all five loads lie within 15 %


def test_loads_far_from_each_other_are_settings_of_their_own():
    data = measured(load_std=0.01)
    columns = data.columns | {
        "normal_force_n": np.where(
            trials(data) % 2 == 0,
            data.columns["normal_force_n"],
            2 * data.columns["normal_force_n"],
        )
    }
    assert np.unique(settings(replace(data, columns=columns))).size == 18


def test_a_commanded_load_says_what_repeats():
    data = measured(load_std=0.2)
    commanded = {"commanded_normal_force_n": np.full(data.count, 0.5)}
    told = replace(data, columns=data.columns | commanded, trial=trials(data))
    assert np.unique(settings(told)).size == 9
    assert np.unique(trials(told)).size == 45


def test_equal_loads_without_trials_scatter_as_replicates_do():
    data = measured(load_std=0.0, trial_std=0.0)
    found = of(data)
    values = data.observed.reshape(9, 20)
    by_hand = values.var(axis=1, ddof=1).mean()
    assert not found.has_trials
    assert found.row.degrees == 9 * 19
    assert found.row.variance == pytest.approx(by_hand, rel=1e-12)


def test_rows_of_a_trial_share_its_gain_in_the_covariance():
    data = measured()
    noise = noise_of(data)
    assert noise is not None
    covariance = noise.lower @ noise.lower.T
    trial = trials(data)
    same = (trial[:, None] == trial) & ~np.eye(data.count, dtype=bool)
    apart = trial[:, None] != trial
    assert covariance[same].min() - covariance[apart].max() == pytest.approx(0.12**2, rel=0.5)
    assert np.median(noise.own_std) == pytest.approx(0.01, rel=0.3)
    assert noise.source == "rows and trials"


def test_the_columns_of_a_file_name_trial_and_setting(tmp_path):
    path = tmp_path / "data.csv"
    head = "frequency_hz,voltage_v,normal_force_n,cof,setting,trial,commanded_normal_force_n"
    rows = [f"100,50,{0.49 + 0.01 * i},0.6,a,{i},0.5" for i in range(3)]
    rows += [f"100,80,{0.49 + 0.01 * i},0.7,b,{i},0.5" for i in range(3)]
    path.write_text("\n".join([head, *rows]))
    data = read_measurements(path)
    assert list(settings(data)) == [0, 0, 0, 1, 1, 1]
    assert np.unique(trials(data)).size == 6


def touches(row_std: float, trial_std: float, seed: int) -> Measurements:
    """A touch per setting and session, without voltage first and then with it, a gain for both.

    A file of these says that noise is a fifth of what it is, and more of it with voltage.
    """
    chance = np.random.default_rng(seed)
    rows, trial = [], 0
    for session in range(4):
        for frequency_hz in FREQUENCIES_HZ:
            for voltage_v in VOLTAGES_V:
                load_n = 0.5 * np.exp(0.08 * chance.standard_normal())
                gain = np.exp(trial_std * chance.standard_normal() + 0.05 * session)
                for volts in (0.0, voltage_v):
                    noise = row_std * chance.uniform(0.8, 1.25) * (1.0 + (volts > 0.0))
                    cof = gain * (0.5 + 5e-6 * volts**2 / load_n)
                    cof *= np.exp(noise * chance.standard_normal())
                    row = (frequency_hz, volts, load_n, cof, 0.2 * noise * cof, 0.5)
                    rows.append((*row, session, trial))
                trial += 1
    names = ("frequency_hz", "voltage_v", "normal_force_n", "cof", "cof_std")
    *columns, session, number = np.array(rows).T
    data = dict(zip((*names, "commanded_normal_force_n"), columns, strict=True))
    whole = session.astype(np.intp)
    return Measurements(data, whole, tuple("abcd"), None, "00", trial=number.astype(np.intp))


@pytest.mark.parametrize("seed", range(2))
def test_sessions_repeat_one_another_where_each_has_a_setting_once(seed):
    """What a touch shares with and without voltage is its gain, what is left a row's own."""
    data = touches(0.004, 0.05, seed)
    assert trials_are_touches(data)
    assert np.unique(trials(data)).size == 36
    found = levels(data, data.observed, data.stated_std)
    assert found.has_trials
    # Five standard deviations of a variance with so many degrees of freedom.
    assert found.row.variance == pytest.approx(25.0, rel=5 * (2 / found.row.degrees) ** 0.5)
    spread = 5 * (2 / found.trial.degrees) ** 0.5
    assert found.trial.variance == pytest.approx(0.05**2, rel=spread)


def bare(row_std: float, trial_std: float, seed: int) -> Measurements:
    """Six sessions that read nine settings once each, without a column that counts trials."""
    chance, rows = np.random.default_rng(seed), []
    for session in range(6):
        gain, time_s = np.exp(0.05 * chance.standard_normal()), 0.0
        for frequency_hz, voltage_v in chance.permutation(
            list(product(FREQUENCIES_HZ, VOLTAGES_V))
        ):
            load_n = 0.5 * np.exp(0.1 * chance.standard_normal())
            touch = gain * np.exp(trial_std * chance.standard_normal())
            time_s += 20.0
            for later_s in (0.0, 0.5, 1.0):
                level = 0.4 + 2e-5 * voltage_v**2 / load_n
                cof = level * touch * np.exp(row_std * chance.standard_normal())
                rows.append((frequency_hz, voltage_v, load_n, cof, time_s + later_s, session))
    *columns, number = np.array(rows).T
    names = ("frequency_hz", "voltage_v", "normal_force_n", "cof", "time_s")
    data = dict(zip(names, columns, strict=True))
    return Measurements(data, number.astype(np.intp), tuple("abcdef"), None, str(seed))


@pytest.mark.parametrize("seed", range(2))
def test_sessions_repeat_one_another_without_a_column_of_trials_too(seed):
    """A file whose touches only their loads tell apart has a gain of each touch as any other."""
    data = bare(0.01, 0.1, seed)
    found = of(data)
    assert found.has_trials
    # Five standard deviations of a variance with so many degrees of freedom.
    spread = 5 * (2 / found.trial.degrees) ** 0.5
    assert found.trial.variance == pytest.approx(0.1**2, rel=spread)
    assert found.row.variance == pytest.approx(1e-4, rel=5 * (2 / found.row.degrees) ** 0.5)


def test_a_plan_that_goes_through_settings_is_no_touch():
    data = touches(0.004, 0.05, 1)
    plan = replace(data, trial=data.session)
    assert not trials_are_touches(plan)
    assert np.unique(trials(plan)).size == data.count - 4 * 8  # rows without voltage are repeats


def numbered(data: Measurements) -> Measurements:
    """The same with a column of trials, and loads as commanded."""
    commanded = {"commanded_normal_force_n": np.full(data.count, 0.5)}
    return replace(data, columns=data.columns | commanded, trial=trials(data))


def on_one_clock(data: Measurements) -> Measurements:
    """The same with a pause of 10 s between trials, in the file from the last row to the first."""
    time_s = data.columns["time_s"] + 10.0 * np.repeat(np.arange(45), 4)
    return replace(data, columns=data.columns | {"time_s": time_s}).subset(
        np.arange(data.count)[::-1]
    )


@pytest.mark.parametrize("made", [lambda data: data, numbered])
def test_times_that_begin_anew_in_each_touch_do_not_mix_the_touches(made):
    """The file is in order of measurement, so that neighbours in it are neighbours in time."""
    data = made(measured())
    (order,) = rows_in_order(data)
    assert list(order) == list(range(data.count))
    alone, remembering = noise_of(data), noise_of(data, 0.6)
    assert alone is not None
    assert remembering is not None
    found = remembering.lower @ remembering.lower.T - alone.lower @ alone.lower.T
    at = np.arange(data.count)
    shared = 0.6 ** np.abs(at[:, None] - at) * np.outer(alone.own_std, alone.own_std)
    np.fill_diagonal(shared, 0.0)
    np.testing.assert_allclose(found, shared, atol=1e-12)


@pytest.mark.parametrize("made", [lambda data: data, numbered])
def test_touches_on_one_clock_are_in_its_order(made):
    data = on_one_clock(made(measured()))
    (order,) = rows_in_order(data)
    assert (np.diff(data.columns["time_s"][order]) > 0.0).all()


def test_noise_that_remembers_in_a_touch_is_found_there():
    """First-order noise of 0.7 from row to row, anew in each trial of four: 3/4 of all pairs."""
    chance = np.random.default_rng(5)
    noise = chance.standard_normal((45, 4))
    for i in range(1, 4):
        noise[:, i] = 0.7 * noise[:, i - 1] + np.sqrt(1.0 - 0.7**2) * noise[:, i]
    correlation, p = neighbour_correlation(measured(), noise.ravel())
    # Five standard deviations of a correlation by 179 pairs.
    assert correlation == pytest.approx(0.75 * 0.7, abs=5.0 / np.sqrt(179.0))
    assert p < 1e-3


def test_what_repeats_of_a_setting_share_over_time_is_no_noise_of_neighbours():
    """Attraction that fades at some settings alike in all five repeats, beside a trial's gain."""
    chance = np.random.default_rng(6)
    fading = np.outer(np.repeat(chance.standard_normal(9), 5), np.linspace(0.5, -0.5, 4))
    left = fading + 0.1 * chance.standard_normal((45, 4))
    correlation, _ = neighbour_correlation(measured(), left.ravel())
    assert correlation < 0.0
