"""pymeasure's own driver of the 33500s, an independent client, against the simulated one over
TCP.
"""

import pytest

from hw.generator.keysight_33500.driver import Keysight33500
from hw.generator.keysight_33500.simulator import Simulated33500
from hw.generator.settings import GeneratorSettings
from hw.serving.tcp import TcpServer
from hw.transport.tcp import TcpTransport
from tests.hw.instruments import IMMEDIATE, pymeasure_client

pytestmark = pytest.mark.timeout(60)


@pytest.fixture
def simulated():
    return Simulated33500(IMMEDIATE)


@pytest.fixture
def server(simulated):
    with TcpServer(simulated) as server:
        yield server


@pytest.fixture
def client(server):
    with pymeasure_client("agilent", "Agilent33500", server.resource) as client:
        yield client


@pytest.mark.parametrize("channel", [False, True])
@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("shape", "SIN", "SIN"),
        ("shape", "SQU", "SQU"),
        ("shape", "TRI", "TRI"),
        ("shape", "DC", "DC"),
        ("frequency", 4700.0, 4700.0),
        ("amplitude", 1.5, 1.5),
        ("amplitude_unit", "VRMS", "VRMS"),
        ("offset", 0.25, 0.25),
        ("voltage_high", 2.0, 2.0),
        ("voltage_low", -2.0, -2.0),
        ("square_dutycycle", 35, 35.0),
        ("output", True, True),
        ("output", False, False),
        ("output_load", 75, 75.0),
        ("burst_state", True, True),
    ],
)
def test_every_property_is_accepted_and_read_back(client, name, value, shown, channel):
    """By channel, `SOUR1:...`, and without."""
    target = client.ch_1 if channel else client
    setattr(target, name, value)
    got = getattr(target, name)
    assert got == (shown if isinstance(shown, (str, bool)) else pytest.approx(shown))
    assert client.check_errors() == []


def test_what_the_client_sets_is_at_the_terminals(client, simulated):
    client.ch_1.output_load = "INF"
    client.ch_1.frequency = 250.0
    client.ch_1.amplitude = 1.0
    client.ch_1.output = True
    assert client.ch_1.output is True
    assert simulated.output()[:4] == (250.0, pytest.approx(0.5), 0.0, True)


def test_the_instrument_itself_refuses_what_is_beyond_the_rigs_limit(client, server, simulated):
    """The client knows nothing of the driver's limits: 150 V at a gain of 100 is 3 Vpp."""
    transport = TcpTransport(server.host, server.port)
    driver = Keysight33500(
        transport, GeneratorSettings(100.0, 150.0, 10.0, 10e3, reply_timeout_s=3.0)
    )
    driver.connect()
    driver.set_point(250.0, 150.0)
    driver.set_output(True)
    assert simulated.output().amplitude_v == pytest.approx(1.5)
    client.ch_1.amplitude = 9.0
    assert [int(error[0]) for error in client.check_errors()] == [-222]
    assert simulated.output().amplitude_v == pytest.approx(1.5)
    client.ch_1.offset = 4.5
    assert simulated.output().offset_v == pytest.approx(0.0)
    assert driver.close() is True
