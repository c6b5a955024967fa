"""What newcomers get wrong: the exit status, and a message that says what, where and what to do."""

import shlex
from pathlib import Path

import pytest

BASE = "frequency_hz,voltage_v,normal_force_n"
SLIDE = "time_s,position_m,normal_force_n"
STROKE = [f"{0.01 * i:.2f},{0.0004 * i:.4f},0.5" for i in range(30)]

FILES = {
    "mine.toml": "",
    "ok.csv": f"{BASE}\n250,75,0.5\n",
    "semicolons.csv": f"{BASE.replace(',', ';')}\n250;75;0,5\n",
    "decimal_commas.csv": f"{BASE}\n250,75,0,5\n",
    "slide_short.csv": "\n".join([SLIDE, *STROKE[:5], "0.05,0.002", *STROKE[6:]]),
    "slide_lifted.csv": "\n".join([SLIDE, *(row.replace(",0.5", ",-0.5") for row in STROKE)]),
}

# command line, code, words of the message, words of the hint
WRONG = [
    # words
    ("help", "usage", "No such command 'help'", "haptic --help"),
    ("set", "usage", "MU", "haptic set --help"),
    ("set '0.6; rm x'", "usage", "not '0.6; rm x'", "haptic set --help"),
    ("experiment run first_lok --participant P1", "unknown_experiment", "first_lok", "first_look"),
    ("experiment run first_look --participant 'P 1'", "bad_name", "letters and digits", "P01"),
    ("experiment analyse folder", "no_results", "holds no session", "haptic experiment run"),
    ("mark trial --data [1]", "bad_json", "no JSON object", "Give an object"),
    ("solve --friction 0,6", "usage", "'--friction': Input should be a valid", "haptic solve"),
    ("solve --friction 0.6 --policy fixed_frequency", "bad_frequency", "needs a", "--frequency"),
    ("surface build --voltage-high-v nan", "bad_axes", "nan V is not in 0..5000 V", "example 150"),
    # names and files of configuration
    ("solve --friction 0.6 --rig folder", "unknown_rig", "'folder'", "simulated"),
    ("doctor --rig mine", "unknown_rig", "'mine'", "give mine.toml"),
    ("solve --friction 0.6 --model ok.csv", "unknown_model", "ok.csv", "must end in .toml"),
    ("measure --out d.csv --plan papr", "unknown_plan", "'papr'", "Did you mean 'paper'?"),
    ("study finger", "unknown_population", "'finger'", "Did you mean 'fingers'?"),
    # tables
    ("predict --out out.csv --table none.csv", "file_not_found", "none.csv does not", "the name"),
    ("diagnose", "bad_data", "give data or --plan", ""),
    ("diagnose semicolons.csv", "bad_data", "column cof is missing", "cof"),
    ("calibrate decimal_commas.csv", "bad_data", "line 2: has more fields", "0.5, not 0,5"),
    ("demo --texture steps", "not_a_texture", "timed script", "daemon"),
    # files of the program's own
    ("solve --friction 0.6 --surface folder", "surface_not_found", "is a folder", "surface build"),
    ("export surface.h5 --out x.csv", "recording_foreign", "not a recording", "haptic record"),
    ("measure --plan paper --out folder", "file_exists", "folder: is a folder", "--out"),
    ("measure --plan paper --out ok.csv --resume", "not_resumable", "did not write it", "--out"),
    ("measure --plan paper --out d.csv --resume --force", "usage", "contradict", "one of them"),
    ("measure --plan paper --out d.csv --hide none.toml", "bad_hide", "none.toml does", "series_r"),
    # a daemon that is not there
    ("daemon run --osc nowhere", "bad_address", "'nowhere'", "127.0.0.1:9000"),
]
FAILED = [
    ("predict --table ok.csv --out folder", "not_written", "it is a folder", "--out"),
    ("status", "no_daemon", "none.sock", "haptic daemon run"),
    ("watch", "no_daemon", "none.sock", "haptic daemon run"),
    ("off --socket folder", "no_daemon", "folder", "haptic daemon run"),
]


@pytest.fixture(autouse=True)
def _desk(tmp_path, monkeypatch, small_file):
    """A folder with the files of somebody who is new here."""
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "folder").mkdir()
    small_file.write(tmp_path / "surface.h5")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HAPTIC_SOCKET", str(tmp_path / "none.sock"))


@pytest.mark.parametrize(
    ("command", "code", "said", "hint"), WRONG + FAILED, ids=lambda x: x[:60] if " " in x else ""
)
def test_a_wrong_thing_is_said(haptic, command, code, said, hint):
    more = ("--surface", "surface.h5") if command.startswith("demo") else ()
    done = haptic(*shlex.split(command), *more, "--json")
    assert done.status == (1 if (command, code, said, hint) in FAILED else 2), done.err
    assert set(done.said) == {"error"}
    error = done.said["error"]
    assert set(error) == {"code", "message", "hint"}
    assert error["code"] == code
    assert said in error["message"]
    assert hint in error["hint"]
    assert f"error: {error['message']}" in done.err
    assert "Traceback" not in done.err


def test_a_byte_order_mark_in_a_configuration_is_no_mistake(haptic):
    shipped = Path(__file__).parents[3] / "configs" / "rigs" / "simulated.toml"
    Path("mine.toml").write_bytes(b"\xef\xbb\xbf" + shipped.read_bytes())
    command = "solve --friction 0.6 --rig mine.toml --surface surface.h5"
    assert haptic(*command.split()).status == 0


def test_what_the_system_refuses_is_a_message_and_not_a_traceback(haptic, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device", "out.csv")

    monkeypatch.setattr("haptic_driver.cli.solve.build_surface", full)
    done = haptic("solve", "--friction", "0.6", "--json")
    assert done.status == 1
    assert done.said["error"]["message"] == "out.csv: No space left on device"
