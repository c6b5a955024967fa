"""A linear stage slides the screen or the finger, or presses the finger on the screen.

In go positions and speeds in SI units; out go messages of the controller's protocol in counts
(`apt.py`, `lts150.py`). `simulated.py` speaks the same bytes. `letting_go.py` lifts a stage that
presses a finger, by the stage's own answers.

One rule holds: an error or interrupt during a move stops the stage first.
"""

__all__ = ["letting_go", "lts150", "simulated"]
