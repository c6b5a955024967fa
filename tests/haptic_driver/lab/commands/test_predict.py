"""`haptic predict`: reference conditions, columns carried through, and what is wrong with a
table.
"""

import csv

import numpy as np
import pytest

from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.touch import SPEED_REFERENCE_M_S
from model.touch_model import TouchModel
from tests.fingers import SHIPPED
from tests.haptic_driver.commands import rows_of

ADDED = ["electrostatic_force_n", "cof", "current_rms_a", "current_a", "current_phase_rad"]
BASE = "frequency_hz,voltage_v,normal_force_n"

# frequency_hz, voltage_v, normal_force_n, then force, friction and current of an independent
# solution good to 0.05 %.
REFERENCE = [
    (1.0, 150.0, 0.25, 0.0612039, 0.637346, 2.29781e-06),
    (100.0, 125.0, 0.25, 0.223476, 0.969678, 5.36741e-05),
    (250.0, 75.0, 0.5, 0.100787, 0.615205, 4.22916e-05),
    (100000.0, 25.0, 1.0, 0.0086701, 0.516439, 0.000806755),
    (1000000.0, 150.0, 0.5, 0.219815, 0.73709, 0.0399048),
]
AGREED = 2e-3


@pytest.fixture
def predict(haptic, tmp_path):
    """Run one table; returns status, what `--json` said, and the rows written."""

    def run(text, *arguments, encoding="utf-8"):
        table, out = tmp_path / "conditions.csv", tmp_path / "out.csv"
        table.write_text(text, encoding=encoding)
        done = haptic("predict", "--table", table, "--out", out, "--json", *arguments)
        rows = []
        if out.exists():
            with out.open(newline="", encoding="utf-8") as file:
                rows = list(csv.reader(file))
        return done.status, done.said, rows

    return run


def numbers(rows, name):
    return [float(row[rows[0].index(name)]) for row in rows[1:]]


def test_reference_conditions(predict):
    lines = [BASE, *(f"{f:g},{v:g},{n:g}" for f, v, n, *_ in REFERENCE)]
    status, said, rows = predict("\n".join(lines))
    assert status == 0
    assert said["rows"] == len(REFERENCE) == len(rows) - 1
    for i, name in enumerate(ADDED[:3], start=3):
        assert numbers(rows, name) == pytest.approx([r[i] for r in REFERENCE], rel=AGREED)


def test_other_columns_are_carried_through_in_order(predict):
    """But for the answers of an earlier run, which are replaced."""
    head = "session,voltage_v,speed_m_s,frequency_hz,note,normal_force_n,time_s"
    row = 'A,75,0.02,250,"dry, clean",0.5,1.5'
    _, said, rows = predict(f"{head},{','.join(ADDED)}\n{row},9,9,9,9,9\n")
    assert (said["rows"], said["model"], said["outside_theory"]) == (1, "reference", 0)
    assert rows[0] == [*head.split(","), *ADDED]
    assert rows[1][:7] == ["A", "75", "0.02", "250", "dry, clean", "0.5", "1.5"]
    assert numbers(rows, "cof") == pytest.approx([0.615205], rel=AGREED)


def test_measured_friction_is_kept_beside_the_answer(haptic, tmp_path):
    table, out = tmp_path / "data.csv", tmp_path / "out.csv"
    table.write_text(f"cof,{BASE}\n0.61,250,75,0.5\n")
    done = haptic("predict", "--table", table, "--out", out)
    (row,) = rows_of(out)
    assert row["cof_measured"] == "0.61"
    assert float(row["cof"]) == pytest.approx(0.615205, rel=AGREED)
    assert "column cof" in done.err
    assert "cof_measured" in done.err
    again = tmp_path / "again.csv"
    assert haptic("predict", "--table", out, "--out", again).status == 0
    assert again.read_bytes() == out.read_bytes()


def test_every_optional_column_reaches_the_model(predict, tmp_path):
    """By the model itself, with effects of speed and time. Empty cells are the usual values."""
    model = tmp_path / "finger.toml"
    effects = "[effects.velocity_dependent_friction]\nexponent = 0.1\n"
    effects += "[effects.contact_ageing]\nshare = 0.5\ntime_constant_s = 30.0\n"
    model.write_text(SHIPPED + effects, encoding="utf-8")
    status, said, rows = predict(
        f"{BASE},speed_m_s,time_s,voltage_offset_v,waveform,finger,contact_area_m2\n"
        "250,75,0.5,,,,,,\n"
        "any,0,0.5,0.2,3000,,,,\n"
        "250,75,0.5,0.2,9,60,SQUARE,sliding,1.2e-4\n"
        ",75,0.5,0.02,9,0,dc,,1e-4\n"
        "1000,5,0.5,,,,,resting,\n"
        "1000,5,0.5,,,,,none,\n",
        "--model",
        str(model),
    )
    assert status == 0, said
    asked = Conditions(
        frequency_hz=np.array([250.0, 0.0, 250.0, 0.0, 1e3, 1e3]),
        voltage_v=np.array([75.0, 0.0, 75.0, 75.0, 5.0, 5.0]),
        normal_force_n=np.full(6, 0.5),
        speed_m_s=np.array([SPEED_REFERENCE_M_S, 0.2, 0.2, 0.02] + 2 * [SPEED_REFERENCE_M_S]),
        time_s=np.array([0.0, 3000.0, 9.0, 9.0, 0.0, 0.0]),
        voltage_offset_v=np.array([0.0, 0.0, 60.0, 0.0, 0.0, 0.0]),
        waveform=np.array(["sine", "sine", "square", "dc", "sine", "sine"]),
        finger=np.array(4 * ["sliding"] + ["resting", "none"]),
        contact_area_m2=np.array([np.nan, np.nan, 1.2e-4, 1e-4, np.nan, np.nan]),
    )
    expected = TouchModel(load_model(str(model))).predict(asked)
    for name, values in (
        ("electrostatic_force_n", expected.electrostatic_force_n),
        ("cof", expected.cof),
        ("current_a", np.abs(expected.electrode_current_a)),
    ):
        assert numbers(rows, name) == pytest.approx(values, rel=1e-7, nan_ok=True)


def test_what_the_printed_equations_cannot_answer_is_said(predict):
    _, said, _ = predict(f"{BASE}\n250,75,0.5\n250,600,0.5\n", "--model", "published")
    assert "1 of 2 conditions: (31) as printed diverges" in said["notes"][0]


def test_a_force_that_is_steeper_than_that_of_fingers_is_said_once(predict, haptic, tmp_path):
    """Of the rows with the most voltage, that with the least load speaks."""
    table = f"{BASE}\n125,150,1\n125,150,0.5\n125,80,0.5\n"
    _, said, _ = predict(table)
    (note,) = said["notes"]
    assert "the model 'reference' is steeper than published fingers" in note
    assert "150 V at 0.5 N" in note
    done = haptic("predict", "--table", tmp_path / "conditions.csv", "--out", tmp_path / "out.csv")
    assert done.err.count("steeper than published fingers") == 1
    _, said, _ = predict(table, "--model", "measured")
    assert said["notes"] == []
    _, said, _ = predict(f"{BASE}\n125,75,0.5\n")
    assert said["notes"] == []


def test_pull_in_is_counted_and_empty_of_numbers(predict, haptic, tmp_path):
    status, said, rows = predict(f"{BASE}\n250,75,0.5\n250,20000,0.5\n")
    assert status == 0
    assert said["outside_theory"] == 1
    assert rows[2][-2] == "nan"
    done = haptic("predict", "--table", tmp_path / "conditions.csv", "--out", tmp_path / "out.csv")
    assert "warning: 1 of 2 rows" in done.err


# --- wrong tables
# ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (f"{BASE}\n", "bad_table", "has no rows"),
        (f"{BASE}\n250,75,0.5\n250,high,0.5\n", "not_a_number", "line 3: voltage_v is 'high'"),
        (f"{BASE}\n250,-75,0.5\n", "bad_condition", ", line 2: voltage_v = -75"),
        (f"{BASE},finger\n1000,5,0.5,slidign\n", "bad_condition", "slidign"),
        (f"{BASE},cof,cof_measured\n250,75,0.5,0.6,0.6\n", "bad_table", "cof and cof_measured"),
        (f"{BASE},contact_area_m2\n250,75,0.5,1.2e-4\n", "bad_condition", "one area"),
    ],
)
def test_what_is_wrong_with_a_table_is_said_and_nothing_is_written(
    predict, tmp_path, text, code, words
):
    status, said, rows = predict(text, "--model", "published" if "area" in text else "reference")
    assert status == 2
    assert said["error"]["code"] == code
    assert words in said["error"]["message"]
    assert str(tmp_path / "conditions.csv") in said["error"]["message"]
    assert said["error"]["hint"]
    assert rows == []


def test_what_a_drive_makes_of_the_voltage_is_added(predict, tmp_path):
    """A first-order roll-off at its cutoff: 1/sqrt(2), 45 degrees late; the current lags with
    it.
    """
    model = tmp_path / "slow.toml"
    effect = "\n[effects.amplifier_bandwidth]\ncutoff_hz = 1000.0\norder = 1.0\n"
    model.write_text(SHIPPED + effect, encoding="utf-8")
    table = f"{BASE}\n1000,1,0.5\n"
    _, _, plain = predict(table)
    _, _, rows = predict(table, "--model", str(model))
    assert numbers(rows, "electrode_voltage_v") == pytest.approx([0.5**0.5], rel=1e-6)
    assert numbers(rows, "electrode_voltage_phase_rad") == pytest.approx([-0.785398], abs=1e-4)
    late = numbers(plain, "current_phase_rad")[0] - numbers(rows, "current_phase_rad")[0]
    assert late == pytest.approx(0.785398, abs=1e-4)
    assert numbers(rows, "current_a")[0] == pytest.approx(
        0.5**0.5 * numbers(plain, "current_a")[0], rel=1e-4
    )  # 1 V attracts a little
