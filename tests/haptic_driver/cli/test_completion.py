"""What the shell is offered after TAB: commands, options, and the names of what lies in the config
folders.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_driver.cli.main import main

pytestmark = pytest.mark.process

SCRIPT = Path(sys.executable).with_name("haptic")
LINES = [
    ("haptic so", {"solve"}),
    ("haptic texture p", {"play", "preview"}),
    ("haptic solve --fr", {"--friction", "--frequency"}),
    ("haptic solve --policy min_", {"min_voltage", "min_current"}),
    ("haptic solve --model ref", {"reference"}),
    ("haptic demo --texture min", {"mine"}),
]


@pytest.fixture(autouse=True)
def _a_texture_of_ones_own(tmp_path, monkeypatch):
    textures = tmp_path / "configs" / "textures"
    textures.mkdir(parents=True)
    (textures / "mine.toml").write_text('kind = "uniform"\ncof = 0.6\n')
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("line", "offered"), LINES)
def test_bash_is_offered(line, offered, monkeypatch, capsys):
    monkeypatch.setenv("_HAPTIC_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 0
    assert set(capsys.readouterr().out.split()) == offered


def test_zsh_is_offered(monkeypatch, capsys):
    monkeypatch.setenv("_HAPTIC_COMPLETE", "complete_zsh")
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", "haptic texture p")
    with pytest.raises(SystemExit):
        main([])
    said = capsys.readouterr().out
    assert '"play"' in said
    assert '"preview"' in said


def run(*words, **environment):
    """What a process of its own prints."""
    given = os.environ | environment
    return subprocess.run(
        words, env=given, capture_output=True, text=True, timeout=120, check=True
    ).stdout


def test_a_tab_does_not_import_every_command():
    """Only the command on the line, so that the shell need not wait for the others."""
    code = (
        "import sys; from haptic_driver.cli.main import main\ntry: main([])\nexcept SystemExit:"
        " pass\nprint('haptic_driver.cli.demo' in sys.modules)"
    )
    asked = {"COMP_WORDS": "haptic texture ", "COMP_CWORD": "2"}
    *offered, imported = run(
        sys.executable, "-c", code, _HAPTIC_COMPLETE="complete_bash", **asked
    ).split()
    assert "preview" in offered
    assert imported == "False"


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_what_is_installed_completes_in_bash(tmp_path):
    """`haptic --install-completion`, as docs/getting-started.md says, then a new shell and TAB."""
    script = f"""
        {SCRIPT} --install-completion bash > /dev/null
        source ~/.bashrc
        COMP_WORDS=(haptic texture play li) COMP_CWORD=3
        _haptic_completion haptic
        echo "${{COMPREPLY[@]}}"
    """
    path = f"{SCRIPT.parent}:{os.environ['PATH']}"
    assert run("bash", "-c", script, HOME=str(tmp_path), PATH=path) == "linen\n"
