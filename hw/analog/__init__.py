"""Analog and digital lines of cards carry monitors, envelopes and enable levels.

`lines.py` has the contracts for single lines, which drivers use; cards and boxes supply them.
`ni_daq.py` and `sound_card.py` are the cards, and `simulated_output.py` stands for one.
`demodulation.py` turns a sampled record into amplitude and phase at the carrier.

One rule holds for outputs (`output.py`): a level or a stream lasts only while somebody refreshes
it, and then goes to its zero level.
"""

__all__ = ["cards", "demodulation", "lines", "ni_daq", "output", "simulated_output", "sound_card"]
