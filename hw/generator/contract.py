"""What a rig asks of a waveform generator, and how a kind of generator makes itself known.

A package adds a kind by an entry point of the group `haptic_driver.generators` that names a
`GeneratorKind`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

from hw import plugins
from hw.generator.settings import Shape
from hw.setting import Setting

if TYPE_CHECKING:
    from hw.generator.settings import ExternalModulation

GROUP = "haptic_driver.generators"
WHAT = "waveform generator"


class GeneratorReport(NamedTuple):
    """What a generator says of itself; `programmed` is for a person, `load_open`: volts are into an
    open circuit. `held`: what its driver sets at connecting, and what is set now.
    """

    identity: str
    serial_number: str
    firmware: str
    output_on: bool
    load_open: bool
    programmed: str
    held: tuple[Setting, ...] = ()


class Generator(Protocol):
    """All that a rig uses. Voltages are peak volts at the electrode. `hw.generator.driver` has most
    of it ready.

    `off` and `close` return what is known, never raise DeviceError: True, it says off; False, it
    says on; None, it does not say. All else raises DeviceError and leaves the output off, or as it
    was where nothing was sent.
    """

    @property
    def minimum_voltage_v(self) -> float:
        """The lowest voltage that can be set; below it, the output is switched off."""

    def identify(self) -> GeneratorReport:
        """Open, and only ask: nothing is set, switched or emptied. BadReply for another
        instrument.
        """

    def connect(self) -> None:
        """Open, reset, and set up a sine of minimum amplitude with the output off, all of it read
        back.
        """

    def set_point(
        self,
        frequency_hz: float,
        voltage_v: float,
        voltage_offset_v: float = 0.0,
        *,
        shape: Shape = Shape.SINE,
        modulation: ExternalModulation | None = None,
    ) -> None:
        """Set what goes out and read it back; LimitExceeded, with nothing sent, for what `settings`
        does not allow.

        For Shape.DC `voltage_v` is the voltage itself. A kind without other `shapes` makes sines
        without offset.
        """

    def set_output(self, on: bool) -> None:
        """Switch the output and read it back."""

    def is_on(self) -> bool:
        """Ask whether the output is on, and change nothing."""

    def off(self) -> bool | None:
        """Lowest level, output off, and ask."""

    def close(self) -> bool | None:
        """`off`, and hang up."""


class TerminalOutput(NamedTuple):
    """What is at the open terminals; both voltages are 0 while the output is off.

    `amplitude_v` is half the peak-to-peak value and `offset_v` the middle between the extremes.
    """

    frequency_hz: float
    amplitude_v: float
    offset_v: float
    on: bool
    shape: Shape = Shape.SINE


@dataclass(frozen=True)
class GeneratorLatency:
    """Simulated time from a command to its effect at the terminals, by what the command changes.

    The defaults are of the size in the 33220A's data sheet (5988-8544EN, from memory: low
    confidence).
    """

    amplitude_s: float = 0.030
    frequency_s: float = 0.003
    function_s: float = 0.111
    output_s: float = 0.0


class SimulatedGenerator(Protocol):
    """A generator as bytes in, bytes out, with its own clock; thread-safe. `hw.generator.terminals`
    has the latter.
    """

    def handle(self, data: bytes) -> bytes:
        """Carry out complete messages and return their answers."""

    def advance(self, dt_s: float) -> None:
        """Let simulated time pass."""

    def output(self) -> TerminalOutput:
        """What is at the open terminals now."""

    def set_modulation_input(self, voltage_v: float) -> None:
        """Put a voltage on Modulation In; it acts at once. Open, it is at 0 V."""


Listener = Callable[[TerminalOutput], object]


class MakeSimulator(Protocol):
    """Makes a simulated generator.

    `listener` is called at each change at the terminals. `am_full_scale` is the amplitude at + full
    scale of Modulation In, as a multiple of the one programmed.
    """

    def __call__(
        self,
        latency: GeneratorLatency,
        *,
        listener: Listener | None = None,
        am_full_scale: float = 1.0,
    ) -> SimulatedGenerator:
        """Make one."""


@dataclass(frozen=True)
class GeneratorKind:
    """One kind of generator: driver, simulator, and what the watchdog says to it over a connection
    of its own.

    `make` is given a `Transport` and `GeneratorSettings`. `switch_off` answers nothing. The answer
    to `ask_off` matches `off_answers`, whose group `off` distinguishes off from on. Amplitudes are
    into an open circuit. `limits_itself`: the driver sets a voltage limit of the instrument's own.
    One whose `shapes` hold direct voltages makes offsets too. A kind that makes its carrier
    `by_samples` has no commands. Its `make` is given an `AnalogOutput` in place of the transport,
    and `CarrierSettings`. The watchdog then takes the output to zero. `relay_interval_s`: its
    output is switched on at most so often, to spare the relay; no data sheet states how many
    switchings one lasts (unverified).
    """

    make: Callable[..., Generator]
    simulator: MakeSimulator
    amplitude_low_vpp: float
    amplitude_high_vpp: float
    ask_off: bytes = b"OUTP?\n"
    switch_off: bytes = b"OUTP 0\n"
    off_answers: re.Pattern[bytes] = re.compile(rb"(?P<off>0)|1")
    external_modulation: bool = False
    limits_itself: bool = False
    by_samples: bool = False
    shapes: frozenset[Shape] = frozenset({Shape.SINE})
    relay_interval_s: float = 0.5


def generator_kind(name: str) -> GeneratorKind:
    """The installed kind of that name; ValueError lists what is installed."""
    kind = plugins.load(GROUP, name, WHAT)
    if not isinstance(kind, GeneratorKind):
        raise ValueError(f"{WHAT} {name!r} is {kind!r}, not a hw.generator.contract.GeneratorKind")
    return kind
