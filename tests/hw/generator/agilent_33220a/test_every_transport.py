"""The generator's driver says and hears the same over every transport that it can use."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import pytest

from hw.errors import LimitExceeded
from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.settings import GeneratorSettings
from hw.serving.memory import MemoryTransport
from hw.serving.serial import SerialServer
from hw.serving.tcp import TcpServer
from hw.transport.contract import Transport
from hw.transport.marker import scpi_marker
from hw.transport.serial import SerialTransport
from hw.transport.tcp import TcpTransport
from hw.transport.usbtmc import UsbTmcTransport
from hw.transport.visa import VisaTransport
from tests.hw.testing.usb_backend import SimulatedUsbBackend

LINKS: dict[str, Callable[[Simulated33220A, ExitStack], Transport]] = {
    "memory": lambda core, stack: MemoryTransport(core),
    "tcp": lambda core, stack: TcpTransport.from_resource(
        stack.enter_context(TcpServer(core)).resource
    ),
    "serial": lambda core, stack: SerialTransport(
        stack.enter_context(SerialServer(core)).path, marker=scpi_marker
    ),
    "usbtmc": lambda core, stack: UsbTmcTransport(
        0x0957, 0x0407, "SIM0001", backend=stack.enter_context(SimulatedUsbBackend(core))
    ),
    "visa-tcp": lambda core, stack: VisaTransport(stack.enter_context(TcpServer(core)).resource),
    "visa-serial": lambda core, stack: VisaTransport(
        stack.enter_context(SerialServer(core)).resource, marker=scpi_marker
    ),
}


@pytest.fixture(params=LINKS)
def pair(request):
    core = Simulated33220A()
    settings = GeneratorSettings(100.0, 150.0, 1.0, 1e6, reply_timeout_s=5.0)
    with ExitStack() as stack:
        driver = Agilent33220A(LINKS[request.param](core, stack), settings)
        stack.callback(driver.close)
        yield core, driver


def test_a_session_ends_as_told_and_off(pair):
    core, driver = pair
    driver.connect()
    assert not core.output().on
    driver.set_point(250.0, 75.0)
    driver.set_output(True)
    core.advance(1.0)
    output = core.output()
    assert output.frequency_hz == 250.0
    assert output.amplitude_v == pytest.approx(
        0.75, rel=1e-3
    )  # 75 V at the electrode, a gain of 100
    with pytest.raises(LimitExceeded):
        driver.set_point(250.0, 151.0)
    assert driver.off() is True
    core.advance(1.0)
    assert not core.output().on
