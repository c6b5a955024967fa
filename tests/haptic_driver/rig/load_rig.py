"""A finger's body on a load stage, behind the stage's driver: time passes as the wire answers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from haptic_driver.rig.load_controller import LoadSettings, Phase
from haptic_driver.rig.load_loop import LoadLoop
from hw.errors import DeviceTimeout
from hw.finger.body import BodySettings, Elastic, FingerBody
from hw.force.sensor import ForceReading
from hw.health import FORCE, with_health
from hw.serving.memory import MemoryTransport
from hw.stage.letting_go import Mounting
from hw.stage.lts150 import Lts150, StageSettings
from tests.hw.testing.faulty_stage import FaultyLts150

STAGE = StageSettings(
    travel_low_m=0.0,
    travel_high_m=0.150,
    velocity_m_s=0.050,
    acceleration_m_s2=0.050,
    velocity_limit_m_s=0.050,
    acceleration_limit_m_s2=0.050,
)
MOUNTING = Mounting(towards=1, clear_m=0.0)
DT_S = 1e-3
BYTE_S = 10.0 / 115_200.0
FACE_M = 0.010  # stage position at which the skin touches
CUTOFF_HZ = 13.8 * 20.0  # of friction that follows its steady value, at 20 mm/s
SENSOR_NOISE_N = 3e-3


class Finger:
    """Body, stage and touch on one clock that passes in steps of `DT_S`, whoever sleeps.

    `voltage_on` says when 80 V attract; friction and attraction are then as assumed here. The plate
    is not level: sliding at 20 mm/s lifts it at `tilt_m_s`. `reply_s` is what the interface adds to
    the wire's time per answer.
    """

    def __init__(
        self,
        elastic: Elastic | None = None,
        body: BodySettings | None = None,
        *,
        reply_s: float = 0.004,
        tilt_m_s: float = 0.1e-3,
        voltage_on: Callable[[float], bool] = lambda time_s: False,
        sensor: Callable[[float, float], ForceReading | None] | None = None,
    ) -> None:
        self.now_s = 0.0
        self.body = FingerBody(elastic, body)
        self.face_m = FACE_M
        self.told: list[tuple[float, float]] = []  # time and load, at every step
        self._reply_s, self._tilt_m_s, self._voltage_on = reply_s, tilt_m_s, voltage_on
        self._friction_n = 0.0
        self._sensor = sensor
        self._noise = np.random.default_rng(1)
        self.slides = False
        self._there = False  # the finger comes when the stage has homed
        self.instrument = FaultyLts150(lambda: self.now_s)
        transport = MemoryTransport(self, clock=lambda: self.now_s)
        self.stage = Lts150(transport, STAGE, clock=lambda: self.now_s, sleep=self.sleep)
        self.stage.connect()
        self.stage.home()
        self.stage.wait(60.0)
        self.stage.move_to(FACE_M - 2e-3)
        self.stage.wait(60.0)
        self._there = True

    def handle(self, data: bytes) -> bytes:
        answer = self.instrument.handle(data)
        taken_s = BYTE_S * (len(data) + len(answer)) + (self._reply_s if answer else 0.0)
        self.sleep(taken_s)
        return answer

    def sleep(self, duration_s: float) -> None:
        """Let time pass; the finger lives meanwhile."""
        end_s = self.now_s + duration_s
        while self.now_s < end_s - 1e-12:
            dt_s = min(DT_S, end_s - self.now_s)
            self.now_s += dt_s
            if self._there:
                self._live(dt_s)

    def read_force(self) -> ForceReading:
        load_n = self.body.load_n + float(self._noise.normal(0.0, SENSOR_NOISE_N))
        if self._sensor is not None:
            reading = self._sensor(self.now_s, load_n)
            if reading is None:
                raise DeviceTimeout("the sensor is silent", "")
            return reading
        return ForceReading(self.now_s, load_n, self._friction_n, False)

    def _live(self, dt_s: float) -> None:
        if self.slides:
            self.face_m -= self._tilt_m_s * dt_s
        on = self._voltage_on(self.now_s)
        cof, attraction_n = (0.7, 0.25) if on else (0.4, 0.0)
        steady_n = cof * self.body.load_n if self.slides else 0.0
        self._friction_n += (steady_n - self._friction_n) * -math.expm1(
            -2.0 * math.pi * CUTOFF_HZ * dt_s
        )
        depth_m = 1e-3 * self.instrument.position_mm - self.face_m
        self.body.step(
            dt_s,
            depth_m,
            attraction_n=attraction_n if self.body.load_n > 0.0 else 0.0,
            friction_n=self._friction_n,
        )
        self.told.append((self.now_s, self.body.load_n))

    def loop(self, settings: LoadSettings, last_m: float | None = None) -> LoadLoop:
        return LoadLoop(
            self.stage,
            with_health(SimpleNamespace(read=self.read_force), "sensor", FORCE, lambda: self.now_s),
            settings,
            MOUNTING,
            clock=lambda: self.now_s,
            sleep=self.sleep,
            last_m=last_m,
        )

    def held(self, loop: LoadLoop, until_s: float) -> None:
        """Look until then, or until the loop has ended."""
        while self.now_s < until_s and loop.look().phase is not Phase.ENDED:
            pass

    def load(self, since_s: float, until_s: float) -> np.ndarray:
        """The true load every `DT_S`."""
        times, loads = np.array(self.told).T
        return np.interp(np.arange(since_s, until_s, DT_S), times, loads)


@dataclass(frozen=True)
class Score:
    """How well a load was held; shares of the target. `settled_s` counts from the first touch until
    the load below 5 Hz stays within 10 %.
    """

    settled_s: float
    overshoot: float
    slow: float
    fast: float


def slow_part(load_n: np.ndarray) -> np.ndarray:
    """What lies below 5 Hz, by a brick wall; the mean stays."""
    spectrum = np.fft.rfft(load_n)
    spectrum[np.fft.rfftfreq(len(load_n), DT_S) > 5.0] = 0.0
    return np.fft.irfft(spectrum, len(load_n))


def score(finger: Finger, settings: LoadSettings, seconds: float = 12.0) -> Score:
    """Approach, settle, slide for `seconds` from 2 s after the touch."""
    loop = finger.loop(settings)
    while loop.look().phase is not Phase.HOLD:
        if loop.state.phase is Phase.ENDED:
            raise AssertionError(loop.state.reason)
    touched_s = finger.now_s
    finger.held(loop, touched_s + 2.0)
    finger.slides = True
    finger.held(loop, touched_s + 2.0 + seconds)
    if loop.state.phase is Phase.ENDED:
        raise AssertionError(loop.state.reason)
    first = finger.load(touched_s, touched_s + 2.0) / settings.target_n
    mean = np.convolve(first, np.ones(200) / 200, mode="same")[:1900]
    outside = np.flatnonzero(abs(mean - 1.0) > 0.1)
    held = finger.load(touched_s + 2.0, touched_s + 2.0 + seconds) / settings.target_n
    slow = slow_part(held)
    return Score(
        float(outside[-1] + 1) * DT_S if len(outside) else 0.0,
        float(first.max() - 1.0),
        float(np.sqrt(np.mean((slow - 1.0) ** 2))),
        float(np.std(held - slow)),
    )
