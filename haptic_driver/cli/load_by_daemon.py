"""`haptic load hold` where a daemon has the rig: under a lease, until Ctrl-C."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from haptic_driver.cli.control import client_of, held_already, lease_file
from haptic_driver.cli.output import signals_to, stderr
from haptic_driver.cli.output import status as shown_status
from haptic_driver.client import LEASE_S, HapticClient, NoDaemonError
from haptic_driver.daemon.messages import LoadPhase, Status
from haptic_driver.errors import HapticError
from haptic_driver.rig.load_loop import settled

POLL_S = 0.1
LET_GO_S = 15.0  # for the stage to show that it rests
RESTS = (LoadPhase.FREE, LoadPhase.STOPPED)


def daemon_on(rig: str | None, socket: str | None) -> HapticClient | None:
    """A client of the daemon that answers, if it has the rig of this name or none is named.

    NoDaemonError where nobody answers at a `socket` that the command line, not the environment,
    gives.
    """
    try:
        client = client_of(socket)
        return client if rig is None or client.status().rig == rig else None
    except NoDaemonError:
        if socket is not None and socket != os.environ.get("HAPTIC_SOCKET"):
            raise
        return None


def hold(client: HapticClient, newtons: float, seconds: float | None) -> dict[str, Any]:
    """Hold a load for so long after it has settled, or until Ctrl-C; what is said of it.

    HapticError when the daemon lets go before, or does not show in the end that it did. Another
    load that was asked for under the same lease is an error too, and is left held.
    """
    loads, depth_m, until_s, is_ours = list[float](), math.nan, math.inf, True
    as_ctrl_c = signals_to(signal.default_int_handler)
    with _lease(client) as token, as_ctrl_c, shown_status("load stage") as tell:
        try:
            client.hold_load(token, newtons)
            while time.monotonic() < until_s:
                status = client.status()
                load = status.load
                if load is None or load.target_n is None:
                    raise _ended(status)
                if load.target_n != newtons:
                    is_ours = False
                    raise _taken_over(load.target_n)
                tell(str(load))
                if load.phase is LoadPhase.HOLD and load.load_n is not None:
                    if not loads and settled(load.load_n, newtons):
                        stderr.print(f"holding {newtons:g} N; Ctrl-C lets go")
                        until_s = math.inf if seconds is None else time.monotonic() + seconds
                        loads.append(load.load_n)
                    elif loads:
                        loads.append(load.load_n)
                    depth_m = math.nan if load.depth_m is None else load.depth_m
                time.sleep(POLL_S)
        except KeyboardInterrupt:  # the usual end
            pass
        except NoDaemonError as gone:
            raise _gone() from gone
        finally:
            if is_ours:
                with suppress(NoDaemonError):
                    client.release_load()
        _await_free(client)
    mean_n = sum(loads) / len(loads) if loads else math.nan
    return {"load_n": newtons, "mean_load_n": mean_n, "depth_m": depth_m}


@contextmanager
def _lease(client: HapticClient) -> Iterator[str]:
    """The token of an earlier `haptic arm` of this user, or of a lease of our own, which
    `haptic set` may use too.
    """
    held = held_already(client)
    if held is not None:
        yield held.token
        return
    with (
        client.armed(LEASE_S, f"haptic load hold, process {os.getpid()}") as session,
        lease_file(client.address, session.token),
    ):
        session.wait_held()
        yield session.token


def _await_free(client: HapticClient) -> None:
    until_s = time.monotonic() + LET_GO_S
    while (load := client.status().load) is not None and load.phase not in RESTS:
        if time.monotonic() >= until_s:
            raise HapticError(
                "load_presses",
                f"the load stage has not shown that it let go: {load}",
                "Lift the finger off by hand, switch the stage off",
            )
        time.sleep(POLL_S)


def _gone() -> HapticError:
    return HapticError(
        "load_let_go",
        "the daemon has ended while the load was held; whether the stage let go is unknown",
        "Look whether the finger is free, and lift it off if not",
    )


def _taken_over(newtons: float) -> HapticError:
    return HapticError(
        "load_taken_over",
        f"the holder of the lease asked for {newtons:g} N meanwhile",
        "haptic load release lets go",
    )


def _ended(status: Status) -> HapticError:
    """Why the daemon lets go, which nobody here has asked for."""
    if status.fault is not None:
        return HapticError(
            "load_let_go",
            f"the daemon went into fault: {status.fault}",
            "Remove the cause, then haptic reset",
        )
    said = "the load was let go: by OFF, a release, the end of the lease, or the daemon's end"
    return HapticError("load_let_go", said, "Then hold it again")
