"""pymeasure's driver of Teledyne's T3AFG, in Siglent's dialect: an independent client of the
simulated SDG.
"""

import pytest

from hw.generator.siglent_sdg.simulator import SimulatedSdg
from hw.serving.tcp import TcpServer
from tests.hw.instruments import IMMEDIATE, pymeasure_client

pytestmark = pytest.mark.timeout(60)


@pytest.fixture
def simulated():
    return SimulatedSdg(IMMEDIATE)


@pytest.fixture
def client(simulated):
    with (
        TcpServer(simulated) as server,
        pymeasure_client("teledyne", "TeledyneT3AFG", server.resource) as client,
    ):
        yield client


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("wavetype", "SQUARE"),
        ("wavetype", "RAMP"),
        ("wavetype", "SINE"),
        ("frequency", 4700.0),
        ("amplitude", 1.5),
        ("offset", -0.25),
        ("output_enabled", True),
        ("output_enabled", False),
    ],
)
def test_every_property_is_accepted_and_read_back(client, name, value):
    setattr(client.ch_1, name, value)
    assert getattr(client.ch_1, name) == (
        value if isinstance(value, (str, bool)) else pytest.approx(value)
    )


def test_what_the_client_sets_is_at_the_terminals(client, simulated):
    client.reset()
    client.ch_1.frequency = 250.0
    client.ch_1.amplitude = 1.0
    client.ch_1.offset = 0.5
    assert client.ch_1.output_enabled is False
    client.ch_1.output_enabled = True
    assert client.id.split(",")[1] == "SDG1032X"
    assert simulated.output()[:4] == (250.0, pytest.approx(0.5), pytest.approx(0.5), True)
