"""What all commands share: exit status, messages, JSON and nothing else on stdout, help with an
example.
"""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_driver.cli.main import known
from tests.haptic_driver.commands import one_object

SCRIPT = Path(sys.executable).with_name("haptic")
GROUPS = {
    "surface": "build info plot",
    "texture": "list preview check play",
    "daemon": "run unit",
    "load": "hold tune",
    "experiment": "run simulate analyse check",
    "challenge": "make answer score",
    "exercise": "make score",
    "scene": "",
}
COMMANDS = [name.split() for name in known() if name not in GROUPS]
COMMANDS += [[group, name] for group, names in GROUPS.items() for name in names.split()]


@pytest.fixture(autouse=True)
def _in_an_empty_folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("arguments", "words"), [("slove --friction 0.6", "slove")])
def test_bad_input_is_status_2_and_a_message_with_a_hint_on_stderr(haptic, arguments, words):
    """What it says with `--json`: test_wrong_things.py."""
    done = haptic(*arguments.split())
    assert (done.status, done.out) == (2, "")
    first, second, *_ = done.err.splitlines()
    assert first.startswith("error: ")
    assert words in first
    assert second.startswith("hint: ")
    assert "Traceback" not in done.err


def test_a_failure_is_status_1(refuses, surface_path, tmp_path):
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "s.png"
    refuses("not_written", "surface", "plot", surface_path, "--out", out, status=1)


@pytest.mark.parametrize("command", [*COMMANDS, []], ids=" ".join)
def test_help_shows_an_example_line_and_every_command_knows_json(haptic, command):
    done = haptic(*command, "--help")
    assert (done.status, done.err) == (0, "")
    assert "Usage: haptic" in done.out
    if command:
        text = " ".join(done.out.split())
        assert re.search(rf"Example: haptic {' '.join(command)} \S", text)
        assert "--json" in text


@pytest.mark.parametrize("group", [[], ["surface"]], ids=["haptic", "surface"])
def test_without_a_command_help_is_shown_and_no_empty_error(haptic, group):
    done = haptic(*group)
    assert done.status == 2
    assert "Usage: haptic" in done.out + done.err
    assert "error: \n" not in done.err


@pytest.mark.process
def test_version(haptic):
    done = haptic("--version")
    assert done.status == 0
    assert re.fullmatch(r"haptic-driver \d+\.\d+\.\d+\S*( \([0-9a-f]{12,}(-dirty)?\))?\n", done.out)


# --- the installed script
# --------------------------------------------------------------------------------------


def script(*arguments):
    return subprocess.run(
        [SCRIPT, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.process
def test_the_scripts_exit_status_and_streams_for_bad_input(surface_path):
    done = script("solve", "--friction", "9", "--surface", surface_path, "--json")
    assert done.returncode == 2
    assert one_object(done.stdout)["error"]["code"] == "unreachable"
    assert done.stderr.startswith("error: friction 9 cannot be reached")


@pytest.mark.process
def test_a_pipe_sees_no_progress_bar_and_no_colours(surface_path, tmp_path):
    slide = tmp_path / "slide.csv"
    lines = [f"{0.01 * i},{4e-4 * i},0.5" for i in range(40)]
    slide.write_text("\n".join(["time_s,position_m,normal_force_n", *lines]))
    done = script("demo", "--trace", slide, "--surface", surface_path, "--out", tmp_path / "out")
    assert done.returncode == 0
    assert done.stderr == ""
    assert "simulated" in done.stdout
    assert not re.search(r"[\x1b\r]", done.stdout)


def test_ctrl_c_in_a_command_is_a_failure_with_words_and_json(refuses, monkeypatch):
    """Once the parser made the status 130 of it, without a word."""

    def interrupted(model):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("haptic_driver.lab.commands.sensitivity.load_model", interrupted)
    assert refuses("interrupted", "sensitivity", status=1)["message"].startswith("interrupted")
