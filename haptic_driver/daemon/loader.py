"""The loader: the process that reads what a client names, and how control asks it.

    python -m haptic_driver.daemon.loader LINK

A texture or a model may come from anybody and be anything. So it is read in a process of its own,
with bounds on memory and time, one at a time and with no precedence. Control gets the result, or
the reason of the refusal.
"""

from __future__ import annotations

import math
import pickle
import resource
import signal
import socket
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lookup.models import load_model
from haptic_driver.processes import parent
from haptic_driver.processes.child import Child
from haptic_driver.processes.real_time import give_way
from haptic_driver.processes.shared_memory import TARGET_BYTES
from haptic_driver.render.scene import of_every_kind
from haptic_driver.render.texture import Target
from haptic_driver.textures.library import load, load_material, load_texture, texture_names
from haptic_driver.textures.reach import Demand, demand
from haptic_driver.textures.scene import Drawn, Made, Material
from haptic_driver.textures.tile import Grid, cell_means, levels
from model.description import ModelDescription
from model.support.errors import nearest

MEMORY_BYTES = 256 << 20
TIME_S = 5.0  # of a processor: where the machine is busy, others have it
HANG_S = 60.0  # until it is given up whatever it waits for
TOO_MUCH = "too_much"
START_TIMEOUT_S = 60.0  # of the process, on a busy machine
PATIENCE_S = 0.2  # for another request to end: who waits holds a thread of the API


class Asking(NamedTuple):
    """What is to be rendered and what it asks for; `drawn`: of a scene, its objects.

    `perceptual_gain`: by which friction varies more than its texture's file says.
    """

    target: Target
    demand: Demand
    drawn: Drawn | None
    perceptual_gain: float


class Loader:
    """The process as control sees it; started again when it is needed. Thread-safe.

    `name` is what `pids` calls it: whoever plays a texture does not wait for whoever looks at one.
    """

    def __init__(self, name: str = "loader") -> None:
        self._name = name
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._link: Connection | None = None
        self._is_ready = False

    def start(self) -> None:
        """Begin to start it, so that the first request does not wait so long."""
        with self._lock:
            self._start()

    def texture(self, name: str, reachable_cof: tuple[float, float]) -> Asking:
        """A texture or script, and what it asks of a surface that reaches so far. Raises
        HapticError.
        """
        found: Asking = self._ask(_texture, name, reachable_cof)
        return found

    def material(
        self, material: Material, reachable_cof: tuple[float, float]
    ) -> tuple[Made, Demand]:
        """What an object of a scene is made of, likewise. Raises HapticError."""
        found: tuple[Made, Demand] = self._ask(
            _material, material.name, material.width_mm, reachable_cof
        )
        return found

    def tile(self, name: str, grid: Grid) -> tuple[float, float, bytes]:
        """A texture of the library: its lowest and highest friction, and `levels` of a grid. Raises
        HapticError.
        """
        found: tuple[float, float, bytes] = self._ask(_tile, name, grid)
        return found

    def model(self, name: str) -> ModelDescription:
        """A model. Raises HapticError."""
        found: ModelDescription = self._ask(load_model, name)
        return found

    @property
    def pids(self) -> dict[str, int]:
        """Its process id, while there is one."""
        child = self._child
        return {self._name: child.pid} if child is not None else {}

    def close(self) -> None:
        with self._lock:
            self._end()

    def _ask(self, work: Callable[..., Any], name: str, *arguments: Any) -> Any:
        if not self._lock.acquire(timeout=PATIENCE_S):
            raise RefusedError(
                "loading", "something else is being loaded", "ask again when it is there"
            )
        try:
            _, link = self._ready()
            try:
                link.send((TIME_S, work, name, *arguments))
                if not link.poll(HANG_S):
                    self._end()
                    raise _hangs(name)
                is_given, answer = pickle.loads(link.recv_bytes(2 * TARGET_BYTES))
            except (OSError, EOFError):
                self._end()
                raise _too_much(name) from None
            if not is_given and answer[1]["code"] == TOO_MUCH:
                self._end()  # what is left of its memory is in pieces; the next asks another
        finally:
            self._lock.release()
        if not is_given:
            is_bad_input, content = answer
            raise (BadInputError if is_bad_input else HapticError)(**content)
        return answer

    def _ready(self) -> tuple[Child, Connection]:
        child, link = self._start()
        if not self._is_ready:
            try:
                child.ready(START_TIMEOUT_S)
            except HapticError:
                self._end()
                raise
            self._is_ready = True
        return child, link

    def _start(self) -> tuple[Child, Connection]:
        if self._child is not None and self._child.ended is not None:
            self._end()
        if self._child is None or self._link is None:
            ours, theirs = socket.socketpair()
            with theirs:
                self._link = Connection(ours.detach())
                self._child = Child(
                    self._name, __name__, [theirs.fileno()], descriptors=[theirs.fileno()]
                )
        return self._child, self._link

    def _end(self) -> None:
        child, link, self._child, self._link, self._is_ready = (
            self._child,
            self._link,
            None,
            None,
            False,
        )
        if link is not None:
            link.close()
        if child is not None:
            child.kill()


def _texture(name: str, reachable_cof: tuple[float, float]) -> Asking:
    loaded = load(name, texture_dirs())
    asked = demand(loaded.target, reachable_cof)
    return Asking(loaded.target, asked, loaded.drawn, loaded.perceptual_gain)


def _material(
    name: str, width_mm: float | None, reachable_cof: tuple[float, float]
) -> tuple[Made, Demand]:
    texture = load_material(Material(name, width_mm), texture_dirs())
    return Made.of(texture), demand(texture, reachable_cof)


def _tile(name: str, grid: Grid) -> tuple[float, float, bytes]:
    names = texture_names(texture_dirs())
    if name not in names:
        raise BadInputError(
            "unknown_texture",
            f"there is no texture '{name[:200]}' in the library",
            nearest(name, names),
        )
    texture = load_texture(name, texture_dirs())
    low, high = texture.bounds()
    return low, high, levels(cell_means(texture, grid), low, high)


def _too_much(name: str) -> BadInputError:
    most = f"{TIME_S:g} s of a processor or {MEMORY_BYTES >> 20} MiB"
    return BadInputError(
        TOO_MUCH, f"{name[:200]} takes more than {most} to read", "make it smaller"
    )


def _hangs(name: str) -> BadInputError:
    said = f"{name[:200]} was not read within {HANG_S:g} s"
    return BadInputError(TOO_MUCH, said, "look whether its disk answers, or what the machine does")


def _answer(work: Callable[..., Any], name: str, *arguments: Any) -> bytes:
    try:
        said = pickle.dumps((True, work(name, *arguments)), protocol=5)
        return said if len(said) <= 2 * TARGET_BYTES else _refusal(_too_much(name))
    except HapticError as error:
        return _refusal(error)


def _refusal(error: HapticError) -> bytes:
    return pickle.dumps((False, (isinstance(error, BadInputError), error.content)))


def _bounded() -> None:
    give_way()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most_bytes = pages * resource.getpagesize() + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main() -> int:
    """Answer until control hangs up."""
    import scipy.interpolate  # noqa: PLC0415  (what is read may need it)
    import scipy.ndimage  # noqa: F401, PLC0415
    from PIL import PngImagePlugin  # noqa: F401, PLC0415

    for texture in of_every_kind():
        texture.cof_at(*np.zeros((2, 1)))  # what is compiled takes more room than a texture may
    with Connection(int(sys.argv[1])) as link:
        _bounded()
        parent.tell({"ready": True})
        while True:
            try:
                time_s, *asked = link.recv()
            except EOFError:
                return 0
            signal.setitimer(signal.ITIMER_PROF, time_s)  # it dies of that, and control sees it
            signal.alarm(math.ceil(HANG_S + time_s))  # control has given up long before, or is gone
            try:
                said = _answer(*asked)
            except MemoryError:
                link.send_bytes(_refusal(_too_much(asked[1])))
                return 1
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            link.send_bytes(said)
            signal.alarm(0)


if __name__ == "__main__":
    sys.exit(main())
