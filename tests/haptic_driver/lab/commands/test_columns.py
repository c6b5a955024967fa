"""`--column`, `--map` and lateral forces: tables and trials as labs have them."""

from __future__ import annotations

from pathlib import Path

import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.commands.columns import columns_named
from haptic_driver.lab.measuring.recordings import read_data
from model.diagnosis.data import COLUMNS, read_measurements
from model.support.errors import ModelError
from model.support.tables import read_table
from tests.docs import own_data
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.refusal import refused

PAGE = Path(__file__).resolve().parents[4] / "docs" / "own-data.md"
SI = "frequency_hz,voltage_v,normal_force_n\n100,125,0.25\n10000,50,0.5\n"
LAB = "f (kHz),U,Fz,mu\n0.1,0.125,250,0.9\n10,0.05,500,0.6\n"
CALLED = ["frequency_hz=f (kHz):kHz", "voltage_v=U:kV", "normal_force_n=Fz:mN", "cof=mu:1"]


def options(said: list[str]) -> list[str]:
    return [word for each in said for word in ("--column", each)]


def table(tmp_path, text: str, name: str = "lab.csv") -> Path:
    (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path / name


def named(*said: str):
    return columns_named(said, COLUMNS, "cof=mu")


def test_a_table_in_a_labs_units_predicts_as_in_si(haptic, tmp_path):
    haptic("predict", "--table", table(tmp_path, SI, "si.csv"), "--out", tmp_path / "a.csv")
    lab, out = table(tmp_path, LAB), tmp_path / "b.csv"
    done = haptic("predict", "--table", lab, "--out", out, *options(CALLED))
    assert done.status == 0, done.err
    expected, found = rows_of(tmp_path / "a.csv"), rows_of(out)
    for name in ("electrostatic_force_n", "cof", "current_a"):
        assert [row[name] for row in found] == [row[name] for row in expected]
    assert [row["Fz"] for row in found] == ["250", "500"]  # carried through as it was
    assert [float(row["normal_force_n"]) for row in found] == [0.25, 0.5]
    assert [row["cof_measured"] for row in found] == ["0.9", "0.6"]


def test_lateral_forces_are_friction_over_the_load(haptic, tmp_path):
    head = SI.splitlines()[0] + ",lateral_force_n,lateral_force_std_n\n"
    path = table(tmp_path, f"{head}100,125,0.25,-0.2,0.01\n10000,50,0.5,0.3,0.01\n")
    data = read_measurements(path)
    assert data.columns["cof"].tolist() == [0.8, 0.6]
    assert data.columns["cof_std"].tolist() == [0.04, 0.02]
    haptic("predict", "--table", path, "--out", tmp_path / "out.csv")
    assert [row["cof_measured"] for row in rows_of(tmp_path / "out.csv")] == ["0.8", "0.6"]


def test_a_held_finger_has_no_friction_of_its_lateral_force(tmp_path):
    head = "frequency_hz,voltage_v,normal_force_n,lateral_force_n,finger,current_a\n"
    text = f"{head}100,125,0.25,0.2,sliding,\n100,125,0.25,0.1,resting,1e-4\n"
    data = read_measurements(table(tmp_path, text))
    assert data.of(0).tolist() == [True, False]


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ("100,125,0.25,much", "lateral_force_n is 'much', not a number"),
        ("100,125,0.25,500", "lateral_force_n = 500 is out of range"),
        ("100,125,0.25,0", "cof = 0.0 is out of range"),
    ],
)
def test_what_is_wrong_with_a_force_is_said_once(tmp_path, cells, said):
    path = table(tmp_path, f"frequency_hz,voltage_v,normal_force_n,lateral_force_n\n{cells}\n")
    with pytest.raises(ModelError) as refused:
        read_measurements(path)
    assert refused.value.message.startswith(f"{path}, line 2: {said}")
    assert "," not in refused.value.message.removeprefix(f"{path}, line 2: {said}")


def test_other_tables_count_under_their_own_names(tmp_path):
    lab = table(tmp_path, LAB)
    ours = table(tmp_path, SI.replace("_n\n", "_n,cof\n").replace("5\n", "5,0.7\n"), "more.csv")
    data = read_data([lab, ours], named=named(*CALLED))
    assert data.columns["cof"].tolist() == [0.9, 0.6, 0.7, 0.7]
    assert data.columns["frequency_hz"].tolist() == [100.0, 10000.0, 100.0, 10000.0]


def test_a_column_that_is_not_there_is_missing(tmp_path):
    another = ["frequency_hz=g", *CALLED[1:]]
    for said, theirs in ((another, "g"), ([*CALLED, "humidity_pct=RH"], "RH")):
        with pytest.raises(BadInputError, match=f"column {theirs} is missing"):
            read_data([table(tmp_path, LAB)], named=named(*said))


def test_a_bracket_is_a_unit_that_is_known_or_is_refused(tmp_path):
    """Volts from peak to peak in German were taken as peak."""
    bare = [CALLED[0], *CALLED[2:], "voltage_v=U"]
    text = LAB.replace(",U,", ",U [Vss],")
    data = read_data([table(tmp_path, text)], named=named(*bare))
    assert data.columns["voltage_v"].tolist() == [0.0625, 0.025]
    unknown = [*bare[:3], "voltage_v=U [Vqq]"]
    with pytest.raises(BadInputError, match="is in Vqq, which is no unit"):
        read_data([table(tmp_path, LAB.replace(",U,", ",U [Vqq],"))], named=named(*unknown))


@pytest.mark.parametrize("command", ["diagnose", "calibrate"])
def test_what_a_column_counts_as_is_told_and_is_no_warning(haptic, tmp_path, command):
    rows = [f"{f},{v},0.5,{mu}" for f in (60, 200, 999) for v, mu in ((0, 0.5), (200, 0.6))] * 2
    path = table(tmp_path, "\n".join(["frequency_hz,U [Vpp],normal_force_n,cof", *rows, ""]))
    out = tmp_path / ("out" if command == "diagnose" else "fitted.toml")
    done = haptic(command, path, "--column", "voltage_v=U [Vpp]", "--out", out, "--json")
    said = "column U [Vpp] counts as voltage_v, times 0.5"
    read_as = done.said["data"]["read_as"] if command == "diagnose" else done.said["read_as"]
    assert read_as == [said]
    assert said not in done.said["warnings"]


def test_a_column_may_be_named_without_the_unit_behind_it(tmp_path):
    text = "f (kHz),U [Vpp],U [mV],Fz,mu\n0.1,250,1,250,0.9\n10,100,1,500,0.6\n"
    bare = ["frequency_hz=f", *CALLED[2:]]
    data = read_data([table(tmp_path, text)], named=named(*bare, "voltage_v=U [Vpp]"))
    assert data.columns["frequency_hz"].tolist() == [100.0, 10000.0]
    assert data.columns["voltage_v"].tolist() == [125.0, 50.0]
    with pytest.raises(BadInputError, match="column U is missing"):  # two columns are called so
        read_data([table(tmp_path, text)], named=named(*bare, "voltage_v=U:Vpp"))


@pytest.mark.parametrize(
    ("said", "code", "words"),
    [
        ("cof", "bad_column", "has no sign ="),
        ("coff=mu", "bad_column", "not a column that is read"),
        ("voltage_v=U:kg", "unknown_unit", "kg is no voltage_v"),
        ("session=Day:s", "unknown_unit", "no unit is converted for session"),
    ],
)
def test_what_cannot_be_is_refused(said, code, words):
    with refused(code, words):
        named(said)


@pytest.mark.parametrize(
    ("said", "factor"),
    [
        ("speed_m_s=v:mm/s", 1e-3),
        ("cof=mu:%", 0.01),
        ("voltage_v=U:Vpp", 0.5),
        ("voltage_v=U:mVrms", 1e-3 * 2**0.5),
        ("voltage_v=in:100 V", 100.0),
        ("contact_area_m2=A:mm^2", 1e-6),
        ("current_phase_rad=p:deg", 0.017453292519943295),
    ],
)
def test_units_become_those_of_the_columns_name(said, factor, tmp_path):
    ((ours, one),) = named(said).items()
    read = read_table(table(tmp_path, f"{one.column}\n8\n"), (), "", named={ours: one})
    assert read.number(0, ours) == pytest.approx(8.0 * factor, rel=1e-12)


@pytest.mark.parametrize(
    ("header", "said", "wanted"),
    [
        ("U (Vpp)", "voltage_v=U (Vpp)", 4.0),
        ("U (V)", "voltage_v=U (V):100 V", 800.0),
        ("Fz_V", "normal_force_n=Fz_V:0.5 N", 4.0),
    ],
)
def test_a_named_column_says_its_own_unit(header, said, wanted, tmp_path):
    path = table(tmp_path, f"{header}\n8\n")
    (ours,) = found = named(said)
    assert read_table(path, (), "", named=found).number(0, ours) == pytest.approx(wanted)


@pytest.mark.parametrize("said", ["voltage_v=U (Vpp):V", "voltage_v=U (Vpp):100 V"])
def test_a_unit_that_the_columns_own_name_denies_is_refused(said, tmp_path):
    path = table(tmp_path, "U (Vpp)\n8\n")
    with pytest.raises(ModelError, match="is in Vpp by its name"):
        read_table(path, (), "", named=named(said))


def test_one_quantity_twice_is_refused_where_it_differs(tmp_path):
    path = table(tmp_path, "voltage_v,voltage_kv\n75,0.075\n75,0.1\n")
    with pytest.raises(ModelError, match="line 3: voltage_v and voltage_kv say one quantity twice"):
        read_table(path, ["voltage_v"], "")


def test_no_column_of_a_table_is_lost_beside_one_that_gets_its_name(haptic, tmp_path):
    path = table(tmp_path, SI.replace("_n\n", "_n,N\n").replace("5\n", "5,1\n"))
    done = haptic("predict", "--table", path, "--out", path, "--column", "normal_force_n=N")
    assert done.status == 2
    assert "of its own" in done.err


def test_trials_go_straight_into_a_prediction_and_a_diagnosis(haptic, tmp_path):
    own_data.write(tmp_path / "trials")
    for path in (tmp_path / "trials").glob("day[12]*"):
        path.unlink()  # those of one day are enough
    (tmp_path / "map.toml").write_text(own_data.map_of(PAGE), encoding="utf-8")
    lost = next((tmp_path / "trials").glob("*_t71.csv"))
    trials, mapped = tmp_path / "trials", ["--map", tmp_path / "map.toml"]
    data, out = tmp_path / "data.csv", tmp_path / "out.csv"
    refused = haptic("predict", "--table", trials, "--out", out, *mapped, "--json")
    assert "_t71.csv" in refused.said["error"]["message"]
    found = haptic("diagnose", trials, *mapped, "--out", tmp_path / "d", "--json")
    assert "_t71.csv" in found.said["error"]["message"]
    lost.unlink()
    assert haptic("rows", trials, *mapped, "--out", data).status == 0
    assert haptic("predict", "--table", trials, "--out", out, *mapped).status == 0
    rows, predicted = rows_of(data), rows_of(out)
    assert [row["cof"] for row in rows] == [row["cof_measured"] for row in predicted]
    assert haptic("diagnose", trials, *mapped, "--column", "cof=mu", "--json").status == 2
    finger = tmp_path / "finger.toml"
    assert haptic("calibrate", trials, *mapped, "--out", finger).status == 0
    assert (tmp_path / "finger.rows.csv").read_text() == data.read_text()
    assert haptic("calibrate", trials, *mapped, "--out", finger, "--json").status == 2


def test_rows_that_repeat_and_forces_that_deny_friction_are_told(tmp_path):
    head = "frequency_hz,voltage_v,normal_force_n,cof,lateral_force_n\n"
    alike, other = "100,125,0.5,0.6,0.3\n", "100,125,0.5,0.6,0.6\n"
    assert read_measurements(table(tmp_path, head + alike)).notes == ()
    (repeated,) = read_measurements(table(tmp_path, head + 3 * alike)).notes
    assert repeated.startswith("2 of 3 rows repeat")
    (denied,) = read_measurements(table(tmp_path, head + alike + other)).notes
    assert "line 3: cof is 0.6, lateral force over load 1.2; so in 1 of 2 rows" in denied
