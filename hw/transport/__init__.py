"""A transport carries bytes to an instrument and back, and hides how it is connected.

In goes the name of an instrument (`resource.py`); out comes a `Transport` over TCP, a serial port,
USBTMC or VISA. All keep one contract (`contract.py`): `write`, `query` and `clear`, each within a
time limit.

Two rules hold. A late answer never goes to the next question: after a failure the line is cleared
first. Every failure is one of the few errors of `hw.errors`.
"""

__all__ = ["contract", "marker", "resource", "running", "serial", "tcp"]
