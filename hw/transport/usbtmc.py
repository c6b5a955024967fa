"""USBTMC instruments, through pyusb: the host side of the USB Test and Measurement Class, revision
1.0.
"""

from __future__ import annotations

import errno
import re
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

import usb.core
import usb.util

from hw.errors import BadReply, DeviceDisconnected
from hw.transport.contract import NO_OTHER_BOUNDS, Bounds, Transport

_RESOURCE = re.compile(
    r"USB\d*::(?P<vendor>0x[0-9a-f]+|[1-9]\d*)::(?P<product>0x[0-9a-f]+|[1-9]\d*)(::(?P<serial>[^:]+))?(::\d+)?::INSTR",
    re.IGNORECASE,
)

_CLASS, _SUBCLASS = 0xFE, 0x03

# MsgID, table 2
_DEV_DEP_MSG_OUT = 1
_DEV_DEP_MSG_IN = 2
_HEADER = struct.Struct("<BBBxLBxxx")  # MsgID, bTag, ~bTag, TransferSize, attributes; section 3.2
_END_OF_MESSAGE = 1
_ALIGNMENT = 4

# bRequest, table 15
_INITIATE_ABORT_BULK_OUT, _CHECK_ABORT_BULK_OUT = 1, 2
_INITIATE_ABORT_BULK_IN, _CHECK_ABORT_BULK_IN = 3, 4
_INITIATE_CLEAR, _CHECK_CLEAR = 5, 6
_TO_INTERFACE, _TO_ENDPOINT = 0xA1, 0xA2  # bmRequestType: class, device to host

_SUCCESS, _PENDING = 1, 2  # USBTMC_status, table 16

# Siglent's: a transfer that is not the last holds this many bytes more than it announces, as users
# of an SDG1062X recorded (pyvisa-py, pull request 449); the sum of what all announce is right.
_UNCOUNTED = {0xF4EC: _ALIGNMENT, 0xF4ED: _ALIGNMENT}

_MAX_PAYLOAD_BYTES = (1 << 16) - _HEADER.size  # of one transfer, either way
_CHECKS = 50
_CHECK_INTERVAL_S = 0.02


class UsbTmcTransport(Transport):
    """Transport over one USBTMC interface; clearing is the device clear of the class, which drops
    late answers.

    Messages go out in transfers of at most 64 KiB; an answer is requested transfer by transfer
    until its end of message. TermChar is not used. Replies with a wrong tag, size or kind are
    refused as BadReply. `backend` is a pyusb back end, None for the system's libusb. Padding beyond
    the three bytes the class allows counts as wrong, but for makers that are known to miscount.
    """

    def __init__(
        self,
        vendor_id: int,
        product_id: int,
        serial_number: str | None = None,
        *,
        backend: Any = None,
        bounds: Bounds = NO_OTHER_BOUNDS,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        serial_part = "" if serial_number is None else f"::{serial_number}"
        super().__init__(
            f"USB0::0x{vendor_id:04X}::0x{product_id:04X}{serial_part}::INSTR", bounds=bounds
        )
        self._ids = {"idVendor": vendor_id, "idProduct": product_id}
        self._serial_number = serial_number
        self._backend = backend
        self._sleep = sleep
        self._device: Any = None
        self._tag = 0
        self._interrupted: Callable[[float], None] | None = None

    @classmethod
    def from_resource(cls, resource: str) -> UsbTmcTransport:
        """Build from `USB0::vendor::product[::serial][::interface]::INSTR`, ids decimal or 0x...;
        or ValueError.

        `0957` without its 0x is refused rather than guessed at: it is not decimal.
        """
        match = _RESOURCE.fullmatch(resource.strip())
        if match is None:
            raise ValueError(
                f"{resource!r} is not of the form USB0::0xVVVV::0xPPPP::SERIAL::0::INSTR"
            )
        return cls(int(match["vendor"], 0), int(match["product"], 0), match["serial"])

    # --- finding and claiming

    def _connect(self, deadline_s: float) -> None:
        device = _find(self._ids, self._serial_number, self._backend, self.resource)
        try:
            self._claim(device)
            self._device_clear(deadline_s)
        except usb.core.USBError as error:
            self._disconnect()
            self._raise(error, "cannot be set up")
        except BaseException:
            self._disconnect()
            raise

    def _claim(self, device: Any) -> None:
        self._device = device
        try:
            configuration = device.get_active_configuration()
        except usb.core.USBError:
            device.set_configuration()
            configuration = device.get_active_configuration()
        interface = usb.util.find_descriptor(
            configuration, bInterfaceClass=_CLASS, bInterfaceSubClass=_SUBCLASS
        )
        if interface is None:
            raise BadReply(
                f"{self.resource} has no USBTMC interface", "check the ids in the configuration"
            )
        self._interface = interface.bInterfaceNumber
        with suppress(NotImplementedError):  # systems without kernel drivers to detach
            if device.is_kernel_driver_active(self._interface):
                device.detach_kernel_driver(self._interface)
        usb.util.claim_interface(device, self._interface)
        self._bulk_out = self._endpoint(interface, usb.util.ENDPOINT_OUT)
        self._bulk_in = self._endpoint(interface, usb.util.ENDPOINT_IN)

    def _endpoint(self, interface: Any, direction: int) -> Any:
        for endpoint in interface:
            if (
                usb.util.endpoint_type(endpoint.bmAttributes) == usb.util.ENDPOINT_TYPE_BULK
                and usb.util.endpoint_direction(endpoint.bEndpointAddress) == direction
            ):
                return endpoint
        raise BadReply(f"{self.resource} lacks a bulk endpoint", "this is no USBTMC instrument")

    def _disconnect(self) -> None:
        if self._device is not None:
            with suppress(usb.core.USBError):
                usb.util.dispose_resources(self._device)
            self._device = None
        self._interrupted = None

    # --- messages

    def _send(self, data: bytes, deadline_s: float) -> None:
        for start in range(0, len(data), _MAX_PAYLOAD_BYTES):
            part = data[start : start + _MAX_PAYLOAD_BYTES]
            last = start + len(part) == len(data)
            self._write_transfer(
                _DEV_DEP_MSG_OUT, len(part), _END_OF_MESSAGE * last, part, deadline_s
            )

    def _receive(self, deadline_s: float, count: int) -> bytes:
        """Return one whole message."""
        message, announced = bytearray(), 0
        while True:
            payload, size, ended = self._read_transfer(deadline_s)
            message += payload
            announced += size
            if ended:
                return bytes(message[:announced])
            if len(message) > self._bounds.max_reply_bytes:
                raise BadReply(
                    f"{self.resource} sent {len(message)} bytes without an end of message",
                    "clear or switch it off",
                )

    def _discard_input(self) -> None:
        """Nothing comes unasked: a device sends only what was requested, and a new message cancels
        an old answer.
        """
        self._check_connected()

    def _write_transfer(
        self, kind: int, size: int, attributes: int, payload: bytes, deadline_s: float
    ) -> None:
        self._check_connected()
        self._tag = self._tag % 255 + 1
        header = _HEADER.pack(kind, self._tag, ~self._tag & 0xFF, size, attributes)
        transfer = header + payload + bytes(-len(payload) % _ALIGNMENT)
        try:
            written = self._bulk_out.write(transfer, self._remaining_ms(deadline_s))
        except usb.core.USBError as error:
            self._interrupted = self._abort_bulk_out
            self._raise(error, "did not take the command")
        if written != len(transfer):
            self._interrupted = self._abort_bulk_out
            raise self._timeout(f"took {written} of {len(transfer)} bytes")

    def _read_transfer(self, deadline_s: float) -> tuple[bytes, int, bool]:
        """Request one transfer; return its payload, the size announced, and whether it ends the
        message.
        """
        self._write_transfer(_DEV_DEP_MSG_IN, _MAX_PAYLOAD_BYTES, 0, b"", deadline_s)
        # One packet more than fits, so that the short packet that ends a full transfer is taken
        # with it.
        room = _HEADER.size + _MAX_PAYLOAD_BYTES + self._bulk_in.wMaxPacketSize
        try:
            reply = self._bulk_in.read(room, self._remaining_ms(deadline_s)).tobytes()
        except usb.core.USBError as error:
            self._interrupted = self._abort_bulk_in
            self._raise(error, "did not answer")
        return self._unpacked(reply)

    def _unpacked(self, reply: bytes) -> tuple[bytes, int, bool]:
        if len(reply) < _HEADER.size:
            raise self._bad(f"a transfer of {len(reply)} bytes, shorter than its header")
        kind, tag, inverse, size, attributes = _HEADER.unpack_from(reply)
        if kind != _DEV_DEP_MSG_IN:
            raise self._bad(f"message kind {kind} instead of {_DEV_DEP_MSG_IN}")
        if tag != self._tag or inverse != ~tag & 0xFF:
            raise self._bad(f"tag {tag} (complement {inverse}) to request {self._tag}")
        if not 0 < size <= _MAX_PAYLOAD_BYTES:
            raise self._bad(f"a size of {size} where 1 to {_MAX_PAYLOAD_BYTES} were asked for")
        excess, ended = len(reply) - _HEADER.size - size, bool(attributes & _END_OF_MESSAGE)
        if not ended and excess == _UNCOUNTED.get(self._ids["idVendor"]):
            return reply[_HEADER.size :], size, ended
        if not 0 <= excess < _ALIGNMENT:
            raise self._bad(f"{len(reply)} bytes that announce a payload of {size}")
        return reply[_HEADER.size : _HEADER.size + size], size, ended

    # --- starting again

    def _reset(self, deadline_s: float) -> None:
        """Abort what was interrupted, then clear the device; a device that does not clear is
        claimed afresh.
        """
        if self._device is not None:
            try:
                if self._interrupted is not None:
                    self._interrupted(deadline_s)
                self._device_clear(deadline_s)
            except (usb.core.USBError, BadReply):
                self._disconnect()
            else:
                return
        self._connect(deadline_s)

    def _abort_bulk_out(self, deadline_s: float) -> None:
        status = self._control(
            _TO_ENDPOINT, _INITIATE_ABORT_BULK_OUT, self._tag, self._bulk_out, 2, deadline_s
        )[0]
        if status == _SUCCESS:
            self._wait_while_pending(
                _TO_ENDPOINT, _CHECK_ABORT_BULK_OUT, self._bulk_out, 8, deadline_s
            )
        self._bulk_out.clear_halt()

    def _abort_bulk_in(self, deadline_s: float) -> None:
        status = self._control(
            _TO_ENDPOINT, _INITIATE_ABORT_BULK_IN, self._tag, self._bulk_in, 2, deadline_s
        )[0]
        if status == _SUCCESS:
            self._drain(deadline_s)
            self._wait_while_pending(
                _TO_ENDPOINT, _CHECK_ABORT_BULK_IN, self._bulk_in, 8, deadline_s
            )

    def _device_clear(self, deadline_s: float) -> None:
        status = self._control(_TO_INTERFACE, _INITIATE_CLEAR, 0, self._interface, 1, deadline_s)[0]
        if status != _SUCCESS:
            raise self._bad(f"status 0x{status:02X} to a device clear")
        self._wait_while_pending(_TO_INTERFACE, _CHECK_CLEAR, self._interface, 2, deadline_s)
        self._bulk_out.clear_halt()
        self._interrupted = None

    def _wait_while_pending(
        self, kind: int, request: int, target: Any, size: int, deadline_s: float
    ) -> None:
        """Poll a split request until it is done, draining Bulk-IN while the device has bytes there
        (bit 0).
        """
        for _ in range(_CHECKS):
            status, flags = self._control(kind, request, 0, target, size, deadline_s)[:2]
            if status != _PENDING:
                return
            if flags & 1 and request != _CHECK_ABORT_BULK_OUT:
                self._drain(deadline_s)
            self._sleep(_CHECK_INTERVAL_S)
        raise self._bad(f"request {request} still pending after {_CHECKS} checks")

    def _drain(self, deadline_s: float) -> None:
        """Read and drop until a short packet, which ends every transfer."""
        packet = self._bulk_in.wMaxPacketSize
        for _ in range(self._bounds.max_reply_bytes // packet + 1):
            if len(self._bulk_in.read(packet, self._remaining_ms(deadline_s))) < packet:
                return
        raise self._bad("packets without end")

    # --- control requests

    def _control(
        self, kind: int, request: int, value: int, target: Any, size: int, deadline_s: float
    ) -> bytes:
        """Send a class request to an endpoint or, by its number, to an interface; return exactly
        `size` bytes.
        """
        index = target if isinstance(target, int) else target.bEndpointAddress
        reply: bytes = self._device.ctrl_transfer(
            kind, request, value, index, size, self._remaining_ms(deadline_s)
        ).tobytes()
        if len(reply) != size:
            raise self._bad(f"{len(reply)} bytes instead of {size} to request {request}")
        return reply

    # --- errors

    def _check_connected(self) -> None:
        if self._device is None:
            raise self._not_connected()

    def _remaining_ms(self, deadline_s: float) -> int:
        return max(1, round(1e3 * self._remaining_s(deadline_s)))  # 0 would mean for ever

    def _raise(self, error: usb.core.USBError, what: str) -> NoReturn:
        if isinstance(error, usb.core.USBTimeoutError) or error.errno == errno.ETIMEDOUT:
            raise self._timeout(what) from None
        if error.errno in (errno.EPIPE, errno.EOVERFLOW):
            raise self._bad(f"a refusal or more than was asked for ({error})") from error
        self._disconnect()
        raise DeviceDisconnected(
            f"{self.resource} {what} ({error})",
            "check power, cable, your permission and other programs",
        ) from error

    def _bad(self, what: str) -> BadReply:
        return BadReply(
            f"{self.resource} sent {what}",
            "clear it; if this recurs, update its firmware or use LAN",
        )


def _find(ids: dict[str, int], serial_number: str | None, backend: Any, resource: str) -> Any:
    """The one device with these ids."""
    try:
        devices = list(usb.core.find(find_all=True, backend=backend, **ids))
        matching = [device for device in devices if serial_number in (None, device.serial_number)]
    except usb.core.NoBackendError:
        raise DeviceDisconnected(
            f"{resource}: no USB library was found", "install libusb 1.0 (Debian: libusb-1.0-0)"
        ) from None
    except (usb.core.USBError, ValueError) as error:  # pyusb: no language id means no permission
        raise DeviceDisconnected(
            f"{resource} cannot be asked for its serial number ({error})",
            "give your user permission to the device, e.g. by a udev rule",
        ) from error
    if not matching:
        there = ", ".join(str(device.serial_number) for device in devices) or "none"
        raise DeviceDisconnected(
            f"{resource} is not connected (serial numbers with these ids: {there})",
            "check power, cable and ids in the configuration",
        )
    if len(matching) > 1:
        there = ", ".join(str(device.serial_number) for device in matching)
        raise DeviceDisconnected(f"{resource} could be any of {there}", "add the serial number")
    return matching[0]
