"""What compiles the stages: no stale machine code, nothing compiled when that is refused."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import haptic_driver
from haptic_driver.render.compiled import kernel

SOURCES = Path(haptic_driver.__file__).parent


@pytest.fixture
def package(tmp_path):
    """A small package of its own: what compiles, signals, a constant, and a kernel that uses
    both.
    """
    folder = tmp_path / "haptic_driver" / "render"
    folder.mkdir(parents=True)
    (folder.parent / "__init__.py").touch()
    (folder / "__init__.py").touch()
    shutil.copy(SOURCES / "render" / "compiled.py", folder)
    (folder.parent / "signals.py").write_text(
        "from typing import NamedTuple\n\nArray = object\n\n\n"
        "class Finger(NamedTuple):\n    first: float\n    second: float\n"
    )
    (folder / "constant.py").write_text("FACTOR = 2.0\n")
    (folder / "user.py").write_text(
        "from haptic_driver.render.compiled import kernel\nfrom haptic_driver.render.constant"
        " import FACTOR\n\n\n@kernel\ndef scaled(finger):\n    return FACTOR * finger.first\n"
    )
    return folder


def scaled(package: Path, first: float, second: float) -> float:
    """What a new process computes with the kernel of `package`."""
    top = package.parents[1]
    environment = os.environ | {
        "PYTHONPATH": str(top),
        "HAPTIC_CACHE_DIR": str(top / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    code = (
        "from haptic_driver.render.user import scaled; from haptic_driver.signals import Finger; "
        f"print(scaled(Finger(first={first!r}, second={second!r})))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        cwd=top,
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def kernel_folders(package: Path) -> set[str]:
    return {p.name for p in (package.parents[1] / "cache" / "kernels").iterdir()}


@pytest.mark.soak
def test_a_change_in_another_file_never_runs_stale_machine_code(package):
    """numba alone would answer 6 each time: the file of the kernel has not changed."""
    assert scaled(package, 3.0, 4.0) == scaled(package, 3.0, 4.0) == 6.0
    assert len(kernel_folders(package)) == 1
    (package / "constant.py").write_text("FACTOR = 5.0\n")
    assert scaled(package, 3.0, 4.0) == 15.0
    assert len(kernel_folders(package)) == 2


@pytest.mark.process
def test_another_policy_has_nothing_compiled_anew(package):
    policies = package / "policies.py"
    policies.write_text("def loudest(settings): ...\n")
    assert scaled(package, 3.0, 4.0) == 6.0
    policies.write_text("def quietest(settings): ...\n")
    assert scaled(package, 3.0, 4.0) == 6.0
    assert len(kernel_folders(package)) == 1


@pytest.mark.process
def test_fields_of_a_signal_that_change_places_are_not_mixed_up(package):
    """Both are floats, so that to numba the record looks as before."""
    assert scaled(package, 3.0, 4.0) == 6.0
    signals = package.parent / "signals.py"
    signals.write_text(
        signals.read_text()
        .replace("first", "x")
        .replace("second", "first")
        .replace("x:", "second:")
    )
    assert scaled(package, 3.0, 4.0) == 6.0


def test_compiling_leaves_the_configuration_of_numba_alone():
    before = numba.config.CACHE_DIR

    @kernel
    def half(x):
        return 0.5 * x

    after = numba.config.CACHE_DIR
    assert after == before
    assert half(3.0) == 1.5


def test_division_by_zero_follows_numpy():
    """error_model numpy: in a tick nothing may raise."""

    @kernel
    def inverse(x):
        return 1.0 / x

    assert np.isinf(inverse(0.0))


REFUSED = """
import pytest
from haptic_driver.render.compiled import kernel, refuse_to_compile
from haptic_driver.signals import TargetFriction

@kernel
def half(target):
    return 0.5 * target.cof

assert half(TargetFriction(3.0, True)) == 1.5
refuse_to_compile()
assert half(TargetFriction(4.0, False)) == 2.0
with pytest.raises(TypeError, match="No matching definition"):
    half(TargetFriction(3, True))
assert len(half.signatures) == 1
"""


@pytest.mark.process
def test_an_integer_where_a_float_belongs_is_refused_and_not_compiled_for(tmp_path):
    """In a process of its own: in this one the other tests go on compiling."""
    (tmp_path / "refused.py").write_text(REFUSED)
    done = subprocess.run(
        [sys.executable, tmp_path / "refused.py"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
