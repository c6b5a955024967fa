"""Drag an object of a scene while it is felt, and keep what happened.

For a daemon that runs: `haptic daemon run --rig simulated`. Places are in millimetres. What is
changed in one block, or by one call, acts at one tick. Then
`haptic scene replay drag.h5 --at 1 --out then.png` draws the scene as it was.
"""

import math
import time

import haptic_driver as hd

with hd.connect() as rig, rig.armed(lease_s=5.0):
    with rig.scene.together() as scene:
        scene.background(0.55)
        scene.add("key", hd.circle(30, 30, 8), "linen")
        scene.add("bar", hd.rectangle(60, 48, 40, 8, 2), 0.8, soft_edge_mm=1.0)
        scene.add("wedge", hd.polygon(85, 15, [[0, -8], [8, 6], [-8, 6]]), "brushed_metal")
    with rig.record("drag.h5"):
        start_s = time.monotonic()
        for k in range(180):
            rig.scene.move("key", 50 + 20 * math.cos(k / 30), 30 + 10 * math.sin(k / 30))
            time.sleep(max(start_s + (k + 1) / 60 - time.monotonic(), 0.0))
ticks = hd.read_recording("drag.h5").to_frame()
ticks.to_csv("drag.csv", index=False)
print(f"{len(ticks)} ticks in drag.csv")
