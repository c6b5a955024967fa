"""Serves a simulated instrument as a USBTMC device, beneath pyusb: no kernel, no cable."""

from __future__ import annotations

import array
import errno
import queue
import struct
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, Self

import usb.backend
import usb.core

from hw.serving.responder import Disconnect, Responder

BULK_OUT, BULK_IN, INTERRUPT_IN = 0x02, 0x86, 0x88
_HEADER = struct.Struct("<BBBxLBxxx")
_PACKET_BYTES = 512
_LANGUAGE_EN_US = 0x0409
_STRINGS = ("", "Agilent Technologies", "33220A")  # by index; the serial number follows
_SUCCESS, _PENDING, _NOT_IN_PROGRESS = 1, 2, 0x81
# USBTMC 1.0, no TermChar; USB488 1.0 with 488.2, remote/local and trigger; SCPI, service requests,
# RL1, DT1
_CAPABILITIES = bytes(
    [_SUCCESS, 0, 0x00, 0x01, 0, 0, *[0] * 6, 0x00, 0x01, 0b111, 0b1111, *[0] * 8]
)


class SimulatedUsbBackend(usb.backend.IBackend):  # type: ignore[misc]  # pyusb has no types
    """A pyusb back end with one USBTMC device on it, as strict as the class allows.

    A message that breaks the rules (tag zero, repeated or without its complement; size zero or not
    that of the transfer; a request while one is open) halts Bulk-OUT, as does a device clear, until
    the halt is cleared; `violations` says why. The instrument works in a thread of its own, which
    `close`, or leaving a `with` block, ends. `pending_checks` is how often a split request answers
    "pending".
    """

    def __init__(
        self,
        core: Responder,
        *,
        vendor_id: int = 0x0957,
        product_id: int = 0x0407,
        serial_number: str = "SIM0001",
        pending_checks: int = 0,
    ) -> None:
        self.core = core
        self._vendor_id, self._product_id, self._serial_number = (
            vendor_id,
            product_id,
            serial_number,
        )
        self.pending_checks = pending_checks
        self.resource = f"USB0::0x{vendor_id:04X}::0x{product_id:04X}::{serial_number}::0::INSTR"
        self.violations: list[str] = []
        self._changed = threading.Condition()
        self._messages: queue.SimpleQueue[tuple[int, bytes] | None] = queue.SimpleQueue()
        self._owner: object | None = None
        self._plugged_in = 0  # counts pluggings; a handle belongs to one of them
        self._configuration = 1
        self._forget()
        self._thread = threading.Thread(
            target=self._work, name=f"serve {self.resource}", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End the instrument's thread."""
        self._messages.put(None)
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *reason: object) -> None:
        """Close, whatever the reason."""
        self.close()

    def replug(self) -> None:
        """Pull the cable and put it back: open handles are dead, everything under way is lost."""
        with self._changed:
            self._plugged_in += 1
            self._owner = None
            self._forget()
            self._changed.notify_all()

    # --- the instrument's side
    # -----------------------------------------------------------------------------

    def _forget(self) -> None:
        """Drop everything under way; answers still being made belong to an older generation, as
        after each message.
        """
        self._generation = getattr(self, "_generation", 0) + 1
        self._command = bytearray()  # of a message whose end has not come
        self.answers = bytearray()
        self._request: tuple[int, int] | None = None  # tag and size that the host asked for
        self._transfer: bytearray | None = None  # what is left of the transfer on Bulk-IN
        self._interrupts: list[bytes] = []
        self._last_tag = 0
        self.halted = False
        self._checks_left = 0

    def _work(self) -> None:
        while (item := self._messages.get()) is not None:
            generation, message = item
            try:
                answer = self.core.handle(message)
            except Disconnect:
                self.replug()
                continue
            with self._changed:
                if generation == self._generation:
                    self.answers += answer
                    self._changed.notify_all()

    # --- bulk and interrupt transfers
    # ----------------------------------------------------------------------

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        """Take one transfer; raises USBError EPIPE when the endpoint is halted."""
        with self._changed:
            self._check(dev_handle)
            transfer = bytes(data)
            if self.halted:
                raise _usb_error(errno.EPIPE)
            problem = self._problem(transfer)
            if problem is not None:
                self.violations.append(problem)
                self.halted = True
                raise _usb_error(errno.EPIPE)
            self._take(transfer)
            return len(transfer)

    def _problem(self, transfer: bytes) -> str | None:
        """Say which rule of sections 3.2 to 3.3 a Bulk-OUT transfer breaks, if any."""
        if len(transfer) < _HEADER.size:
            return f"transfer of {len(transfer)} bytes"
        kind, tag, inverse, size, _ = _HEADER.unpack_from(transfer)
        payload = size if kind == 1 else 0
        rules = {
            f"tag {tag}, complement {inverse}": tag != 0 and inverse == ~tag & 0xFF,
            f"tag {tag} twice": tag != self._last_tag,
            f"message kind {kind}": kind in (1, 2, 128),
            "size 0": size > 0 or kind == 128,
            f"{len(transfer)} bytes for a payload of {payload}": (
                len(transfer) == _HEADER.size + payload + -payload % 4
            ),
            "a request while one is open": kind != 2 or self._request is None,
        }
        return next((broken for broken, kept in rules.items() if not kept), None)

    def _take(self, transfer: bytes) -> None:
        kind, self._last_tag, _, size, attributes = _HEADER.unpack_from(transfer)
        if kind == 2:
            self._request = (self._last_tag, size)
            self._changed.notify_all()
            return
        self.answers.clear()  # a new message interrupts an answer that was not fetched
        self._command += b"*TRG" if kind == 128 else transfer[_HEADER.size : _HEADER.size + size]
        if kind == 128 or attributes & 1:
            message = bytes(self._command)
            self._command.clear()
            self._generation += 1
            self._messages.put(
                (self._generation, message if message.endswith(b"\n") else message + b"\n")
            )

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        """Hand over packets until a short one or until `buff` is full."""
        with self._changed:
            deadline_s = time.monotonic() + timeout / 1e3
            self._check(dev_handle)
            while self._transfer is None and not self._begin_transfer():
                if not self._changed.wait(deadline_s - time.monotonic()):
                    raise usb.core.USBTimeoutError("timed out", -7, errno.ETIMEDOUT)
                self._check(dev_handle)
            return self._packets(buff)

    def _begin_transfer(self) -> bool:
        if self._request is None or not self.answers:
            return False
        (tag, size), self._request = self._request, None
        payload = bytes(self.answers[:size])
        del self.answers[:size]
        self._transfer = bytearray(self.reply(tag, payload, last=not self.answers))
        return True

    def reply(self, tag: int, payload: bytes, *, last: bool) -> bytes:
        """One transfer on Bulk-IN; a test may override this to answer wrongly."""
        header = _HEADER.pack(2, tag, ~tag & 0xFF, len(payload), last)
        return header + payload + bytes(-len(payload) % 4)

    def _packets(self, buff: Any) -> int:
        assert self._transfer is not None
        done = 0
        while done < len(buff):
            packet = self._transfer[:_PACKET_BYTES]
            if len(packet) > len(buff) - done:
                raise _usb_error(errno.EOVERFLOW)
            buff[done : done + len(packet)] = array.array("B", packet)
            done += len(packet)
            del self._transfer[: len(packet)]
            if len(packet) < _PACKET_BYTES:
                self._transfer = None
                break
        return done

    def intr_read(self, dev_handle: Any, ep: int, intf: int, size: Any, timeout: int) -> int:
        """Hand over one notification."""
        with self._changed:
            self._check(dev_handle)
            if not self._interrupts:
                raise usb.core.USBTimeoutError("timed out", -7, errno.ETIMEDOUT)
            data = self._interrupts.pop(0)
            size[: len(data)] = array.array("B", data)
            return len(data)

    def clear_halt(self, dev_handle: Any, ep: int) -> None:
        """Let an endpoint work again."""
        with self._changed:
            self._check(dev_handle)
            if ep == BULK_OUT:
                self.halted = False

    # --- control requests
    # ----------------------------------------------------------------------------------

    def ctrl_transfer(
        self,
        dev_handle: Any,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: Any,
        timeout: int,
    ) -> int:
        """Answer string descriptors and the class's requests; anything else stalls."""
        if (bmRequestType, bRequest) == (0x80, 6) and wValue >> 8 == 3:
            answer = self._string(wValue & 0xFF)
        elif bmRequestType == 0xA1 and bRequest == 128:
            answer = self._status_byte(wValue)
        else:
            with self._changed:
                self._check(dev_handle)
                answer = self._class_request(bmRequestType, bRequest, wValue, wIndex)
        count = min(len(answer), len(data))
        data[:count] = array.array("B", answer[:count])
        return count

    def _string(self, index: int) -> bytes:
        if index == 0:
            return struct.pack("<BBH", 4, 3, _LANGUAGE_EN_US)
        text = [*_STRINGS, self._serial_number][index].encode("utf-16-le")
        return bytes([len(text) + 2, 3]) + text

    def _class_request(self, kind: int, request: int, value: int, index: int) -> bytes:
        answer = None
        match kind, index:
            case 0xA2, 0x02:
                answer = self._abort_out(request, value)
            case 0xA2, 0x86:
                answer = self._abort_in(request, value)
            case 0xA1, 0:
                answer = self._interface_request(request)
        if answer is None:
            raise _usb_error(errno.EPIPE)
        return answer

    def _abort_out(self, request: int, tag: int) -> bytes | None:
        if request == 1:
            underway = tag == self._last_tag and bool(self._command)
            self._command.clear()
            return self._initiated(tag, underway)
        return bytes([self._check_status(), *[0] * 7]) if request == 2 else None

    def _abort_in(self, request: int, tag: int) -> bytes | None:
        """After INITIATE the host reads until a short packet, here one of no bytes."""
        if request == 3:
            underway = self._request is not None and self._request[0] == tag
            if underway:
                self._request, self._transfer = None, bytearray()
            return self._initiated(tag, underway)
        queued = self._transfer is not None
        return (
            bytes([_PENDING if queued else self._check_status(), queued, *[0] * 6])
            if request == 4
            else None
        )

    def _interface_request(self, request: int) -> bytes | None:
        if request == 5:
            self._forget()
            self.halted = True
            return self._initiated(0, True)[:1]
        answers = {
            7: _CAPABILITIES,
            **dict.fromkeys((64, 160, 161, 162), bytes([_SUCCESS])),
        }  # pulse, remote, lockout
        return bytes([self._check_status(), 0]) if request == 6 else answers.get(request)

    def _initiated(self, tag: int, underway: bool) -> bytes:
        self._checks_left = self.pending_checks
        return bytes([_SUCCESS if underway else _NOT_IN_PROGRESS, tag])

    def _check_status(self) -> int:
        self._checks_left -= 1
        return _PENDING if self._checks_left >= 0 else _SUCCESS

    def _status_byte(self, tag: int) -> bytes:
        """READ_STATUS_BYTE of USB488: the value comes on the interrupt endpoint."""
        if not 2 <= tag <= 127:
            raise _usb_error(errno.EPIPE)
        status = int(self.core.handle(b"*STB?\n"))
        with self._changed:
            self._interrupts.append(bytes([tag | 0x80, status]))
        return bytes([_SUCCESS, tag, 0])

    # --- what enumeration asks
    # -----------------------------------------------------------------------------

    def enumerate_devices(self) -> Iterator[Any]:
        yield self

    def get_parent(self, dev: Any) -> None:
        """No hub."""

    def get_device_descriptor(self, dev: Any) -> SimpleNamespace:
        """USB 2.0, table 9-8, and where the device is plugged in."""
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0200,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=self._vendor_id,
            idProduct=self._product_id,
            bcdDevice=0x0100,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=3,
            bNumConfigurations=1,
            bus=1,
            address=1,
            port_number=1,
            port_numbers=(1,),
            speed=3,
        )

    def get_configuration_descriptor(self, dev: Any, config: int) -> SimpleNamespace:
        """USB 2.0, table 9-10."""
        _only(config)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=39,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0xC0,
            bMaxPower=1,
            extra_descriptors=[],
        )

    def get_interface_descriptor(
        self, dev: Any, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        """USB 2.0, table 9-12: USBTMC with the USB488 subclass."""
        _only(intf, alt, config)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=3,
            bInterfaceClass=0xFE,
            bInterfaceSubClass=3,
            bInterfaceProtocol=1,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(
        self, dev: Any, ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        """USB 2.0, table 9-13."""
        _only(intf, alt, config)
        address, kind, packet = (
            (BULK_OUT, 2, _PACKET_BYTES),
            (BULK_IN, 2, _PACKET_BYTES),
            (INTERRUPT_IN, 3, 8),
        )[ep]
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=address,
            bmAttributes=kind,
            wMaxPacketSize=packet,
            bInterval=1,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    # --- handles
    # -------------------------------------------------------------------------------------------

    def open_device(self, dev: Any) -> Any:
        """A handle that dies with the present plugging."""
        return SimpleNamespace(plugged_in=self._plugged_in)

    def close_device(self, dev_handle: Any) -> None:
        with self._changed:
            if self._owner is dev_handle:
                self._owner = None

    def set_configuration(self, dev_handle: Any, config_value: int) -> None:
        """Choose the one configuration."""
        self._configuration = config_value

    def get_configuration(self, dev_handle: Any) -> int:
        """The configuration in force."""
        return self._configuration

    def set_interface_altsetting(self, dev_handle: Any, intf: int, altsetting: int) -> None:
        _only(intf, altsetting)

    def claim_interface(self, dev_handle: Any, intf: int) -> None:
        """Take the interface; raises USBError EBUSY while another handle has it."""
        with self._changed:
            self._check(dev_handle, claimed=False)
            if self._owner is not None and self._owner is not dev_handle:
                raise _usb_error(errno.EBUSY)
            self._owner = dev_handle

    def release_interface(self, dev_handle: Any, intf: int) -> None:
        """Give the interface back."""
        self.close_device(dev_handle)

    def is_kernel_driver_active(self, dev_handle: Any, intf: int) -> bool:
        return False

    def _check(self, dev_handle: Any, *, claimed: bool = True) -> None:
        if dev_handle.plugged_in != self._plugged_in:
            raise _usb_error(errno.ENODEV)
        if claimed and self._owner is not dev_handle:
            raise _usb_error(errno.EBUSY)


def _usb_error(code: int) -> usb.core.USBError:
    return usb.core.USBError(errno.errorcode[code], None, code)


def _only(*indices: int) -> None:
    """Descriptors are asked for by index until IndexError."""
    if any(indices):
        raise IndexError(indices)
