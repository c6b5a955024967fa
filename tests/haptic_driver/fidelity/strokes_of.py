"""Strokes made of given friction, for the tests of this folder."""

import numpy as np

from haptic_driver.fidelity.strokes import Stroke

TICK_S = 1e-3


def stroke_of(asked, felt, load_n=0.5, reachable=None):
    asked, felt = np.asarray(asked, float), np.asarray(felt, float)
    load = np.full(asked.shape, load_n)
    there = np.ones(asked.shape, bool) if reachable is None else np.asarray(reachable)
    return Stroke(asked, felt * load, load, there)


def rough(seconds, seed, rms=0.03, mean=0.6, tick_s=TICK_S):
    """White noise: as much in every hertz."""
    noise = np.random.default_rng(seed).standard_normal(round(seconds / tick_s))
    return mean + rms * noise
