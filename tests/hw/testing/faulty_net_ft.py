"""A simulated Net F/T box with faults on demand."""

from __future__ import annotations

import enum
import socket

from hw.force.net_ft_server import BAD_STATUS_RAW, NetFtServer, WrenchSource


class RdtFault(enum.Enum):
    """What happens to a record instead of being sent."""

    DROP = "drop"
    REORDER = "reorder"  # sent after its successor
    DUPLICATE = "duplicate"  # sent twice
    FROZEN = "frozen"  # the box repeats its last measurement under a new RDT sequence
    BAD_STATUS = "bad status"
    WRONG_SOURCE = "wrong source"  # sent from another port
    WRONG_LENGTH = "wrong length"  # cut short
    SILENCE = "silence"  # as DROP, and the sequence stands still


class FaultyNetFt(NetFtServer):
    """Spoils records between `inject` and `heal`."""

    def __init__(
        self,
        wrench: WrenchSource,
        *,
        counts_per_n: float = 1e6,
        counts_per_n_m: float = 1e6,
        rate_hz: float | None = 1000.0,
        range_n: float = float("inf"),
    ) -> None:
        super().__init__(
            wrench,
            counts_per_n=counts_per_n,
            counts_per_n_m=counts_per_n_m,
            rate_hz=rate_hz,
            range_n=range_n,
        )
        self._fault: RdtFault | None = None
        self._fault_count = 0.0
        self._spoiled_by: RdtFault | None = None  # the record that is being sent
        self._held_back: bytes | None = None
        self._stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._stranger.bind(("127.0.0.1", 0))

    @property
    def streaming(self) -> bool:
        """Whether a client is being served."""
        with self._lock:
            return self._client is not None

    def close(self) -> None:
        super().close()
        self._stranger.close()

    def inject(self, fault: RdtFault, *, count: float = 1) -> None:
        """Spoil the next `count` records (`math.inf`: all until `heal`)."""
        with self._lock:
            self._fault, self._fault_count = fault, count

    def heal(self) -> None:
        """Send records properly again."""
        with self._lock:
            self._fault_count = 0.0

    def set_sequence(self, rdt_sequence: int) -> None:
        """Number the next record `rdt_sequence` + 1, e.g. to see the counter wrap."""
        with self._lock:
            self._rdt_sequence = rdt_sequence

    def _emit(self) -> None:
        if self._client is None:
            return
        self._spoiled_by = self._fault if self._fault_count >= 1 else None
        self._fault_count -= self._spoiled_by is not None
        if self._spoiled_by is RdtFault.SILENCE:
            return
        if self._spoiled_by is RdtFault.FROZEN:
            self._f_t_sequence -= 1
        if self._spoiled_by is not RdtFault.BAD_STATUS:
            super()._emit()  # and a test may set the status meanwhile
            return
        status_raw, self.status_raw = self.status_raw, BAD_STATUS_RAW
        super()._emit()
        self.status_raw = status_raw

    def _send(self, record: bytes) -> None:
        match self._spoiled_by:
            case RdtFault.DROP:
                return
            case RdtFault.REORDER:
                self._held_back = record
                return
            case RdtFault.WRONG_SOURCE:
                assert self._client is not None
                self._stranger.sendto(record, self._client)
                return
            case RdtFault.DUPLICATE:
                super()._send(record)
            case RdtFault.WRONG_LENGTH:
                record = record[:-4]
        super()._send(record)
        if self._held_back is not None:
            super()._send(self._held_back)
            self._held_back = None
