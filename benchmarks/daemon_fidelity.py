"""What the daemon renders by its own recordings, in real time and with default settings, beside the
demo's.

Each shipped texture at 20 and 80 mm/s with a lift every 2 s, on both simulated rigs; gaps of the
envelope in ten minutes idle and beside four busy loops.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.claim import Claim
from haptic_driver.client import HapticClient
from haptic_driver.config import texture_dirs
from haptic_driver.daemon.messages import Status
from haptic_driver.daemon.set_up import reach_hz, render_settings
from haptic_driver.daemon.stepped import render_slide
from haptic_driver.errors import HapticError
from haptic_driver.fidelity.measure import Fidelity
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.fidelity.samples import fidelity_of_samples
from haptic_driver.fidelity.sliding import AFTER_TOUCH_S, since_touch_s, sliding
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.recording.read import read_run
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.textures.bands import CENTRES_HZ
from haptic_driver.textures.library import load_texture
from model.touch_model import TouchModel
from tests.even_strokes import even_strokes, write_slide

RIGS = ("simulated", "simulated-envelope")
TEXTURES = (
    "linen",
    "grating",
    "ridges",
    "braille",
    "fine_grating",
    "sandpaper",
    "brushed_metal",
    "ratchet",
    "ramp",
)
PROMISED = ("linen", "grating", "ridges", "braille")
SPEEDS_M_S = (0.020, 0.080)
TEXTURE_S = {"simulated": 15.0, "simulated-envelope": 33.5}  # of the latter: ten minutes in all
LEARNING_S = 5.0  # of an unknown finger, before the first texture
LOADED_S, BUSY_LOOPS = 600.0, 4
LOG = Path(tempfile.gettempdir(), "haptic-daemon-fidelity.log")
BUSY = "while True: pass"


class Rendered(NamedTuple):
    """One texture in the daemon, or in the demo: what of it was measured."""

    fidelity: Fidelity
    on: float  # share of sliding time
    first: float  # share of the first 0.1 s of touches within 10 %
    switched: int
    lifts: int

    @property
    def within(self) -> float:
        """Share of sliding time within 5 %, 0 where nothing is known."""
        return self.fidelity.share_within_5_percent or 0.0


Table = dict[tuple[str, str, float], Rendered]  # of rig, texture, speed; without those at fault


def run() -> Iterator[Claim]:
    surface_of = {rig: load_rig(rig) for rig in RIGS}
    found: Table = {}
    demos: Table = {}
    for rig in RIGS:
        gaps = 0
        for speed_m_s in SPEEDS_M_S:
            with _daemon(rig, speed_m_s) as client:
                for texture in TEXTURES:
                    try:
                        status, rendered, dry = _rendered(
                            client, surface_of[rig], texture, TEXTURE_S[rig]
                        )
                    except HapticError as error:
                        yield _faulty(
                            client, f"{rig}, {texture} at {1e3 * speed_m_s:g} mm/s", error
                        )
                        continue
                    found[rig, texture, speed_m_s] = rendered
                    gaps += dry
                    demo = _demo(surface_of[rig], texture, speed_m_s)
                    demos[rig, texture, speed_m_s] = demo
                    yield _line(rig, texture, speed_m_s, rendered, demo)
                    yield _latency(f"{rig}, {texture}", speed_m_s, status)
        if rig == "simulated-envelope":
            yield Claim(
                "gaps of an envelope in ten minutes, idle", str(gaps), "at most 1", gaps <= 1
            )
    yield from _promised(found, demos)
    yield _loaded()


def _faulty(client: HapticClient, what: str, error: HapticError) -> Claim:
    """A texture that ended in a fault; the daemon is made ready for the next."""
    fault = client.status().fault
    client.reset()
    return Claim(what, fault or str(error), "no fault", holds=False)


@contextmanager
def _daemon(rig: str, speed_m_s: float) -> Iterator[HapticClient]:
    """`haptic daemon run` with a finger that makes even strokes."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as ending:
        slide, socket = Path(folder, "slide.csv"), Path(folder, "daemon.sock")
        write_slide(even_strokes(speed_m_s), slide)
        command = [str(Path(sys.executable).with_name("haptic")), "daemon", "run", "--json"]
        command += ["--rig", rig, "--socket", str(socket), "--slide", str(slide)]
        log = ending.enter_context(open(LOG, "a"))
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log)
        ending.callback(process.wait)
        ending.callback(process.terminate)
        assert process.stdout is not None
        if not process.stdout.readline():
            raise RuntimeError("the daemon did not start")
        yield ending.enter_context(HapticClient(socket))


def _rendered(
    client: HapticClient, config: RigConfig, texture: str, seconds: float
) -> tuple[Status, Rendered, int]:
    """Play a texture for so long, record it, and judge the recording; gaps of the envelope
    besides.
    """
    with tempfile.TemporaryDirectory() as folder, client.armed(2.0) as session:
        path = Path(folder, "run.h5")
        session.play(texture, nearest=True)
        time.sleep(LEARNING_S)
        before = client.status()
        client.record(path)
        time.sleep(seconds)
        status = client.record(None)
        session.off()
        samples = read_run(path).samples
    switched = status.switched - before.switched
    return status, _judged(samples, config, switched), status.underruns - before.underruns


def _demo(config: RigConfig, texture: str, speed_m_s: float) -> Rendered:
    """The same in simulated time: two touches, after two in which the finger becomes known."""
    description = load_model("reference")
    settings = render_settings(config, build_surface(description, config.operating_limits()))
    wanted = load_texture(texture, texture_dirs())
    with SimulatedRig(config, TouchModel(description), envelope=True) as bench:
        slide = even_strokes(speed_m_s, touches=4)
        record = render_slide(slide, wanted, settings, bench)
    return _judged(record.samples[record.samples.size // 2 :], config, 0)


def _judged(samples: NDArray[np.void], config: RigConfig, switched: int) -> Rendered:
    there, since_s = sliding(samples), since_touch_s(samples)
    fidelity = fidelity_of_samples(
        samples, load_perception(), reach_hz(config), config.simulation.force_noise_n
    )
    begun = there & (since_s < AFTER_TOUCH_S) & np.isfinite(samples["target_cof"])
    begun &= samples["reachable"] == 1
    error = samples["measured_cof"][begun] / samples["target_cof"][begun] - 1.0
    return Rendered(
        fidelity=fidelity,
        on=float(np.mean(samples["output_on"][there] == 1)),
        first=float(np.mean(np.abs(error) <= 0.10)) if error.size else float("nan"),
        switched=switched,
        lifts=int(np.count_nonzero(np.diff(samples["in_contact"].astype(int)) == -1)),
    )


def _line(rig: str, texture: str, speed_m_s: float, daemon: Rendered, demo: Rendered) -> Claim:
    """Daemon and demo side by side."""
    one, other = daemon.fidelity, demo.fidelity
    words = (
        f"within 5 % {_share(one.share_within_5_percent)} (demo"
        f" {_share(other.share_within_5_percent)}, "
    )
    words += f"a constant {_share(one.constant_share_within_5_percent)}); "
    words += (
        f"rms {_share(one.relative_error_rms, 1)} (demo {_share(other.relative_error_rms, 1)}); "
    )
    words += f"on {_share(daemon.on, 1)}; first 0.1 s within 10 % {_share(daemon.first)}; "
    words += f"switched {daemon.switched} in {daemon.lifts} lifts; gain {_gains(one)}"
    return Claim(f"{rig}, {texture} at {1e3 * speed_m_s:g} mm/s", words)


def _promised(found: Table, demos: Table) -> Iterator[Claim]:
    """What is promised of the table."""
    least_on = min(found.values(), key=lambda each: each.on).on
    what = "output on while sliding, least of all"
    yield Claim(what, _share(least_on, 1), "at least 99 %", least_on >= 0.99)
    shares = {
        (texture, speed): each.within
        for (rig, texture, speed), each in found.items()
        if rig == "simulated-envelope" and texture in PROMISED
    }
    texture, speed = key = min(shares, key=shares.__getitem__)
    what = "simulated-envelope: within 5 %, least of linen, grating, ridges, braille"
    told = f"{_share(shares[key])} ({texture} at {1e3 * speed:g} mm/s)"
    yield Claim(what, told, "at least 90 %", shares[key] >= 0.90)
    # What SCPI allows is what the same controller reaches in simulated time.
    ratios = {
        (texture, speed): found["simulated", texture, speed].within / demo.within
        for (rig, texture, speed), demo in demos.items()
        if rig == "simulated" and texture in PROMISED and demo.within > 0.0
    }
    texture, speed = key = min(ratios, key=ratios.__getitem__)
    what = "simulated: within 5 %, of what SCPI allows (the demo), least of the same"
    told = f"{_share(ratios[key])} ({texture} at {1e3 * speed:g} mm/s)"
    yield Claim(what, told, "at least 95 %", ratios[key] >= 0.95)
    gains = [
        gain
        for (rig, _, _), each in found.items()
        if rig == "simulated-envelope"
        for gain, centre_hz in zip(each.fidelity.band_gain, CENTRES_HZ.tolist(), strict=True)
        if gain is not None and centre_hz <= 100.0
    ]
    told = f"{min(gains):.2f} to {max(gains):.2f} in {len(gains)} bands"
    holds = min(gains) >= 0.8 and max(gains) <= 1.2
    yield Claim("envelope: gain of felt against asked up to 100 Hz", told, "0.8 to 1.2", holds)
    first = {
        f"{rig}, {texture} {1e3 * speed:g}": each.first
        for (rig, texture, speed), each in found.items()
    }
    for rig in RIGS:
        own = {name: share for name, share in first.items() if name.startswith(f"{rig},")}
        least = min(own, key=own.__getitem__)
        told = (
            f"{_share(own[least])} of it ({least} mm/s), mean"
            f" {_share(float(np.mean(list(own.values()))))}"
        )
        yield Claim(f"{rig}: first 0.1 s of touches within 10 %, least of all", told)
    most = max(each.switched / max(each.lifts, 1) for each in found.values())
    yield Claim(
        "switchings of the generator's output per lift, most of all",
        f"{most:.2f}",
        "at most 1",
        most <= 1.0,
    )


def _latency(rig: str, speed_m_s: float, status: Status) -> Claim:
    budget_s = status.latency_budget_s["total"]
    what = f"{rig} at {1e3 * speed_m_s:g} mm/s: latency measured against expected"
    if status.latency_measured_s is None:
        return Claim(what, f"cannot be told; {1e3 * budget_s:.1f} ms expected")
    off_s = status.latency_measured_s - budget_s
    told = f"{1e3 * status.latency_measured_s:.1f} ms, {1e3 * budget_s:.1f} ms expected"
    return Claim(what, told, "within 5 ms", abs(off_s) <= 5e-3)


def _loaded() -> Claim:
    """Gaps beside busy loops."""
    with _daemon("simulated-envelope", SPEEDS_M_S[0]) as client, ExitStack() as ending:
        for _ in range(BUSY_LOOPS):
            busy = subprocess.Popen([sys.executable, "-c", BUSY])
            ending.callback(busy.wait)
            ending.callback(busy.kill)
        try:
            config = load_rig("simulated-envelope")
            status, rendered, gaps = _rendered(client, config, "linen", LOADED_S)
        except HapticError as error:
            return _faulty(client, f"the same beside {BUSY_LOOPS} busy loops", error)
    words = (
        f"{gaps}; linen within 5 % {_share(rendered.fidelity.share_within_5_percent)}, on"
        f" {_share(rendered.on, 1)}"
    )
    words += f", lead {1e3 * status.latency_budget_s['envelope']:.1f} ms"
    return Claim(f"the same beside {BUSY_LOOPS} busy loops", words, "at most 10", gaps <= 10)


def _share(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{100.0 * value:.{digits}f} %"


def _gains(fidelity: Fidelity) -> str:
    return " ".join("-" if gain is None else f"{gain:.2f}" for gain in fidelity.band_gain)
