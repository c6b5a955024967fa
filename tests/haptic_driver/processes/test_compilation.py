"""What numba compiles is told as it happens, and only then; what it is spared comes back when it is
wanted.
"""

import io
from contextlib import nullcontext

import numba
import numpy as np
import pytest
from rich.console import Console

from haptic_driver.cli import output
from haptic_driver.processes.compilation import compilation, compilation_said


@pytest.fixture
def kernel():
    """A kernel that nobody has compiled, and another that it calls, with help from numba's own."""

    @numba.njit
    def inner(x):
        return np.median(x)

    @numba.njit
    def outer(x):
        return 2.0 * inner(x)

    return outer


def test_each_kernel_is_told_once_with_how_many_were_done(kernel):
    told = []
    with compilation(lambda name, done: told.append((name, done))):
        assert kernel(np.arange(3.0)) == 2.0
        kernel(np.arange(5.0))
    assert told == [("outer", 0), ("inner", 0), ("outer", 1), (None, 2)]


def test_a_log_has_one_line_for_what_is_waited_for(kernel, capsys):
    with compilation_said("render process"):
        kernel(np.arange(3.0))
        kernel(np.arange(3))  # other types, so another machine code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == 2 * "render process: compiling outer, this once\n"


@pytest.mark.parametrize("within", ["nothing", "a bar", "a status"])
def test_a_terminal_shows_it_alone_and_within_other_progress(kernel, monkeypatch, within):
    shown = Console(file=io.StringIO(), force_terminal=True, width=100)
    monkeypatch.setattr(output, "stderr", shown)
    around = {
        "nothing": nullcontext(),
        "a bar": output.progress("fingers", 5),
        "a status": output.status("diagnosing"),
    }
    with output.compiling(), around[within]:
        kernel(np.arange(3.0))
    assert "compiling, this once: kernel 1, inner" in shown.file.getvalue()
    assert "compiling, this once: kernel 2, outer" in shown.file.getvalue()


def test_a_pipe_sees_nothing_of_it(kernel, capsys):
    with output.compiling():
        kernel(np.arange(3.0))
    assert capsys.readouterr() == ("", "")
