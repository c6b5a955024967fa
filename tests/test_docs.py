"""Every `haptic` command shown in README and docs runs as shown."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from haptic_driver.cli.main import main

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def commands(page: Path) -> list[str]:
    blocks = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    lines = [line.partition("  #")[0].strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("haptic ")]


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that the pages ask the reader to write."""
    (tmp_path / "conditions.csv").write_text("frequency_hz,voltage_v,normal_force_n\n250,75,0.5\n,0,0.5\n")
    rows = [f"{0.01 * i:.2f},{0.0004 * i:.5f},{0.5 if i > 10 else 0.0}" for i in range(200)]
    (tmp_path / "slide.csv").write_text("time_s,position_m,normal_force_n\n" + "\n".join(rows) + "\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_run_as_shown(page: Path, reader: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in commands(page):
        status = main(shlex.split(command)[1:])
        assert status == 0, f"{command}\n{capsys.readouterr().err}"


def test_the_readme_shows_commands_at_all() -> None:
    assert len(commands(ROOT / "README.md")) >= 5


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_and_pictures_exist(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name} points to {target}"
