"""`haptic predict`: reference conditions, columns carried through, and what is wrong with a
table.
"""

import csv
import json
from pathlib import Path

import pytest

MODELS = Path(__file__).parents[4] / "configs" / "models"
ADDED = ["electrostatic_force_n", "cof", "current_rms_a", "current_a", "current_phase_rad"]
BASE = "frequency_hz,voltage_v,normal_force_n"

# frequency_hz, voltage_v, normal_force_n, then force, friction and current of an independent
# solution good to 0.05 %.
REFERENCE = [
    (1.0, 150.0, 0.25, 0.0612039, 0.637346, 2.29781e-06),
    (1.0, 10.0, 0.5, 0.000344335, 0.512353, 1.53306e-07),
    (10.0, 75.0, 1.0, 0.0843483, 0.555186, 1.13659e-05),
    (50.0, 100.0, 0.5, 0.187211, 0.703704, 4.93242e-05),
    (100.0, 125.0, 0.25, 0.223476, 0.969678, 5.36741e-05),
    (250.0, 75.0, 0.5, 0.100787, 0.615205, 4.22916e-05),
    (500.0, 50.0, 0.5, 0.0397863, 0.552741, 2.63278e-05),
    (1000.0, 100.0, 0.25, 0.0982237, 0.713162, 3.90761e-05),
    (10000.0, 125.0, 0.5, 0.154297, 0.67, 0.000327334),
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


def test_what_json_says(predict, tmp_path):
    _, said, _ = predict(f"{BASE}\n250,75,0.5\n", "--model", "table1")
    assert set(said) == {"rows", "out", "model", "outside_theory", "notes"}
    assert said == {
        "rows": 1,
        "out": str(tmp_path / "out.csv"),
        "model": "table1",
        "outside_theory": 0,
        "notes": [],
    }


def test_other_columns_are_carried_through_in_order(predict):
    text = (
        'session,voltage_v,speed_m_s,frequency_hz,note,normal_force_n,time_s\nA,75,0.02,250,"dry,'
        ' clean",0.5,1.5\n'
    )
    _, _, rows = predict(text)
    assert rows[0] == [*text.splitlines()[0].split(","), *ADDED]
    assert rows[1][:7] == ["A", "75", "0.02", "250", "dry, clean", "0.5", "1.5"]


def test_answers_of_an_earlier_run_are_replaced(predict):
    _, _, rows = predict(f"{BASE},{','.join(ADDED)},note\n250,75,0.5,9,9,9,9,9,kept\n")
    assert rows[0] == [*BASE.split(","), "note", *ADDED]
    assert numbers(rows, "cof") == pytest.approx([0.615205], rel=AGREED)


def test_measured_friction_is_kept_beside_the_answer(haptic, tmp_path):
    table, out = tmp_path / "data.csv", tmp_path / "out.csv"
    table.write_text(f"cof,{BASE},note\n0.61,250,75,0.5,first\n")
    done = haptic("predict", "--table", table, "--out", out)
    rows = list(csv.reader(out.read_text(encoding="utf-8").splitlines()))
    assert rows[0] == ["cof_measured", *BASE.split(","), "note", *ADDED]
    assert rows[1][:5] == ["0.61", "250", "75", "0.5", "first"]
    assert numbers(rows, "cof") == pytest.approx([0.615205], rel=AGREED)
    assert "column cof" in done.err
    assert "cof_measured" in done.err
    again = tmp_path / "again.csv"
    assert haptic("predict", "--table", out, "--out", again).status == 0
    assert again.read_bytes() == out.read_bytes()


def test_two_columns_of_one_name_are_never_written(predict):
    status, said, rows = predict(f"{BASE},cof,cof_measured\n250,75,0.5,0.6,0.6\n")
    assert status == 2
    assert "cof and cof_measured" in said["error"]["message"]
    assert rows == []


def test_speed_and_time_reach_the_effects_that_need_them(predict, tmp_path):
    """Friction at v = 10 v_ref, and t = 100 T: by the formulas of the catalogue."""
    model = tmp_path / "finger.toml"
    effects = """
[effects.velocity_dependent_friction]
exponent = { value = 0.1, source = "made up" }
[effects.contact_ageing]
share = { value = 0.5, source = "made up" }
time_constant_s = { value = 30.0, source = "made up" }
"""
    model.write_text(
        (MODELS / "reference.toml").read_text(encoding="utf-8") + effects, encoding="utf-8"
    )
    status, said, rows = predict(
        f"{BASE},speed_m_s,time_s\n,0,0.5,0.2,3000\n,0,0.5,0.02,3000\n,0,0.5,,3000\n,0,0.5,,\n",
        "--model",
        str(model),
    )
    assert status == 0, said
    fast, at_reference, unsaid, young = numbers(rows, "cof")
    assert fast == pytest.approx(at_reference * 10.0**0.1, rel=1e-6)
    assert unsaid == at_reference
    assert young == pytest.approx(0.5 * at_reference, rel=1e-6)


def test_what_the_printed_equations_cannot_answer_is_said(haptic, tmp_path):
    table = tmp_path / "conditions.csv"
    table.write_text(f"{BASE}\n250,75,0.5\n250,600,0.5\n")
    done = haptic(
        "predict", "--table", table, "--out", tmp_path / "out.csv", "--model", "published", "--json"
    )
    assert "note: 1 of 2 conditions: (31) as printed diverges" in done.err
    assert "(31) as printed diverges" in json.loads(done.out)["notes"][0]


def test_a_table_is_replaced_whole_or_not_at_all(haptic, tmp_path, monkeypatch):
    table = tmp_path / "conditions.csv"
    table.write_text(f"{BASE}\n250,75,0.5\n")
    before = table.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.replace", full)
        assert haptic("predict", "--table", table, "--out", table).status == 1
    assert table.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [table.name]


def test_without_voltage_the_frequency_may_be_left_empty(predict):
    status, _, rows = predict(f"{BASE}\n,0,0.5\nany,0.0,1.0\n250,75,0.5\n")
    assert status == 0
    assert numbers(rows, "cof") == pytest.approx([0.512, 0.512, 0.615205], rel=AGREED)
    assert numbers(rows, "electrostatic_force_n")[:2] == [0.0, 0.0]
    assert numbers(rows, "current_rms_a")[:2] == [0.0, 0.0]


def test_waveforms_and_offsets(predict):
    """At 250 Hz force goes with the mean square: a square wave of V/sqrt(2) is the sine of V, and a
    bias adds to it.
    """
    rows = predict(
        f"{BASE},waveform,voltage_offset_v\n"
        "250,75,0.5,sine,0\n"
        "250,75,0.5,,\n"
        f"250,{75 / 2**0.5},0.5,SQUARE,0\n"
        "250,75,0.5,square,0\n"
        ",75,0.5,dc,\n"
        "250,75,0.5,sine,60\n"
        "250,75,0.5,sine,-60\n"
        "250,0,0.5,sine,60\n"
    )[2]
    sine, unsaid, half, square, steady, biased, biased_back, bias_alone = numbers(
        rows, "electrostatic_force_n"
    )
    assert sine == pytest.approx(0.100787, rel=AGREED)
    assert unsaid == sine
    assert half == pytest.approx(sine, rel=1e-6)  # nine digits are written of the voltage
    assert (
        square > 1.9 * sine
    )  # twice the mean square, and more where attraction brings the surfaces together
    assert 0.0 < steady < square
    assert biased == biased_back
    assert 0.0 < bias_alone < biased - sine + bias_alone
    assert biased > sine + 0.9 * bias_alone


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
    ],
)
def test_what_is_wrong_with_a_table_is_said_and_nothing_is_written(
    predict, tmp_path, text, code, words
):
    status, said, rows = predict(text)
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
    model.write_text(
        (MODELS / "reference.toml").read_text(encoding="utf-8") + effect, encoding="utf-8"
    )
    table = f"{BASE}\n1000,1,0.5\n"
    _, _, plain = predict(table)
    assert plain[0] == [*BASE.split(","), *ADDED]
    _, _, rows = predict(table, "--model", str(model))
    assert rows[0] == [
        *BASE.split(","),
        *ADDED,
        "electrode_voltage_v",
        "electrode_voltage_phase_rad",
    ]
    assert numbers(rows, "electrode_voltage_v") == pytest.approx([0.5**0.5], rel=1e-6)
    assert numbers(rows, "electrode_voltage_phase_rad") == pytest.approx([-0.785398], abs=1e-4)
    late = numbers(plain, "current_phase_rad")[0] - numbers(rows, "current_phase_rad")[0]
    assert late == pytest.approx(0.785398, abs=1e-4)
    assert numbers(rows, "current_a")[0] == pytest.approx(
        0.5**0.5 * numbers(plain, "current_a")[0], rel=1e-4
    )  # 1 V attracts a little


def test_fingers_that_do_not_slide(predict):
    status, _, rows = predict(
        f"{BASE},finger\n1000,5,0.5,sliding\n1000,5,0.5,resting\n1000,5,0.5,none\n1000,5,0.5,\n"
    )
    assert status == 0
    sliding, resting, none, unsaid = numbers(rows, "current_a")
    assert unsaid == sliding
    assert resting > 2.0 * sliding
    assert none == 0.0
    assert [row[rows[0].index("cof")] == "nan" for row in rows[1:]] == [False, True, True, False]


def test_a_seen_area_stands_for_the_models(predict):
    """Twice the load on twice the area: the same pressure, twice the force and the current."""
    status, _, rows = predict(
        f"{BASE},contact_area_m2\n250,75,0.5,\n250,75,0.5,1e-4\n250,75,1.0,2e-4\n"
    )
    assert status == 0
    for name, factor in (("electrostatic_force_n", 2.0), ("cof", 1.0), ("current_a", 2.0)):
        one, same, twice = numbers(rows, name)
        assert one == same
        assert twice == pytest.approx(factor * one, rel=1e-7)  # nine digits are written


def test_a_published_variant_knows_one_area(predict):
    text = f"{BASE},contact_area_m2\n250,75,0.5,1.2e-4\n"
    status, said, _ = predict(text, "--model", "published")
    assert status == 2
    assert "one area" in said["error"]["message"]
