import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import model
from model.support import compiled
from model.support.compiled import kernel

SOURCES = Path(model.__file__).parent


@pytest.fixture
def package(tmp_path):
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
    (folder / "support" / "constant.py").write_text("FACTOR = 2.0\n")
    (folder / "support" / "user.py").write_text(
        "from model.support.compiled import kernel\nfrom model.support.constant import FACTOR\n\n\n"
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
    code = f"from model.support.user import scaled; print(scaled({x!r}))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        cwd=package.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def imported(path: Path) -> Iterator[Path]:
    text = path.read_text("utf-8")
    for module, name in re.findall(r"^ *from model\.(\S+) import (\w*)", text, re.M):
        found = SOURCES / module.replace(".", "/")
        yield found / f"{name}.py" if found.is_dir() else found.with_suffix(".py")


def kernel_folders(package: Path) -> set[str]:
    return {p.name for p in (package.parent / "cache" / "kernels").iterdir()}


@pytest.mark.process
def test_a_change_in_another_file_never_runs_stale_machine_code(package):
    """numba alone would answer 6 twice: the file of the kernel has not changed."""
    assert scaled(package, 3.0) == 6.0
    before = kernel_folders(package)
    assert len(before) == 1
    (package / "support" / "constant.py").write_text("FACTOR = 5.0\n")
    assert scaled(package, 3.0) == 15.0
    assert len(kernel_folders(package) - before) == 1


def test_the_folder_is_named_by_every_kernel_and_all_that_it_imports():
    named = {path for pattern in compiled.SOURCES for path in SOURCES.glob(pattern)}
    with_kernels = {p for p in SOURCES.rglob("*.py") if "\n@kernel" in p.read_text("utf-8")}
    assert with_kernels
    reached, new = set(), with_kernels
    while new:
        reached |= new
        new = {found for path in new for found in imported(path)} - reached
    assert reached <= named


@pytest.mark.process
def test_a_change_where_no_kernel_is_compiles_nothing_anew(package):
    assert scaled(package, 3.0) == 6.0
    (package / "effects.py").write_text("MORE = 1.0\n")
    assert scaled(package, 3.0) == 6.0
    assert len(kernel_folders(package)) == 1


def test_division_by_zero_follows_numpy():
    """error_model numpy: an infinite voltage of pull-in is an infinity, not an exception."""

    @kernel
    def inverse(x):
        return 1.0 / x

    assert np.isinf(inverse(0.0))
