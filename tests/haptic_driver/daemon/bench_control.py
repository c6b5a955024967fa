"""What the API asks of a daemon, in memory: the daemon's own state machine, a clock, no rig; not a
test.

`calls` lists every call that asked for a change, also those that were refused.
"""

from __future__ import annotations

import threading
import time
from base64 import b64encode
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np

from haptic_driver.daemon.messages import (
    DaemonState,
    Marked,
    RefusedError,
    RenderedFidelity,
    SceneChanged,
    SceneShown,
    Status,
    Tile,
    Timing,
    Why,
)
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.state_machine import StateMachine
from haptic_driver.daemon.web.server import serve
from haptic_driver.errors import BadInputError
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.recording.clock import clock_offsets
from haptic_driver.recording.event import Event
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.textures.objects import SceneDescription

FIDELITY = RenderedFidelity(
    first_tick=0,
    last_tick=9999,
    sliding_time_s=6.5,
    share_within_5_percent=0.97,
    constant_share_within_5_percent=0.7,
    constant_cof=0.6,
    relative_error_rms=0.0136,
    cof_error_rms=0.0081,
    correlation=0.91,
    band_gain=[0.91, 1.3, 0.79, None, 1.0, 0.66, None, None, None],
    band_coherence=[0.98, 0.9, 0.8, None, 0.5, 0.1, None, None, None],
    share_above_jnd=0.0,
    bands_felt=9 * [None],
    reach_hz=110.0,
    said=["within 5 % for 97 % of the time; a constant 0.60 reaches 70 %", "and more"],
)


@contextmanager
def serving(control, folder, *arguments, **options):
    """Its API at the socket `d.sock` of a folder; gives the page's address where there is a
    port.
    """
    place = Place(folder / "d.sock")
    try:
        with serve(control, place, *arguments, **options) as url:
            yield url
    finally:
        place.close()


class BenchControl:
    def __init__(self):
        self.ahead_s = 0.0  # of the clock, as leases go by it
        self.machine = StateMachine()
        self.machine.connected()
        self.calls = []
        self.ticks = 0
        self.cof = None
        self.texture = None
        self.scene = None
        self.recording = None
        self.flags = []
        self.holders = []
        self.model = "reference"
        self.shown_off = True  # whether switching off can be shown
        self.told = []
        self.agreement, self.disagreement, self.adaptation = [], None, None
        self.overruns = 0
        self.fidelity = None
        self.load = None
        self.instruments = []
        self.latency = {"latency_why": "nobody has looked yet"}
        self.inquiry = SimpleNamespace(
            answer=Why(state="not_asked", said="nobody has asked yet"), page=lambda: "<h1>Why</h1>"
        )
        controller = SimpleNamespace(quiet_above_hz=600.0)
        config = SimpleNamespace(controller=controller)
        settings = SimpleNamespace(config=config)
        self.basis = SimpleNamespace(inquiry=self.inquiry, settings=settings, why=self.ask_why)
        self.targets = self
        self.lock = threading.RLock()
        self.tell("state", "idle")

    def begin_anew(self):
        """As it was at first, behind the same server, which may be asking."""
        self.__init__()
        for name in vars(self).keys() - vars(type(self)()).keys():
            delattr(self, name)

    def tell(self, kind, message, data=None):
        number, now_s = len(self.told) + 1, time.monotonic()
        self.told.append(
            Event(number=number, time_s=now_s, kind=kind, message=message, data=data or {})
        )

    def _now_s(self):
        return time.monotonic() + self.ahead_s

    def _expire(self):
        if self.machine.armed and self._now_s() > self.machine.lease_until_s:
            self.machine.run_out(self.machine.arming)
            self.tell("lease", "the lease ran out")

    def status(self):
        with self.lock:
            self._expire()
            self.ticks += 1
            rendering = self.machine.state is DaemonState.RENDERING
            on = rendering if self.shown_off else None
            output = KnownOutput(on, "generator says so", 0.1)
            return Status(
                state=self.machine.state,
                simulated=True,
                rig="bench",
                model=self.model,
                texture=self.texture if rendering else None,
                target_cof=self.cof if rendering else None,
                measured_cof=float("nan"),
                reachable_cof=[0.5, 0.9],
                frequency_hz=250.0 if rendering else None,
                voltage_v=75.0 if rendering else 0.0,
                current_rms_a=20e-6 if rendering else None,
                output_on=output.on,
                output_said=str(output),
                ticks=self.ticks,
                overruns=self.overruns,
                underruns=0,
                switched=1,
                relay_interval_s=1.0,
                flags=self.flags,
                fault=self.machine.fault_reason,
                lease_left_s=(
                    self.machine.lease_until_s - self._now_s() if self.machine.armed else None
                ),
                lease_holder=self.machine.holder,
                actuator="none",
                real_time=False,
                latency_budget_s={"tick": 0.0005, "total": 0.01},
                fidelity=self.fidelity,
                load=self.load,
                instruments=self.instruments,
                **self.latency,
                surface_hash="0" * 8,
                agreement=self.agreement,
                disagreement=self.disagreement,
                adaptation=self.adaptation,
                recording=self.recording,
                recording_fault=None,
                timing=Timing(
                    in_time=None, missed=0, lateness_edges_s=[], lateness_counts=[], last_cause=None
                ),
            )

    def _change(self, name, *arguments):
        self.calls.append((name, *arguments))
        self._expire()

    def arm(self, lease_s, holder="somebody"):
        with self.lock:
            self._change("arm", lease_s)
            self.holders.append(holder)
            lease = self.machine.arm(self._now_s(), lease_s, holder)
            self.tell("state", "armed")
            return lease

    def renew(self, token):
        with self.lock:
            self._change("renew")
            return self.machine.renew(token, self._now_s())

    def _render(self, token, cof, texture):
        with self.lock:
            self.machine.renew(token, self._now_s())
            self.machine.render(token, self._now_s())
            self.cof, self.texture = cof, texture
            self.tell("target", texture or f"friction {cof:g}")
        return self.status()

    def set(self, token, cof, *, nearest=False):
        if not nearest and cof > 1.5:
            raise BadInputError(
                "unreachable", f"friction {cof:g} is far out of reach", "give nearest"
            )
        self._change("set", cof)
        return self._render(token, cof, None)

    def play(self, token, texture, *, nearest=False):
        self._change("play", texture)
        if texture not in self.textures():
            raise BadInputError(
                "unknown_texture", f"there is no texture {texture!r}", "did you mean 'linen'?"
            )
        return self._render(token, None, texture)

    def hold_load(self, token, newtons):
        self._change("hold_load", newtons)
        raise BadInputError("no_load_stage", "rig bench has no load stage", "add one")

    def release_load(self):
        self._change("release_load")
        return self.status()

    def change_scene(self, token, changes, *, show=False, nearest=False):
        self._change("change_scene", *changes)
        self.scene = (self.scene or SceneDescription()).changed(changes)
        self._render(token, None, "scene")
        self.tell("scene", "changed")
        count = len(self.scene.object)
        return SceneChanged(number=1, time_s=time.monotonic(), objects=count, rendering=True)

    def scene_shown(self):
        rendering = self.machine.state is DaemonState.RENDERING
        return SceneShown(number=1, rendering=rendering, scene=self.scene)

    def off(self):
        with self.lock:
            self._change("off")
            self.machine.off()
        return self.status()

    def disarm(self):
        with self.lock:
            self._change("disarm")
            self.machine.disarm()
            self.tell("state", "disarmed")
        return self.status()

    def fail(self, reason):
        with self.lock:
            self.machine.fault(reason)
            self.tell("fault", reason)

    def reset(self):
        with self.lock:
            self._change("reset")
            if self.machine.state is not DaemonState.FAULT:
                raise RefusedError("no_fault", "the daemon is not in fault", "nothing to reset")
            self.machine.reset()
        return self.status()

    def use_model(self, name, carrier_hz=None, *, feedback=True):
        with self.lock:
            self._change("use_model", name)
            if self.machine.state is not DaemonState.IDLE:
                raise RefusedError(
                    "not_idle", f"the daemon is {self.machine.state}", "disarm, or reset, first"
                )
            if name not in ("reference", "other"):
                raise BadInputError(
                    "unknown_model", f"there is no model {name!r}", "did you mean 'reference'?"
                )
            self.model = name
        return self.status()

    def adapt(self, on):
        self._change("adapt", on)
        self.adaptation = "no refit yet" if on else None
        return self.status()

    def ask_why(self, minutes):
        self._change("why", minutes)
        said = "Skin hydration is missing from the model: probability 97 %."
        found = {
            "verdict": "effect_found",
            "effects": ["skin_hydration"],
            "model": "other",
            "rows": 40,
        }
        self.inquiry.answer = Why(state="done", said=said, more=["tells this from that"], **found)
        return self.inquiry.answer

    def record(self, path, lease=None):
        self._change("record", path, lease)
        self.recording = path
        return self.status()

    def mark(self, label, data):
        self._change("mark", label, dict(data))
        self.tell("marker", label, dict(data))
        return Marked(number=len(self.told), time_s=self.told[-1].time_s, **dict(clock_offsets()))

    def textures(self):
        return ["grating", "linen"]

    def scripts(self):
        return []

    def models(self):
        return ["other", "reference"]

    @property
    def newest_tick(self):
        return self.ticks

    def samples(self, since_tick, most):
        samples = np.zeros(5, SAMPLE)
        samples["tick"] = np.arange(self.ticks, self.ticks + 5)
        samples["lateness_s"] = [1e-6, 15e-6, 15e-6, 3e-3, 1.0]
        samples["measured_cof"] = [np.nan, 0.5, 0.5, 0.5, np.nan]
        return samples[samples["tick"] > since_tick][-most:]

    def events(self, since):
        return [event for event in self.told if event.number > since]

    def surface_map(self):
        return {
            "frequency_hz": [100.0, 200.0],
            "voltage_v": [0.0, 50.0],
            "cof": [[0.5, 0.6], [0.5, None]],
            "limits_v": {"voltage": [40.0, 40.0], "slew rate": [None, 30.0]},
        }

    def tile(self, asked):
        low, high, cells = 0.5, 0.7, np.ones(asked.columns * asked.rows, np.uint8)
        return Tile(
            columns=asked.columns,
            rows=asked.rows,
            cof_low=low,
            cof_high=high,
            levels=b64encode(cells).decode(),
        )

    def texture_map(self):
        return {"x_m": [0.0, 0.01], "y_m": [0.0], "cof": [[0.5, None]]}
