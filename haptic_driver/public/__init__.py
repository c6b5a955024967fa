"""The public interface offers what `import haptic_driver as hd` names, one file per task.

- `predictions` ask the model;
- `surfaces` look up operating points;
- `rigs` slide a simulated finger;
- `connection` talks to a running daemon.

What data mean is said by `lab/findings.py`. Each function calls what the commands call, with plain
arguments and results. One rule holds: nothing else of the driver imports this room.
"""

__all__ = ["commands", "connection", "given", "picture", "predictions", "rigs", "surfaces"]
