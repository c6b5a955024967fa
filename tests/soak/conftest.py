"""The killable daemon of the daemon's own tests."""

from __future__ import annotations

from tests.haptic_driver.daemon import killing

killable_daemon = killing.killable_daemon
