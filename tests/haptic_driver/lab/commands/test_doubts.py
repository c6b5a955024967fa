"""No command prints a number from a file that it doubts without the doubt beside it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from haptic_driver.cli.main import main
from hw.camera.fingerprint import Optics, Touch, drawn
from model.support.toml import toml_lines
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.raw_trials.made import signals, with_keys, write_csv
from tests.reports import without_pictures

tifffile = pytest.importorskip("tifffile")
pytest.importorskip("skimage")
SPIKE = "a spike"


def a_map(folder: Path) -> str:
    """The map of the made trials, whose voltage is in the name of the file."""
    said = with_keys(voltage_on={"column": "voltage"})
    said["conditions"] = {
        "patterns": [r"(?P<voltage>\d+)V_(?P<frequency>\d+)Hz", r"t(?P<trial>\d+)"],
        "units": {"voltage": "V", "frequency": "Hz"},
    }
    (folder / "map.toml").write_text(toml_lines(said), encoding="utf-8")
    return "map.toml"


def trials(folder: Path) -> str:
    """Eight trials, one of which has a spike before the voltage."""
    (folder / "trials").mkdir()
    for number in range(8):
        voltage_v = 40 + 20 * (number % 4)
        columns = signals(0.5 + 0.02 * (number % 4), seed=number)
        columns["U"] *= voltage_v / 75.0
        if number == 5:
            columns["U"][50:53] = 500.0
        name = f"{voltage_v}V_{100 * 2 ** (number // 4)}Hz_t{number:02}.csv"
        write_csv(folder / "trials" / name, columns)
    return "trials"


def one_trial(folder: Path) -> str:
    columns = signals()
    columns["U"][50:53] = 500.0
    return write_csv(folder / "75V_100Hz_t1.csv", columns).name


def table(folder: Path) -> str:
    """What `haptic rows` wrote of such trials."""
    names = ("frequency_hz", "voltage_v", "normal_force_n", "cof", "doubts")
    lines = [",".join(names)]
    for number in range(8):
        cof = 0.5 + 0.02 * (number % 4) + 0.001 * (number // 4)
        said = "voltage has a spike at 0.2 s: passed over" if number == 5 else ""
        lines.append(f"100,{40 + 20 * (number % 4)},0.5,{cof:.4f},{said}")
    (folder / "data.csv").write_text("\n".join(lines), encoding="utf-8")
    return "data.csv"


def film(folder: Path) -> str:
    """Every frame twice."""
    optics = Optics(width=230, height=290, scale_m=50e-6, blur_m=15e-6)
    frame = drawn(Touch(5e-5), optics, np.random.default_rng(2)).image
    tifffile.imwrite(folder / "film.tif", np.stack([frame, frame]), photometric="minisblack")
    return "film.tif"


def heights(folder: Path) -> str:
    """Seven places without a number."""
    values = np.tile(np.linspace(0.0, 9.0, 80, dtype="f4"), (60, 1))
    values[20:27, 30] = -3.4e38
    tifffile.imwrite(folder / "height.tif", values, photometric="minisblack")
    return "height.tif"


class Case(NamedTuple):
    """A command, the file that is doubted, and what must be said of it."""

    command: str
    source: Callable[[Path], str]
    words: tuple[str, ...]
    doubt: str


CASES = (
    Case("rows", trials, ("{}", "--map", "{map}", "--out", "o.csv"), "a spike of the voltage"),
    Case("contact", film, ("{}", "--scale", "0.05", "--out", "o.csv"), "repeat the one before"),
    Case("texture from-image", heights, ("{}", "--width-mm", "60", "--out", "o.toml"), "no number"),
    Case("texture import", one_trial, ("{}", "--map", "{map}", "--out", "o.toml"), SPIKE),
    Case("predict", trials, ("--table", "{}", "--map", "{map}", "--out", "o.csv"), SPIKE),
    Case("predict", table, ("--table", "{}", "--out", "o.csv"), SPIKE),
    Case("diagnose", trials, ("{}", "--map", "{map}", "--out", "o"), SPIKE),
    Case("diagnose", table, ("{}", "--out", "o"), SPIKE),
    Case("calibrate", trials, ("{}", "--map", "{map}", "--out", "o.toml"), SPIKE),
    Case("calibrate", table, ("{}", "--out", "o.toml"), SPIKE),
)


@pytest.mark.parametrize("case", CASES, ids=[f"{c.command} {c.source.__name__}" for c in CASES])
def test_a_doubt_stands_beside_the_numbers(case, tmp_path, monkeypatch, capsys):
    """Of the commands with two cases one is read by a person, the other by a program."""
    single = [one.command for one in CASES].count(case.command) == 1
    for as_json in (False, True) if single else (case.source is table,):
        folder = tmp_path / ("json" if as_json else "text")
        folder.mkdir()
        monkeypatch.chdir(folder)
        source, map_file = case.source(folder), a_map(folder)
        words = [word.format(source, map=map_file) for word in case.words]
        with without_pictures():
            status = main([*case.command.split(), *words, *(["--json"] if as_json else [])])
        printed = capsys.readouterr()
        assert status == 0, printed.err
        if as_json:
            assert case.doubt in json.dumps(json.loads(printed.out), ensure_ascii=False)
        else:
            assert case.doubt in " ".join((printed.out + printed.err).split())


def test_a_doubt_stands_in_the_row(tmp_path, monkeypatch):
    """Also where only the file that was written goes on."""
    monkeypatch.chdir(tmp_path)
    a_map(tmp_path)
    wanted = {
        "rows": (trials(tmp_path), ("--map", "map.toml"), SPIKE),
        "contact": (film(tmp_path), ("--scale", "0.05"), "repeat the one before"),
    }
    for command, (source, more, doubt) in wanted.items():
        assert main([command, source, *more, "--out", f"{command}-out.csv"]) == 0
        assert any(doubt in row["doubts"] for row in rows_of(tmp_path / f"{command}-out.csv"))
