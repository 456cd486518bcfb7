"""A network between a Franka and its driver, on loopback, that stalls on request.

    python -m geodesic_motion_studies.hardware.stalling_network ADDRESS ARM SECONDS

It passes on what comes to ADDRESS, the requests by TCP and the packets of every millisecond, to the arm and back. As a
router that translates addresses it has a port of its own in the place of the driver's. From SIGUSR1 on nothing passes
for so many seconds; then all that has come meanwhile is sent on at once, in the order in which it came, and nothing
is lost.
"""

from __future__ import annotations

import os
import selectors
import signal
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress

#: Where a Franka listens.
PORT = 1337
#: The first request ends, after a header and a version, with the port at which the driver hears the arm.
_PORT_AT = 14
_LARGEST = 65536
#: Where it is permitted it comes before driver and arm, as the network of a kernel does.
_PRIORITY = 50


class StallingNetwork:
    """All that lies between an arm and the drivers that connect to it."""

    def __init__(self, address: str, arm: str, duration: float) -> None:
        """address : where the drivers connect. arm : its address. duration : of a stall [s]."""
        self._arm, self._duration = arm, duration
        self._until = -float("inf")
        self._held: deque[Callable[[], object]] = deque()
        self.selector = selectors.DefaultSelector()
        self._listener = socket.create_server((address, PORT))
        self.selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def stall(self) -> None:
        """Let nothing pass from now on."""
        self._until = time.monotonic() + self._duration

    def serve(self) -> None:
        """Pass on what comes, for ever."""
        while True:
            left = self._until - time.monotonic()
            if self._held and left <= 0.0:
                self._release()
            for key, _ in self.selector.select(max(0.0, left) if self._held else None):
                key.data()

    def pass_on(self, send: Callable[[], object]) -> None:
        """Do it now, or after all that is held."""
        if self._held or time.monotonic() < self._until:
            self._held.append(send)
        else:
            send()

    def _release(self) -> None:
        lasted = time.monotonic() - self._until + self._duration
        print(f"held {len(self._held)} packets for {1e3 * lasted:.1f} ms", flush=True)
        while self._held:
            self._held.popleft()()

    def _accept(self) -> None:
        driver, _ = self._listener.accept()
        try:
            arm = socket.create_connection((self._arm, PORT))
        except OSError:  # no arm is there
            driver.close()
        else:
            _Connection(self, driver, arm)


class _Connection:
    """A driver's connection to the arm: requests between two sockets, packets of every millisecond between two more."""

    def __init__(self, network: StallingNetwork, driver: socket.socket, arm: socket.socket) -> None:
        self._network, self._driver, self._arm = network, driver, arm
        self._to_driver, self._to_arm = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._to_arm.bind(("", 0))
        self._arm_sends_from: tuple[str, int] | None = None
        self._asked = self._over = False
        self._read = {
            driver: self._request, arm: self._answer, self._to_driver: self._command, self._to_arm: self._state,
        }  # fmt: skip
        for each, read in self._read.items():
            network.selector.register(each, selectors.EVENT_READ, self._guarded(read))

    def _guarded(self, read: Callable[[], None]) -> Callable[[], None]:
        def guarded() -> None:
            if not self._over:
                with suppress(ConnectionRefusedError):  # the driver has closed its port
                    read()

        return guarded

    def _request(self) -> None:
        data = _received(self._driver)
        if data and not self._asked:
            self._asked = True
            (port,) = struct.unpack_from("<H", data, _PORT_AT)
            self._to_driver.connect((self._driver.getpeername()[0], port))
            own = struct.pack("<H", self._to_arm.getsockname()[1])
            data = data[:_PORT_AT] + own + data[_PORT_AT + len(own) :]
        self._stream(self._arm, data)

    def _answer(self) -> None:
        self._stream(self._driver, _received(self._arm))

    def _state(self) -> None:
        data, self._arm_sends_from = self._to_arm.recvfrom(_LARGEST)
        self._send(lambda: self._to_driver.send(data))

    def _command(self) -> None:
        data = self._to_driver.recv(_LARGEST)
        self._send(lambda: self._to_arm.sendto(data, self._arm_sends_from))

    def _stream(self, receiver: socket.socket, data: bytes) -> None:
        if data:
            self._send(lambda: receiver.sendall(data))
            return
        self._over = True
        for each in self._read:
            self._network.selector.unregister(each)
        self._send(self._close)

    def _send(self, send: Callable[[], object]) -> None:
        def tried() -> None:
            with suppress(OSError):  # who is to have it has closed it
                send()

        self._network.pass_on(tried)

    def _close(self) -> None:
        for each in self._read:
            each.close()


def _received(stream: socket.socket) -> bytes:
    """What has come by TCP; nothing where the connection has ended."""
    try:
        return stream.recv(_LARGEST)
    except ConnectionResetError:
        return b""


def main() -> None:
    """Pass on until SIGINT or SIGTERM."""
    address, arm, duration = sys.argv[1:]
    network = StallingNetwork(address, arm, float(duration))
    signal.signal(signal.SIGUSR1, lambda number, frame: network.stall())
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # it holds nothing that has to be ended in order
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    network.serve()


if __name__ == "__main__":
    main()
