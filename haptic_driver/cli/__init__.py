"""The `haptic` command line has one module per command or group of commands.

A command reads its arguments and files, calls the other rooms, and prints the result. `main.py`
puts the commands together: these, those that follow from `daemon/verbs.py`, and those of every
package that an entry point of `haptic_driver.commands` names. `output.py` holds what all share: one
JSON object or text goes to stdout, errors go to stderr.

One rule holds: every failure becomes a message and an exit status (`main.py`).
"""

__all__ = ["control", "daemon", "load", "main", "output", "texture"]

import os

# Small matrices: several BLAS threads cost more than they bring, and fight over the cores. Set
# before numpy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ON_A_RIG = "On a rig, simulated or real"
# What `haptic --help` says of each command, by panel. A module is imported only when its command
# is asked for: `haptic off` must not wait for matplotlib.
PANELS = {
    "Without a rig": {
        "demo": "Slide a finger over a texture on a simulated rig: the main job.",
        "surface": "Build, describe and draw the lookup surface.",
        "solve": "Find the frequency and voltage that give a friction.",
        "simulate": "Serve the simulated instruments of a rig on loopback.",
    },
    ON_A_RIG: {
        "doctor": "Check a rig without energising it.",
        "load": "Have a load stage hold a finger's load.",
        "daemon": "Run the daemon.",
        "arm": "Arm, and hold the lease until Ctrl-C or `haptic disarm`.",
        "texture": "List, draw, check, import and play textures.",
        "scene": "Put objects on the screen, move them, see them replayed.",
        "osc": "Take commands as Open Sound Control messages.",
        "watch": "Show state, friction, voltage and flags until Ctrl-C.",
    },
    "Record and experiment": {
        "record": "Record every tick into a file, until --stop.",
        "mark": "Write a marker into events and recording.",
    },
    "When friction is not as the model says": {"why": "Diagnose what was rendered so far."},
}
