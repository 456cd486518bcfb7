"""A network that holds what comes, and then sends it on."""

from __future__ import annotations

import select
import signal
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from geodesic_motion_ros.demo.demo_run import Processes
from geodesic_motion_ros.demo.server_probe import loopback_address
from geodesic_motion_studies.hardware.served_runs import start_network
from geodesic_motion_studies.hardware.stalling_network import PORT

#: Of a stall, and the longest that anything is waited for [s].
STALL, PATIENCE = 0.5, 100.0


class Ends:
    """An arm and a driver with a network between them, connected."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        def kept(each: socket.socket) -> socket.socket:
            each.settimeout(PATIENCE)
            return stack.enter_context(each)

        self.arm_listener = kept(socket.create_server((loopback_address(), PORT)))
        self.processes = stack.enter_context(Processes(folder, {}))
        start_network(self.processes, loopback_address(), STALL)
        self.driver_packets, self.arm_packets = (
            kept(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)
        )
        self.driver_packets.bind(("127.0.0.1", 0))
        self.driver = kept(_connected(loopback_address(network=True)))
        self.arm = kept(self.arm_listener.accept()[0])
        # header, version, and where the driver hears packets
        self.driver.sendall(struct.pack("<IIIHH", 0, 1, 16, 9, self.driver_packets.getsockname()[1]))
        *header, port = struct.unpack("<IIIHH", self.arm.recv(100))
        assert header == [0, 1, 16, 9]
        self.arm_packets.sendto(b"state", (self.arm.getpeername()[0], port))
        data, network = self.driver_packets.recvfrom(100)
        assert data == b"state"
        self.arm_packets.connect((self.arm.getpeername()[0], port))
        self.driver_packets.connect(network)


def _connected(address: str) -> socket.socket:
    """A connection to a program that is still starting."""
    until = time.monotonic() + PATIENCE
    while True:
        try:
            return socket.create_connection((address, PORT))
        except ConnectionRefusedError:
            assert time.monotonic() < until
            time.sleep(0.01)


@pytest.fixture
def ends(tmp_path: Path) -> Iterator[Ends]:
    with ExitStack() as stack:
        yield Ends(tmp_path, stack)


def test_what_is_sent_arrives_at_the_other_end(ends: Ends) -> None:
    ends.driver.sendall(b"request")
    assert ends.arm.recv(100) == b"request"
    ends.arm.sendall(b"answer")
    assert ends.driver.recv(100) == b"answer"
    ends.driver_packets.send(b"command")
    assert ends.arm_packets.recv(100) == b"command"


def test_a_stall_holds_what_comes_from_either_end_and_loses_and_overtakes_nothing(ends: Ends) -> None:
    ends.processes.send("network", signal.SIGUSR1)
    until = time.monotonic() + PATIENCE
    streams = (ends.driver_packets, ends.arm_packets), (ends.arm_packets, ends.driver_packets), (ends.driver, ends.arm)
    sent, received = b"", [b"", b"", b""]
    while "held " not in ends.processes.log("network") or min(map(len, received)) < len(sent):
        if "held " not in ends.processes.log("network"):
            sent += bytes([len(sent) % 256])
            for sender, _ in streams:
                sender.send(sent[-1:])
        for stream, (_, receiver) in enumerate(streams):
            while select.select([receiver], [], [], 0.0)[0]:
                received[stream] += receiver.recv(1000)
        assert time.monotonic() < until, (len(sent), [len(each) for each in received])
        time.sleep(5e-3)  # what a stall holds fits into the receiver's buffer
    assert received == [sent] * 3
    _, count, _, _, lasted, _ = ends.processes.log("network").split()
    assert int(count) > 0
    assert float(lasted) >= 1000.0 * STALL


def test_the_end_of_a_connection_is_passed_on_and_another_one_begins(ends: Ends) -> None:
    ends.driver.close()
    assert ends.arm.recv(100) == b""
    again = _connected(loopback_address(network=True))
    with again, ends.arm_listener.accept()[0] as arm:
        arm.sendall(b"answer")
        assert again.recv(100) == b"answer"
