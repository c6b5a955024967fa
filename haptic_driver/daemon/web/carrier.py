"""How the page judges the carrier's ripple."""

from __future__ import annotations

from typing import TYPE_CHECKING

from haptic_driver.config import Checked
from haptic_driver.daemon.verbs import Empty, Verb
from haptic_driver.textures.bands import EDGES_HZ

if TYPE_CHECKING:
    from haptic_driver.daemon.daemon import Daemon


class CarrierRule(Checked):
    """A ripple of friction counts as felt below `quiet_above_hz`; `bands_hz`: the edges of the
    bands.
    """

    quiet_above_hz: float
    bands_hz: list[float]


def _rule(daemon: Daemon, _asked: Empty, _token: str) -> CarrierRule:
    controller = daemon.basis.settings.config.controller
    return CarrierRule(quiet_above_hz=controller.quiet_above_hz, bands_hz=EDGES_HZ.tolist())


CARRIER = Verb(
    name="carrier",
    method="GET",
    path="/carrier",
    asked=Empty,
    answer=CarrierRule,
    do=_rule,
    said="Where the ripple at twice the carrier is felt, and the bands in which it may lie.",
)
