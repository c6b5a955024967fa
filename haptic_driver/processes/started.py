"""All processes and threads of the driver, and the only place that starts one.

`docs/processes.md` draws these tables. What `hw` needs for itself it starts itself, such as the
watchdog.
"""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from haptic_driver.processes.real_time import go_first

if TYPE_CHECKING:  # who starts a thread does not wait for pools
    from concurrent.futures import ProcessPoolExecutor


class Part(NamedTuple):
    """A process or a thread, and what it is for.

    `within`: the process that it belongs to, a child to its parent. `owner`: the file that has it
    started.
    """

    name: str
    within: str
    owner: str
    purpose: str


class Memory(NamedTuple):
    """One record of the shared memory, and the only process and file that may write it."""

    name: str
    writer: str
    file: str
    content: str


PROCESSES = (
    Part("control", "a shell or systemd", "daemon/run.py", "states, leases, instruments and API"),
    Part("render", "control", "daemon/supervision.py", "the tick: from finger to voltage"),
    Part("envelope", "control", "daemon/supervision.py", "the samples of an analog output"),
    Part("instruments", "control", "daemon/supervision.py", "simulated ones, in real time"),
    Part("watchdog", "control", "daemon/instruments.py", "switches off when control falls silent"),
    Part("recorder", "control", "recording/process.py", "samples and events into a file"),
    Part("observer", "control", "daemon/observer.py", "holds what is felt against the model"),
    Part("loader", "control", "daemon/loader.py", "reads what a client names"),
    Part("painter", "control", "daemon/daemon.py", "the same for pictures alone"),
    Part("why", "control", "daemon/inquiry.py", "diagnoses what was rendered"),
    Part("holder", "`haptic arm`", "cli/control.py", "holds a lease while a script lives"),
    Part("study", "`haptic study`", "lab/studies.py", "one of the workers of a study"),
)

THREADS = (
    Part("watch", "control", "daemon/daemon.py", "looks at everything every 20 ms, and beats"),
    Part("bring_out", "control", "daemon/daemon.py", "render's newest output to the generator"),
    Part("sense", "control", "daemon/supervision.py", "sensors to shared memory"),
    Part("press", "control", "daemon/load.py", "holds a load by the load stage, and lets go"),
    Part("bring_back", "control", "daemon/supervision.py", "starts again what died"),
    Part("door", "control", "daemon/web/server.py", "accepts connections and hears OFF"),
    Part("off", "control", "daemon/web/off.py", "switches off; eight, there before anybody asks"),
    Part("api", "control", "daemon/web/server.py", "the web server's event loop; one per address"),
    Part("child", "control", "processes/child.py", "gives to and hears one child"),
    Part("observe", "control", "daemon/observer.py", "hears the observer, and starts it again"),
    Part("why", "control", "daemon/inquiry.py", "waits for a diagnosis"),
    Part("current", "control", "live/current_sensor.py", "the electrode, and a touch by it"),
    Part("record", "control", "daemon/recordings.py", "ends a recording, or goes on with it"),
    Part("outlets", "control", "daemon/outlets.py", "samples and events to other programs"),
    Part("inlet", "control", "daemon/inlets.py", "markers from other programs"),
    Part("event_line", "control", "daemon/event_line.py", "an edge for each event that has a code"),
    Part("line_in", "control", "rig/line_in.py", "hears edges; also in `haptic measure`"),
    Part("begin", "control", "daemon/line_in.py", "begins or ends a recording for an edge"),
    Part("pat", "control", "daemon/service.py", "tells systemd that ticks advance"),
    Part("say", "control", "cli/daemon.py", "messages to a terminal, which may be stopped"),
    Part("bounded", "any", "processes/patience.py", "work that may hang and is waited for so long"),
    Part("ahead", "recorder", "recording/process.py", "takes ticks while a disk is awaited"),
    Part("linger", "instruments", "simulation/process.py", "ends them after their daemon"),
    Part("turns", "`haptic osc`", "cli/osc.py", "asks what came; who hears OFF does that itself"),
    Part("lease", "a client", "client.py", "renews a client's lease"),
)

MEMORY = (
    Memory("sensed", "control", "daemon/supervision.py", "what the sensors said last"),
    Memory("order", "control", "daemon/orders.py", "what render may do, until when"),
    Memory("driven", "control", "daemon/output_pump.py", "what may go out, since when it does"),
    Memory("targets", "control", "daemon/targets.py", "the friction that is asked for"),
    Memory("scene", "control", "daemon/targets.py", "where the objects of a scene are"),
    Memory("surfaces", "control", "daemon/basis.py", "the model as a look-up surface"),
    Memory("output", "render", "daemon/render_process.py", "the newest voltage and carrier"),
    Memory("ring", "render", "daemon/render_process.py", "one sample per tick"),
    Memory("courses", "render", "daemon/render_process.py", "the courses of envelopes"),
    Memory("played", "envelope", "daemon/envelope_process.py", "how far the envelope is written"),
)

# What keeps output alive, or takes it off: these go before what is not in real time.
URGENT = frozenset({"watch", "bring_out", "sense", "press", "door", "off"})

_PROCESSES, _THREADS = ({part.name for part in parts} for parts in (PROCESSES, THREADS))


def start_thread(name: str, work: Callable[..., object], *arguments: object) -> threading.Thread:
    """A thread that ends with its process at the latest. RuntimeError where there is none to be
    had.
    """
    _require(name, _THREADS)

    def run() -> None:
        if name in URGENT:
            go_first()
        work(*arguments)

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    return thread


def start_process(name: str, command: Sequence[str], **options: Any) -> subprocess.Popen[bytes]:
    """A process; the options are those of Popen."""
    _require(name, _PROCESSES)
    process: subprocess.Popen[bytes] = subprocess.Popen(command, **options)
    return process


def start_workers(name: str, count: int) -> ProcessPoolExecutor:
    """So many processes with interpreters of their own: kernels and threads survive no fork."""
    from concurrent.futures import ProcessPoolExecutor  # noqa: PLC0415
    from multiprocessing import get_context  # noqa: PLC0415

    _require(name, _PROCESSES)
    os.environ["PYTHONSAFEPATH"] = "1"  # as `PYTHON` has it; a pool takes no command
    return ProcessPoolExecutor(count, mp_context=get_context("spawn"))


def _require(name: str, known: set[str]) -> None:
    if name not in known:
        raise ValueError(f"{name} is not in the tables of {__name__}")
