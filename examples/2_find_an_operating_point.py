"""Build a lookup surface and find the operating point for a friction.

The surface holds the model on a grid of frequency, voltage and normal force. The controller looks
up in it what the real-time loop looks up, within the rig's limits.
"""

import haptic_driver as hd

surface = hd.surface("reference", rig="simulated")
low, high = surface.reachable(normal_force_n=0.5)
print(f"reachable under 0.5 N: {low:.3f} to {high:.3f}")

point = surface.solve(friction=0.60, normal_force_n=0.5, policy="min_voltage")
print(f"friction {point.cof:.3f} at {point.frequency_hz:.0f} Hz and {point.voltage_v:.1f} V peak")
