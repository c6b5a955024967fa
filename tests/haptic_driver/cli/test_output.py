"""What every command prints with: text as it is, JSON at once, and a bar that keeps up."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from haptic_driver.cli import output
from haptic_driver.errors import BadInputError
from tests.waiting import HANG_S

pytestmark = pytest.mark.process


def terminal(**how):
    return Console(file=io.StringIO(), force_terminal=True, width=100, **how)


def test_brackets_and_colons_of_a_path_are_printed(haptic, surface_file, tmp_path, monkeypatch):
    """They were once taken for markup and left out: `picture: a.png` of a file a[bold]:x:.png."""
    monkeypatch.chdir(tmp_path)
    surface_file.write(tmp_path / "s.h5")
    done = haptic("surface", "plot", "s.h5", "--out", "a[bold]:x:.png")
    assert done.status == 0
    assert done.out == "picture: a[bold]:x:.png\n"


def test_an_error_is_printed_as_it_is(monkeypatch):
    shown = terminal(markup=False, emoji=False)
    monkeypatch.setattr(output, "stderr", shown)
    output.report_error(BadInputError("x", r"no [bold] \[here] :x:", "[points] 1"), as_json=False)
    said = shown.file.getvalue()
    assert r" no [bold] \[here] :x:" in said
    assert " [points] 1" in said


def test_json_is_out_before_the_command_ends(monkeypatch):
    """A reader of a daemon's pipe waits for the line, and the daemon runs on."""
    buffer = io.BytesIO()
    pipe = io.TextIOWrapper(io.BufferedWriter(Unbuffered(buffer)), write_through=False)
    monkeypatch.setattr(sys, "stdout", pipe)
    output.report(True, {"socket": "d.sock"}, lambda: None)
    assert buffer.getvalue() == b'{"socket": "d.sock"}\n'


class Unbuffered(io.RawIOBase):
    def __init__(self, into):
        self.into = into

    def writable(self):
        return True

    def write(self, data):
        return self.into.write(bytes(data))


@pytest.mark.parametrize("steps", [range(1001), [32, 64, 700, 1000]], ids=["by one", "by blocks"])
def test_the_bar_follows_steps_of_any_size(monkeypatch, steps):
    """A step that was no multiple of a two-hundredth of all was once not shown, the last one
    neither.
    """
    shown = terminal()
    monkeypatch.setattr(output, "stderr", shown)
    with output.progress("exporting", 1000) as advance:
        for done in steps:
            advance(done)
    assert "1000/1000" in shown.file.getvalue()


SCRIPT = Path(sys.executable).with_name("haptic")
LIST = f"{SCRIPT} texture list"


def shell(command, **environment):
    return subprocess.run(
        ["sh", "-c", command],
        capture_output=True,
        text=True,
        timeout=HANG_S,
        env=os.environ | environment,
        check=False,
    )


@pytest.mark.parametrize("how", ["", "--json"])
def test_output_that_cannot_be_written_is_said_without_a_traceback(how):
    full = shell(f"{LIST} {how} > /dev/full")
    assert (full.returncode, full.stdout) == (1, "")
    assert full.stderr == "note: what was to be printed is lost: No space left on device\n"
    closed = shell(f"{LIST} {how} >&-")
    assert (closed.returncode, closed.stderr) == (0, "")  # nobody wanted it
    left = shell(f"({LIST} {how}; echo $? >&2) | true")
    assert left.stderr in ("0\n", "1\n")  # the reader may have left before or after
    error = shell(f"{SCRIPT} texture preview nosuch {how} > /dev/full 2> /dev/full")
    assert error.returncode == 2


def test_a_letter_that_the_terminal_lacks_is_escaped(tmp_path):
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "woven.toml").write_text(
        'kind = "uniform"\ncof = 0.6\ndescription = "gewebt, 2 µm"\n', encoding="utf-8"
    )
    done = shell(LIST, PYTHONIOENCODING="ascii", HAPTIC_CONFIGS=str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    assert r"2 \xb5m" in done.stdout


@pytest.mark.parametrize(
    ("word", "where"), [("disarm", ">&-"), ("off", "> /dev/full 2> /dev/full")]
)
def test_what_was_done_is_done_whoever_reads_about_it(control, socket, word, where):
    done = shell(f"{SCRIPT} {word} --json {where}")
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    status = shell(f"{SCRIPT} status --json > /dev/full")
    assert status.returncode == 1  # what it would have said is all that it does


@pytest.mark.parametrize(("line_s", "said"), [(0.0, "rows: 2 of 5\nwaiting: 3 of 5\n"), (10.0, "")])
def test_a_pipe_is_told_now_and_then_how_far_it_is(monkeypatch, line_s, said):
    """A measurement of 95 s into a file was silent."""
    pipe = Console(file=io.StringIO(), force_terminal=False, width=100)
    monkeypatch.setattr(output, "stderr", pipe)
    monkeypatch.setattr(output, "LINE_S", line_s)
    with output.progress("rows", 5) as advance:
        advance(2)
        advance.tell("waiting")
        advance(3)
    assert pipe.file.getvalue() == said


def test_a_pipe_is_told_the_steps_of_a_long_command(monkeypatch):
    pipe = Console(file=io.StringIO(), force_terminal=False, width=100)
    monkeypatch.setattr(output, "stderr", pipe)
    monkeypatch.setattr(output, "LINE_S", 0.0)
    with output.status("diagnosing") as tell:
        tell("effect 3 of 22")
    assert pipe.file.getvalue() == "diagnosing: effect 3 of 22\n"


def test_a_reader_that_leaves_ends_no_measurement(monkeypatch):
    """`haptic measure 2>&1 | head -1` ended it at the second line."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as gone:
        monkeypatch.setattr(sys, "stderr", gone)
        monkeypatch.setattr(output, "stderr", Console(file=gone, force_terminal=False))
        monkeypatch.setattr(output, "LINE_S", 0.0)
        with output.progress("rows", 5) as advance:
            advance(2)
            advance(3)
