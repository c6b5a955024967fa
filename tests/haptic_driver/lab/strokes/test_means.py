"""The numbers of figure 3, against frictions that are known."""

from __future__ import annotations

import statistics
from math import sqrt
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.lab.strokes.file import KeptStroke, strokes_path
from haptic_driver.lab.strokes.means import mean_and_error, stroke_means
from tests.haptic_driver.lab.refusal import refused
from tests.haptic_driver.lab.strokes.stroke_files import data_file, stroke, written

OFF = (0.50, 0.52, 0.51)
ON = {50.0: (0.56, 0.60, 0.61), 250.0: (0.60, 0.62, 0.70)}


def trials(**changes: float) -> list[KeptStroke]:
    made = [
        {"cof": cof, "frequency_hz": 0.0, "voltage_v": 0.0, "trial": i}
        for i, cof in enumerate(OFF, start=1)
    ]
    for f, cofs in ON.items():
        made += [{"cof": c, "frequency_hz": f, "trial": i} for i, c in enumerate(cofs, start=1)]
    return [stroke(row, **said, **changes) for row, said in enumerate(made, start=1)]  # type: ignore[arg-type]


@pytest.fixture
def data(tmp_path):
    return data_file(tmp_path / "data.csv", trials())


def test_steady_friction_is_the_mean_over_trials_with_its_standard_error(data):
    steady = stroke_means(data, {}).steady
    assert steady.frequency_hz.tolist() == [50.0, 250.0]
    assert steady.trials == (3, 3)
    for i, cofs in enumerate(ON.values()):
        assert steady.cof[i] == pytest.approx(statistics.mean(cofs))
        assert steady.cof_sem[i] == pytest.approx(statistics.stdev(cofs) / sqrt(3))
    assert steady.cof_off == pytest.approx(0.51)
    assert steady.cof_off_sem == pytest.approx(0.01 / sqrt(3))


def test_the_force_by_31_as_printed_and_as_corrected(data):
    """(1 - off/on) F_n and (on/off - 1) F_n, errors by random draws of both means."""
    steady = stroke_means(data, {}).steady
    assert steady.printed_n == pytest.approx([(1 - 0.51 / 0.59) * 0.5, (1 - 0.51 / 0.64) * 0.5])
    assert steady.corrected_n == pytest.approx([(0.59 / 0.51 - 1) * 0.5, (0.64 / 0.51 - 1) * 0.5])
    draw = np.random.default_rng(1).standard_normal
    off = 0.51 + 0.01 / sqrt(3) * draw(200_000)
    on = 0.59 + statistics.stdev(ON[50.0]) / sqrt(3) * draw(200_000)
    # to first order, of errors of 1 and 3 %
    assert steady.printed_sem_n[0] == pytest.approx(np.std((1 - off / on) * 0.5), rel=0.01)
    assert steady.corrected_sem_n[0] == pytest.approx(np.std((on / off - 1) * 0.5), rel=0.01)


def test_the_force_needs_the_load_that_was_measured(tmp_path):
    steady = stroke_means(data_file(tmp_path / "d.csv", trials(load_n=0.53)), {}).steady
    assert steady.corrected_n[0] == pytest.approx((0.59 / 0.51 - 1) * 0.53)


def test_curves_are_means_of_trials_by_displacement(data):
    means = stroke_means(data, {})
    assert means.window_m == (0.015, 0.035)
    off, low, high = means.curves
    assert [curve.frequency_hz for curve in means.curves] == [0.0, 50.0, 250.0]
    steady = (high.displacement_m > 0.0155) & (high.displacement_m < 0.0345)
    before = high.displacement_m < 0.0145
    assert steady.sum() == 19  # a bin is a twentieth of the window
    assert high.cof[steady] == pytest.approx(0.64)
    assert high.cof_sem[steady] == pytest.approx(statistics.stdev(ON[250.0]) / sqrt(3))
    assert high.cof[before] == pytest.approx(0.5)
    assert high.cof_sem[before] == pytest.approx(0.0, abs=1e-12)
    assert low.velocity_m_s == pytest.approx(0.02)
    assert off.normal_force_n == pytest.approx(0.5)


def test_trials_without_voltage_are_needed_for_a_force_alone(tmp_path):
    means = stroke_means(data_file(tmp_path / "d.csv", trials()[2:]), {})
    assert means.left_out == (0.0,)
    assert np.isnan(means.steady.corrected_n).all()
    assert means.steady.cof[0] == pytest.approx(0.59)


def test_of_several_conditions_one_is_chosen_or_asked_for(tmp_path):
    more = [stroke(20 + i, voltage_v=100.0, trial=i, cof=0.8 + 0.1 * i) for i in (1, 2)]
    data = data_file(tmp_path / "d.csv", [*trials(), *more])
    assert stroke_means(data, {}).condition.voltage_v == 75.0  # two frequencies, not one
    asked = stroke_means(data, {"voltage_v": 100.0})
    assert asked.steady.cof == pytest.approx([0.95])
    with refused("no_such_condition", hint="75 V, 0.5 N, 20 mm/s; 100 V"):
        stroke_means(data, {"voltage_v": 60.0})


def test_rows_that_somebody_left_out_are_left_out(tmp_path):
    data = data_file(tmp_path / "d.csv", trials())
    lines = data.read_text().splitlines(keepends=True)
    data.write_text("".join(lines[:-1]))
    steady = stroke_means(data, {}).steady
    assert steady.trials == (3, 2)
    assert steady.cof[1] == pytest.approx(0.61)


def no_strokes(data: Path) -> None:
    strokes_path(data).unlink()


def others(data: Path) -> None:
    written(strokes_path(data), [stroke(row, trial=row) for row in (1, 2)])


def of_another_day(data: Path) -> None:
    moved = trials()
    for one in moved:
        one.samples["time_s"] += 0.5
    written(strokes_path(data), moved)


def single(data: Path) -> None:
    data_file(data, [stroke(1), stroke(2, frequency_hz=50.0)])


def no_window(data: Path) -> None:
    data_file(data, trials(window_m=(0.02, 0.02)))  # type: ignore[arg-type]


def no_data(data: Path) -> None:
    data.write_text("time,force\n1,2\n")


def no_rows(data: Path) -> None:
    data.write_text(data.read_text().splitlines()[0])


def no_number(data: Path) -> None:
    data.write_text(data.read_text().replace(",0.02,", ",fast,"))


@pytest.mark.parametrize(
    ("harm", "code", "words"),
    [
        (no_strokes, "no_strokes", "data.strokes.h5"),
        (others, "strokes_foreign", "no stroke of session 1, trial 1, 0 Hz"),
        (of_another_day, "strokes_foreign", "no stroke of session 1, trial 1"),
        (single, "one_trial", "no frequency was measured twice at 75 V"),
        (no_window, "no_steady_window", "only 20 to 20 mm"),
        (no_data, "not_measured_data", "no column frequency_hz"),
        (no_rows, "no_friction", "no friction of a sliding finger"),
        (no_number, "bad_number", "speed_m_s 'fast' is no number"),
    ],
)
def test_what_cannot_be_drawn_is_said(data, harm, code, words):
    harm(data)
    with refused(code, words):
        stroke_means(data, {})


def test_means_pass_over_what_is_not_there():
    values = np.array([[1.0, 2.0, np.nan], [3.0, np.nan, np.nan], [5.0, 4.0, 7.0]])
    mean, error = mean_and_error(values)
    assert mean[:2] == pytest.approx([3.0, 3.0])
    assert error[:2] == pytest.approx([2.0 / sqrt(3.0), 1.0])
    assert np.isnan(mean[2])
    assert np.isnan(error[2])
