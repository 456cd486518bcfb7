"""The place of the arm, out of joint states as drivers publish them: whole or in parts, fast or slow, by any clock.

Each joint has a time of its own. The state is of the oldest of these times, at which every joint is known: those that
were heard later are interpolated between their last two messages.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.nodes.input_faults import NO_CLOCK
from geodesic_motion_ros.nodes.joint_bytes import SeenJointState, parse_joint_state
from geodesic_motion_ros.nodes.messages import MessageRefused, check_limits, other_prefix, read_some_joints, seconds
from geodesic_motion_ros.nodes.node_time import Moment
from geodesic_motion_ros.nodes.plausible_joints import OVERTAKEN, PlausibleJoints
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.sender_clock import SenderClock
from geodesic_motion_ros.robot.joint_history import JointHistory
from geodesic_motion_ros.robot.kinematics import Robot

#: Messages that wait for the control loop, at most: those of 50 ms of a driver that sends 1,000 a second.
_WAITING = 50
#: Times that differ by less [s] are the same: what is left of nanoseconds in sums of seconds.
_SAME = 1e-6
#: Joints that are heard of so much later [s] than others are named where the state is too old.
PARTS_APART = 0.1
#: Of so many periods of its driver state_timeout should be, so that a late state does not stop the arm.
_PERIODS = 2.0
#: Names of other joints that a reason lists.
_MOST_NAMES = 30


@dataclass(frozen=True)
class _Part:
    """What one message says of the arm: the joints by their places (k,), positions (k,) [rad], stamp, arrival."""

    places: np.ndarray
    positions: np.ndarray
    stamp: float
    arrival: Moment


class ArmState:
    """The newest state of an arm.

    Callbacks hand over messages as bytes (`receive`), the control loop reads them (`update`), and no more of them than
    it needs: of a driver that sends 1,000 whole states a second every tenth. Messages about other joints are passed
    over; what is wrong with one about the arm is refused, and counted in `refusals`.

    Attributes
    ----------
    joints : (n,) [rad] at the time `taken` [s, running]; None before every joint was heard.
    count : how many states there have been. history : those of the last seconds.
    clock : that of the driver. plausible : judges each state by the one before.
    """

    def __init__(
        self, robot: Robot, refusals: RefusalLog, prefix: str = "", topic: str = "joint_states"
    ) -> None:
        """robot : its joints have the names of the messages, which begin with the prefix. topic : where they come from.
        """
        self._topic = topic
        self._robot, self._names, self._refusals, self._prefix = robot, robot.joint_names, refusals, prefix
        self.joints: np.ndarray | None = None
        self.taken = 0.0
        self.count = 0
        self.history = JointHistory(robot)
        self.clock = SenderClock()
        self.plausible = PlausibleJoints(robot)
        self._refused = ""
        self._lock = threading.Lock()
        self._waiting: deque[tuple[bytes, Moment]] = deque(maxlen=_WAITING)
        count = len(self._names)
        # Of the last two messages about each joint, the newest first: positions [rad] and times [s], stamps [s].
        self._positions, self._times = np.full((2, count), np.nan), np.full((2, count), -np.inf)
        self._stamps = np.zeros(count)
        # Joints of the messages that were passed over, when the newest of them came [s], and whether one of them was
        # about the arm.
        self._others: dict[str, None] = {}
        self._others_since = -np.inf
        # When the newest message about the arm came [s].
        self._heard = -np.inf
        self._has_no_positions = False
        # When `remarks` was asked last [s], of how many states, and how often in a row these came too slowly, or joints
        # had not been heard of.
        self._asked, self._counted, self._slow, self._unheard = 0.0, 0, 0, 0

    def receive(self, wire: bytes, arrival: Moment) -> None:
        """Note a serialised JointState; any thread may call this."""
        self._waiting.append((wire, arrival))

    def update(self) -> None:
        """Read what has been received since the last call; any thread may call this."""
        with self._lock:
            self._update()

    def _update(self) -> None:
        parts: list[_Part] = []
        is_newest = True
        while self._waiting:
            wire, arrival = self._waiting.pop()
            with self._refusals.guard(self._topic) as guard:
                part = self._read(wire, arrival)
            if guard.reason or part is not None:
                self._heard = max(self._heard, arrival.running)
                self._refused = guard.reason if is_newest else self._refused
                is_newest = False
            if guard.reason or part is None:
                continue
            parts.append(part)
            if len(part.places) == len(self._names):
                # What is older is not needed.
                self._waiting.clear()
        for part in reversed(parts):
            with self._refusals.guard(self._topic) as guard:
                self._merge(part)
            self._refused = guard.reason or self._refused

    def fault(self, now: float) -> str:
        """Return what is wrong with the newest messages, or with all so far where there is no state; "" for nothing.

        now : [s, running].
        """
        if self._others and PARTS_APART < self._others_since - self._heard < np.inf:
            return f"since then messages name {self._listed()} alone: {self._remedy()}"
        if self._refused:
            refused = f"the newest message was refused: {self._refused}"
            return "; ".join(filter(None, (refused, self.clock.remark(now))))
        if self.joints is None:
            return self._lacking()
        old = self._times[0] < np.max(self._times[0]) - PARTS_APART
        if np.any(old):
            return f"nothing new is heard of {', '.join(np.array(self._names)[old])}"
        return self.clock.remark(now)

    def remarks(self, now: float, timeout: float) -> dict[str, str]:
        """Return what a person should know of states that are taken, by kind; to be asked once a second.

        now : [s, running]. timeout : a state that is older [s] stops the arm.
        """
        rate = (self.count - self._counted) / max(now - self._asked, _SAME)
        self._asked, self._counted = now, self.count
        self._slow = self._slow + 1 if 0.0 < rate * timeout < _PERIODS else 0
        lacking = "" if self.joints is not None else self._lacking()
        # Not before it is certain: drivers publish in several messages, and a gripper's may be the first.
        self._unheard = self._unheard + 1 if lacking else 0
        remarks = {"clock": self.clock.remark(now), "names": lacking if self._unheard > 1 else ""}
        if self._slow > 1:
            remarks["rate"] = (
                f"states come {rate:.0f} times a second, state_timeout is {timeout:g} s: one that is a little late "
                f"stops the arm; have the driver send more, or set state_timeout to {_PERIODS / rate:.1f} or more"
            )
        return {kind: f"{self._topic}: {remark}" for kind, remark in remarks.items() if remark}

    def _read(self, wire: bytes, arrival: Moment) -> _Part | None:
        """None where a message says nothing of where the arm is."""
        message = parse_joint_state(wire)
        places, positions = read_some_joints(message, self._names)
        if not len(places):
            self._pass_over(message)
            self._others_since = arrival.running
            return None
        check_limits(positions, self._robot, places)
        if not arrival.has_clock:
            raise MessageRefused(f"{NO_CLOCK}: its age is unknown")
        return _Part(places, positions, seconds(message.header.stamp), arrival)

    def _pass_over(self, message: SeenJointState) -> None:
        self._others = dict(list((dict.fromkeys(message.name) | self._others).items())[:_MOST_NAMES])
        self._has_no_positions = self._has_no_positions or not set(self._names).isdisjoint(message.name)

    def _merge(self, part: _Part) -> None:
        """Take what a message says of its joints, and the state that follows where it is a new one."""
        places, stamp = part.places, part.stamp
        taken = part.arrival.running - self.clock.age(stamp, part.arrival)
        if stamp != 0.0 and np.all(self._stamps[places] == stamp):
            return  # an old state that is published again
        late = float(np.max(self._times[0, places])) - taken
        if late > OVERTAKEN:
            raise MessageRefused(f"its stamp is {late:.3g} s older than that of the newest state")
        if late > 0.0:
            return  # overtaken
        self._stamps[places] = stamp
        self._positions[1, places], self._times[1, places] = self._positions[0, places], self._times[0, places]
        self._positions[0, places], self._times[0, places] = part.positions, taken
        oldest = float(np.min(self._times[0]))
        if not np.isfinite(oldest) or (self.joints is not None and oldest <= self.taken + _SAME):
            return
        joints = self._joints_at(oldest)
        self.plausible.check(joints, oldest)
        self.joints, self.taken = joints, oldest
        self.count += 1
        self.history.add(joints, oldest)

    def _joints_at(self, time: float) -> np.ndarray:
        """Positions (n,) [rad] at a time [s] that no joint is older than."""
        newest, (later, earlier) = self._positions[0].copy(), self._times
        moving = (later > time + _SAME) & np.isfinite(earlier)
        if np.any(moving):
            before = self._robot.nearest_turn(np.where(moving, self._positions[1], newest), newest)
            share = np.minimum(1.0, (later - time)[moving] / (later - earlier)[moving])
            newest[moving] += share * (before - newest)[moving]
        return newest

    def _lacking(self) -> str:
        """Why there is no state, by the messages so far; "" where there were none."""
        unheard = [name for name, time in zip(self._names, self._times[0], strict=True) if not np.isfinite(time)]
        others = self._listed()
        if len(unheard) < len(self._names):
            return f"no message has {', '.join(unheard)}" + (f"; other joints are {others}" if others else "")
        if self._has_no_positions:
            return "the messages about the arm hold no positions"
        if not self._others:
            return ""
        return f"the messages name {others}; expected {', '.join(self._names)}: {self._remedy()}"

    def _listed(self) -> str:
        return ", ".join(self._others)

    def _remedy(self) -> str:
        """What to do where the joints of the messages are called otherwise than the arm's."""
        prefix = other_prefix(self._others, self._names, self._prefix)
        if prefix is not None:
            return f"set the parameter joint_prefix to '{prefix}'"
        return f"take a skill of that arm, or remap {self._topic} to the topic of this one, whose joints its URDF names"
