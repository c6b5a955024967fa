"""LSL and OSC as their own receivers see them, over loopback."""

import json
import math
import socket
import subprocess
import sys

import numpy as np
import pytest

from haptic_driver.daemon.inlets import LslMarkers, label_of
from haptic_driver.daemon.outlets import LslOutlet, OscOutlet, feeding
from haptic_driver.daemon.verbs import Mark
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.recording.event import Event
from tests.haptic_driver.daemon.ticks import made_tick
from tests.waiting import HANG_S, until

EVENT = Event(number=3, time_s=2.0, kind="marker", message="begin", data={"trial": 1})
LSL_ON_LOOPBACK = "[multicast]\nResolveScope = machine\nIPv6 = disable\n[ports]\nIPv6 = disable\n"


class Telling:
    """An event log to which one event is added, and an outlet that keeps what it gets, or fails."""

    def __init__(self, error=None):
        self.events, self.got, self.error = [], [], error

    def since(self, number):
        return [event for event in self.events if event.number > number]

    def send(self, samples, events):
        if self.error is not None:
            raise self.error
        self.got.append((samples["tick"].tolist(), list(events)))


def test_outlets_get_what_is_new_once_and_a_failing_one_ends_alone(shared):
    shared.ring.write(made_tick(1))
    good, bad, said = Telling(), Telling(OSError("no route")), []
    good.events = [EVENT.model_copy(update={"number": 2})]
    with feeding([bad, good], shared.ring, good.since, said.append):
        until(lambda: said)
        good.events.append(EVENT)
        for tick in range(2, 50):
            shared.ring.write(made_tick(tick))
        until(
            lambda: (
                sum(len(ticks) for ticks, _ in good.got) == 48
                and any(events for _, events in good.got)
            )
        )
    assert [tick for ticks, _ in good.got for tick in ticks] == list(range(2, 50))
    assert [event for _, events in good.got for event in events] == [EVENT]
    assert said == ["Telling ended: no route"]


def test_osc_messages_are_read_by_an_osc_parser(shared):
    osc = pytest.importorskip("pythonosc.osc_message", reason="python-osc is not installed")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(HANG_S)
        outlet = OscOutlet(f"127.0.0.1:{receiver.getsockname()[1]}")
        shared.ring.write(made_tick(1, position_x_m=0.5))
        shared.ring.write(
            made_tick(
                2,
                position_x_m=0.01,
                position_y_m=0.02,
                target_cof=0.6,
                measured_cof=math.nan,
                frequency_hz=250.0,
                voltage_v=80.0,
                normal_force_n=0.5,
            )
        )
        outlet.send(shared.ring.read(0).samples, [EVENT])
        sample, event = (osc.OscMessage(receiver.recv(2048)) for _ in range(2))
        outlet._client._sock.close()
    assert sample.address == "/haptic/sample"
    np.testing.assert_allclose(
        sample.params, [0.01, 0.02, 0.6, np.nan, 250.0, 80.0, 0.5], rtol=1e-6
    )
    assert event.address == "/haptic/event"
    assert event.params[:3] == [3, "marker", "begin"]
    assert json.loads(event.params[3]) == {"trial": 1}


@pytest.mark.parametrize("address", ["127.0.0.1:x", "127.0.0.1:0", "127.0.0.1:70000"])
def test_a_bad_osc_address_is_refused(address):
    with pytest.raises(BadInputError, match="is no HOST:PORT"):
        OscOutlet(address)


@pytest.mark.parametrize(
    ("said", "label"),
    [
        ("a\n2026-01-01 12:00:00,000 haptic_driver.daemon: fault", None),
        ("\x1b[2J", "\\x1b[2J"),
        ("", "(nothing)"),
        (300 * "x", 200 * "x"),
    ],
)
def test_what_a_stream_says_is_a_label_as_mark_takes_it(said, label):
    found = label_of(said)
    assert Mark(label=found).label == found
    assert found.isprintable()
    assert label is None or found == label


LSL_DIALOGUE = """
import sys, time
import numpy as np
import pylsl
from haptic_driver.daemon.outlets import LslOutlet
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.recording.event import Event

outlet = LslOutlet(1000.0, "test")
inlets = []
for name in ("haptic-samples", "haptic-events"):
    found = pylsl.resolve_byprop("name", name, timeout=30.0)
    inlets.append(pylsl.StreamInlet(found[0]))
    inlets[-1].open_stream(timeout=30.0)
samples = np.zeros(3, SAMPLE)
now_s = time.monotonic()
samples["tick"] = [7, 8, 9]
samples["time_s"] = now_s + np.arange(3) * 1e-3
samples["target_cof"] = 0.6
outlet.send(samples, [Event(number=3, time_s=now_s, kind="marker", message="begin")])
rows, stamps = zip(*(inlets[0].pull_sample(timeout=30.0) for _ in range(3)))
marker, stamp = inlets[1].pull_sample(timeout=30.0)
channel = inlets[0].info().desc().child("channels").child("channel")
assert channel.child_value("label") == "tick"
assert [row[0] for row in rows] == [7.0, 8.0, 9.0]
assert [row[SAMPLE.names.index("target_cof")] for row in rows] == [0.6] * 3
assert np.allclose(np.diff(stamps), 1e-3, atol=1e-6)
assert abs(stamps[0] - pylsl.local_clock()) < 60.0 and abs(stamp - stamps[0]) < 1e-3
assert '"begin"' in marker[0]
"""


LSL_MARKERS_DIALOGUE = """
import time
import pylsl
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.inlets import LslMarkers, hearing

def begun(source):
    return pylsl.StreamOutlet(pylsl.StreamInfo("paradigm", "Markers", 1, 0.0, "string", source))

def heard(count):
    until_s = time.monotonic() + 60.0
    while len(events.since(0)) < count and not failed and time.monotonic() < until_s:
        time.sleep(0.01)
    assert not failed, failed
    assert len(events.since(0)) == count, events.since(0)
    return events.since(0)

outlet, events, failed = begun("made"), EventLog(), []
with hearing(LslMarkers("paradigm"), events.add, failed.append):
    assert outlet.wait_for_consumers(60.0)
    sent_s = time.monotonic() - 3.0
    outlet.push_sample(["trial 7"], sent_s + pylsl.local_clock() - time.monotonic())
    (event,) = heard(1)
    told = (event.kind, event.message, event.data)
    assert told == ("marker", "trial 7", {"stream": "paradigm"}), event
    assert abs(event.time_s - sent_s) < 0.01, (event, sent_s)

    outlet.push_sample(["two\\nlines"])
    assert heard(2)[1].message == "two\\\\nlines", events.since(0)

    del outlet  # the program ends, and is started again as another sender
    lost = heard(3)[2]
    assert lost.kind == "inlet" and "is lost" in lost.message, lost
    outlet = begun("another")
    found = heard(4)[3]
    assert found.kind == "inlet" and "heard again" in found.message, found
    outlet.push_sample(["trial 8"])
    assert heard(5)[4].message == "trial 8", events.since(0)
"""


@pytest.mark.parametrize("dialogue", [LSL_DIALOGUE, LSL_MARKERS_DIALOGUE], ids=["out", "in"])
def test_streams_of_lsl_go_out_and_come_in(dialogue, tmp_path, monkeypatch):
    pytest.importorskip("pylsl", reason="pylsl is not installed")
    (tmp_path / "lsl.cfg").write_text(LSL_ON_LOOPBACK)
    monkeypatch.setenv("LSLAPICFG", str(tmp_path / "lsl.cfg"))
    done = subprocess.run(
        [sys.executable, "-c", dialogue],
        capture_output=True,
        text=True,
        timeout=2 * HANG_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("module", "extra", "make"),
    [
        ("pylsl", "lsl", lambda: LslOutlet(1000.0, "test")),
        ("pylsl", "lsl", lambda: LslMarkers("paradigm")),
        ("pythonosc.udp_client", "osc", lambda: OscOutlet("127.0.0.1:9")),
    ],
)
def test_a_missing_package_names_its_extra(monkeypatch, module, extra, make):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(HapticError) as missing:
        make()
    assert missing.value.code == "missing_package"
    assert f"haptic-driver[{extra}]" in missing.value.hint
