"""pymeasure's own drivers, independent clients, against the simulated generators over TCP."""

import pytest

from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.keysight_33500.driver import Keysight33500
from hw.generator.keysight_33500.simulator import Simulated33500
from hw.generator.settings import GeneratorSettings
from hw.generator.siglent_sdg.simulator import SimulatedSdg
from hw.serving.memory import MemoryTransport
from hw.serving.tcp import TcpServer
from tests.hw.instruments import IMMEDIATE, pymeasure_client

pytestmark = pytest.mark.timeout(60)
CLIENTS = {
    Simulated33220A: ("agilent", "Agilent33220A"),
    Simulated33500: ("agilent", "Agilent33500"),
    SimulatedSdg: ("teledyne", "TeledyneT3AFG"),
}
EVERY = {"frequency": [4700.0], "amplitude": [1.5], "offset": [0.25]}
KEYSIGHT = {
    **EVERY,
    "amplitude_unit": ["VRMS"],
    "voltage_high": [2.0],
    "voltage_low": [-2.0],
    "square_dutycycle": [35],
    "output": [True, False],
    "burst_state": [True],
}
PROPERTIES = {
    Simulated33220A: {"shape": ["SQUARE", "RAMP", "PULSE", "NOISE", "DC"], **KEYSIGHT},
    Simulated33500: {"shape": ["SQU", "TRI", "DC"], "output_load": [75], **KEYSIGHT},
    SimulatedSdg: {"wavetype": ["SQUARE", "RAMP"], "output_enabled": [True, False], **EVERY},
}


@pytest.fixture(params=CLIENTS, ids=lambda kind: kind.__name__)
def simulated(request):
    return request.param(IMMEDIATE)


@pytest.fixture
def client(simulated):
    with (
        TcpServer(simulated) as server,
        pymeasure_client(*CLIENTS[type(simulated)], server.resource) as client,
    ):
        yield client


def test_every_property_is_accepted_and_read_back(client, simulated):
    """By channel, `SOUR1:...`, where there is one, and without."""
    keysight = not isinstance(simulated, SimulatedSdg)
    targets = [*([client] if keysight else []), *([client.ch_1] if hasattr(client, "ch_1") else [])]
    for target in targets:
        for name, values in PROPERTIES[type(simulated)].items():
            for value in values:
                client.reset()
                setattr(target, name, value)
                got = getattr(target, name)
                if isinstance(value, str):
                    assert value.startswith(got), (name, got)
                else:
                    assert got == pytest.approx(value), name
        assert not keysight or client.check_errors() == []


@pytest.mark.parametrize("simulated", [Simulated33220A], indirect=True)
def test_common_commands(client):
    for state in ("REMOTE", "RWLOCK", "LOCAL"):
        client.remote_local_state = state
    client.beep()
    assert (client.options, client.complete, int(client.status)) == ("0", "1", 0)
    client.clear()
    assert client.check_errors() == []
    client.amplitude = 1000.0
    assert [int(error[0]) for error in client.check_errors()] == [-222]


def test_what_the_client_sets_is_at_the_terminals(client, simulated):
    """33220A: without OUTP:LOAD its reset value stands, and 1 Vpp is 2 Vpp open, 1 V peak."""
    client.reset()
    target = getattr(client, "ch_1", client)
    if isinstance(simulated, Simulated33500):
        target.output_load = "INF"
    target.frequency, target.amplitude = 250.0, 1.0
    setattr(target, "output_enabled" if isinstance(simulated, SimulatedSdg) else "output", True)
    assert client.id.split(",")[1] in ("33220A", "33512B", "SDG1032X")
    peak_v = 1.0 if isinstance(simulated, Simulated33220A) else 0.5
    assert simulated.output()[:4] == (250.0, pytest.approx(peak_v), 0.0, True)


@pytest.mark.parametrize("simulated", [Simulated33500], indirect=True)
def test_the_instrument_itself_refuses_what_is_beyond_the_rigs_limit(client, simulated):
    """The client knows nothing of the driver's limits: 150 V at a gain of 100 is 3 Vpp."""
    settings = GeneratorSettings(100.0, 150.0, 10.0, 10e3)
    driver = Keysight33500(MemoryTransport(simulated), settings)
    driver.connect()
    driver.set_point(250.0, 150.0)
    driver.set_output(True)
    assert simulated.output().amplitude_v == pytest.approx(1.5)
    client.ch_1.amplitude = 9.0
    assert [int(error[0]) for error in client.check_errors()] == [-222]
    client.ch_1.offset = 4.5
    assert simulated.output()[1:3] == (pytest.approx(1.5), pytest.approx(0.0))
    assert driver.close() is True
