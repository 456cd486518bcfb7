"""Planner and twin on two hosts: this one, and a network namespace that a pair of virtual Ethernet devices joins to it.

Run as a process of its own, which tells what it found as JSON: a process knows only those network devices that were
there when it first talked.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from types import TracebackType

from geodesic_motion_ros.demo.demo_run import termination_as_interrupt
from geodesic_motion_ros.utils.errors import GeodesicMotionError
from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import FaultSkipped, Findings

#: Of what a wireless network does to packets.
_DELAY, _LOSS = "5ms", "1%"
_ADDRESSES = ("10.211.97.1", "10.211.97.2")


class SecondHost:
    """Exists while it is entered; FaultSkipped where the kernel or the user may not make one.

    Attributes
    ----------
    command : runs what follows it on that host. network : what its packets undergo.
    """

    def __init__(self) -> None:
        number = os.getpid()
        self._name, self._here, self._there = f"faults{number}", f"fh{number}", f"ft{number}"
        self.command: Sequence[str] = ("ip", "netns", "exec", self._name)
        self.network = "as it is"

    def __enter__(self) -> SecondHost:
        if shutil.which("ip") is None:
            raise FaultSkipped("there is no `ip` (iproute2), which makes network namespaces")
        try:
            self._join()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # With the namespace goes the device in it, and with that its other end.
        subprocess.run(["ip", "link", "del", self._here], capture_output=True)
        subprocess.run(["ip", "netns", "del", self._name], capture_output=True)

    def _join(self) -> None:
        there = self.command
        _run("ip", "netns", "add", self._name)
        _run("ip", "link", "add", self._here, "type", "veth", "peer", "name", self._there, "netns", self._name)
        for address, device, on in ((_ADDRESSES[0], self._here, ()), (_ADDRESSES[1], self._there, there)):
            _run(*on, "ip", "address", "add", f"{address}/24", "dev", device)
            _run(*on, "ip", "link", "set", device, "up", "multicast", "on")
        _run(*there, "ip", "link", "set", "lo", "up")
        _run(*there, "ip", "route", "add", "224.0.0.0/4", "dev", self._there)
        self._disturb()

    def _disturb(self) -> None:
        try:
            for device, on in ((self._here, ()), (self._there, self.command)):
                _run(*on, "tc", "qdisc", "add", "dev", device, "root", "netem", "delay", _DELAY, "loss", _LOSS)
        except (FaultSkipped, FileNotFoundError):
            self.network = "undisturbed: the kernel has no netem"
        else:
            self.network = f"{_DELAY} late, {_LOSS} lost, in each direction"


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise FaultSkipped(f"network namespaces cannot be made: {' '.join(command)}: {done.stderr.strip()}")


def motion(skill: str, folder: Path, domain: int) -> Findings:
    """One motion of a skill with its planner on the other host; FaultSkipped where that cannot be made."""
    findings = Findings()
    with SecondHost() as host, Bench(skill, folder, domain, host.command) as bench:
        bench.prepare({}, {})
        bench.asks.send_goal()
        bench.verdict("OK")
        began = time.monotonic()
        bench.arrive()
        codes = Counter(status.code for status in bench.seen.since(began))
        findings.note(f"{host.network}; goal reached after {time.monotonic() - began:.1f} s; {dict(codes)}")
        bench.judge(findings)
    return findings


def main() -> None:
    """Print what was found; of a host that cannot be made, why."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("skill")
    parser.add_argument("folder", type=Path)
    parser.add_argument("domain", type=int)
    options = parser.parse_args()
    try:
        with termination_as_interrupt():
            answer = asdict(motion(options.skill, options.folder, options.domain))
    except FaultSkipped as skipped:
        answer = {"skipped": str(skipped)}
    except GeodesicMotionError as error:
        answer = asdict(Findings([], [str(error)]))
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
