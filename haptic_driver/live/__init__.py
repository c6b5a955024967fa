"""Felt friction held against the model while something renders, and the model mended by it.

The room reads forward, and each stage hands a record to the next:

- `window.py` cuts samples into windows of even sliding, by what `drive.py` says they answer to;
- `comparison.py` sets friction felt in windows beside friction expected;
- `agreement.py` tests, as windows come, whether the two agree, and where they do not;
- `refit.py` fits the finger's own numbers to the windows of the last minutes;
- `proof.py` keeps what predicts windows that it has not seen;
- `swap.py` lets render go on with the surface of that, and back.

Samples come from a running daemon (`follow.py`) or from files (`recordings.py`), and are cut by the
same code; `why.py` diagnoses them. Without a force sensor `touch_by_current.py` estimates what is
felt, and `current_sensor.py` reads it. Processes, answers and orders are the daemon's.
"""
