"""Experiment files for tests: a small one, and whatever else is put into it."""

from __future__ import annotations

from pathlib import Path

from haptic_driver.lab.psychophysics.description import Experiment, load_experiment

CONSTANT = '[method]\nkind = "constant"\nlevels = [0.05, 0.1, 0.2]\nrepeats = 2\n'
STAIRCASE = """[method]
kind = "staircase"
start = 0.4
steps = [0.5, 0.25, 0.12]
low = 0.01
high = 1.0
reversals = 60
averaged = 54
trials = 240
"""
QUEST_PLUS = """[method]
kind = "quest_plus"
levels = { low = 0.02, high = 0.8, count = 30 }
thresholds = { low = 0.03, high = 0.6, count = 30 }
trials = 120
"""
CONDITION = '[[condition]]\nname = "a"\ncof = 0.5\n'


def made(
    folder: Path, head: str = "", tables: str = CONSTANT, conditions: str = CONDITION
) -> Experiment:
    path = folder / "made.toml"
    path.write_text(f'name = "made"\n{head}\n{tables}\n{conditions}')
    return load_experiment(str(path))
