"""Live adaptation compares measured friction with the model while something renders, and refits the
model.

The stages run in one direction, and each passes a record to the next:

- `window.py` cuts samples into windows of even sliding, by the drive that `drive.py` says they
  answer to;
- `comparison.py` sets the windows' measured friction beside the expected friction;
- `agreement.py` tests, as windows come, whether the two agree, and where they do not;
- `refit.py` fits the finger's own numbers to the windows of the last minutes;
- `proof.py` accepts a refit only if it predicts windows that it has not seen;
- `swap.py` switches render to the surface of the refit, and back.

Samples come from a running daemon (`follow.py`) or from recordings, and the same code cuts both.
`why.py` diagnoses them. Without a force sensor `touch_by_current.py` estimates friction
from the current that `current_sensor.py` reads. Processes, answers and orders belong to the daemon.
"""

__all__ = ["agreement", "current_sensor", "follow", "swap", "touch_by_current", "why", "window"]
