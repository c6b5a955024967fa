"""The killable daemon of the daemon's own tests."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

_SPEC = spec_from_file_location("killable", Path(__file__).parents[1] / "haptic_driver" / "daemon" / "conftest.py")
_daemon = module_from_spec(_SPEC)
_SPEC.loader.exec_module(_daemon)
killable_daemon, process_exists = _daemon.killable_daemon, _daemon.process_exists
