"""The wheel holds everything that the program looks for, and works in an environment of its own."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("haptic_driver", "model", "hw")
SOURCES = (*PACKAGES, "configs")
BUILD_FILES = ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE")


def run(*command: object, folder: Path, timeout_s: float = 250.0) -> str:
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("HAPTIC_CONFIGS", "PYTHONPATH")
    }
    done = subprocess.run(
        list(map(str, command)),
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built from a copy, so that nothing is left behind in the checkout, and nothing old gets
    in.
    """
    copy = tmp_path_factory.mktemp("source")
    for name in SOURCES:
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in BUILD_FILES:
        shutil.copy(ROOT / name, copy / name)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    run(*build, "--wheel-dir", copy / "dist", ".", folder=copy)
    (built,) = (copy / "dist").glob("*.whl")
    return built


def test_the_wheel_holds_every_module_config_and_page(wheel):
    held = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }
    wanted |= {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "haptic_driver/daemon/web/dashboard").iterdir()
    } | {f"{package}/py.typed" for package in PACKAGES}
    wanted.add("model/reporting/page.html")
    configs = [path for path in (ROOT / "configs").rglob("*") if path.is_file()]
    assert {path.parent.name for path in configs} >= {
        "rigs",
        "models",
        "textures",
        "plans",
        "populations",
    }
    wanted |= {f"haptic_driver/{path.relative_to(ROOT).as_posix()}" for path in configs}
    assert wanted <= held, sorted(wanted - held)


def test_the_wheel_installs_only_its_packages(wheel):
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(PACKAGES)


def test_a_checkout_says_its_commit(tmp_path):
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    commit = run("git", "rev-parse", "HEAD", folder=ROOT).strip()
    said = run(Path(sys.executable).with_name("haptic"), "--version", folder=tmp_path)
    found = re.fullmatch(r"haptic-driver \d+\.\d+\.\d+\S* \(([0-9a-f]{12,})(-dirty)?\)\n", said)
    assert found is not None, said
    assert commit.startswith(found[1])


@pytest.mark.soak
@pytest.mark.timeout(600)
def test_installed_in_an_empty_environment_the_demo_runs_from_any_folder(wheel, tmp_path):
    """The libraries are those of this environment: only this project is installed."""
    home, elsewhere = tmp_path / "venv", tmp_path / "elsewhere"
    venv.create(home, with_pip=True)
    elsewhere.mkdir()
    python = home / "bin" / "python"
    run(
        python,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
        wheel,
        folder=elsewhere,
    )
    packages = Path(
        run(
            python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", folder=elsewhere
        ).strip()
    )
    (packages / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")

    where = run(
        python, "-c", "import haptic_driver; print(haptic_driver.__file__)", folder=elsewhere
    )
    assert Path(where.strip()).is_relative_to(packages)
    haptic = home / "bin" / "haptic"
    demo = json.loads(
        run(haptic, "demo", "--texture", "linen", "--out", "out", "--json", folder=elsewhere)
    )
    assert demo["simulated"] is True
    assert demo["share_within_5_percent"] > 0.8
    assert (elsewhere / demo["pictures"][0]).is_file()
    assert json.loads(run(haptic, "doctor", "--rig", "simulated", "--json", folder=elsewhere))
    assert "haptic-driver" in run(haptic, "--version", folder=elsewhere)


def pythons() -> list[str]:
    """Every Python from 3.11 to 3.15 of this machine that starts, newest of each minor version."""
    found = {}
    roots = [Path(folder) for folder in os.environ.get("PATH", "").split(os.pathsep)]
    roots += sorted(Path.home().glob(".pyenv/versions/*/bin"))
    for minor in range(11, 16):
        for python in (root / f"python3.{minor}" for root in roots):
            done = None
            if os.access(python, os.X_OK):
                done = subprocess.run([python, "-c", ""], capture_output=True, check=False)
            if done is not None and done.returncode == 0:
                found[minor] = str(python)
    return list(found.values())


@pytest.mark.soak
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("python", pythons(), ids=lambda path: Path(path).name)
def test_the_wheel_installs_with_its_libraries_and_runs(python, wheel, tmp_path):
    """The libraries come from the package index, in the versions that fit this Python."""
    home, elsewhere = tmp_path / "venv", tmp_path / "elsewhere"
    run(python, "-m", "venv", home, folder=tmp_path)
    elsewhere.mkdir()
    own = home / "bin" / "python"
    run(own, "-m", "pip", "install", "--quiet", wheel, folder=elsewhere, timeout_s=1000)
    demo = json.loads(run(home / "bin" / "haptic", "demo", "--json", folder=elsewhere))
    assert demo["simulated"] is True
    assert demo["share_within_5_percent"] > 0.8
    solved = json.loads(
        run(home / "bin" / "haptic", "solve", "--friction", "0.6", "--json", folder=elsewhere)
    )
    assert abs(solved["cof"] - 0.6) < 0.001
