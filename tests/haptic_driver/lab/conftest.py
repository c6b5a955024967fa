"""A model, the shipped rig, and a rig whose limits let every point through."""

from __future__ import annotations

import pytest

from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import RigConfig, load_rig
from model.touch_model import TouchModel


@pytest.fixture(scope="session")
def model() -> TouchModel:
    return TouchModel(load_model("reference"))


@pytest.fixture
def config() -> RigConfig:
    return load_rig("simulated")
