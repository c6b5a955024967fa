import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import model
from model.support.compiled import kernel

SOURCES = Path(model.__file__).parent


@pytest.fixture
def package(tmp_path) -> Path:
    """A small package `model` of its own: the compiler wrapper, a constant, and a kernel that uses
    it.
    """
    folder = tmp_path / "model"
    (folder / "support").mkdir(parents=True)
    for name in ("__init__.py", "support/__init__.py", "support/compiled.py"):
        shutil.copy(SOURCES / name, folder / name)
    (tmp_path / "haptic_driver").mkdir()
    shutil.copy(SOURCES.parent / "haptic_driver" / "__init__.py", tmp_path / "haptic_driver")
    shutil.copytree(SOURCES.parent / "haptic_driver" / "base", tmp_path / "haptic_driver" / "base")
    (folder / "constant.py").write_text("FACTOR = 2.0\n")
    (folder / "user.py").write_text(
        "from model.support.compiled import kernel\nfrom model.constant import FACTOR\n\n\n"
        "@kernel\ndef scaled(x):\n    return FACTOR * x\n"
    )
    return folder


def scaled(package: Path, x: float) -> float:
    """What a new process computes with the kernel of `package`."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(package.parent),
        "HAPTIC_CACHE_DIR": str(package.parent / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    code = f"from model.user import scaled; print(scaled({x!r}))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        cwd=package.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def kernel_folders(package: Path) -> set[str]:
    return {p.name for p in (package.parent / "cache" / "kernels").iterdir()}


def test_a_change_in_another_file_never_runs_stale_machine_code(package) -> None:
    """numba alone would answer 6 twice: the file of the kernel has not changed."""
    assert scaled(package, 3.0) == 6.0
    before = kernel_folders(package)
    assert len(before) == 1
    (package / "constant.py").write_text("FACTOR = 5.0\n")
    assert scaled(package, 3.0) == 15.0
    assert len(kernel_folders(package) - before) == 1


def test_unchanged_sources_share_one_folder(package) -> None:
    assert scaled(package, 3.0) == scaled(package, 3.0) == 6.0
    assert len(kernel_folders(package)) == 1


def test_compiling_leaves_the_configuration_of_numba_alone() -> None:
    before = numba.config.CACHE_DIR

    @kernel
    def half(x):
        return 0.5 * x

    after = numba.config.CACHE_DIR
    assert after == before
    assert half(3.0) == 1.5


def test_division_by_zero_follows_numpy() -> None:
    """error_model numpy: an infinite voltage of pull-in is an infinity, not an exception."""

    @kernel
    def inverse(x):
        return 1.0 / x

    assert np.isinf(inverse(0.0))
