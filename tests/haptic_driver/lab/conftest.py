"""A model, the shipped rig, and command lines that are refused."""

import pytest

from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from model.touch_model import TouchModel
from tests.haptic_driver.lab.refusal import refuses

__all__ = ["refuses"]


@pytest.fixture(scope="session")
def model():
    return TouchModel(load_model("reference"))


@pytest.fixture
def config():
    return load_rig("simulated")
