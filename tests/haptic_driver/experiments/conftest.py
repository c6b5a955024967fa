"""A model, the shipped rig, and a rig whose limits let every point through."""

from __future__ import annotations

import pytest

from haptic_driver.config import RigConfig, load_model, load_rig
from model.touch_model import TouchModel


@pytest.fixture(scope="session")
def model() -> TouchModel:
    return TouchModel(load_model("reference"))


@pytest.fixture
def config() -> RigConfig:
    return load_rig("simulated")
