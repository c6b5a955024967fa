"""The Siglent SDG1000X and SDG2000X series, channel 1 (Teledyne's T3AFG speaks the same)."""

from __future__ import annotations

import re

from hw.errors import BadReply
from hw.generator.dialogue import NOT_WHOLE, GeneratorDialogue
from hw.generator.driver import GeneratorDriver, Programmed, near, steps
from hw.generator.settings import GeneratorSettings
from hw.generator.siglent_sdg.gate import LEAST_VPP, SiglentGate
from hw.setting import Setting
from hw.transport.contract import Transport

_KEYS = {"offset_v": "OFST", "frequency_hz": "FRQ", "amplitude_vpp": "AMP"}
_UNIT = re.compile(r"(HZ|V|DEG)$")
# What is read back may differ by this share, or by this much, since small levels have few digits
# (unverified).
_LEVEL_TOLERANCE = 1e-3
_LEVEL_LSB_V = 1e-3
_FREQUENCY_TOLERANCE = 1e-6
_OUTPUT = re.compile(r"C1:OUTP (?P<state>ON|OFF)(?P<rest>(,\w+,\w+)*)")
_SYNC = re.compile(r"C1:SYNC (?P<state>ON|OFF)(,TYPE,(?P<of>\w+))?")


class SiglentSdg(GeneratorDriver):
    """Driver of channel 1: sines with an offset, without modulation.

    The instrument takes one setting per message, and clips and ignores without an error. So the
    driver reads everything back, and switches off what is not as set. Where nothing is believed any
    more, the driver resets it with its output off. A reset alone ends all that the front panel can
    add (combined channels, harmonics). A reset also switches Sync off, by which others are
    triggered: it is switched on again. Answers are those that Siglent's programming guide and
    public clients show; none was seen by this project on an instrument: unverified.
    """

    model = re.compile(r"(SDG[12]\d\d\dX|T3AFG)\S*")
    amplitude_low_vpp = LEAST_VPP  # 2 mVpp to 10 Vpp into 50 ohm, doubled open; up to 10 MHz
    amplitude_high_vpp = 20.0

    def __init__(self, transport: Transport, settings: GeneratorSettings) -> None:
        self._line = GeneratorDialogue(transport, SiglentGate(settings), settings.reply_timeout_s)
        super().__init__(self._line, settings)

    def _ask_state(self) -> tuple[bool, bool, str]:
        (output_on, load, _), wave = self._output(), self._pairs("BSWV")
        programmed = ", ".join(
            f"{key} {wave[key]}" for key in ("WVTP", "AMP", "OFST") if key in wave
        )
        return output_on, load == "HZ", programmed

    def _reset(self) -> None:
        for line in ("C1:OUTP OFF", "*RST", "C1:OUTP OFF"):
            self._line.send(line)
        self._check_output(self._ask_output(), on=False)

    def _set_up(self) -> None:
        self._reset()
        base = self._base()
        for line in (
            "C1:OUTP LOAD,HZ",
            "C1:OUTP PLRT,NOR",
            "C1:SYNC ON",
            f"C1:BSWV AMP,{LEAST_VPP:g}",
            "C1:BSWV OFST,0",
            "C1:BSWV WVTP,SINE",
            f"C1:BSWV FRQ,{base.frequency_hz:.12g}",
        ):
            self._line.send(line)
        self._check_state(base)
        self._check_sync()

    def _program(self, believed: Programmed, wanted: Programmed) -> None:
        for name, value in steps(believed, wanted):
            self._line.send(f"C1:BSWV {_KEYS[name]},{value:.12g}")
        self._check_state(wanted)

    def _ask_output(self) -> bool:
        return self._output()[0]

    def _switch(self, on: bool) -> bool:
        self._line.send(f"C1:OUTP {'ON' if on else 'OFF'}")
        return self._ask_output()

    def _try_off(self, *, levels: bool) -> bool:
        if levels:
            self._line.send(f"C1:BSWV AMP,{LEAST_VPP:g}")
            self._line.send("C1:BSWV OFST,0")
        return self._switch(False)

    # --- what is read back

    def _output(self) -> tuple[bool, str, str]:
        """Whether the output is on, the load that levels are shown for, "HZ" for an open circuit,
        and the polarity.
        """
        reply = self._line.query("C1:OUTP?")
        match = _OUTPUT.fullmatch(reply)
        fields = [] if match is None else match["rest"].split(",")[1:]
        shown = dict(zip(fields[::2], fields[1::2], strict=True))
        if match is None or "LOAD" not in shown:
            raise self._line.bad_reply(f"answered {reply[:80]!r} to 'C1:OUTP?'", NOT_WHOLE)
        return match["state"] == "ON", shown["LOAD"], shown.get("PLRT", "NOR")

    def _check_sync(self) -> None:
        """What is triggered by Sync measures phases against it."""
        reply = self._line.query("C1:SYNC?")
        match = _SYNC.fullmatch(reply)
        if match is None or match["state"] != "ON" or match["of"] not in (None, "CH1"):
            raise self._line.bad_reply(
                f"answers {reply[:80]!r} where Sync was switched on for channel 1", NOT_WHOLE
            )

    def _ask_held(self) -> list[Setting]:
        _, load, polarity = self._output()
        wave, modulation = self._pairs("BSWV"), self._line.query("C1:MDWV?")
        sync = self._line.query("C1:SYNC?").removeprefix("C1:SYNC ")
        return [
            Setting("C1:OUTP LOAD", "HZ", load),
            Setting("C1:OUTP PLRT", "NOR", polarity),
            Setting("C1:SYNC", "ON", sync.partition(",")[0]),
            Setting("C1:BSWV WVTP", "SINE", wave.get("WVTP")),
            Setting("C1:BSWV PHSE", "0", wave.get("PHSE")),
            Setting("C1:MDWV STATE", "OFF", modulation.rpartition("STATE,")[2].partition(",")[0]),
        ]

    def _pairs(self, header: str) -> dict[str, str]:
        """The keys and values that a header's question is answered with."""
        reply = self._line.query(f"C1:{header}?")
        fields = reply.removeprefix(f"C1:{header} ").split(",")
        if not reply.startswith(f"C1:{header} ") or len(fields) % 2:
            raise self._line.bad_reply(f"answered {reply[:80]!r} to 'C1:{header}?'", NOT_WHOLE)
        return dict(zip(fields[::2], fields[1::2], strict=True))

    def _check_state(self, wanted: Programmed) -> None:
        """What is not as set may be any voltage, so it is switched off."""
        try:
            wave, (_, load, polarity) = self._pairs("BSWV"), self._output()
            modulation = self._line.query("C1:MDWV?")
            frequency_hz, amplitude_vpp, offset_v = (
                self._line.number(_UNIT.sub("", wave.get(key, "")))
                for key in ("FRQ", "AMP", "OFST")
            )
            as_set = (
                wave["WVTP"] == "SINE"
                and near(frequency_hz, wanted.frequency_hz, _FREQUENCY_TOLERANCE)
                and near(amplitude_vpp, wanted.amplitude_vpp, _LEVEL_TOLERANCE, _LEVEL_LSB_V)
                and near(offset_v, wanted.offset_v, _LEVEL_TOLERANCE, _LEVEL_LSB_V)
                and load == "HZ"
                and polarity == "NOR"
                and self._line.number(_UNIT.sub("", wave.get("PHSE", "0"))) == 0.0
                and modulation == "C1:MDWV STATE,OFF"
            )
            shown = f"{wave}, load {load}, polarity {polarity}, {modulation}"
        except (BadReply, KeyError) as error:
            as_set, shown = False, str(error)
        if not as_set:
            self.off()
            raise self._line.bad_reply(
                f"holds {shown} where SINE, {wanted.frequency_hz:g} Hz, {wanted.amplitude_vpp:g}"
                f" Vpp, offset {wanted.offset_v:g} V, an open load and no inversion were set",
                NOT_WHOLE,
            )
