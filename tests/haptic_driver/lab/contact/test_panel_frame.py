"""Contact areas from capacitive frames, against contacts that were drawn."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_driver.lab.contact.judge import NO_FINGER, OUTSIDE
from haptic_driver.lab.contact.panel_file import read_calibration, read_frames
from haptic_driver.lab.contact.panel_frame import (
    CLIPPED,
    MERGED,
    WEAK,
    Pairs,
    Touch,
    calibrated,
    edge_counts,
    find_touches,
)
from tests.haptic_driver.commands import rows_of, said_by
from tests.haptic_driver.lab.refusal import refused

from .panel_drawing import COLUMNS, FULL_COUNTS, ROWS, Ellipse, any_contact, drawn, noisy

EDGE = 0.1 * FULL_COUNTS
BARE = np.zeros((ROWS, COLUMNS))


def panel(count: int, seed: int, *range_m2: float) -> tuple[np.ndarray, np.ndarray]:
    """Frames with a touch each, and the areas."""
    random = np.random.default_rng(seed)
    contacts = [any_contact(random, *range_m2) for _ in range(count)]
    frames = np.array([noisy(drawn(one), random) for one in contacts])
    return frames, np.array([one.area_m2 for one in contacts])


def write_areas(path, area_m2, fingers=None):
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "contact_area_m2", *(["finger"] if fingers else [])])
        for i, area in enumerate(area_m2):
            cell = f"{area:.9g}" if np.isfinite(area) else ""
            writer.writerow([i, cell, *([fingers[i]] if fingers else [])])


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Frames of a panel with areas of a camera, and the calibration by them."""
    folder = tmp_path_factory.mktemp("panel")
    frames, area_m2 = panel(60, seed=11)
    np.save(folder / "frames.npy", frames)
    write_areas(folder / "areas.csv", area_m2, [f"f{i % 4}" for i in range(60)])
    words = (folder / "frames.npy", folder / "areas.csv", "--out", folder / "panel.toml")
    said_by("calibrate-panel", *words)
    return folder


def tell(lab, tmp_path, frames, *words):
    np.save(tmp_path / "new.npy", frames)
    out = tmp_path / "contact.csv"
    calibration = ("--calibration", lab / "panel.toml")
    said = said_by("contact-panel", tmp_path / "new.npy", *calibration, "--out", out, *words)
    return said, rows_of(out)


def test_areas_of_other_touches_come_out_with_the_spread_that_is_told(lab, tmp_path):
    frames, true_m2 = panel(60, 12, 50e-6, 200e-6)
    said, rows = tell(lab, tmp_path, frames, "--rate", "50")
    assert (said["frames"], said["counted"], said["bad"]) == (60, 60, {})
    assert [float(row["time_s"]) for row in rows] == pytest.approx(np.arange(60) / 50.0)
    told_m2 = np.array([float(row["contact_area_m2"]) for row in rows])
    std_m2 = np.array([float(row["contact_area_std_m2"]) for row in rows])
    off = np.abs(told_m2 / true_m2 - 1.0)
    constant = np.median(np.abs(np.median(true_m2) / true_m2 - 1.0))
    # cells are half as wide as the contacts: a fifth of a cell along the outline is 10 %
    assert np.median(off) < 0.1
    assert np.median(off) < 0.5 * constant
    # of 60 draws of a normal distribution 95 % lie within two, less than 85 % once in 500
    assert np.mean(np.abs(told_m2 - true_m2) < 2.0 * std_m2) > 0.85
    assert std_m2.mean() / true_m2.mean() < 0.2


def test_the_calibration_says_how_far_fingers_left_out_are_off(lab):
    calibration = read_calibration(lab / "panel.toml")
    assert (calibration.fingers, calibration.touches) == (4, 60)
    assert calibration.shape == [ROWS, COLUMNS]
    assert calibration.error < 0.1 < calibration.constant_error


def test_an_error_left_out_is_that_of_the_finger_and_not_of_the_fit():
    """Two fingers differ by two in what their frames say; a fit of both would be off by less."""
    sizes = np.linspace(2.0, 6.0, 20)
    touches = [Touch(5.0, 5.0, 400.0, size, 1.0 + (i % 3)) for i, size in enumerate(sizes)]
    area_m2 = 20e-6 * sizes * np.where(np.arange(20) < 10, 1.0, 2.0)
    names = ["a"] * 10 + ["b"] * 10
    found = calibrated((9, 9), 40.0, Pairs([*touches, *touches], np.tile(area_m2, 2), names * 2))
    # a is told twice its area, b half of it: errors of 1 and of 0.5 in equal numbers
    assert found.error == pytest.approx(0.75, abs=0.01)


def test_a_finger_with_more_touches_counts_no_more():
    random = np.random.default_rng(3)
    touches = [Touch(5.0, 5.0, 400.0, *random.uniform(2.0, 6.0, 2)) for _ in range(24)]
    area_m2 = 20e-6 * np.array([t.extent_cells2 for t in touches]) * random.uniform(0.8, 1.2, 24)
    names = ["a"] * 12 + ["b"] * 12
    once = calibrated((9, 9), 40.0, Pairs(touches, area_m2, names))
    often = [*range(24), *range(12), *range(12)]
    pairs = Pairs([touches[i] for i in often], area_m2[often], [names[i] for i in often])
    again = calibrated((9, 9), 40.0, pairs)
    assert again.coefficients == pytest.approx(once.coefficients, rel=1e-9)


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**16),
    gain=st.floats(0.05, 50.0),
    offset=st.floats(-500.0, 500.0),
    turn=st.integers(0, 3),
    mirror=st.booleans(),
)
def test_sizes_do_not_depend_on_gain_offset_or_direction(seed, gain, offset, turn, mirror):
    frame = drawn(any_contact(np.random.default_rng(seed)))
    (one,) = find_touches(frame, EDGE)
    other = np.rot90(gain * frame + offset, turn)
    (same,) = find_touches(other[:, ::-1] if mirror else other, gain * EDGE)
    assert same.extent_cells2 == pytest.approx(one.extent_cells2, abs=0.05)  # steps at its outline
    assert same.spread_cells2 == pytest.approx(one.spread_cells2, rel=1e-6)
    assert same.peak_counts == pytest.approx(gain * one.peak_counts, rel=1e-6)


@settings(max_examples=15, deadline=None)
@given(area_m2=st.floats(35e-6, 150e-6), ratio=st.floats(1.0, 1.6), turn_rad=st.floats(0.0, 3.1))
def test_a_larger_contact_of_one_form_has_a_larger_area(lab, area_m2, ratio, turn_rad):
    calibration = read_calibration(lab / "panel.toml")
    small, large = (
        calibration.area(calibration.seen(drawn(Ellipse(a, ratio, turn_rad)))[0])[0]
        for a in (area_m2, 1.3 * area_m2)
    )
    assert small < large


def test_each_touch_of_a_frame_is_told_where_it_is(lab):
    calibration = read_calibration(lab / "panel.toml")
    frame = drawn(Ellipse(60e-6, row=4.3, column=4.0), Ellipse(120e-6, row=14.0, column=10.6))
    found = calibration.seen(frame)
    assert [touch.bad for touch in found] == ["", ""]
    assert [touch.row for touch in found] == pytest.approx([4.3, 14.0], abs=0.1)
    assert [touch.column for touch in found] == pytest.approx([4.0, 10.6], abs=0.1)
    areas = [calibration.area(touch)[0] for touch in found]
    assert areas == pytest.approx([60e-6, 120e-6], rel=0.3)  # three times the spread told


@pytest.mark.parametrize(
    ("frame", "why"),
    [
        (BARE, NO_FINGER),
        (drawn(Ellipse(90e-6, row=0.3)), OUTSIDE),
        (drawn(Ellipse(60e-6, 1.0, row=7.0), Ellipse(60e-6, 1.0, row=9.5)), MERGED),
        (np.minimum(drawn(Ellipse(150e-6)), 0.6 * FULL_COUNTS), CLIPPED),
        (0.2 * drawn(Ellipse(90e-6)), WEAK),
    ],
)
def test_what_has_no_area_says_why(lab, tmp_path, frame, why):
    said, rows = tell(lab, tmp_path, [frame, drawn(Ellipse(90e-6))])
    assert said["bad"] == {why: 1}
    assert [row["bad"] for row in rows] == [why, ""]
    assert rows[0]["contact_area_m2"] == rows[0]["contact_area_std_m2"] == ""
    assert float(rows[1]["contact_area_m2"]) > 0.0


def test_an_area_beyond_the_calibration_is_in_doubt(lab, tmp_path):
    frame = drawn(Ellipse(450e-6, 1.0))
    _, (row,) = tell(lab, tmp_path, [frame], "--rate", "50")
    assert row["doubts"] == "beyond the areas of the calibration"


def test_a_single_frame_as_csv_and_as_npz_is_the_same(lab, tmp_path):
    frame = np.round(drawn(Ellipse(90e-6)))
    np.savetxt(tmp_path / "one.csv", frame, delimiter=",", fmt="%d")
    np.savez(tmp_path / "one.npz", time=np.zeros(1), frames=frame[None])
    for name in ("one.csv", "one.npz"):
        assert np.array_equal(read_frames(tmp_path / name), frame[None])


def test_what_are_no_frames_is_refused(lab, tmp_path):
    (tmp_path / "broken.npy").write_bytes(b"\x93NUMPY")
    (tmp_path / "words.csv").write_text("a,b\n1,2\n")
    np.save(tmp_path / "flat.npy", np.zeros(9))
    np.save(tmp_path / "complex.npy", np.zeros((2, 9, 9), complex))
    np.save(tmp_path / "objects.npy", np.array([[{}]]), allow_pickle=True)
    np.savez(tmp_path / "two.npz", a=BARE, b=BARE)
    for name in ("broken.npy", "words.csv", "flat.npy", "complex.npy", "objects.npy", "two.npz"):
        with refused("bad_frames", name):
            read_frames(tmp_path / name)
    with refused("bad_frames", "film.avi"):
        read_frames(tmp_path / "film.avi")


def test_frames_of_another_panel_are_refused(lab, tmp_path, refuses):
    np.save(tmp_path / "turned.npy", drawn(Ellipse(90e-6)).T)
    words = ("--calibration", lab / "panel.toml", "--out", tmp_path / "x.csv")
    error = refuses("bad_frames", "contact-panel", tmp_path / "turned.npy", *words)
    assert f"({COLUMNS}, {ROWS})" in error["message"]
    holed = drawn(Ellipse(90e-6))
    holed[3, 3] = np.nan
    np.save(tmp_path / "holed.npy", holed)
    refuses("bad_frames", "contact-panel", tmp_path / "holed.npy", *words)
    assert not (tmp_path / "x.csv").exists()


def test_frames_without_any_touch_are_said(lab, tmp_path, refuses):
    np.save(tmp_path / "bare.npy", BARE)
    words = ("--calibration", lab / "panel.toml", "--out", tmp_path / "x.csv")
    refuses("no_contact", "contact-panel", tmp_path / "bare.npy", *words, status=1)


def test_counts_that_fall_or_do_not_stand_out_are_refused():
    frames = np.array([drawn(Ellipse(90e-6))])
    with refused("bad_frames", "counts fall under a touch"):
        edge_counts(-frames)
    noise = np.random.default_rng(2).normal(0.0, 0.1 * FULL_COUNTS, frames.shape)
    with refused("bad_frames", "do not stand out"):
        edge_counts(frames + noise)


def test_frames_of_no_use_are_left_out_of_a_calibration_and_counted(lab, tmp_path):
    frames, area_m2 = panel(20, seed=13)
    frames[0] = 0
    frames[1] = drawn(Ellipse(60e-6, row=4.0, column=4.0), Ellipse(60e-6, row=14.0, column=10.0))
    area_m2[2] = np.nan
    np.save(tmp_path / "frames.npy", frames)
    write_areas(tmp_path / "areas.csv", area_m2)
    words = (tmp_path / "frames.npy", tmp_path / "areas.csv", "--out", tmp_path / "panel.toml")
    said = said_by("calibrate-panel", *words)
    assert said["touches"] == 17
    told = " ".join(said["said"])
    for words in (
        "one finger",
        "1 frames are not used: no finger",
        "1 frames are not used: several",
    ):
        assert words in told


def test_pairs_that_cannot_calibrate_are_refused(tmp_path, refuses):
    frames, area_m2 = panel(20, seed=14)
    np.save(tmp_path / "frames.npy", frames)
    shuffled = np.random.default_rng(0).permutation(area_m2)
    for code, areas, word in (
        ("bad_areas", area_m2[:-1], "19 rows for 20 frames"),
        ("bad_areas", 1e6 * area_m2, "no finger touches with"),
        ("bad_areas", np.full(20, np.nan), "no area"),
        ("too_few_touches", np.where(np.arange(20) < 11, area_m2, np.nan), "11 touches"),
        ("no_better", shuffled, "by the counts"),
    ):
        write_areas(tmp_path / "areas.csv", areas)
        words = (tmp_path / "frames.npy", tmp_path / "areas.csv", "--out", tmp_path / "p.toml")
        assert word in refuses(code, "calibrate-panel", *words)["message"]
        assert not (tmp_path / "p.toml").exists()
