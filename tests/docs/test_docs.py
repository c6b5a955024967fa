"""Every command shown in README and docs: run as shown, in a session with a daemon, or at least
parsed.

Blocks marked `sh` run as they stand. Of those marked `text`, what needs a daemon runs against one;
the rest, and commands in running text, must be understood by the program's own parser. Targets of
make and extras of pip must exist.
"""

from __future__ import annotations

import ast
import json
import os
import re
import runpy
import shlex
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import httpx
import matplotlib.pyplot as plt
import pytest
import typer

from haptic_driver.cli.main import build_app, known, main
from haptic_driver.client import HapticClient
from haptic_driver.config import find_config
from haptic_driver.daemon.messages import DaemonState
from tests.docs import own_data
from tests.reports import without_pictures

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
# A quarter of a minute and more of what tests of the commands do on less data: with `make soak`.
LONG = [
    ROOT / "docs" / name
    for name in ("challenge.md", "course.md", "diagnosis.md", "paper-experiment.md")
]
OWN_DATA = ROOT / "docs" / "own-data.md"
PAPER = ROOT / "docs" / "paper-experiment.md"
TEXTURES = ROOT / "docs" / "textures.md"
SCRIPT = Path(sys.executable).with_name("haptic")
HANG_S = 120.0
CODE = ("docs", "examples", "haptic_driver", "hw", "model", "tests", "validation")

SERVED = "haptic daemon run --rig simulated --port 8470"  # what sessions begin with
UNTIL_CTRL_C = ("haptic arm", "haptic watch")
ASKS_DAEMON = re.compile(
    "arm|set|texture play|off|disarm|use|adapt|reset|status|watch|record|mark"
    "|experiment run first_look|experiment analyse|texture import out/|texture check out/"
)
PLACEHOLDERS = {"MU": "0.6", "MODEL": "reference", "T": "linen", "FILE": "run.h5", "DIR": "out"}
PLACEHOLDERS["..."] = ""


def blocks(page: Path, mark: str) -> list[str]:
    """The lines of each fenced block of that mark, without prompts and what is said behind them."""
    return ["\n".join(map(bare, block.splitlines())) for block in as_they_are(page, mark)]


def as_they_are(page: Path, mark: str) -> list[str]:
    text = page.read_text(encoding="utf-8")
    fenced = re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    return [block for marked, block in fenced if marked == mark]


def bare(line: str) -> str:
    """A line without its prompt, what is said behind it, and the variables before it."""
    line = re.split(r"  +", line.removeprefix("$ ").strip())[0]
    return re.sub(r"^(\w+=\S+ )+(?=haptic )", "", line)


def commands(page: Path, mark: str, beside: str = "haptic ") -> list[str]:
    return [
        line
        for block in blocks(page, mark)
        for line in block.splitlines()
        if line.startswith(("haptic ", beside))
    ]


def mentioned(page: Path) -> list[str]:
    """Commands in running text."""
    text = re.sub(
        r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    return re.findall(r"`(haptic [^`\n]+)`", text)


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


# --- blocks that run as they stand
# -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One reader's folder, with what the pages ask to write, or what a session has from another
    command.
    """
    folder = tmp_path_factory.mktemp("reader")
    shutil.copy(
        find_config("reference", "models"), folder / "finger.toml"
    )  # as `haptic calibrate` writes one
    (folder / "conditions.csv").write_text(
        "frequency_hz,voltage_v,normal_force_n\n250,75,0.5\n,0,0.5\n"
    )
    own_data.write(folder / "trials")
    (folder / "map.toml").write_text(own_data.map_of(OWN_DATA))
    (folder / "figure3.toml").write_text(blocks(PAPER, "toml")[0])
    (scene,) = (text for text in blocks(TEXTURES, "toml") if text.startswith('kind = "scene"'))
    (folder / "keys.toml").write_text(scene)
    rows = [f"{0.01 * i:.2f},{0.0004 * i:.5f},{0.5 if i > 10 else 0.0}" for i in range(200)]
    (folder / "slide.csv").write_text("time_s,position_m,normal_force_n\n" + "\n".join(rows) + "\n")
    return folder


@pytest.fixture
def reader(folder, monkeypatch):
    """The reader, in that folder."""
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture(scope="module")
def done():
    """Commands that the reader has given: those that several pages show are given once."""
    return set()


@pytest.mark.process
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(p, marks=pytest.mark.soak if p in LONG else ())
        for p in PAGES
        if p != OWN_DATA and commands(p, "sh")
    ],
    ids=name_of,
)
def test_commands_run_as_shown(page, reader, done, capsys):
    runs_as_shown(page, done, capsys)


def runs_as_shown(page: Path, done: set[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run what nobody has run yet; all that was printed."""
    printed = ""
    for command in commands(page, "sh"):
        if command not in done:
            status = main(shlex.split(command)[1:])
            out, err = capsys.readouterr()
            assert status == 0, f"{command}\n{err}"
            printed += out + err
            done.add(command)
    return printed


def test_the_page_on_own_data_tells_and_shows_what_comes_out(reader, capsys):
    """A broken file is told as on the page."""
    with without_pictures():
        printed = runs_as_shown(OWN_DATA, set(), capsys)
    shown = next(block for block in blocks(OWN_DATA, "text") if block.startswith("data.csv"))
    assert all(line in printed for line in shown.strip().splitlines())
    page = OWN_DATA.read_text(encoding="utf-8")
    trial = (reader / "trials" / "day1_60V_10Hz_0p3N_t01.csv").read_text(encoding="cp1252")
    shown = next(block for block in blocks(OWN_DATA, "text") if block.startswith("Messung"))
    assert trial.startswith(shown)
    said = json.loads((reader / "own-diagnosis" / "report.json").read_text(encoding="utf-8"))
    assert said["verdict"] == "effect_found"
    (effect,) = said["effects"]
    assert effect["name"] == "humid_gap_conduction"
    found = effect["parameters"]["gap_conductivity_s_per_m"]
    assert f"{found['value']:.1e}".replace("e-0", "e-") in page
    assert abs(found["value"] - own_data.HUMID_S_PER_M) < 3.0 * found["std"]


@pytest.mark.soak
def test_with_the_baseline_as_a_row_the_name_on_own_data_is_the_same(reader):
    make = next(c for c in commands(OWN_DATA, "sh") if "--leave-out-bad" in c)
    as_rows = (reader / "map.toml").read_text().replace('use = "gain"\ncof = 0.512', 'use = "row"')
    (reader / "rows.toml").write_text(as_rows)
    make = make.replace("map.toml", "rows.toml").replace("data.csv", "r.csv")
    assert main(shlex.split(make)[1:]) == 0
    assert main(["diagnose", "r.csv", "--model", "reference", "--out", "rows-diagnosis"]) == 0
    said = json.loads((reader / "rows-diagnosis" / "report.json").read_text(encoding="utf-8"))
    assert [effect["name"] for effect in said["effects"]] == ["humid_gap_conduction"]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_no_command_hides_in_a_block_without_a_mark(page):
    assert commands(page, "") == []
    assert not re.search(r"^ {4}haptic [a-z]", page.read_text(encoding="utf-8"), flags=re.MULTILINE)


# --- sessions with a daemon
# ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    """The environment of a reader in whose terminal `SERVED` runs, at its usual place; ended by
    Ctrl-C.

    Its port is any free one.
    """
    home = tmp_path_factory.mktemp("run")
    home.chmod(0o700)
    environment = {name: value for name, value in os.environ.items() if name != "HAPTIC_SOCKET"}
    environment["XDG_RUNTIME_DIR"] = str(home)
    words = [SCRIPT, *shlex.split(SERVED.replace("8470", "0"))[1:]]
    with (
        (home / "log").open("w") as log,
        subprocess.Popen(
            words, env=environment, stdout=subprocess.PIPE, stderr=log, text=True
        ) as process,
    ):
        assert process.stdout is not None
        assert "is ready at" in process.stdout.readline(), (home / "log").read_text()
        page = process.stdout.readline().partition("page, for you alone: ")[2].strip()
        assert "<title>" in httpx.get(page, timeout=HANG_S, trust_env=False).text
        yield environment | {"PAGE": page, "LOG": str(home / "log")}
        process.send_signal(signal.SIGINT)
        assert process.wait(HANG_S) == 0, (home / "log").read_text()


def test_the_readme_begins_its_session_like_this():
    assert SERVED in commands(ROOT / "README.md", "text")


def sessions() -> list[Path]:
    """Pages that ask a daemon of the usual rig, or of one that they do not name."""
    found = []
    for page in PAGES:
        lines = list(commands(page, "text"))
        rigs = [line.split()[4] for line in lines if line.startswith("haptic daemon run --rig ")]
        if any(map(asks_daemon, lines)) and rigs[:1] in ([], ["simulated"]):
            found.append(page)
    return found


def asks_daemon(line: str) -> bool:
    return ASKS_DAEMON.match(line.removeprefix("haptic ")) is not None


@pytest.mark.realtime
@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=() if p.name == "README.md" else pytest.mark.soak) for p in sessions()],
    ids=name_of,
)
def test_a_session_with_the_daemon_runs_as_shown(page, daemon, reader, done, monkeypatch, capsys):
    """One terminal for each command that runs until Ctrl-C, one for all others; no experiment is
    run twice.
    """
    monkeypatch.delenv("HAPTIC_SOCKET", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", daemon["XDG_RUNTIME_DIR"])
    terminals: dict[str, subprocess.Popen[str]] = {}
    try:
        for line in commands(page, "text", "sleep "):
            words = shlex.split(line)[1:]
            if line.startswith("sleep "):
                time.sleep(float(words[0]))
            elif not asks_daemon(line) or line in done:
                continue
            elif line in UNTIL_CTRL_C:
                terminal = subprocess.Popen(
                    [SCRIPT, *words], env=daemon, stdout=subprocess.PIPE, text=True
                )
                terminals[line] = terminal
                assert terminal.stdout is not None
                assert terminal.stdout.readline(), line
            elif "--detach" in words:
                subprocess.run([SCRIPT, *words], env=daemon, timeout=HANG_S, check=True)
            else:
                assert main(words) == 0, f"{line}\n{capsys.readouterr().err}"
                if words[0] == "experiment":
                    done.add(line)
    finally:
        main(["disarm"])  # `haptic arm` ends with it
        main(["reset"])  # whatever a busy machine did to this session, the next begins idle
        for line, terminal in terminals.items():
            if line != "haptic arm":
                terminal.send_signal(signal.SIGINT)
            terminal.communicate(timeout=HANG_S)
    assert {line for line, terminal in terminals.items() if terminal.returncode} == set()


def printed(words: list[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        words, env=environment, capture_output=True, text=True, timeout=HANG_S, check=False
    )


@pytest.mark.realtime
def test_requests_by_curl_run_as_shown(daemon):
    """The block of `docs/daemon.md`, by a shell, with the token that `/arm` gave for TOKEN."""
    if shutil.which("curl") is None:
        pytest.skip("no curl")
    (block,) = [block for block in blocks(ROOT / "docs" / "daemon.md", "text") if "curl " in block]
    place, *lines = block.splitlines()
    assert len(lines) >= 5
    token = "TOKEN"
    for line in lines:
        script = f"{place}\n{line.replace('TOKEN', token)} --silent --show-error --fail-with-body"
        done = printed(["sh", "-c", script], daemon)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        if found := re.search(r'"token":\s*"([^"]+)"', done.stdout):
            token = found[1]
    assert token != "TOKEN"


# --- notebooks, other languages and programs
# -------------------------------------------------------------------


NOTEBOOKS = [
    pytest.param(path, marks=pytest.mark.soak if path.stem == "diagnosis" else ())  # as LONG above
    for path in sorted((ROOT / "examples").glob("*.ipynb"))
]
RECIPES = ROOT / "docs" / "recipes.md"


@pytest.fixture
def lab(daemon, monkeypatch, tmp_path):
    """Somebody at a desk beside that daemon; nobody is armed before or after."""
    monkeypatch.delenv("HAPTIC_SOCKET", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", daemon["XDG_RUNTIME_DIR"])
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.chdir(tmp_path)
    yield daemon
    plt.close("all")
    with HapticClient() as client:
        assert client.status().state is DaemonState.IDLE


@pytest.mark.process
@pytest.mark.usefixtures("lab")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_to_its_end_and_is_kept_without_its_outputs(path):
    said: dict[str, Any] = {}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
            exec(compile("".join(cell["source"]), cell["id"], "exec"), said)
    expected = {
        "first_touch": lambda: said["rig"].status().output_on is False and len(said["ticks"]) > 500,
        "own_texture": lambda: said["made"].name == "waves.toml",
        "experiment": lambda: said["low"] < 0.12 < said["high"],
        "diagnosis": lambda: (
            "humid_gap_conduction"
            in [c["name"] for c in said["diagnosis"].report["alternatives"][:3]]
        ),
    }
    assert expected[path.stem]()


@pytest.mark.process
@pytest.mark.usefixtures("lab")
def test_ten_lines_of_python_render_linen(capsys):
    script = ROOT / "examples" / "0_first_touch.py"
    runpy.run_path(str(script))
    assert re.fullmatch(r"friction 0\.\d{3}\n", capsys.readouterr().out)
    assert Path("linen.png").stat().st_size > 10_000
    body = script.read_text(encoding="utf-8").split('"""')[2]
    assert len([line for line in body.splitlines() if line]) <= 10


@pytest.mark.process
@pytest.mark.usefixtures("lab")
def test_the_recipe_for_psychopy(monkeypatch):
    """Against a made PsychoPy: a window that shows nothing and a participant who says yes."""
    psychopy = MagicMock()
    psychopy.core.wait = time.sleep
    psychopy.event.waitKeys.return_value = ["y"]
    monkeypatch.setitem(sys.modules, "psychopy", psychopy)
    (code,) = [block for block in as_they_are(RECIPES, "python") if "psychopy" in block]
    exec(code, {})
    with HapticClient() as client:
        marked = [event for event in client.events() if event.kind == "marker"][-4:]
    assert [event.message for event in marked] == ["shown", "answer"] * 2
    assert marked[-1].data == {"trial": 1, "answer": "y"}


@pytest.mark.realtime
def test_the_recipe_for_javascript(lab):
    if (node := shutil.which("node")) is None:
        pytest.skip("no node")
    (code,) = as_they_are(RECIPES, "js")
    assert "127.0.0.1:8470" in code
    page = page_of(lab)
    code = code.replace("127.0.0.1:8470", page.netloc.decode())
    options = ["--experimental-websocket", "--no-warnings", "--input-type=module"]
    environment = lab | {"HAPTIC_TOKEN": page.params["token"]}
    done = printed([node, *options, "--eval", code], environment)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"(\w+ 0\.6 \S+\n){10}", done.stdout), Path(lab["LOG"]).read_text()


@pytest.mark.realtime
@pytest.mark.parametrize("mark", ["matlab", "csharp"])
def test_what_other_languages_send_is_what_the_daemon_takes(lab, mark):
    """Neither runs here; their requests do, in the order in which they stand."""
    (code,) = as_they_are(RECIPES, mark)
    asked = matlab_requests(code) if mark == "matlab" else csharp_requests(code)
    page = page_of(lab)
    headers = {"Authorization": f"Bearer {page.params['token']}"}
    assert [path for path, _ in asked][:2] == ["/arm", "/renew"]
    with httpx.Client(
        base_url=page.copy_with(path="/", query=None), trust_env=False, timeout=HANG_S
    ) as http:
        for path, body in [*asked, ("/disarm", {})]:
            answer = http.post(path, json=body, headers=headers)
            assert answer.status_code == 200, (path, answer.text, Path(lab["LOG"]).read_text())
            if path == "/arm":
                headers["X-Haptic-Lease"] = answer.json()["token"]


def matlab_requests(code: str) -> list[tuple[str, dict[str, Any]]]:
    """Path and body of every `webwrite`; bodies are `struct('name', value, ...)`. Clean-up at the
    end left out.
    """
    found = []
    for path, fields in re.findall(
        r"webwrite\(\[base '(/\w+)'\], struct\((.*?)\), options\)", code
    ):
        values = ast.literal_eval(f"[{fields}]")
        found.append((path, dict(zip(values[::2], values[1::2], strict=True))))
    return [one for one in found if one[0] != "/disarm"]


def csharp_requests(code: str) -> list[tuple[str, dict[str, Any]]]:
    """Path and body of every `Ask`, a friction and a texture in place of what is joined to them."""
    found = []
    for path, body in re.findall(
        r'Ask\("(/\w+)", (.*?)(?:, answer.*|\)\);|\);)$', code, flags=re.MULTILINE
    ):
        text = re.sub(r'" \+ cof.*? \+ "', "0.6", body)
        text = re.sub(r'" \+ name \+ "', "linen", text)
        found.append((path, json.loads(ast.literal_eval(text))))
    return found


def page_of(lab: dict[str, str]) -> httpx.URL:
    return httpx.URL(lab["PAGE"])


# --- everything else is understood
# -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def program():
    found = known()
    return typer.main.get_command(build_app(found, found))


def understood(program: Any, line: str) -> bool:
    """Parse a command line to its end without running it; raises what the parser says. False for no
    command.
    """
    words = [PLACEHOLDERS.get(word, word) for word in shlex.split(line)[1:]]
    if words[0].startswith("-"):
        return any(
            words == [flag] for option in program.params for flag in option.opts
        ) or words == ["--help"]
    context, command = program.make_context("haptic", list(words)), program
    while hasattr(command, "resolve_command"):
        rest = [*context._protected_args, *context.args]
        if not rest:
            return False  # a group alone
        name, command, rest = command.resolve_command(context, rest)
        context = command.make_context(name, rest, parent=context)
    return True


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_that_are_only_shown_are_understood(page, program):
    for line in [*commands(page, "text"), *(commands(page, "sh") if page in LONG else [])]:
        assert understood(program, line), line


def test_the_container_file_copies_what_is_there_and_runs_a_command_that_is_understood(program):
    text = (ROOT / "deploy" / "Containerfile").read_text(encoding="utf-8")
    copied = [
        word
        for line in re.findall(r"^COPY (.*) \S+$", text, flags=re.MULTILINE)
        for word in line.split()
    ]
    assert {"setup.py", "configs", "haptic_driver"} <= set(copied)
    assert [name for name in copied if not (ROOT / name).exists()] == []
    (command,) = re.findall(r"exec (haptic [^\"]+)", text)
    assert command == SERVED
    assert understood(program, command)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_in_running_text_are_understood(page, program):
    """One that is only named must be there; one with options or arguments must be right to the
    end.
    """
    for line in mentioned(page):
        words = line.split()[1:]
        group = hasattr(program.commands.get(words[0]), "commands")
        only_named = len(words) <= (2 if group else 1) and not words[0].startswith("-")
        assert is_there(program, words) if only_named else understood(program, line), line


def is_there(program: Any, words: list[str]) -> bool:
    commands = program.commands
    for word in words:
        if word not in commands:
            return False
        commands = getattr(commands[word], "commands", {})
    return True


def test_an_option_that_is_not_there_would_be_found(program):
    for line in (
        "haptic solve --frction 0.6",
        "haptic daemon start",
        "haptic set much",
        "haptic nothing",
    ):
        with pytest.raises(Exception, match=r"No such|valid number"):
            understood(program, line)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_targets_of_make_and_extras_of_pip_exist(page):
    text = page.read_text(encoding="utf-8")
    targets = re.findall(
        r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    for target in re.findall(r"(?:`|^)make ([a-z-]+)", text, flags=re.MULTILINE):
        assert target in targets, target
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    for extra in re.findall(r"haptic-driver\[(\w+)\]", text):
        assert extra in extras, extra


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_and_pictures_exist(page):
    for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name} points to {target}"


@cache
def code() -> list[str]:
    return [f"/{path.relative_to(ROOT)}" for room in CODE for path in (ROOT / room).rglob("*.py")]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_of_code_that_a_page_names_are_there(page):
    for name in re.findall(r"`([\w/]+\.py)`", page.read_text(encoding="utf-8")):
        assert any(path.endswith(f"/{name}") for path in code()), name
