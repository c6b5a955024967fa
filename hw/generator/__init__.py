"""A waveform generator makes the carrier that the amplifier raises to the electrode's voltage.

In go frequency and voltage at the electrode; out go commands of the instrument, whose answers are
checked. `contract.py` says what a rig asks of every kind, and how a kind registers. `driver.py` has
what all drivers share. Each instrument has a room with its driver and a simulator.

Two rules hold. Every message passes a last gate (`gate.py`), which reads what is about to be sent
and refuses too much voltage. Settings of an instrument are read back.
"""

__all__ = ["analog_carrier", "contract", "dialogue", "driver", "gate", "settings", "terminals"]
