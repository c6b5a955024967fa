from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.analog.cards import make_card
from hw.analog.output import AnalogOutputSettings, OutputUnderrun
from hw.analog.sound_card import SoundCardOutput, SoundSettings
from hw.errors import DeviceDisconnected, DeviceError, InstrumentRejected, LimitExceeded
from hw.generator.analog_carrier.driver import AnalogCarrier, CarrierSettings
from hw.generator.settings import GeneratorSettings
from tests.hw.testing.sound_card import OutputStream, install

SETTINGS = AnalogOutputSettings(
    low_v=-1.0,
    high_v=1.0,
    zero_level_v=0.0,
    sample_rate_limit_hz=48e3,
    buffer_s=0.1,
    lease_s=0.5,
    timeout_s=0.2,
)


@pytest.fixture(autouse=True)
def _sounddevice(monkeypatch):
    install(monkeypatch)


def card(**kwargs: Any) -> SoundCardOutput:
    sound = SoundSettings(48e3, 2.0, dc_coupled=True)
    sound = sound._replace(
        **{name: kwargs.pop(name) for name in SoundSettings._fields if name in kwargs}
    )
    return SoundCardOutput("DAC", SETTINGS, sound, **({"watch": False} | kwargs))


def test_blocks_come_out_scaled_in_order_on_their_channel():
    with card(channel=1) as output:
        output.write([0.2, 0.4, 0.6], 48e3)
        output.write([0.8, 1.0], 48e3)
        first, second = OutputStream.newest.pull(4), OutputStream.newest.pull(4)
    played = np.concatenate((first, second))
    assert played[:, 1].tolist() == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.5, 0.5])
    assert played[:, 0].tolist() == [0.0] * 8
    assert OutputStream.newest.state == "closed"


def test_running_dry_keeps_the_last_sample_for_a_moment_then_gives_zero_and_is_reported():
    now = [0.0]
    with card(clock=lambda: now[0]) as output:
        output.write([1.0, 1.0], 48e3)
        assert OutputStream.newest.pull(3)[:, 0].tolist() == [0.5, 0.5, 0.5]
        output.write([0.6], 48e3)
        assert OutputStream.newest.pull(2)[:, 0].tolist() == pytest.approx([0.3, 0.3])
        assert output.gaps == 1
        now[0] = 0.1
        with pytest.raises(OutputUnderrun) as refused:
            output.write([1.0], 48e3)
        assert refused.value.code == "output_underrun"
        assert OutputStream.newest.pull(1)[0, 0] == 0.0


def test_an_underflow_of_the_card_itself_ends_the_stream():
    now = [0.0]
    with card(clock=lambda: now[0]) as output:
        output.write(np.full(1000, 1.0), 48e3)
        assert OutputStream.newest.pull(10, underflow=True).max() == 0.0
        now[0] = 0.1
        with pytest.raises(OutputUnderrun):
            output.check()


def test_a_block_that_arrives_after_an_underflow_does_not_hide_it():
    now = [0.0]
    with card(clock=lambda: now[0]) as output:
        output.write(np.full(1000, 1.0), 48e3)
        OutputStream.newest.pull(10, underflow=True)
        now[0] = 0.1
        output._append(np.full(1000, 1.0))  # the callback came between write's check and its block
        with pytest.raises(OutputUnderrun):
            output.check()
        assert OutputStream.newest.pull(1)[0, 0] == 0.0


def test_a_dc_coupled_card_holds_a_level_until_its_lease_ends():
    now = [0.0]
    with card(clock=lambda: now[0]) as output:
        output.hold(1.0)
        assert OutputStream.newest.pull(5).tolist() == [[0.5, 0.0]] * 5
        now[0] = 0.6
        with pytest.raises(OutputUnderrun):
            output.check()
        assert OutputStream.newest.pull(5).max() == 0.0


def test_an_ac_coupled_card_refuses_to_hold():
    with card(dc_coupled=False) as output:
        output.write([0.5] * 100, 48e3)
        with pytest.raises(LimitExceeded, match="AC-coupled"):
            output.hold(0.5)
        assert OutputStream.newest.pull(1)[0, 0] == 0.25  # the stream goes on
        output.hold(0.0)
    with pytest.raises(ValueError, match="AC-coupled"):
        SoundCardOutput(
            "DAC",
            AnalogOutputSettings(
                low_v=-1.0, high_v=1.0, zero_level_v=-1.0, sample_rate_limit_hz=48e3
            ),
            SoundSettings(48e3, 1.0, dc_coupled=False),
        )


def test_limits_and_rate_are_checked_and_leave_the_stream_alone():
    with card() as output:
        output.write([1.0] * 10, 48e3)
        for block_v, rate_hz in (([1.1], 48e3), ([0.0], 44.1e3)):
            with pytest.raises(LimitExceeded):
                output.write(block_v, rate_hz)
        assert OutputStream.newest.pull(1)[0, 0] == 0.5
    with pytest.raises(ValueError, match="full scale"):
        card(full_scale_v=0.5)


def test_a_card_pulled_out_is_reported():
    output = card()
    output.open()
    OutputStream.newest.abort()
    with pytest.raises(DeviceDisconnected, match="has stopped"):
        output.hold(1.0)
    with pytest.raises(DeviceDisconnected):
        output.close()


def test_an_unknown_device_is_refused():
    output = SoundCardOutput("Dac", SETTINGS, SoundSettings(48e3, 1.0, dc_coupled=True))
    with pytest.raises(InstrumentRejected, match="No output device"):
        output.open()


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(DeviceError) as caught:
        card().open()
    assert "haptic-driver[sound]" in caught.value.hint


def test_without_portaudio_the_library_is_named(monkeypatch):
    monkeypatch.delitem(sys.modules, "sounddevice")
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    pytest.importorskip("_sounddevice", reason="the real sounddevice package is not installed")
    with pytest.raises(DeviceError, match="PortAudio") as caught:
        card().open()
    assert "libportaudio2" in caught.value.hint


@settings(deadline=None, max_examples=40)
@given(count=st.integers(1, 12), channel=st.integers(0, 12), volts=st.floats(-1.0, 1.0))
def test_of_any_card_one_channel_plays_or_it_is_refused(count, channel, volts):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(OutputStream, "channels_there", (1, count))
        output = card(channel=channel)
        if channel >= count:
            with pytest.raises(InstrumentRejected, match=f"has {count} output"):
                output.open()
            return
        with output:
            output.write([volts], 48e3)
            (played,) = OutputStream.newest.pull(1)
    # of 2 V
    assert played[channel] == pytest.approx(0.5 * volts)
    assert not np.delete(played, channel).any()


def test_another_rate_of_the_cards_is_refused_and_left(monkeypatch):
    monkeypatch.setattr(OutputStream, "got_rate_hz", 44_100.0)
    output = card()
    with pytest.raises(InstrumentRejected, match="44100 samples/s where 48000"):
        output.open()
    assert OutputStream.newest.state == "closed"


@pytest.mark.parametrize(
    ("device", "api"),
    [
        *((name, "ALSA") for name in ("pulse", "default", "pipewire", "dmix")),
        ("Built-in Audio", "JACK Audio Connection Kit"),
        ("Speakers", "PulseAudio"),
        ("Primary Sound Driver", "Windows DirectSound"),
    ],
)
@pytest.mark.parametrize("named", [True, False])
def test_a_sound_servers_device_is_refused_by_name(monkeypatch, device, api, named):
    """It says that it has 32 channels, and mixes them to the sockets that there are."""
    monkeypatch.setattr(OutputStream, "devices", (device,))
    monkeypatch.setattr(OutputStream, "channels_there", (2, 32))
    monkeypatch.setattr(OutputStream, "host_api", api)
    sound = SoundSettings(48e3, 2.0, dc_coupled=True)
    output = SoundCardOutput(device if named else None, SETTINGS, sound, watch=False)
    with pytest.raises(InstrumentRejected, match=device):
        output.open()


def test_a_card_whose_callback_stopped_is_lost_and_never_said_to_be_at_zero():
    now = [0.0]
    output = card(clock=lambda: now[0])
    output.open()
    OutputStream.newest.pull(1)
    output.write([0.5] * 2400, 48e3)
    OutputStream.newest.pull(480)
    # a gap and its latency are 30 and 20 ms
    now[0] = 0.06
    with pytest.raises(DeviceDisconnected, match=r"takes no samples.*NOT known to be at zero"):
        output.check()
    assert output.level_v is None
    OutputStream.newest.pull(480)
    with pytest.raises(DeviceDisconnected, match="takes no samples"):
        output.zero()
    with pytest.raises(DeviceDisconnected):
        output.close()
    output.open()
    OutputStream.newest.pull(1)
    assert output.level_v == 0.0
    output.close()


@settings(max_examples=30)
@given(pulls=st.lists(st.tuples(st.integers(1, 480), st.floats(0.0, 0.049)), max_size=6))
def test_a_card_is_lost_when_it_takes_nothing_for_longer_than_it_may(pulls):
    now = [0.0]
    output = card(clock=lambda: now[0])
    output.open()
    OutputStream.newest.pull(1)
    output.write([0.5] * 4700, 48e3)
    for count, gap_s in pulls:
        now[0] += gap_s
        output.check()
        OutputStream.newest.pull(count)
    now[0] += 0.051
    with pytest.raises(DeviceDisconnected, match="takes no samples"):
        output.check()
    with pytest.raises(DeviceDisconnected):
        output.close()


def test_a_level_that_no_callback_takes_is_not_held():
    now = [0.0]
    output = card(clock=lambda: now[0])
    output.open()
    OutputStream.newest.pull(1)
    output.hold(1.0)
    now[0] = 0.06
    with pytest.raises(DeviceDisconnected, match="takes no samples"):
        output.hold(1.0)
    with pytest.raises(DeviceDisconnected):
        output.close()


def named_card(name: str) -> Any:
    """As a rig's file names it; full scale is 1.4 V at its socket. Nothing looks at the time."""
    settings = AnalogOutputSettings(-1.4, 1.4, 0.0, 48e3, buffer_s=0.04, gap_s=60.0)
    output = make_card(f"card:sound:{name}", settings)
    output.watched = False
    return output


@pytest.mark.parametrize(
    ("name", "device", "channel"),
    [("DAC", "DAC", 0), ("DAC/1", "DAC", 1), ("3/1", 3, 1), ("hw:1,0/1", "hw:1,0", 1)],
)
def test_a_cards_name_says_device_and_channel(monkeypatch, name, device, channel):
    monkeypatch.setattr(OutputStream, "devices", ("DAC", 3, "hw:1,0"))
    with named_card(name) as output:
        output.write([0.7, 0.7], 48e3)
        played = OutputStream.newest.pull(2)
    assert OutputStream.newest.device == device
    assert played[:, channel].tolist() == pytest.approx([0.5, 0.5])
    assert played[:, 1 - channel].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", ["another", "DAC/2"])
def test_a_look_tells_a_card_or_channel_that_is_not_there(name):
    assert named_card("DAC").read_back_v() is None
    with pytest.raises(InstrumentRejected):
        named_card(name).read_back_v()


def test_as_a_carrier_it_gives_the_volts_that_were_measured_at_its_socket():
    frames = 960  # the lead
    carrier = AnalogCarrier(
        named_card("DAC/1"), GeneratorSettings(100.0, 140.0, 100.0, 2.4e3), CarrierSettings(48e3)
    )
    carrier.connect()
    carrier.set_point(1000.0, 70.0)
    carrier.set_output(True)
    rising = OutputStream.newest.pull(frames)[:, 1]
    carrier.pump()
    played = OutputStream.newest.pull(frames)[:, 1]
    turns = np.exp(-2j * np.pi * 1000.0 * np.arange(frames) / 48e3)
    assert abs(rising[0]) < 0.02
    assert 2.0 * abs(turns @ played) / frames == pytest.approx(0.7 / 1.4, rel=1e-6)
    assert carrier.off() is None  # nothing reads its socket: others have to say off
    assert OutputStream.newest.pull(4).max() == 0.0
    carrier.close()
