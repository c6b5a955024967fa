"""The model that render uses: the one it was given, another while idle, or the observer's refit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.inquiry import Inquiry
from haptic_driver.daemon.loader import Loader
from haptic_driver.daemon.messages import DaemonState, RefusedError, Why
from haptic_driver.daemon.observer import Observer
from haptic_driver.daemon.orders import Orders
from haptic_driver.daemon.recordings import Recordings
from haptic_driver.daemon.set_up import DaemonSettings
from haptic_driver.daemon.supervision import Supervisor
from haptic_driver.daemon.targets import Targets
from haptic_driver.lookup.build import is_of
from haptic_driver.lookup.file import SurfaceFile
from haptic_driver.processes.shared_memory import SharedState


class Basis:
    """What render goes by, and the supervisor starts it with: `settings` of the moment."""

    def __init__(
        self, settings: DaemonSettings, shared: SharedState, events: EventLog, loader: Loader
    ) -> None:
        self.settings = settings
        self.observer = Observer(settings.observed, shared, events, self._install)
        self.inquiry = Inquiry(events)
        self._shared, self._events, self._loader = shared, events, loader
        self._own = settings.surface  # of the model as its file has it

    def among(
        self, orders: Orders, targets: Targets, recordings: Recordings, supervisor: Supervisor
    ) -> None:
        """Who else has to do with it; before anything is asked."""
        self._orders, self._targets, self._recordings, self._supervisor = (
            orders,
            targets,
            recordings,
            supervisor,
        )

    def start(self) -> None:
        self.observer.start()
        self.observer.swap.adapt(self.settings.config.adapt)

    def close(self) -> None:
        """End what was begun."""
        self.observer.close()
        self.inquiry.close()

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name."""
        return self.observer.pids | self.inquiry.pids

    def use(self, name: str, carrier_hz: float | None, *, feedback: bool) -> None:
        """Solve a model's surface and let render begin anew with it. RefusedError unless idle and
        not recording.

        Where it is the present model, nothing is solved, and observations and refit are kept.
        """
        with self._recordings.lock, self._targets.choosing:
            with self._orders.lock:
                state = self._orders.machine.state
                if state is not DaemonState.IDLE:
                    raise RefusedError(
                        "not_idle", f"the daemon is {state}", "disarm, or reset, first"
                    )
                if self._recordings.path is not None:
                    raise RefusedError(
                        "recording", "a run keeps its surface", "stop the recording first"
                    )
                self._supervisor.claim_render()
            try:
                before = replace(self.settings, carrier_hz=carrier_hz, feedback=feedback)
                description = self._loader.model(name)
                same = is_of(self._own, description)
                if same:
                    settings = before.with_surface(before.surface, before.render.surface)
                else:
                    settings = before.with_model(name, description)
            except BaseException:
                self._supervisor.release_render()
                raise
            self.settings = settings
            self._supervisor.render_anew(settings)
            if not same:
                self._own = settings.surface
                self.observer.end()
                self.observer = Observer(
                    settings.observed,
                    self._shared,
                    self._events,
                    self._install,
                    self.observer.swap.said,
                )
                self.observer.start()
        self._events.tell(
            "model", name, surface_hash=settings.surface.content_hash, carrier_hz=carrier_hz
        )

    def why(self, minutes: float) -> Why:
        """Diagnose what was rendered in that time, by the model as its file has it."""
        rows = list(self.observer.rows)
        recent = [row for row in rows if row.time_s >= rows[-1].time_s - 60.0 * minutes]
        return self.inquiry.ask(
            recent, self.settings.model, simulated=self.settings.config.is_computed
        )

    def _install(self, surface: SurfaceFile, too_late: Callable[[], bool]) -> bool:
        """Let render go on with another surface between two ticks; whether that was ordered."""
        with self._targets.choosing:
            number = self._orders.order.surface
            if too_late():
                return False
            try:
                self._targets.await_taken(lambda output: output.surface == number)
            except RefusedError as error:
                self._events.tell("adapt", error.message)
                return False
            settings = self.settings.with_surface(surface, number + 1)
            stages = settings.render.tick
            self._shared.surfaces.write(number + 1, (stages.controller.settings, stages.worst_case))
            self.settings = self._supervisor.settings = settings
            self._orders.use_surface(number + 1)
        return True
