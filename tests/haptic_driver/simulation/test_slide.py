"""Slides: what a file may hold, and how a record is judged."""

import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.rig.slide import read_slide, synthetic_slide
from haptic_driver.simulation.slide import score
from tests.haptic_driver.slide_records import made_record, made_samples

HEADER = "time_s,position_m,normal_force_n"


def write(tmp_path, rows, header=HEADER, encoding="utf-8"):
    path = tmp_path / "slide.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding=encoding)
    return path


def rows(count=20, step_s=0.005, start_s=0.0):
    return [f"{start_s + step_s * i},{1e-4 * i},0.5" for i in range(count)]


def refused(path):
    with pytest.raises(BadInputError) as error:
        read_slide(path)
    assert error.value.code in (
        "bad_slide",
        "bad_table",
        "missing_column",
        "not_a_number",
        "file_not_found",
        "file_unreadable",
    )
    assert str(path) in error.value.message
    assert error.value.hint
    return error.value


# --- files
# ------------------------------------------------------------------------------------------------


def test_a_slide_is_resampled_to_the_tick(tmp_path):
    slide = read_slide(write(tmp_path, rows(11, 0.010, start_s=5.0)))
    assert slide.name == "slide.csv"
    np.testing.assert_allclose(slide.time_s, 5.0 + 1e-3 * np.arange(100), atol=1e-9)
    # 0.1 mm per 10 ms, linear between the rows
    np.testing.assert_allclose(slide.position_m, 1e-5 * np.arange(100), atol=1e-12)
    np.testing.assert_array_equal(slide.normal_force_n, 0.5)


def test_uneven_times_are_interpolated(tmp_path):
    times = [0.0, 0.001, 0.004, 0.010, 0.011, 0.02, 0.03, 0.05, 0.06, 0.09]
    slide = read_slide(write(tmp_path, [f"{t},{2.0 * t},{0.1 + t}" for t in times]))
    np.testing.assert_allclose(slide.position_m, 2.0 * slide.time_s, atol=1e-12)
    np.testing.assert_allclose(slide.normal_force_n, 0.1 + slide.time_s, atol=1e-12)


def test_a_short_line_is_named(tmp_path):
    assert (
        "line 3"
        in refused(write(tmp_path, ["0.0,0.0,0.5", "0.01,0.0", *rows(20, start_s=1.0)])).message
    )


@pytest.mark.parametrize("time_s", ["0.02", "0.01"])
def test_time_that_stands_or_goes_back_is_named_with_its_line(tmp_path, time_s):
    lines = rows()
    lines[5] = f"{time_s},0.0,0.5"  # after 0.020 in line 6
    message = refused(write(tmp_path, lines)).message
    assert "line 7" in message
    assert "time_s does not rise" in message


@pytest.mark.parametrize("count", [0, 1, 9])
def test_too_few_rows(tmp_path, count):
    assert f"has {count} rows" in refused(write(tmp_path, rows(count))).message


@pytest.mark.parametrize("step_s", [1e-5, 1e-4])
def test_rows_within_a_single_tick_are_too_short(tmp_path, step_s):
    """Ten rows within 1 ms leave one tick, from which no speed follows."""
    refused(write(tmp_path, rows(10, step_s)))


def test_time_in_milliseconds_is_guessed(tmp_path):
    assert "is time_s in seconds?" in refused(write(tmp_path, rows(1000, 5.0))).message


@pytest.mark.parametrize("force_n", ["0", "-0.5"])
def test_a_finger_that_never_touches_is_no_slide(tmp_path, force_n):
    """A force of the wrong sign would give an empty result without a word."""
    lines = [line.replace(",0.5", f",{force_n}") for line in rows()]
    assert "never touches" in refused(write(tmp_path, lines)).message


# --- made up
# ------------------------------------------------------------------------------------------------


def test_the_synthetic_slide_is_what_it_says():
    slide = synthetic_slide()
    assert np.ptp(slide.position_m) == pytest.approx(0.080, rel=1e-6)
    assert slide.position_m[-1] == pytest.approx(0.0, abs=1e-9)
    # a least-jerk stroke peaks at 15/8 of its mean speed, 80 mm in 2.2 s; averaging over 10 ms
    # takes a little off
    assert slide.speed_m_s.max() == pytest.approx(15.0 / 8.0 * 0.080 / 2.2, rel=1e-3)
    pressed = slide.normal_force_n > 0.3
    assert 0.4 < slide.normal_force_n[pressed].mean() < 0.6
    assert (slide.normal_force_n[(slide.time_s > 3.1) & (slide.time_s < 3.4)] == 0.0).all()
    assert slide.normal_force_n.min() >= -1e-12


# --- score
# ------------------------------------------------------------------------------------------------


def test_what_is_counted_besides_fidelity():
    contact = np.ones(100, bool)
    contact[:10] = False
    off_screen, voltage = np.zeros(100, bool), np.full(100, 70.0)
    off_screen[50:], voltage[70:] = True, 1.0
    result = score(
        made_record(
            samples=made_samples(in_contact=contact), off_screen=off_screen, voltage_v=voltage
        )
    )
    assert result.contact_time_s == pytest.approx(0.090)
    assert result.output_on_without_contact_s == pytest.approx(
        0.020
    )  # 1 V is the lowest that an output has
    assert result.max_voltage_v == 77.0


def test_a_slide_is_judged_by_the_measure_of_fidelity():
    """From 0.1 s after the touch on, while it slides over a target."""
    contact, measured = np.ones(400, bool), np.full(400, 0.6)
    contact[:50] = False
    measured[50:150] = 0.9  # within 0.1 s of the touch
    measured[300:] = 0.66
    result = score(
        made_record(400, samples=made_samples(400, in_contact=contact, measured_cof=measured))
    ).fidelity
    assert result.sliding_time_s == pytest.approx(0.250, abs=0.0011)
    assert result.share_within_5_percent == pytest.approx(
        0.6, abs=0.03
    )  # averages reach over the edge


def test_a_resting_finger_is_not_judged():
    result = score(made_record(samples=made_samples(speed_m_s=0.001)))
    assert result.fidelity.sliding_time_s == 0.0
    assert result.contact_time_s == pytest.approx(0.100)
    assert result.fidelity.share_within_5_percent is None
