"""From rows of a file to what a made-up problem is made of."""

from __future__ import annotations

from pathlib import Path

from model.diagnosis.data import read_measurements
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.space import Predictor
from tests.fingers import FINGER


def read_rows(folder: Path, header: str, rows: list[str]) -> tuple[Predictor, Noise]:
    """The reference finger's predictor of these rows, and their noise."""
    path = folder / "data.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    data = read_measurements(path)
    noise = noise_of(data)
    assert noise is not None
    return Predictor(FINGER, data), noise
