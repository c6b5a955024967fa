"""Names and words from outside never reach a terminal, a log or a page as they are."""

import io
import logging

import pytest
from rich.table import Table

from haptic_driver.cli.output import PlainConsole
from haptic_driver.config import config_names, find_config
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.quiet_log import Printable
from haptic_driver.errors import HapticError, shown
from haptic_driver.lookup.models import load_model
from haptic_driver.textures.library import texture_names

EVIL = "linen\x1b[2J\n\u202egnp.exe\x07\x9b31m"
HARMLESS = r"linen\x1b[2J\n\u202egnp.exe\x07\x9b31m"


def test_what_does_not_print_is_written_out():
    assert shown(EVIL) == HARMLESS
    assert shown("a\nb\tc", lines=True) == "a\nb\\tc"
    assert shown("Reibung 0,6 µN – Größe 日本") == "Reibung 0,6 µN – Größe 日本"


def test_an_error_says_it_so():
    error = HapticError("x", f"no texture {EVIL}", f"Known: {EVIL}\nAnother line")
    assert error.message == f"no texture {HARMLESS}"
    assert error.hint.splitlines() == [
        r"Known: linen\x1b[2J",
        r"\u202egnp.exe\x07\x9b31m",
        "Another line",
    ]
    assert str(error) == error.message


@pytest.mark.parametrize("colour", [True, False])
def test_a_console_prints_it_so_in_text_and_tables_and_keeps_its_own_colours(colour):
    console = PlainConsole(
        file=io.StringIO(), force_terminal=colour, width=200, highlight=False, markup=False
    )
    table = Table("name")
    table.add_row(EVIL)
    console.print(f"plays {EVIL}")
    console.print(table)
    console.print("bold", style="bold")
    said = console.file.getvalue()
    assert "\x1b[2J" not in said
    assert not set(said) & {"\u202e", "\x07", "\x9b"}
    assert r"plays linen\x1b[2J" in said
    assert ("\x1b[1mbold" in said) is colour


def test_a_line_of_the_log_is_one_line():
    line = Printable("%(message)s").format(
        logging.makeLogRecord({"msg": "plays %s", "args": (EVIL,)})
    )
    assert line == f"plays {HARMLESS}"


def test_an_event_says_it_so_to_the_api_the_page_and_the_log(caplog):
    events = EventLog()
    with caplog.at_level(logging.INFO):
        events.tell("texture", EVIL)
    assert [event.message for event in events.since(0)] == [HARMLESS]
    assert caplog.messages == [f"texture: {HARMLESS}"]


def test_names_that_would_not_show_as_they_are_are_not_offered(tmp_path, monkeypatch):
    monkeypatch.setenv("HAPTIC_CONFIGS", str(tmp_path))
    for kind in ("textures", "models"):
        (tmp_path / kind).mkdir()
        for name in ("mine", "a\x1b[2Jb", "a\u202eb"):
            (tmp_path / kind / f"{name}.toml").write_text("")
    assert texture_names([tmp_path / "textures"]) == ["mine"]
    assert "mine" in config_names("models")
    assert all(name.isprintable() for name in config_names("models"))


def test_a_model_is_called_as_it_shows(tmp_path, model_file_text):
    path = tmp_path / "m.toml"
    path.write_text(model_file_text.replace('name = "reference"', 'name = "m\\u001b[2J\\u202e"', 1))
    assert load_model(str(path)).name == r"m\x1b[2J\u202e"


@pytest.fixture
def model_file_text():
    return find_config("reference", "models").read_text(encoding="utf-8")
