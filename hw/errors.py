"""What can go wrong with a device, in terms a caller can act on."""

# ruff: noqa: N818 - the names say what happened; `Error` adds nothing

from __future__ import annotations

from haptic_driver.base.errors import HapticError


class DeviceError(HapticError):
    """A device failed; `message` names the resource, and `code` is one per class."""

    code = "device_error"

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(type(self).code, message, hint)


class DeviceTimeout(DeviceError):
    """No complete answer came in time; whether the command was carried out is unknown."""

    code = "device_timeout"


class DeviceDisconnected(DeviceError):
    """The connection is closed, refused or lost; whether the last command was carried out is
    unknown.
    """

    code = "device_disconnected"


class BadReply(DeviceError):
    """The answer is garbage, belongs to another kind of instrument, or contradicts what was set."""

    code = "bad_reply"


class NotBelieved(DeviceError):
    """A reading that cannot be true."""

    code = "not_believed"


class LimitExceeded(DeviceError):
    """Refused before anything was sent to the device."""

    code = "limit_exceeded"


class InstrumentRejected(DeviceError):
    """The instrument understood the dialogue and posted an error of its own."""

    code = "instrument_rejected"


class SwitchedOff(DeviceError):
    """What watches the output has switched it off, and allows it to come on again."""

    code = "switched_off"
