"""Time stamps of films as cameras and people write them."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from haptic_driver.lab.contact.film import read_film
from haptic_driver.lab.contact.times import read_times
from tests.haptic_driver.lab.refusal import refused

FRAMES_S = np.array([0.0, 0.0167, 0.0334, 0.0601, 0.0768])
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    unit=st.sampled_from(sorted(UNITS)),
    style=st.sampled_from(["time_{u}", "Time ({u})", "timestamp [{u}]", "t / {u}", "time in {u}"]),
    separator=st.sampled_from([",", ";", "\t", ", "]),
    last=st.booleans(),
    start_s=st.floats(0.0, 1e4),
)
def test_the_column_of_time_in_its_own_unit(tmp_path, unit, style, separator, last, start_s):
    """The last column was taken for time, and any unit for s."""
    rows = [["frame", style.format(u=unit), "exposure_ms"]]
    for i, time_s in enumerate(FRAMES_S):
        rows.append([str(i), f"{(start_s + time_s) / UNITS[unit]:.6f}", "8.1"])
    path = tmp_path / "times.csv"
    path.write_text("\n".join(separator.join(row[: 2 if last else 3]) for row in rows))
    # times of 1e4 s to a microsecond
    assert read_times(path, 5) == pytest.approx(FRAMES_S, abs=3e-6)


@pytest.mark.parametrize(
    "form", ["{:%Y-%m-%dT%H:%M:%S.%f}", "{:%Y-%m-%d %H:%M:%S.%f}", "{:%H:%M:%S.%f}"]
)
@pytest.mark.parametrize("second", [30, 59])
def test_dates_pass_over_minutes_and_midnight(tmp_path, form, second):
    start = datetime(2024, 5, 1, 23, 59, second, 970000)
    path = tmp_path / "times.txt"
    path.write_text("\n".join(form.format(start + timedelta(seconds=s)) for s in FRAMES_S))
    assert read_times(path, 5) == pytest.approx(FRAMES_S, abs=1e-6)


@pytest.mark.parametrize(
    "text", ["0\n0.5\n0.9\n", "1, 0\n2, 0.5\n3, 0.9\n", "a.png 0\nb.png .5\nc.png .9"]
)
def test_seconds_alone_or_behind_a_counter_or_a_name(tmp_path, text):
    (tmp_path / "times.txt").write_text(text)
    assert read_times(tmp_path / "times.txt", 3) == pytest.approx([0.0, 0.5, 0.9])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0\n16.7\n33.4\n", "nothing says whether in s or in ms"),
        ("0,0.5,8\n0.1,0.6,8\n0.2,0.7,8\n", "3 columns may be the time"),
        ("time_s,time_ms\n0,0\n0.1,100\n0.2,200\n", "2 columns may be the time"),
        ("time_s\n0\n0.2\n0.1\n", "line 4: times do not rise"),
        ("time_s\n0\n0.2\n", "has 2 time stamps for 3 frames"),
        ("time_V\n1\n2\n3\n", "time_V: V is no time"),
        ("", "is empty"),
    ],
)
def test_what_is_in_doubt_is_refused(tmp_path, text, said):
    (tmp_path / "times.csv").write_text(text)
    with refused("bad_times", said):
        read_times(tmp_path / "times.csv", 3)


def test_own_results_in_the_folder_are_no_frames(tmp_path):
    iio = pytest.importorskip("imageio.v3")
    for name, side in (("f1.png", 60), ("f2.png", 60), ("c-outlines.png", 90), ("._f1.png", 60)):
        iio.imwrite(tmp_path / name, np.zeros((side, side), np.uint8), extension=".png")
    (tmp_path / "c.csv").write_text("frame,time_s\n0,0\n")
    film = read_film(tmp_path, own=[tmp_path / "c.csv", tmp_path / "c-outlines.png"])
    assert [frame.shape for frame in film.frames()] == [(60, 60), (60, 60)]
