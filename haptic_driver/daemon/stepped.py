"""A slide rendered by the daemon's own parts in simulated time: what `haptic demo` does, however
slow the machine.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from haptic_driver.daemon.envelope_process import EnvelopeLoop
from haptic_driver.daemon.output_pump import OutputPump
from haptic_driver.daemon.readings import Readings, touch_estimate, with_electrode
from haptic_driver.daemon.render_process import Renderer, RenderSettings
from haptic_driver.daemon.set_up import reach_hz
from haptic_driver.daemon.supervision import carried
from haptic_driver.live.current_sensor import ElectrodeWatch
from haptic_driver.processes.real_time import Due
from haptic_driver.processes.shared_memory import Order, SharedState
from haptic_driver.render.texture import Target, Texture
from haptic_driver.rig.actuator import make_actuator
from haptic_driver.rig.devices import modulation_input
from haptic_driver.rig.envelope_writer import EnvelopeWriter, Lead
from haptic_driver.rig.part import NoPart
from haptic_driver.rig.parts.finger_trackers import reports_of
from haptic_driver.rig.slide import Slide
from haptic_driver.signals import TICK_S
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.simulation.slide import SlideRecord
from hw.finger.simulated_touch_screen import PANEL, SCREEN, TOUCH_N, SimulatedTouchScreen
from hw.finger.touch_screen import TouchEvents, TouchReports, TouchScreen
from hw.monitor.contract import ElectrodeReading

FINGER_Y_M = 0.030
UP_TICKS = 300  # more than START_S
BEGUN = Order(0, 1, True, math.inf, math.inf, 0, 0)


class SteppedDaemon:
    """Sensors, render, pump and envelope of a simulated rig that was made with `envelope`, by one
    simulated clock. Its touch screen reports as often as the rig's file says.

    Between `connect` and `close`, inside the rig's own `with` block. `model`: by which friction is
    estimated on a rig without a force sensor.
    """

    def __init__(
        self,
        settings: RenderSettings,
        bench: SimulatedRig,
        texture: Target,
        model: str = "reference",
    ) -> None:
        self.bench = bench
        self.shared = SharedState()
        self.failures: list[BaseException] = []
        output = bench.config.output
        self._pump = OutputPump(
            self.shared,
            output.setpoint_interval_s,
            output.linger_s,
            self.failures.append,
            self._now_s,
        )
        self._pump.actuator = make_actuator(bench.config, bench.rig)
        self._renderer = Renderer(settings, self.shared, clock=self._now_s)
        self._envelope = self._envelope_loop()
        interval_s = reports_of(bench.config.finger_tracker).interval_s
        panel = replace(PANEL, report_rate_hz=1.0 / interval_s) if interval_s else PANEL
        self._panel = SimulatedTouchScreen(panel, clock=self._now_s)
        os.set_blocking(self._panel.descriptor, False)
        reports = TouchReports(
            self._panel.descriptor,
            TouchEvents(None),
            name="simulated touch screen",
            close=lambda: os.close(self._panel.descriptor),
        )
        self._screen = TouchScreen(reports, SCREEN, clock=self._now_s)
        self._readings = Readings(bench.config, self._screen.read, bench.read_force, self._now_s)
        estimate = touch_estimate(bench.config, lambda: model)
        self._watch = ElectrodeWatch(
            self._electrode, partial(carried, self.shared), estimate, self._now_s
        )
        self._looks = estimate is not None
        self._looked_s = -math.inf
        self._order = BEGUN
        self._ticks = 0
        self.play(texture)

    @property
    def rejections(self) -> int:
        """How often the safety gate said no."""
        return self._renderer.rejections

    def play(self, texture: Target) -> None:
        """Render this from the next tick on."""
        number, target = self._order.number + 1, self._order.target + 1
        self.shared.targets.write(target, texture)
        self._order = self._order._replace(number=number, target=target)

    def connect(self) -> None:
        """Connect the rig and let out what render decides from now on."""
        self.bench.rig.connect()
        self._pump.open(self._order.number)

    def tick(self, position_m: float, normal_force_n: float, speed_m_s: float) -> None:
        """Let a tick pass with the finger pressing and sliding so. Raises HapticError for what
        failed.
        """
        self._ticks += 1
        self.bench.step(TICK_S, normal_force_n, speed_m_s)
        now_s = self._now_s()
        if normal_force_n >= TOUCH_N:
            self._panel.put(position_m, FINGER_Y_M)
        else:
            self._panel.lift()
        if self._looks and now_s - self._looked_s >= self._watch.period_s:
            self._looked_s = now_s
            self._watch.look()
        sensed = self._readings.read()
        self.shared.sensed.write(with_electrode(sensed, self._watch.newest()))
        self.shared.order.write(self._order._replace(beat_s=now_s))
        self._pump.turn(now_s)  # what render said a tick ago
        self._renderer.step(Due(self._ticks, now_s, 0.0, 0))
        if self._envelope is not None:
            self._envelope.turn(now_s)
        if self.failures:
            raise self.failures[0]

    def close(self) -> None:
        """Nothing more goes out; the rig is its own to switch off."""
        self._pump.close()
        self._screen.close()
        os.close(self._panel.output)
        self.shared.close()

    def _now_s(self) -> float:
        return self.bench.instruments.time_s

    def _electrode(self, frequency_hz: float) -> ElectrodeReading | None:
        return self.bench.electrode.read(frequency_hz, self.bench.instruments.voltage_v)

    def _envelope_loop(self) -> EnvelopeLoop | None:
        config, output = self.bench.config, self.bench.analog_output
        section, modulation = config.analog_output, modulation_input(config)
        if output is None or modulation is None or isinstance(section, NoPart):
            return None
        rise_v_per_s = config.output.voltage_rise_v_per_s
        rate_hz = output.plays_at(section.envelope_rate_hz)
        writer = EnvelopeWriter(output, modulation, rate_hz, rise_v_per_s)
        return EnvelopeLoop(self.shared, writer, Lead(section.lead_s, section.buffer_s))


def render_slide(
    slide: Slide,
    texture: Texture,
    settings: RenderSettings,
    bench: SimulatedRig,
    progress: Callable[[int], None] = lambda tick: None,
    model: str = "reference",
) -> SlideRecord:
    """Run a slide tick by tick; `progress` is called with every tick's number. `model`: see
    `SteppedDaemon`.

    The rig is connected here and switched off at the end, whatever happens. Raises HapticError.
    """
    count = slide.time_s.size
    voltage_v, frequency_hz, samples = np.empty(count), np.empty(count), []
    saturated = np.zeros(count, bool)
    daemon = SteppedDaemon(settings, bench, texture, model)
    try:
        daemon.connect()
        for _ in range(UP_TICKS):  # as at a daemon that renders already when the finger comes
            daemon.tick(float(slide.position_m[0]), 0.0, 0.0)
        speed_m_s = slide.speed_m_s.tolist()
        for i, (x_m, load_n) in enumerate(
            zip(slide.position_m.tolist(), slide.normal_force_n.tolist(), strict=True)
        ):
            daemon.tick(x_m, load_n, speed_m_s[i])
            samples.append(daemon.shared.ring.newest(1))
            voltage_v[i], frequency_hz[i] = (
                bench.instruments.voltage_v,
                bench.instruments.frequency_hz,
            )
            saturated[i] = daemon.shared.sensed.read().saturated
            progress(i)
    finally:
        off = bench.rig.off()
        daemon.close()
    config = bench.config
    return SlideRecord(
        slide=slide,
        samples=np.concatenate(samples),
        voltage_v=voltage_v,
        frequency_hz=frequency_hz,
        off_screen=slide.normal_force_n < 0.5 * settings.tick.finger.contact_off_n,
        saturated=saturated,
        lowest_voltage_v=bench.rig.minimum_voltage_v,
        max_voltage_v=bench.amplifier.max_voltage_v,
        rejections=daemon.rejections,
        off=off,
        reach_hz=reach_hz(config),
        noise_n=config.simulation.force_noise_n,
    )
