"""Commands of packages outside: one joins the command line, one that fails is left out."""

import sys

import pytest

from haptic_driver.cli.main import main
from hw import plugins

PANELS = 'PANELS = {"On a rig, simulated or real": {"warm-up": "Slide before a session."%s}}\n'
MODULE = "import typer\n\ndef %s(minutes: float = 1.0):\n    print('%s', minutes)\n"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Puts a package of commands beside those that are installed."""

    def package(name, panels, **modules):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(panels)
        for module, code in modules.items():
            (tmp_path / name / f"{module}.py").write_text(code)
        about = tmp_path / f"{name}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        points = f"[haptic_driver.commands]\n{name} = {name}:PANELS\n"
        (about / "entry_points.txt").write_text(points)

    monkeypatch.syspath_prepend(tmp_path)
    forget = plugins.installed.cache_clear, plugins.load.cache_clear
    for cleared in forget:
        cleared()
    yield package
    for cleared in forget:
        cleared()


def test_a_package_adds_a_command_and_one_of_a_group(install, capsys):
    more = ', "texture warm": "Look at it."'
    install(
        "outside_words",
        PANELS % more,
        warm_up=MODULE % ("warm_up", "slid"),
        texture_warm=MODULE % ("texture_warm", "looked"),
    )
    assert main(["warm-up", "--minutes", "3"]) == 0
    assert main(["texture", "warm"]) == 0
    assert capsys.readouterr().out == "slid 3.0\nlooked 1.0\n"
    assert main(["--help"]) == 0
    assert "Slide before a session." in capsys.readouterr().out


def test_a_package_that_fails_is_left_out_and_no_verb_asks_for_it(install, capsys):
    install("outside_broken", "raise SystemExit(3)\n")
    assert main(["off", "--help"]) == 0
    assert capsys.readouterr().err == ""
    assert main(["texture", "list", "--json"]) == 0
    assert "note: package of commands 'outside_broken'" in capsys.readouterr().err


@pytest.mark.usefixtures("install")
def test_the_driver_answers_without_its_laboratory(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "haptic_driver.lab.commands", None)
    for words in (["--help"], ["solve", "--help"], ["texture", "list", "--json"]):
        assert main(words) == 0
    said = capsys.readouterr()
    assert "note: package of commands 'lab'" in said.err
    assert "diagnose" not in said.out
