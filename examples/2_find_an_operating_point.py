"""Build a lookup surface and find the operating point for a friction.

The surface holds the model on a grid of frequency, voltage and normal force; the controller looks
up in it what the real-time loop looks up, within the rig's limits.
"""

from haptic_driver.render.controller import INITIAL, Controller, ControllerSettings
from haptic_driver.rig.config import load_rig
from haptic_driver.signals import NO_COMMAND, FingerState, TargetFriction
from haptic_driver.surface.build import build_surface
from haptic_driver.surface.file import ready_for_lookup
from haptic_driver.surface.models import load_model

limits = load_rig("simulated").operating_limits()
surface = build_surface(load_model("reference"), limits)
controller = Controller(
    ControllerSettings(ready_for_lookup(surface, limits), limits, policy="min_voltage")
)

low, high = controller.reachable(0.5)
print(f"reachable under 0.5 N: {low:.3f} to {high:.3f}")

finger = FingerState(
    time_s=0.0,
    position_x_m=0.0,
    position_y_m=0.0,
    velocity_x_m_s=0.0,
    velocity_y_m_s=0.0,
    normal_force_n=0.5,
    in_contact=True,
)
_, point = controller.step(INITIAL, TargetFriction(cof=0.60, active=True), finger, NO_COMMAND)
print(f"friction {point.cof:.3f} at {point.frequency_hz:.0f} Hz and {point.voltage_v:.1f} V peak")
