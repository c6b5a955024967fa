"""A client of the daemon for experiments.

    from haptic_driver.client import HapticClient

    with HapticClient() as client, client.armed() as session:
        session.set(0.6)
        session.play("linen")

Whatever ends the inner block, an error and Ctrl-C too, leaves the output off. A client that dies no
longer renews its lease, and the daemon ramps the output to zero by itself.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from copy import copy
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from socket import socket as Line  # noqa: N812  (arguments are called socket)
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar
from urllib.parse import urlencode

from pydantic import BaseModel, ValidationError

from haptic_driver.daemon.address import Address
from haptic_driver.daemon.messages import (
    LEASE_HEADER,
    ErrorReport,
    Lease,
    RefusedError,
    SceneChanged,
    SceneShown,
    StateFrame,
    Status,
)
from haptic_driver.daemon.scene import Scene, circle, ellipse, mask, polygon, rectangle
from haptic_driver.daemon.verbs import (
    MOST_SAMPLES,
    Answer,
    Client,
    Holder,
    Verb,
    Verbs,
    Written,
    methods,
)
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.processes.started import start_thread
from haptic_driver.recording.event import Event

if TYPE_CHECKING:  # `haptic status` waits neither for numpy nor for WebSockets
    import numpy as np
    from numpy.typing import NDArray
    from websockets.sync.client import ClientConnection

__all__ = [
    "LEASE_S",
    "Channel",
    "HapticClient",
    "LeaseLostError",
    "NoDaemonError",
    "Session",
    "circle",
    "ellipse",
    "mask",
    "polygon",
    "rectangle",
]

TIMEOUT_S = 10.0  # switching off waits for a slow instrument
PATIENCE_S = 300.0  # with what may wait for a process to start, on a busy machine
LEASE_S = 2.0  # of a program: writing to a slow disk must not cost it
RENEWALS_PER_LEASE = 4
PATIENCE_LEASES = 0.5  # one renewal may take so much of the lease: another comes in time
POLL_S = 0.1

Schema = TypeVar("Schema", bound=BaseModel)


class NoDaemonError(HapticError):
    """Nobody answers at the socket."""


class LeaseLostError(RefusedError):
    """The lease has ended while it was held: disarmed by somebody, a fault, or renewed too late."""


class HapticClient(Verbs):
    """One daemon, by its socket or the address of its page (else `HAPTIC_SOCKET`, else the usual
    socket). Its methods are the entries of `Verbs` and what stands here.

    Methods may be called from several threads. Every method raises what the daemon refuses.
    BadInputError is for unusable input, and RefusedError for what its present state forbids.
    NoDaemonError means that it does not answer, HapticError a fault.
    """

    def __init__(self, socket: Path | str | None = None) -> None:
        self.address = Address.of(socket)
        self._timeout_s = TIMEOUT_S
        self._line(TIMEOUT_S).close()

    def within(self, timeout_s: float) -> HapticClient:
        """A client of the same daemon that waits so long for an answer; then NoDaemonError."""
        client = copy(self)
        client._timeout_s = timeout_s
        return client

    def close(self) -> None:
        """Nothing is left open between requests; what the daemon does is not changed by it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def armed(self, lease_s: float = 0.5, holder: str = "") -> Iterator[Session]:
        """Arm, and keep the lease alive in the block; disarmed afterwards, and shown to be off.

        Raises LeaseLostError at the end of the block when the lease was lost in it. Raises
        HapticError when the output cannot be shown to be off. An error of the block itself goes
        before these.
        """
        with Session(self, self.arm(lease_s, holder)) as session:
            yield session

    @contextmanager
    def channel(self) -> Iterator[Channel]:
        """A connection for many commands a second, which keeps the lease that it is given.

        That lease is renewed by whatever is asked, and ends with the block or with this program.
        """
        with self._connected("/commands", compression=None, max_size=None) as line:
            yield Channel(line, self)

    def textures(self) -> list[str]:
        """Names that `play` knows."""
        return self.texture_names().textures

    def models(self) -> list[str]:
        """Names that `use_model` knows."""
        return self.model_names().models

    def events(self, since: int = 0) -> list[Event]:
        """What happened after event number `since`."""
        return self.events_since(since).events

    def samples(self, since_tick: int = 0, most: int = 1000) -> NDArray[np.void]:
        """Ticks after `since_tick`, the newest `most` of them, of dtype
        `haptic_driver.processes.samples.SAMPLE`.
        """
        from haptic_driver.daemon.web.frames import samples_of  # noqa: PLC0415

        return samples_of(self.sample_columns(since_tick, most).root)

    def watch(self) -> Generator[StateFrame, None, None]:
        """The state, 20 times a second, until the daemon ends."""
        return self._stream("/state", StateFrame)

    def ask(self, verb: Verb[..., Any, Answer], said: dict[str, Any], token: str = "") -> Answer:
        """What the daemon answers; HapticError where it has switched off and cannot show it.

        A connection of its own, so that switching off never waits for what another thread has
        asked.
        """
        _write(verb, said)
        path, content = verb.path, None
        if verb.method == "GET":
            path += "?" * bool(said) + urlencode(said)
        elif said:
            content = _as_json(said)
        headers = self._credentials | {"Content-Type": "application/json"}
        headers |= {LEASE_HEADER: token} if token else {}
        with closing(HTTPConnection(self.address.authority)) as connection:
            connection.sock = self._line(PATIENCE_S if verb.slow else self._timeout_s)
            try:
                connection.request(verb.method, path, content, headers)
                response = connection.getresponse()
                answer = response.read()
            except (OSError, HTTPException) as error:
                raise NoDaemonError(
                    "no_answer",
                    f"the daemon at {self.address} does not answer ({error})",
                    "wait, if it has just been started; else look at its log",
                ) from error
        if response.status >= 400:
            raise _error_of(response.status, answer)
        found = _understood(verb.answer, answer)
        if verb.switches_off and isinstance(found, Status):
            _require_off(found)
        return found

    def _stream(self, path: str, schema: type[Schema]) -> Generator[Schema, None, None]:
        from websockets.exceptions import ConnectionClosed, WebSocketException  # noqa: PLC0415

        with self._connected(path) as messages:
            try:
                while True:
                    yield _understood(schema, messages.recv())
            except ConnectionClosed:
                return
            except (OSError, WebSocketException) as error:
                raise self._no_daemon() from error

    def _connected(self, path: str, **options: Any) -> ClientConnection:
        from websockets.exceptions import InvalidStatus, WebSocketException  # noqa: PLC0415
        from websockets.sync.client import connect  # noqa: PLC0415

        where, headers = f"ws://{self.address.authority}{path}", self._credentials
        try:
            line: ClientConnection = connect(
                where, sock=self._line(None), additional_headers=headers, **options
            )
        except InvalidStatus as refused:
            self.status()  # says why, which the answer to a WebSocket does not
            said = f"the daemon at {self.address} takes no connection ({refused})"
            raise HapticError("busy", said, "ask again") from refused
        except (OSError, WebSocketException) as error:
            raise self._no_daemon() from error
        return line

    @property
    def _credentials(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.address.token}"} if self.address.token else {}

    def _line(self, timeout_s: float | None) -> Line:
        try:
            line = self.address.connected(self._timeout_s)
        except OSError as error:
            raise self._no_daemon() from error
        line.settimeout(timeout_s)
        return line

    def _no_daemon(self) -> NoDaemonError:
        hint = (
            "start one: haptic daemon run --rig simulated; or give HAPTIC_SOCKET the address of its"
            " page"
        )
        return NoDaemonError("no_daemon", f"no daemon answers at {self.address}", hint)


class Channel(Verbs):
    """A daemon's command channel. Each method waits for its answer, whichever thread asks.

    Methods are those of `Verbs`, without a lease's token. `tick` is that from which on the last
    answer holds. Raises what `HapticClient` raises.
    """

    def __init__(self, line: ClientConnection, client: HapticClient) -> None:
        self.token = ""  # the daemon's end keeps it
        self.tick = 0
        self._line, self._client = line, client
        self._asked = 0
        self._names = {verb.path + verb.method: name for name, verb in methods().items()}
        self._alone = threading.Lock()

    @property
    def scene(self) -> Scene:
        """The daemon's scene of objects."""
        return _scene(self, self.scene_shown)

    def ask(self, verb: Verb[..., Any, Answer], said: dict[str, Any], token: str = "") -> Answer:
        """What the daemon answers; by another lease than the channel's own with its token."""
        from websockets.exceptions import ConnectionClosed  # noqa: PLC0415

        if verb.switches_off:  # waits for no thread that asks here, and has to be shown
            return self._client.ask(verb, said)
        _write(verb, said)
        command = {"verb": self._names[verb.path + verb.method], "asked": said, "lease": token}
        patience_s = PATIENCE_S if verb.slow else TIMEOUT_S
        try:
            with self._alone:
                self._asked += 1
                self._line.send(_as_json({"id": self._asked, **command}).decode())
                answer = json.loads(self._line.recv(patience_s))
                while answer["id"] != self._asked:  # what came too late for who asked it
                    answer = json.loads(self._line.recv(patience_s))
        except (ConnectionClosed, TimeoutError) as error:
            raise NoDaemonError(
                "no_answer", f"the command channel does not answer ({error})", "look at its log"
            ) from error
        if "error" in answer:
            raise _error_of(answer["status"], _as_json({"error": answer["error"]}))
        self.tick = answer["tick"]
        return verb.answer.model_validate(answer["answer"])


def _scene(holder: Holder, shown: Callable[[], SceneShown]) -> Scene:
    def change(changes: list[dict[str, Any]], show: bool) -> SceneChanged:
        return holder.ask(Verbs.change_scene, {"changes": changes, "show": show})

    return Scene(change, shown)


def _write(verb: Verb[..., Any, Any], said: dict[str, Any]) -> None:
    """Values as a client sends them."""
    for name, field in verb.schema.model_fields.items():
        for how in field.metadata:
            if isinstance(how, Written):
                said[name] = how.of(said.get(name))


def new_samples(
    samples: Callable[[int, int], NDArray[np.void]],
    silent_s: float,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], object] = time.sleep,
) -> Iterator[NDArray[np.void]]:
    """Samples of a client from now on, as they come; HapticError where none came for `silent_s`.

    `sleep` waits on `clock`, which is that of the samples where they are not of real time.
    """
    newest = samples(0, 1)
    tick = int(newest["tick"][-1]) if newest.size else 0
    heard_s = clock()
    while clock() - heard_s < silent_s:
        sleep(POLL_S)
        new = samples(tick, MOST_SAMPLES)
        if new.size:
            tick, heard_s = int(new["tick"][-1]), clock()
            yield new
    raise HapticError("stopped", "the daemon renders no more", "See: haptic status")


class Session:
    """A lease that a thread renews, and what only its holder may ask; disarms at the end of its
    block.
    """

    set = Verbs.set
    play = Verbs.play
    change_scene = Verbs.change_scene
    hold_load = Verbs.hold_load

    def __init__(self, client: HapticClient, lease: Lease) -> None:
        self.token = lease.token
        self.lost: LeaseLostError | None = None  # why the lease is no longer ours
        self._client = client
        self._lease_s = lease.lease_s
        self._ending = threading.Event()
        self._answered = threading.Event()  # the first renewal
        self._renewing: threading.Thread | None = None  # in the block
        self._open = ExitStack()
        self._channel: Channel | None = None

    def ask(self, verb: Verb[..., Any, Answer], said: dict[str, Any], _: str = "") -> Answer:
        """What the daemon answers the holder of the lease."""
        asked: Client = self._client
        if verb.path == "/scene":  # changed many times a second
            if self._channel is None:
                self._channel = self._open.enter_context(self._client.channel())
            asked = self._channel
        return asked.ask(verb, said, self.token)

    @property
    def scene(self) -> Scene:
        """The daemon's scene of objects."""
        return _scene(self, self._client.scene_shown)

    def record(self, path: Path | None) -> Status:
        """Record into a file until the lease is over, whatever ends it, or stop that with None."""
        return self._client.record(path, self.token)

    def release_load(self) -> Status:
        """Have the load stage let go; still armed, and the output as it is."""
        return self._client.release_load()

    def off(self) -> Status:
        """Output to zero at once; still armed."""
        return self._client.off()

    def wait_held(self) -> None:
        """Until the lease has been renewed once, and so is held by a thread that runs, however
        slowly it came up.

        Raises LeaseLostError when it was lost before that, HapticError when the daemon does not
        answer.
        """
        answered = self._answered.wait(TIMEOUT_S)
        if self.lost is not None:
            raise self.lost
        if not answered:
            raise NoDaemonError(
                "no_answer",
                f"the daemon at {self._client.address} does not answer",
                "look at its log",
            )

    def wait_lost(self, timeout_s: float) -> bool:
        """Wait until the lease is lost, at most so long; whether it is."""
        if self._renewing is not None:
            self._renewing.join(timeout_s)
        return self.lost is not None

    def __enter__(self) -> Self:
        self._renewing = start_thread("lease", self._renew)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Disarm, unless the lease has become somebody else's."""
        self._ending.set()
        try:
            if self.lost is None:
                self._client.disarm()
            elif error is None:
                raise self.lost
        except HapticError:
            if error is None:
                raise
        finally:
            self._open.close()
            if self._renewing is not None:
                self._renewing.join()

    def _renew(self) -> None:
        """Until the block ends or the daemon refuses; what is not answered is asked again."""
        renewer = self._client.within(PATIENCE_LEASES * self._lease_s)
        renewed_s = time.monotonic()
        while not self._ending.is_set():
            asked_s = time.monotonic()
            try:
                renewer.renew(self.token)
            except RefusedError as refused:
                if not self._ending.is_set():
                    ago = f"it was last renewed {asked_s - renewed_s:.2g} s before"
                    said = f"{refused.message}; {ago}"
                    self.lost = LeaseLostError(refused.code, said, refused.hint)
                self._answered.set()
                return
            except HapticError:
                pass
            else:
                renewed_s = asked_s
                self._answered.set()
            next_s = asked_s + self._lease_s / RENEWALS_PER_LEASE
            self._ending.wait(max(next_s - time.monotonic(), 0.0))


def _as_json(said: dict[str, Any]) -> bytes:
    try:
        return json.dumps(said).encode()
    except (TypeError, ValueError) as error:
        raise BadInputError(
            "bad_request", f"no JSON can say this: {error}", "Say it else"
        ) from error


def _understood(schema: type[Schema], content: bytes | str) -> Schema:
    try:
        return schema.model_validate_json(content)
    except ValidationError as error:
        said = f"the answer is no {schema.__name__}"
        raise HapticError(
            "bad_answer", said, "is this the daemon, and of the same version?"
        ) from error


def _require_off(status: Status) -> None:
    if status.output_on is not False:
        known = "is still on" if status.output_on else "cannot be shown to be off"
        said = f"the output {known}: {status.output_said}"
        raise HapticError("not_off", said, "switch the amplifier off by hand")


def _error_of(status: int, content: bytes) -> HapticError:
    try:
        said = ErrorReport.model_validate_json(content).error
    except ValidationError:
        return HapticError("bad_answer", f"status {status} without a reason", "is this the daemon?")
    kinds = {
        403: RefusedError,
        409: RefusedError,
        400: BadInputError,
        413: BadInputError,
        422: BadInputError,
    }
    return kinds.get(status, HapticError)(said.code, said.message, said.hint)
