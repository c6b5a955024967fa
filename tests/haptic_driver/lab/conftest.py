"""A model, the shipped rig, and a rig whose limits let every point through."""

import pytest

from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from model.touch_model import TouchModel


@pytest.fixture(scope="session")
def model():
    return TouchModel(load_model("reference"))


@pytest.fixture
def config():
    return load_rig("simulated")
