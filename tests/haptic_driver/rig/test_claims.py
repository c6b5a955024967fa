"""One program at a time has an instrument, whoever runs it."""

import os
import signal
import subprocess
import sys

import pytest

from haptic_driver.errors import HapticError
from haptic_driver.rig.claims import Claims, same_place
from haptic_driver.rig.devices import _claim_itself, build_rig, connect_devices
from haptic_driver.rig.part import Wiring
from haptic_driver.simulation.served import ServedRig
from haptic_driver.simulation.twin import as_real
from hw.transport.resource import make_transport
from tests.haptic_driver.stand_ins import BreakableSensor
from tests.waiting import until

HOLDING = """
import sys, time
from haptic_driver.rig.claims import Claims
claims = Claims(sys.argv[1:])
claims.take()
print("held", flush=True)
time.sleep(1000.0)
"""
# the names of sockets as they are for all others in another network name space: not there
ELSEWHERE = """
import haptic_driver.rig.claims as claims
usual = claims._socket_name
claims._socket_name = lambda name: usual(name) + b"elsewhere"
"""


@pytest.fixture
def hold():
    """Another process that has claimed some addresses."""
    processes = []

    def start(*addresses, elsewhere=False):
        program = ELSEWHERE + HOLDING if elsewhere else HOLDING
        command = [sys.executable, "-c", program, *addresses]
        processes.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        assert processes[-1].stdout.readline() == "held\n"
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def is_free(address):
    claims = Claims([address])
    try:
        claims.take()
    except HapticError:
        return False
    claims.release()
    return True


@pytest.mark.process
def test_what_another_program_has_is_refused_and_who_it_is_told(hold):
    other = hold("TCPIP::192.0.2.5::5025::SOCKET", "ASRL/dev/ttyUSB7::INSTR")
    with pytest.raises(HapticError) as refused:
        Claims(["TCPIP0::192.0.2.5::inst0::INSTR"]).take()  # the same instrument by another port
    assert refused.value.code == "in_use"
    assert f"process {other.pid}" in refused.value.message
    assert "192.0.2.5" in refused.value.message


@pytest.mark.process
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_claim_ends_with_its_process_however_that_ends(hold, how):
    other = hold("dev1/port0/line0")
    assert not is_free("Dev1/port0/line0")
    other.send_signal(how)
    until(lambda: is_free("Dev1/port0/line0"))


@pytest.mark.process
def test_all_or_none(hold):
    hold("b.example:49152")
    with pytest.raises(HapticError):
        Claims(["a.example:49152", "b.example:49152"]).take()
    assert is_free("a.example:49152")


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("TCPIP::192.0.2.5::5025::SOCKET", "tcpip0::192.0.2.5::INSTR", True),
        ("TCPIP::192.0.2.5::5025::SOCKET", "TCPIP::192.0.2.6::5025::SOCKET", False),
        (
            "TCPIP::127.0.0.1::5025::SOCKET",
            "TCPIP::127.0.0.1::5026::SOCKET",
            False,
        ),  # simulated ones live there
        ("TCPIP::localhost::5025::SOCKET", "TCPIP0::127.0.0.1::5025::SOCKET", True),
        ("visa:TCPIP::192.0.2.5::INSTR", "192.0.2.5:5025", True),
        ("TCPIP::[fe80::1]::5025::SOCKET", "TCPIP::[fe80::2]::5025::SOCKET", False),
        ("ASRL/dev/null::INSTR", "/dev//null", True),
        ("/dev/stdin", os.path.realpath("/dev/stdin"), True),  # a link leads where it leads
        ("USB::0x0957::0x0407::MY1::0::INSTR", "USB0::0x0957::0x0407::MY1::INSTR", True),
        ("USB0::0x0957::0x0407::MY1::INSTR", "USB0::0x0957::0x0407::MY2::INSTR", False),
        ("GPIB0::10::INSTR", "GPIB1::10::INSTR", False),
        ("card:ni:/Dev1/ao0", "Dev1/ao0", True),
        ("card:sound:hw:1,0/1", "sound:HW:1,0", True),
        ("card:sound:3/1", "sound:3", True),
        ("card:sound:3", "card:sound:4", False),
    ],
)
def test_what_counts_as_one_instrument(one, other, same):
    assert (same_place(one) == same_place(other)) is same


@pytest.mark.process
def test_a_second_program_on_a_rig_touches_nothing(rig_config, touch):
    """Two daemons once ran one generator: one said "idle, 0 V" while the other held 95 V."""
    with ServedRig(as_real(rig_config), touch) as served:
        real = served.config
        with connect_devices(real):
            with pytest.raises(HapticError) as refused:
                connect_devices(real).open()
            assert refused.value.code == "in_use"
        with connect_devices(real) as again:  # closed, and free
            assert again.rig.state.value == "off"


@pytest.mark.process
def test_a_second_program_by_another_address_of_the_generator_touches_nothing(rig_config, touch):
    """A claim was of the address alone; the output of the first must not even be switched off."""
    with ServedRig(as_real(rig_config), touch) as served:
        real = served.config
        port = make_transport(served.endpoints["waveform_generator_serial"])
        claims = Claims([])
        other = build_rig(real, port, BreakableSensor(), Wiring())
        with connect_devices(real):
            served.generator.handle(b"OUTP ON\n")
            served.advance(0.2)
            assert served.generator.output().on
            with pytest.raises(HapticError, match="serial number SIM") as refused:
                _claim_itself(claims, other, port)
            assert refused.value.code == "in_use"
            other.close()
            claims.release()
            assert served.generator.output().on


@pytest.mark.process
def test_another_network_name_space_is_the_same_machine(hold):
    """Names of sockets are another name space's own there: a container had the instrument too."""
    other = hold("TCPIP::192.0.2.9::5025::SOCKET", elsewhere=True)
    assert not is_free("TCPIP::192.0.2.9::INSTR")
    other.kill()
    until(lambda: is_free("TCPIP::192.0.2.9::INSTR"))
