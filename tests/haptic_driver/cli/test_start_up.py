"""A command imports what it needs and no more: nobody waits for matplotlib to learn whether an
output is on.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import pytest
import typer

from haptic_driver.cli.main import build_app, known, main

pytestmark = pytest.mark.process

# By what they are for; each takes from a tenth of a second to one to import.
NUMBERS = {
    "numpy",
    "numba",
    "scipy.linalg",
    "scipy.special",
    "scipy.interpolate",
    "scipy.stats",
    "h5py",
}
PICTURES = {"matplotlib", "PIL"}
DEVICES = {"pyvisa", "serial", "usb", "hw.transport", "hw.simulated"}
WEB = {"fastapi", "starlette", "uvicorn", "httpx", "websockets", "asyncio"}
EVERYTHING = NUMBERS | PICTURES | DEVICES | WEB
COMPILING = [
    "predict",
    "surface",
    "solve",
    "demo",
    "measure",
    "diagnose",
    "calibrate",
    "sensitivity",
    "explore",
]


def imported(*arguments: str) -> set[str]:
    """What one command that succeeds has imported at its end."""
    code = "import sys; from haptic_driver.cli.main import main; status = main(sys.argv[1:])\n"
    code += "print(*sys.modules, file=sys.stderr); sys.exit(status)"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return set(done.stderr.split())


@pytest.mark.parametrize("after_s", [0.1, 0.4])
def test_ctrl_c_while_importing_ends_it_quietly(after_s):
    """Whatever it imports then; a later Ctrl-C meets the command, which says that it was."""
    code = "from haptic_driver.cli.start import run; run()"
    out = ["--out", "/dev/null/x", "--json"]
    words = [sys.executable, "-c", f"print(flush=True); {code}", "demo", *out]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as it:
        it.stdout.readline()
        time.sleep(after_s)
        it.send_signal(signal.SIGINT)
        answer, said = it.communicate(timeout=60)
    assert "Traceback" not in said
    assert it.returncode == 1
    assert "interrupted" in said
    assert json.loads(answer)["error"]["code"] == "interrupted"


def test_help_shows_no_type_behind_a_flag(capsys):
    for command in ("diagnose", "texture check", "set", "record"):
        assert main([*command.split(), "--help"]) == 0
        shown = capsys.readouterr().out
        assert "--help" in shown
        assert "bool" not in shown


@pytest.mark.parametrize("command", [["--help"], ["--version"]], ids=" ".join)
def test_help_imports_no_command(command):
    found = imported(*command)
    assert not found & EVERYTHING
    modules = {name for name in found if name.startswith("haptic_driver.cli.")}
    assert modules <= {f"haptic_driver.cli.{name}" for name in ("main", "output", "start")}


@pytest.mark.usefixtures("socket")
@pytest.mark.parametrize("command", [["status"], ["off"]], ids=" ".join)
def test_what_asks_the_daemon_imports_no_numbers(command):
    assert not imported(*command) & EVERYTHING


def test_textures_are_listed_without_the_solver():
    assert not imported("texture", "list") & (EVERYTHING - {"numpy", "PIL"})


def test_a_point_is_solved_without_scipy_and_pictures():
    found = imported("solve", "--friction", "0.6")
    assert "numba" in found
    assert not found & (
        EVERYTHING - {"numpy", "numba", "scipy.linalg"}
    )  # numba imports the last with its first kernel


def test_control_imports_no_scipy():
    code = "import sys, haptic_driver.daemon.run; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    assert not {name for name in done.stdout.split() if name.startswith(("scipy.s", "scipy.l"))}


def test_each_line_of_the_help_has_a_command_that_says_more():
    found = known()
    program = typer.main.get_command(build_app(found, found))
    for name, listed in found.items():
        command = program
        for word in name.split():
            command = command.commands[word]
        assert command.help
        assert len(name) + len(listed.line) < 80 or not listed.package


def test_a_command_behind_two_dashes_is_imported_and_run(haptic):
    done = haptic("--", "texture", "list", "--json")
    assert done.status == 0
    assert done.said["textures"]


ASKING = """
import importlib, sys

class Asked(BaseException):
    pass

class Listening:
    def find_spec(self, name, path=None, target=None):
        if name == "numba":
            raise Asked

sys.meta_path.insert(0, Listening())
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except Asked:
        print(name)
"""


def test_numba_is_there_before_a_command_runs_just_where_it_compiles():
    """`compiling` looks for it then; a command that imports it later has to enter `compiling` by
    itself.
    """
    packages = {name: known()[name].package for name in (*COMPILING, "mark")}
    modules = [f"{package}.{name}" for name, package in packages.items()]
    command = [sys.executable, "-c", ASKING, *modules]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert {line.rpartition(".")[2] for line in done.stdout.split()} == set(COMPILING)
