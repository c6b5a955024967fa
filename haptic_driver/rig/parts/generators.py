"""The waveform generator, and the process that switches it off when its driver dies."""

from __future__ import annotations

from contextlib import closing
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from haptic_driver.config import Section, Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import (
    NO_WATCHDOG,
    DeviceSection,
    NoPart,
    Patience,
    Resource,
    SampleRate,
    Seconds,
    SignedFigures,
)
from hw import plugins
from hw.errors import BadReply
from hw.generator import contract as generators


def _installed_model(model: str) -> str:
    return plugins.known(generators.GROUP, model, generators.WHAT)


class ModulationInputConfig(SignedFigures):
    """Modulation In at the back of the generator; see `hw.generator.settings.ModulationInput`."""

    full_scale_v: Annotated[
        float, Within(0.1, 10.0, "no generator's Modulation In takes less or more")
    ] = Field(description="input for the highest amplitude; minus that is nothing, 0 V is HALF")
    amplitude_at_full_scale: Annotated[
        float, Within(0.5, 4.0, "no generator's modulation goes to less or more")
    ] = Field(description="highest amplitude as a multiple of the programmed one: 1 or 2")


class CarrierConfig(SignedFigures):
    """The analog output that makes carrier and envelope in a generator's place, sample by
    sample.
    """

    sample_rate_hz: SampleRate = Field(
        description="asked of the output; the carrier counts on the one that it gets"
    )
    peak_v: Annotated[float, Within(0.01, 10.0, "outputs of cards end at 10 V")] = Field(
        description="the highest at the output's terminal; of a sound card, its full scale there"
    )
    lead_s: Annotated[
        float, Within(0.002, 0.2, "no writer is so early, and no voltage may be so late")
    ] = Field(default=0.02, description="written so far ahead, and so late")
    timeout_s: Seconds = Field(default=0.5, description="no call waits much longer")


class GeneratorConfig(DeviceSection):
    """The waveform generator and how to reach it; `carrier` where an analog output stands in for
    it.
    """

    served_as = "waveform_generator"

    model: Annotated[str, AfterValidator(_installed_model)] = Field(
        default="agilent_33220a",
        description="an installed kind; a wrong name is answered by the list of all",
    )
    resource: Resource = Field(
        description=(
            "how to reach it: `TCPIP::host::5025::SOCKET` (LAN), `TCPIP::host::inst0::INSTR`"
            " (VXI-11), `USB0::…::INSTR`, `ASRL/dev/ttyUSB0::INSTR`, `GPIB0::10::INSTR`,"
            " `visa:NAME` to send any of them through VISA, or `simulated`"
        )
    )
    visa_backend: str = Field(
        default="@py", description='of pyvisa: "@py" is pyvisa-py, "@ivi" an installed VISA library'
    )
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = Field(
        default=115200, description="of a serial resource"
    )
    reply_timeout_s: Annotated[
        float, Within(1e-3, 30.0, "no answer is sooner there, nor waited for longer")
    ] = Field(default=1.0, description="for one answer")
    range_policy: Literal["fixed", "auto"] = Field(
        default="fixed",
        description=(
            '"fixed": no relay switches; "auto": better accuracy, disturbed when it switches'
        ),
    )
    modulation_input: ModulationInputConfig | None = None
    carrier: CarrierConfig | None = None

    def examine(self, at: Examination) -> Checks:
        """By its driver's `identify`, then the watchdog while the driver's connection is open."""
        from haptic_driver.rig.devices import generator_port, make_generator

        with closing(generator_port(at.rig)) as port:
            found = make_generator(at.rig, port).identify()
            said = f"{found.identity}, serial number {found.serial_number}"
            yield at.ok(said, found.held)
            said = f"{found.firmware}; couplings and clipping are those of manuals"
            yield at.called("firmware").unverified(said)
            output = at.called("output")
            if found.output_on:
                said = f"ON, {found.programmed}: somebody uses it"
                yield output.warning(said, "switch it off before working here")
            else:
                yield output.ok(f"off; programmed: {found.programmed}")
            load = at.called("load setting")
            if found.load_open:
                yield load.ok("open: programmed volts are volts at the amplifier's input")
            else:
                yield load.warning(
                    "not open: at the amplifier's high-impedance input the voltage is up to twice"
                    " what is programmed",
                    "connecting the driver corrects it; by hand, correct it before the output is"
                    " switched on",
                )
            yield from _voltage_limit(at.called("voltage limit"))
            watchdog = at.rig.watchdog or WatchdogConfig(generator=NO_WATCHDOG)
            yield from at.called("watchdog").told(watchdog.examine)


def _voltage_limit(at: Examination) -> Checks:
    kind, limit_v = at.rig.generator_kind(), at.rig.limits.voltage_v
    reach_v = 0.5 * kind.amplitude_high_vpp * at.rig.amplifier.gain_v_per_v
    if reach_v < limit_v:
        said = f"the generator reaches {reach_v:g} V, the limit is {limit_v:g} V"
        yield at.warning(said, "check amplifier.gain_v_per_v")
    keeper = (
        "this program, and by the generator once it is connected"
        if kind.limits_itself
        else "this program alone: the generator's driver sets no limit of the instrument's own"
    )
    could_v = min(reach_v, at.rig.amplifier.voltage_limit_v)
    said = f"{limit_v:g} V is kept by {keeper}; with this amplifier it could ask for {could_v:g} V"
    yield at.unverified(said, "limit the amplifier in hardware where it can be")


class WatchdogConfig(Section):
    """The process that switches off when the driver dies, over connections of its own; see
    `hw.safety.watchdog`.
    """

    generator: Resource = Field(
        description='or "none", said plainly; never the driver\'s USB, GPIB or serial port'
    )
    interlock: Resource | None = Field(
        default=None, description="a second way to the box, if it has one"
    )
    period_s: Patience = Field(
        default=0.5,
        description="without a beat for so long it switches off; not below safety.lease_s",
    )
    reply_timeout_s: Patience = Field(default=0.3, description="for one answer")
    retry_s: Patience = Field(default=0.2, description="between attempts")
    give_up_s: Annotated[
        float, Within(0.1, 3600.0, "one attempt takes as long, and nobody waits for longer")
    ] = Field(default=60.0, description="without evidence")

    def examine(self, at: Examination) -> Checks:
        """Over the connection that it would have; it is not started."""
        from hw.transport.resource import make_transport

        if self.generator == NO_WATCHDOG and not isinstance(at.rig.interlock, NoPart | None):
            said = "there is none: the interlock has to switch off when the driver dies"
            yield at.unverified(said, "kill an armed driver once")
            return
        if self.generator == NO_WATCHDOG:
            hint = (
                "give it a connection of its own, e.g. the generator's LAN socket; or use an"
                " interlock box"
            )
            yield at.warning("there is none: if the driver dies, the output stays as it is", hint)
            return
        kind, by_hand = at.rig.generator_kind(), "kill an armed driver once"
        if kind.by_samples:
            said = f"{self.generator}: opening it would put out a level; it is not started here"
            yield at.unverified(said, by_hand)
            return
        with closing(make_transport(self.generator)) as transport:
            transport.open()
            reply = transport.query(kind.ask_off, self.reply_timeout_s).strip()
            if not kind.off_answers.fullmatch(reply):
                raise BadReply(
                    f"{transport.resource} answered {reply[:80]!r}", "check watchdog.generator"
                )
            yield at.ok(f"{transport.resource} answers beside the driver's connection")
            yield at.called("watchdog switching off").unverified("it is not started here", by_hand)
