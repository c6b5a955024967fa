"""pymeasure's own driver, an independent client, against the simulated generator over TCP."""

import pytest

from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.serving.tcp import TcpServer
from tests.hw.instruments import IMMEDIATE, pymeasure_client

pytestmark = pytest.mark.timeout(60)


@pytest.fixture
def simulated():
    return Simulated33220A(IMMEDIATE)


@pytest.fixture
def client(simulated):
    with (
        TcpServer(simulated) as server,
        pymeasure_client("agilent", "Agilent33220A", server.resource) as client,
    ):
        yield client


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("shape", "SINUSOID", "SIN"),
        ("shape", "SQUARE", "SQU"),
        ("shape", "RAMP", "RAMP"),
        ("shape", "PULSE", "PULS"),
        ("shape", "NOISE", "NOIS"),
        ("shape", "DC", "DC"),
        ("frequency", 4700.0, 4700.0),
        ("amplitude", 1.5, 1.5),
        ("amplitude_unit", "VRMS", "VRMS"),
        ("amplitude_unit", "DBM", "DBM"),
        ("offset", 0.25, 0.25),
        ("voltage_high", 2.0, 2.0),
        ("voltage_low", -2.0, -2.0),
        ("square_dutycycle", 35, 35.0),
        ("output", True, True),
        ("output", False, False),
        ("burst_state", True, True),
        ("beeper_state", False, False),
    ],
)
def test_every_property_is_accepted_and_read_back(client, name, value, shown):
    setattr(client, name, value)
    got = getattr(client, name)
    assert got == (shown if isinstance(shown, (str, bool)) else pytest.approx(shown))
    assert client.check_errors() == []


def test_remote_state_and_beeper(client):
    for state in ("REMOTE", "RWLOCK", "LOCAL"):
        client.remote_local_state = state
    client.beep()
    assert client.check_errors() == []


def test_common_commands(client):
    assert client.id.split(",")[1] == "33220A"
    assert client.options == "0"
    assert client.complete == "1"
    assert int(client.status) == 0
    client.frequency = 5.0
    client.reset()
    assert client.frequency == 1000.0
    client.clear()


def test_errors_come_out_of_the_queue(client):
    client.amplitude = 1000.0
    errors = client.check_errors()
    assert [int(error[0]) for error in errors] == [-222]


def test_what_the_client_sets_is_at_the_terminals(client, simulated):
    client.frequency = 250.0
    client.amplitude = 1.0
    client.output = True
    assert client.output is True
    # pymeasure has no OUTP:LOAD, so the reset value of 50 ohm stands: 1 Vpp is 2 Vpp open, 1 V
    # peak.
    assert simulated.output()[:4] == (250.0, pytest.approx(1.0), 0.0, True)
