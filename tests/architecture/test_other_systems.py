"""Windows and macOS: everything but the daemon's own processes is imported without what only Linux
has.
"""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.process

WITHOUT = """
import builtins, os, pkgutil, signal, socket, sys
from importlib import import_module

imported = builtins.__import__
OURS = ("model", "hw", "haptic_driver")
LINUX = {"fcntl", "resource", "termios", "tty", "pwd", "evdev"}

def elsewhere(name, globals=None, *rest, **named):
    if name in LINUX and str((globals or {}).get("__name__")).startswith(OURS):
        raise ImportError(name)
    return imported(name, globals, *rest, **named)

for module, names in {
    os: ("getuid", "sched_getaffinity", "sched_setscheduler", "setpriority", "SCHED_FIFO"),
    socket: ("AF_UNIX",),
    signal: ("SIGHUP",),
}.items():
    for name in names:
        delattr(module, name)
builtins.__import__ = elsewhere
failed, tried = [], 0
for package in OURS:
    for found in pkgutil.walk_packages(import_module(package).__path__, package + "."):
        tried += 1
        try:
            import_module(found.name)
        except (ImportError, AttributeError) as error:
            failed.append(found.name)
print(tried, *failed)
from haptic_driver.cli.main import main
sys.exit(main(["solve", "--friction", "0.6"]) + main(["status", "--socket", "here.sock"]) - 1)
"""
DAEMON = "haptic_driver.daemon."


def test_all_but_the_daemon_is_imported_and_runs_without_what_only_linux_has(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT],
        capture_output=True,
        text=True,
        timeout=250,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    tried, *failed = done.stdout.splitlines()[0].split()
    assert int(tried) > 300
    assert [name for name in failed if not name.startswith(DAEMON)] == []
    assert f"{DAEMON}place" in failed
    assert "no daemon answers at here.sock" in done.stderr
