"""Arm a rig, render linen, read friction, stop and plot.

A daemon must run: `haptic daemon run --rig simulated` serves simulated instruments and a finger
that slides by itself. However the block ends, the output is off afterwards.
"""

import time

import haptic_driver as hd

with hd.connect() as rig:
    with rig.armed():
        rig.play("linen")
        time.sleep(1.5)
        print(f"friction {rig.measured_friction():.3f}")
    rig.plot().save("linen.png")
