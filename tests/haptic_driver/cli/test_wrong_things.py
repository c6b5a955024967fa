"""What newcomers get wrong: the exit status, and a message that says what, where and what to do."""

from pathlib import Path

import pytest

BASE = "frequency_hz,voltage_v,normal_force_n"
SLIDE = "time_s,position_m,normal_force_n"
STROKE = [f"{0.01 * i:.2f},{0.0004 * i:.4f},0.5" for i in range(30)]
SOLVE = ["solve", "--friction", "0.6"]
PREDICT = ["predict", "--out", "out.csv", "--table"]
DEMO = ["demo", "--surface", "surface.h5"]
MEASURE = ["measure", "--plan", "paper", "--out"]

FILES = {
    "ok.csv": f"{BASE}\n250,75,0.5\n",
    "semicolons.csv": f"{BASE.replace(',', ';')}\n250;75;0,5\n",
    "decimal_commas.csv": f"{BASE}\n250,75,0,5\n",
    "slide_short.csv": "\n".join([SLIDE, *STROKE[:5], "0.05,0.002", *STROKE[6:]]),
    "slide_lifted.csv": "\n".join([SLIDE, *(row.replace(",0.5", ",-0.5") for row in STROKE)]),
    "junk.h5": b"\x00junk" * 100,
}

# command line, exit status, code, words of the message, words of the hint
WRONG = [
    # words
    (["help"], 2, "usage", "No such command 'help'", "haptic --help"),
    (["texture", "lst"], 2, "usage", "Did you mean 'list'?", "haptic texture --help"),
    (["daemon", "start"], 2, "usage", "No such command 'start'", "haptic daemon --help"),
    (["set"], 2, "usage", "MU", "haptic set --help"),
    (["set", "--sockt", "x", "0.6"], 2, "usage", "--socket", "haptic set --help"),
    (["set", "much"], 2, "usage", "not 'much'", "haptic set --help"),
    (["set", "0.6; rm x"], 2, "usage", "not '0.6; rm x'", "haptic set --help"),
    (["daemon", "run", "--port", "http"], 2, "usage", "not 'http'", "haptic daemon run --help"),
    (
        ["experiment", "run", "friction_diference", "--participant", "P1"],
        2,
        "unknown_experiment",
        "friction_diference",
        "friction_difference",
    ),
    (
        ["experiment", "run", "friction_difference", "--participant", "P 1"],
        2,
        "bad_name",
        "letters and digits",
        "P01",
    ),
    (
        ["experiment", "analyse", "folder"],
        2,
        "no_results",
        "holds no session",
        "haptic experiment run",
    ),
    (["mark", "trial", "--data", "[1]"], 2, "bad_json", "no JSON object", "Give an object"),
    (["mark", "trial", "--data", "{level}"], 2, "bad_json", "is not JSON", "Give an object"),
    (["record", "run.h5", "--stop"], 2, "usage", "either a file or --stop", "haptic record --help"),
    # numbers
    (
        ["solve", "--friction", "0,6"],
        2,
        "usage",
        "'--friction': Input should be a valid number",
        "haptic solve",
    ),
    (["solve", "--friction", "0,6"], 2, "usage", "not '0,6'", "haptic solve"),
    (
        [*SOLVE, "--policy", "fixed_frequency"],
        2,
        "bad_frequency",
        "needs a frequency",
        "--frequency",
    ),
    (
        ["surface", "build", "--voltage-high-v", "nan"],
        2,
        "bad_axes",
        "nan V is not in 0..5000 V",
        "For example 150",
    ),
    (
        ["measure", "--plan", "paper", "--out", "d.csv", "--seed", "-1"],
        2,
        "usage",
        "not '-1'",
        "haptic measure",
    ),
    # names and files of configuration
    ([*SOLVE, "--rig", "folder"], 2, "unknown_rig", "'folder'", "simulated"),
    ([*SOLVE, "--rig", "x" * 300], 2, "unknown_rig", "xxx", "Known: "),
    ([*SOLVE, "--model", "ok.csv"], 2, "unknown_model", "ok.csv", "must end in .toml"),
    (
        ["measure", "--out", "d.csv", "--plan", "papr"],
        2,
        "unknown_plan",
        "'papr'",
        "Did you mean 'paper'?",
    ),
    (["study", "finger"], 2, "unknown_population", "'finger'", "Did you mean 'fingers'?"),
    # tables
    ([*PREDICT, "none.csv"], 2, "file_not_found", "none.csv does not exist", "check the name"),
    (["diagnose", "none.csv"], 2, "bad_data", "none.csv does not exist", "check the name"),
    (["diagnose", "semicolons.csv"], 2, "bad_data", "column cof is missing", "cof"),
    (["calibrate", "decimal_commas.csv"], 2, "bad_data", "line 2: has more fields", "0.5, not 0,5"),
    (["calibrate", "ok.csv"], 2, "bad_data", "column cof is missing; found: frequency_hz", "cof"),
    (
        [*DEMO, "--trace", "slide_short.csv"],
        2,
        "not_a_number",
        "line 7: normal_force_n is ''",
        "0.5",
    ),
    (
        [*DEMO, "--trace", "slide_lifted.csv"],
        2,
        "bad_slide",
        "the finger never touches",
        "positive",
    ),
    # textures
    ([*DEMO, "--texture", "steps"], 2, "not_a_texture", "timed script", "daemon"),
    # files of the program's own
    (
        [*SOLVE, "--surface", "folder"],
        2,
        "surface_not_found",
        "is a folder",
        "haptic surface build",
    ),
    (
        ["export", "junk.h5", "--out", "x.csv"],
        2,
        "recording_unreadable",
        "not a readable HDF5 file",
        "haptic record",
    ),
    (
        ["export", "surface.h5", "--out", "x.csv"],
        2,
        "recording_foreign",
        "not a recording",
        "haptic record",
    ),
    (["export", "folder", "--out", "x.csv"], 2, "recording_not_found", "is a folder", "path"),
    (["calibrate", "surface.h5"], 2, "recording_foreign", "not a recording", "haptic record"),
    # what is to be written
    ([*MEASURE, "folder"], 2, "file_exists", "folder: is a folder", "--out"),
    (
        [*MEASURE, "ok.csv", "--resume"],
        2,
        "not_resumable",
        "haptic measure did not write it",
        "--out",
    ),
    ([*MEASURE, "d.csv", "--resume", "--force"], 2, "usage", "contradict", "one of them"),
    (
        [*MEASURE, "d.csv", "--hide", "none.toml"],
        2,
        "bad_hide",
        "none.toml does not exist",
        "series_resistance",
    ),
    (
        ["predict", "--table", "ok.csv", "--out", "folder"],
        1,
        "not_written",
        "it is a folder",
        "--out",
    ),
    # a daemon that is not there
    (["status"], 1, "no_daemon", "none.sock", "haptic daemon run"),
    (["off", "--socket", "folder"], 1, "no_daemon", "folder", "haptic daemon run"),
    (["daemon", "run", "--osc", "nowhere"], 2, "bad_address", "'nowhere'", "127.0.0.1:9000"),
    (["simulate", "--rig", "paper"], 2, "not_simulated", "rig paper", "--like"),
]


@pytest.fixture(autouse=True)
def _desk(tmp_path, monkeypatch, small_file):
    """A folder with the files of somebody who is new here."""
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (tmp_path / "folder").mkdir()
    small_file.write(tmp_path / "surface.h5")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HAPTIC_SOCKET", str(tmp_path / "none.sock"))


@pytest.mark.parametrize(
    ("command", "status", "code", "said", "hint"),
    WRONG,
    ids=lambda x: " ".join(x)[:60] if isinstance(x, list) else "",
)
def test_a_wrong_thing_is_said(haptic, command, status, code, said, hint):
    done = haptic(*command, "--json")
    assert done.status == status, done.err
    assert set(done.said) == {"error"}
    error = done.said["error"]
    assert set(error) == {"code", "message", "hint"}
    assert error["code"] == code
    assert said in error["message"]
    assert hint in error["hint"]
    assert f"error: {error['message']}" in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize("table", ["\ufeff{}\r\n250,75,0.5\r\n", " {} \n 250 , 75 , 0.5 \n"])
def test_what_a_spreadsheet_adds_is_no_mistake(haptic, tmp_path, table):
    """A byte order mark, the line ends of Windows, and spaces after commas."""
    header = BASE if table.startswith("\ufeff") else BASE.replace(",", ", ")
    Path("table.csv").write_bytes(table.format(header).encode())
    assert haptic("predict", "--table", "table.csv", "--out", "made/out.csv").status == 0
    assert Path("made/out.csv").read_text().startswith(f"{BASE},electrostatic_force_n")


def test_a_byte_order_mark_in_a_configuration_is_no_mistake(haptic):
    shipped = Path(__file__).parents[3] / "configs" / "rigs" / "simulated.toml"
    Path("mine.toml").write_bytes(b"\xef\xbb\xbf" + shipped.read_bytes())
    assert haptic(*SOLVE, "--rig", "mine.toml", "--surface", "surface.h5").status == 0


def test_what_the_system_refuses_is_a_message_and_not_a_traceback(haptic, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device", "out.csv")

    monkeypatch.setattr("haptic_driver.cli.solve.build_surface", full)
    done = haptic(*SOLVE, "--json")
    assert done.status == 1
    assert done.said["error"]["message"] == "out.csv: No space left on device"
