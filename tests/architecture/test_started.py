"""One file starts processes and threads, and their memory has the writers that it names."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from haptic_driver.processes.started import MEMORY, PROCESSES, THREADS, start_process, start_thread

PACKAGE = Path(__file__).resolve().parents[2] / "haptic_driver"
FILES = sorted(PACKAGE.rglob("*.py"))
STARTED = "processes/started.py"
ASKS_GIT = "cli/main.py"  # which commit this is, and waits for the answer
ONE_PROCESS = "daemon/stepped.py"  # in which a demo is control and render at once
BY_OTHERS = {"control", "watchdog"}  # by a person or systemd, and by `hw`
STARTERS = {
    *("Thread", "Timer", "start_new_thread", "Popen", "Process", "Pool", "ThreadPool"),
    *("ThreadPoolExecutor", "ProcessPoolExecutor", "InterpreterPoolExecutor", "Manager"),
    *("fork", "forkpty", "posix_spawn", "posix_spawnp", "system", "popen", "daemon"),
    *("run_in_executor", "create_subprocess_exec", "create_subprocess_shell"),
}
MODULES = {"threading", "_thread", "subprocess", "multiprocessing", "concurrent", "asyncio", "os"}
OURS = {"start_thread", "KeptOpen", "start_process", "start_workers", "Child", "Watchdog", "Loader"}


@cache
def nodes(source: str) -> list[ast.AST]:
    return list(ast.walk(ast.parse(source)))


def starts(source: str) -> Iterator[str]:
    """What in a file starts a process or a thread without our tables."""
    for node in nodes(source):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in MODULES:
            yield from (one.name for one in node.names if one.name in STARTERS | {"run", "call"})
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            of = node.func.value.id if isinstance(node.func.value, ast.Name) else ""
            if node.func.attr in STARTERS or of == "subprocess":
                yield f"{of}.{node.func.attr}"
        elif isinstance(node, ast.ClassDef):
            bases = (base.attr for base in node.bases if isinstance(base, ast.Attribute))
            yield from (base for base in bases if base in STARTERS)


def writes(source: str) -> Iterator[str]:
    """Records of the shared memory that a file writes."""
    names = {memory.name for memory in MEMORY}
    for node in nodes(source):
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in ("write", "put")
            and isinstance(node.func.value, ast.Attribute)
            and node.func.value.attr in names
        ):
            yield node.func.value.attr


@cache
def sources() -> dict[str, str]:
    return {file.relative_to(PACKAGE).as_posix(): file.read_text() for file in FILES}


def test_one_file_alone_starts_processes_and_threads():
    found = {file: list(starts(source)) for file, source in sources().items()}
    assert {file for file, what in found.items() if what} == {STARTED, ASKS_GIT}
    assert found[ASKS_GIT] == ["subprocess.run"]


def test_one_file_alone_says_how_python_is_started():
    """Elsewhere `-m` and `-c` would import from the folder in which somebody typed a command."""
    root = PACKAGE.parent
    files = (
        file for name in ("haptic_driver", "hw", "model") for file in (root / name).rglob("*.py")
    )
    naming = {file.name for file in files if "sys.executable" in file.read_text()}
    assert naming == {"interpreter.py"}


@pytest.mark.parametrize(
    "source",
    [
        "import threading\nthreading.Thread(target=print).start()",
        "import threading as t\nt.Timer(1.0, print)",
        "from threading import Thread",
        "import threading\nclass Mine(threading.Thread): ...",
        "import subprocess\nsubprocess.Popen(['ls'])",
        "import subprocess\nsubprocess.check_output(['ls'])",
        "from subprocess import run",
        "import multiprocessing\nmultiprocessing.get_context('spawn').Process(target=print)",
        "from multiprocessing.pool import ThreadPool",
        "from concurrent.futures import ThreadPoolExecutor",
        "import os\nos.fork()",
    ],
)
def test_another_way_to_start_one_is_found(source):
    assert list(starts(source))


def test_what_only_looks_like_it_is_not():
    assert not list(starts("import threading\nthreading.Event()\nclass Process: ...\nProcess()"))


def test_each_is_started_by_the_file_that_the_table_names():
    for part in (*PROCESSES, *THREADS):
        if part.name in BY_OTHERS:
            continue
        inside = nodes((PACKAGE / part.owner).read_text())
        said = {node.value for node in inside if isinstance(node, ast.Constant)}
        called = {getattr(node.func, "id", "") for node in inside if isinstance(node, ast.Call)}
        assert part.name in said, part
        assert called & OURS, part


def test_each_name_stands_for_one_part_in_the_file_that_starts_it():
    owners = {part.name: part.owner for part in THREADS}
    assert len(owners) == len(THREADS)
    for file, source in sources().items():
        for node in nodes(source):
            is_start = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "start_thread"
            if is_start and isinstance(name := node.args[0], ast.Constant):
                assert owners[name.value] == file


def test_what_the_tables_do_not_know_is_not_started():
    with pytest.raises(ValueError, match="idle"):
        start_thread("idle", print)
    with pytest.raises(ValueError, match="idle"):
        start_process("idle", ["true"])


def test_each_record_of_the_shared_memory_has_the_writer_that_the_table_names():
    found = {
        (name, file)
        for file, source in sources().items()
        if file != ONE_PROCESS
        for name in writes(source)
    }
    assert found == {(memory.name, memory.file) for memory in MEMORY}


def test_another_writer_is_found():
    assert list(writes("def f(self): self._shared.order.write(1)")) == ["order"]
    assert not list(writes("def f(self): self._shared.order.read(); file.write(1)"))
