"""Carrier and envelope as the samples of one analog output, in place of a waveform generator.

Amplitudes go from one to the next within a block, straight in voltage squared, which force follows.
A card holds a direct voltage when its samples run out, or when its driver dies. The output's own
watch takes an underrun to zero; the watchdog handles a dead driver.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from hw.analog.output import QUIET_V, AnalogOutput, Array, OutputUnderrun
from hw.errors import BadReply, DeviceError, LimitExceeded, SwitchedOff
from hw.generator.analog_carrier.gate import SampleGate
from hw.generator.contract import GeneratorReport
from hw.generator.settings import ExternalModulation, GeneratorSettings, Shape
from hw.setting import Setting

AMPLITUDE_LOW_VPP, AMPLITUDE_HIGH_VPP = 0.02, 20.0
SAMPLES_PER_PERIOD = 20  # steps of a converter take 0.4 % of a sine with so many
TURN_S = 0.002  # between looks at what is still to be played


@dataclass(frozen=True)
class CarrierSettings:
    """`lead_s`: so far ahead the carrier is written; so late a new amplitude is there."""

    sample_rate_hz: float
    lead_s: float = 0.02


class AnalogCarrier:
    """A `Generator` on an analog output: sines without offset, switched by their samples.

    A thread writes ahead, unless `output` is not watched and somebody else calls `pump`. Evidence
    of off is what the output reads back; None where it cannot. Thread-safe.
    """

    def __init__(
        self, output: AnalogOutput, settings: GeneratorSettings, carrier: CarrierSettings
    ) -> None:
        self.settings, self._carrier = settings, carrier
        self._output = output
        self._lock = threading.RLock()
        self._rate_hz = carrier.sample_rate_hz
        self._gate = SampleGate(settings, self._rate_hz)
        self._frequency_hz, self._amplitude_v = settings.frequency_low_hz, 0.0
        self._written_v, self._phase_rad = 0.0, 0.0
        self._on = self._is_open = False
        self._failure: DeviceError | None = None

    @property
    def minimum_voltage_v(self) -> float:
        """The lowest peak at the electrode that is worth its samples."""
        return 0.5 * AMPLITUDE_LOW_VPP * self.settings.volts_per_volt

    def identify(self) -> GeneratorReport:
        """Only read back: opening an output puts out a level."""
        read_v = self._output.read_back_v()
        on = read_v is not None and read_v > QUIET_V
        said = "does not read back" if read_v is None else f"{read_v:.3g} V at its terminal"
        return GeneratorReport(self._output.resource, "none", "none", on, True, said, self._held())

    def held(self) -> list[Setting]:
        """What was asked of the output and what it got."""
        return list(self._held())

    def connect(self) -> None:
        """Open at zero, read back, and find out at which rate it plays."""
        with self._lock:
            self._output.open()
            try:
                self._rate_hz = self._output.plays_at(self._carrier.sample_rate_hz)
                if self._rate_hz < SAMPLES_PER_PERIOD * self.settings.frequency_high_hz * 0.99:
                    raise BadReply(
                        f"{self._output.resource} plays {self._rate_hz:g} samples/s, too few for"
                        f" {self.settings.frequency_high_hz:g} Hz",
                        f"take a faster output, or a carrier of {SAMPLES_PER_PERIOD} samples",
                    )
                self._gate = SampleGate(self.settings, self._rate_hz)
                if self.off() is False:
                    raise BadReply(
                        f"{self._output.resource} is not at zero after it was set to zero",
                        "is another program at it?",
                    )
            except BaseException:
                self._output.close()
                raise
            if not self._is_open and self._output.watched:
                threading.Thread(target=self._run, name="analog carrier", daemon=True).start()
            self._is_open = True

    def set_point(
        self,
        frequency_hz: float,
        voltage_v: float,
        voltage_offset_v: float = 0.0,
        *,
        shape: Shape = Shape.SINE,
        modulation: ExternalModulation | None = None,
    ) -> None:
        """What goes out from the next block on; raises as `Generator` says."""
        settings = self.settings
        if shape is not Shape.SINE or voltage_offset_v != 0.0 or modulation is not None:
            raise self._refused("makes sines without offset or modulation")
        if not settings.frequency_low_hz <= frequency_hz <= settings.frequency_high_hz:
            raise self._refused(f"{frequency_hz:g} Hz is outside its carriers")
        if not self.minimum_voltage_v <= voltage_v <= settings.voltage_limit_v:
            raise self._refused(f"{voltage_v:g} V is outside what the rig allows")
        with self._lock:
            self._check()
            self._frequency_hz = frequency_hz
            self._amplitude_v = voltage_v / settings.volts_per_volt
            self.pump()
            self._check()

    def set_output(self, on: bool) -> None:
        """On, from zero; or off, read back."""
        if not on:
            if self.off() is False:
                raise BadReply(f"{self._output.resource} reads back a voltage", "look at it")
            return
        with self._lock:
            self._failure = None
            self._output.zero()
            self._gate.forget()
            self._written_v = self._phase_rad = 0.0
            self._on = True
            self.pump()
            self._check()

    def is_on(self) -> bool:
        """By what is read back; by what is written where it is not."""
        read_v = self._output.read_back_v()
        return self._on if read_v is None else read_v > QUIET_V

    def off(self) -> bool | None:
        """Zero at once, whatever is waiting, and read back. Never raises DeviceError.

        It waits for no call that hangs. Without the lock a block that is under way may still come,
        and the read-back then shows it.
        """
        free = self._lock.acquire(timeout=self.settings.reply_timeout_s)
        try:
            self._on = False
            with suppress(DeviceError):
                self._output.zero()
            self._gate.forget()
        finally:
            if free:
                self._lock.release()
        try:
            read_v = self._output.read_back_v()
        except DeviceError:
            return None
        return None if read_v is None else read_v <= QUIET_V

    def close(self) -> bool | None:
        """`off`, and let go of the output."""
        evidence = self.off()
        self._is_open = False
        with suppress(DeviceError):
            self._output.close()
        return evidence

    def pump(self) -> None:
        """Write what is missing of the lead; what fails is raised by the next call of others."""
        with self._lock:
            if not self._on:
                return
            try:
                self._output.check()
                missing_s = self._carrier.lead_s - self._output.buffered_s
                count = int(missing_s * self._rate_hz)
                if count < 1:
                    return
                block_v = self._block(count)
                self._gate.check(block_v, self._rate_hz)
                self._output.write(block_v, self._rate_hz)
                self._written_v = self._amplitude_v
            except DeviceError as error:
                self._on, self._failure = False, error
                if isinstance(error, OutputUnderrun):  # a machine was late: it may come on again
                    self._failure = SwitchedOff(error.message, error.hint)
                with suppress(DeviceError):
                    self._output.zero()
                self._gate.forget()

    def _block(self, count: int) -> Array:
        """The carrier, on from where it is."""
        share = np.arange(1, count + 1) / count
        power_v2 = (1.0 - share) * self._written_v**2 + share * self._amplitude_v**2
        step_rad = 2.0 * np.pi * self._frequency_hz / self._rate_hz
        phase_rad = self._phase_rad + step_rad * np.arange(1, count + 1)
        self._phase_rad = float(phase_rad[-1] % (2.0 * np.pi))
        return np.asarray(np.sqrt(power_v2) * np.sin(phase_rad))

    def _run(self) -> None:
        while self._is_open or self._on:
            self.pump()
            time.sleep(TURN_S)

    def _check(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _held(self) -> tuple[Setting, ...]:
        asked = Setting("sample_rate_hz", self._carrier.sample_rate_hz, None)
        return tuple(self._output.held()) or (asked,)

    def _refused(self, why: str) -> LimitExceeded:
        return LimitExceeded(
            f"{self._output.resource}: {why}; nothing was written",
            "stay within the rig's limits; for zero volts switch the output off",
        )
