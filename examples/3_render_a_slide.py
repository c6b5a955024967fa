"""Render a texture under a sliding finger on the simulated rig.

The finger makes a stroke over a grating. Every command goes as bytes over TCP to a simulated
generator, and friction comes back through a simulated force sensor. The daemon's own parts render,
in simulated time; `slide.to_frame()` has one row per tick of 1 ms.
"""

import haptic_driver as hd

rig = hd.simulated_rig("simulated")
slide = rig.slide("grating", speed_m_s=0.020, normal_force_n=0.5)

print(slide)
print(f"highest voltage {slide.max_voltage_v:.0f} V; output at the end: {slide.off}")
