"""The load stage as the watchdog knows it: the orders that lift or stop it when its program has
died.

A serial port is held by the driver, so the stage is reached only once the driver has ended.
"""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, dataclass
from typing import Self

from hw.stage.letting_go import Mounting, let_go
from hw.stage.lts150 import Lts150, StageSettings
from hw.transport.resource import make_transport

REST_S = 5.0  # for a stage to get to rest
_log = logging.getLogger("hw.safety.watchdog")


@dataclass(frozen=True)
class GuardedStage:
    """An LTS150 along the normal; `retracts`: whether it lifts off or stops where it is."""

    resource: str
    settings: StageSettings
    mounting: Mounting
    retracts: bool

    def as_text(self) -> str:
        """For a command line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_text(cls, text: str) -> Self:
        """ValueError for what `as_text` has not written."""
        try:
            given = json.loads(text)
            settings, mounting = StageSettings(**given["settings"]), Mounting(**given["mounting"])
            return cls(str(given["resource"]), settings, mounting, bool(given["retracts"]))
        except (TypeError, KeyError) as error:
            raise ValueError(f"load stage {text!r}: {error!r}") from error


class StageHold:
    """The watchdog's own way to the stage, open only while it is used; see `Hand`."""

    def __init__(self, stage: GuardedStage) -> None:
        self.resource = stage.resource
        self._stage = stage
        self._logged = ""

    def ask(self) -> bool | None:
        """Whether it rests; None when it does not say. Nothing moves."""
        transport = make_transport(self.resource, rtscts=True)
        try:
            transport.open()
            return not Lts150(transport, self._stage.settings).read_status().moving
        except Exception as error:  # whatever it is, the output must not suffer
            self._log_once(error)
            return None
        finally:
            transport.close()

    def _log_once(self, error: Exception) -> None:
        """Not again what was logged last: it tries many times."""
        said = str(error)
        if said != self._logged:
            self._logged = said
            _log.warning("%s", said if self.resource in said else f"{self.resource}: {said}")

    def switch_off(self) -> bool | None:
        """Lift off or stop; True once it rests there, None when that is not known."""
        transport = make_transport(self.resource, rtscts=True)
        driver = Lts150(transport, self._stage.settings)
        try:
            driver.connect()
            let_go(driver, self._stage.mounting, retract=self._stage.retracts)
            if self._stage.retracts:
                driver.wait(REST_S)
            return True
        except Exception as error:  # as above
            self._log_once(error)
            return None
        finally:
            transport.close()
