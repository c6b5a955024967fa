"""One tree of errors: whoever catches its root has what each room refuses."""

import ast
from pathlib import Path

import pytest

from haptic_driver.base.errors import BadInputError, HapticError, message_of
from haptic_driver.client import NoDaemonError
from haptic_driver.daemon.messages import RefusedError
from hw.errors import DeviceDisconnected, DeviceError
from model.support.errors import ModelError, RowError

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("haptic_driver", "model", "hw")
BUILT_IN = {"Exception", "ValueError", "RuntimeError", "OSError", "KeyError", "TypeError"}
# A simulated instrument answers `ScpiError`; the others are caught where they arise.
ROOTS = {"HapticError", "ScpiError", "Withdrawn", "_Closed"}


def test_there_is_one_root():
    roots = {
        node.name
        for package in PACKAGES
        for file in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        and node.bases
        and {ast.unparse(base) for base in node.bases} <= BUILT_IN
    }
    assert roots == ROOTS


@pytest.mark.parametrize(
    ("error", "cause", "status"),
    [
        (ModelError("roughness is missing", "Give it", "bad_file"), BadInputError, 2),
        (RowError(3, "cof is missing"), BadInputError, 2),
        (DeviceDisconnected("it is gone", "plug it in"), DeviceError, 1),
        (RefusedError("not_armed", "nobody holds a lease"), HapticError, 1),
        (NoDaemonError("no_daemon", "nobody listens"), HapticError, 1),
    ],
)
def test_a_cause_is_told_by_its_class_and_by_the_exit_status(error, cause, status):
    assert isinstance(error, cause)
    assert error.exit_status == status
    assert message_of(error) == error.message
