"""What `haptic why` says of fingers that are the model: 40 of them, rendered in simulated time;
some 15 minutes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.claim import Claim
from haptic_driver.config import texture_dirs
from haptic_driver.daemon.set_up import latency_budget_s, render_settings
from haptic_driver.daemon.stepped import SteppedDaemon
from haptic_driver.live.why import answer, write_windows
from haptic_driver.live.window import windows
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.render.texture import Uniform
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.envelope_writer import LEAST_LEAD_S
from haptic_driver.signals import TICK_S
from haptic_driver.simulation.finger_model import surface_friction
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.textures.library import load_texture
from model.touch_model import TouchModel
from tests.even_strokes import even_strokes

FINGERS, TOUCHES = 40, 8
MOST = 0.5  # of the probability of any effect


def run() -> Iterator[Claim]:
    found = [_asked(seed) for seed in range(1, FINGERS + 1)]
    most = [
        max(share for name, share in said["suspects"].items() if name not in ("none", "unknown"))
        for said in found
    ]
    nothing = sum(said["verdict"] == "no_discrepancy" for said in found)
    yield Claim(
        f"why, on {FINGERS} fingers that are the model: most probable effect of all",
        f"{max(most):.2f}",
        f"at most {MOST:g}",
        max(most) <= MOST,
    )
    yield Claim("why, on these: nothing is missing", f"{nothing} of {FINGERS}")


def _asked(seed: int) -> dict[str, Any]:
    """What why says after three textures: on set points and by an envelope in turn, at ten
    speeds.
    """
    config = load_rig("simulated" if seed % 2 else "simulated-envelope")
    simulation = config.simulation.model_copy(update={"seed": seed})
    config = config.model_copy(update={"simulation": simulation})
    description, limits = load_model("reference"), config.operating_limits()
    surface = build_surface(description, limits)
    slide = even_strokes(0.02 + 0.006 * ((7 * seed) % 10), TOUCHES)
    friction = surface_friction(surface, limits)  # as the daemon's own simulated finger has it
    targets = [*(load_texture(name, texture_dirs()) for name in ("linen", "grating")), Uniform(0.7)]
    samples = []
    with SimulatedRig(config, TouchModel(description), friction=friction, envelope=True) as bench:
        daemon = SteppedDaemon(render_settings(config, surface), bench, targets[0])
        daemon.connect()
        places = (slide.position_m, slide.normal_force_n, slide.speed_m_s)
        for target in targets:
            daemon.play(target)
            for at in np.column_stack(places).tolist():
                daemon.tick(*at)
                samples.append(daemon.shared.ring.newest(1))
        daemon.close()
    budget = latency_budget_s(config, TICK_S, LEAST_LEAD_S)
    rows, _ = windows(np.concatenate(samples), budget)
    with tempfile.TemporaryDirectory() as folder:
        write_windows(Path(folder), rows, simulated=True)
        return answer("reference", Path(folder))
