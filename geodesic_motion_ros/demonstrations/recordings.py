"""Recordings of every kind -> demonstrations to learn from, with everything that was found in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geodesic_motion_ros.demonstrations import bags
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.flaws import find_strangers, repair_demonstration, repair_samples
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.readers import (
    convert_to_radians,
    make_demonstrations,
    make_joint_demonstrations,
)
from geodesic_motion_ros.demonstrations.rounds import Rounds, find_returns, find_rounds
from geodesic_motion_ros.demonstrations.splitting import Split, split_take
from geodesic_motion_ros.demonstrations.takes import NO_FLAW, Action, Flaw, Take
from geodesic_motion_ros.demonstrations.turns import align_turns, unwrap_turns
from geodesic_motion_ros.geometry.curves import arc_length
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.errors import DemonstrationError

if TYPE_CHECKING:
    from geodesic_motion_ros.robot.kinematics import Robot

#: With a larger share of demonstrations left out, the recording is another one than it was taken for.
LARGEST_SHARE_LEFT_OUT = 0.5


@dataclass(frozen=True, eq=False)
class Recording:
    """One recording of a task by a person, before it becomes demonstrations.

    Attributes
    ----------
    takes : as they were recorded.
    motions : the demonstrations in them, samples repaired, also those that are left out.
    flaws : all that was found, in the order of time within each take.
    robot : whose joints were recorded; "": poses of a tool were.
    rounds : the rounds in the motions, from which a closed skill is learned; None: they lead elsewhere.
    """

    takes: tuple[Take, ...]
    motions: tuple[Take, ...]
    flaws: tuple[Flaw, ...]
    robot: str
    rounds: Rounds | None = None

    @classmethod
    def of_files(cls, takes: Sequence[Take], robot: str = "", closed: bool | None = None) -> Recording:
        """Read takes that are one demonstration each. DemonstrationError: a value that cannot be used.

        closed : as of `find_rounds`; False: none are looked for.
        """
        arm = _robot(robot) if robot else None
        repaired = [_repaired(take, arm) for take in takes]
        flaws = [flaw for take, (_, found) in zip(takes, repaired, strict=True) for flaw in (*take.found, *found)]
        return cls._of(takes, [take for take, _ in repaired], flaws, robot, closed)

    @classmethod
    def of_bags(
        cls,
        paths: Sequence[Path],
        topic: str | None,
        how: Split,
        robot: str,
        units: str | None = None,
        closed: bool | None = None,
    ) -> Recording:
        """Read bags with one or more demonstrations each.

        robot : whose joints are read where the topic has joints. units : of joints, "deg", or "rad" as ROS has them.
        closed : as of `of_files`.

        Raises
        ------
        DemonstrationError : a bag cannot be read, lacks the topic, or nothing moves in it; topics of both kinds.
        """
        reads = []
        for path in paths:
            source, found = bags.choose_source(path, topic)
            names = _robot(robot).joint_names if found.kind == bags.JOINTS else ()
            read = bags.read_take(path, source, names, how.marker)
            if names:
                read = replace(read, take=convert_to_radians([read.take], units)[0])
            reads.append(_in_base(read, robot))
        takes = [read.take for read in reads]
        if len({take.is_of_joints for take in takes}) > 1:
            raise DemonstrationError("some of the bags have joints and some have poses: name one topic with --topic")
        names = [take.name for take in takes]
        if len(set(names)) < len(names):
            raise DemonstrationError("two bags have the same name; demonstrations are called by it: rename one")
        return cls.of_long_takes(reads, how, robot if takes[0].is_of_joints else "", closed)

    @classmethod
    def of_long_takes(
        cls, reads: Sequence[bags.BagTake], how: Split, robot: str = "", closed: bool | None = None
    ) -> Recording:
        """Split takes with one or more demonstrations each. DemonstrationError: nothing moves in one.

        closed : as of `of_files`.
        """
        arm = _robot(robot) if robot else None
        motions: list[Take] = []
        flaws: list[Flaw] = []
        for read in reads:
            take, repaired = _repaired(read.take, arm)
            flaws += [*read.flaws, *take.found, *repaired]
            if not any(flaw.action is Action.REFUSED for flaw in repaired):
                parts, between = split_take(take, how, read.markers, read.breaks)
                motions += parts
                flaws += between
        return cls._of([read.take for read in reads], motions, flaws, robot, closed)

    @classmethod
    def _of(
        cls, takes: Sequence[Take], motions: Sequence[Take], flaws: list[Flaw], robot: str, closed: bool | None
    ) -> Recording:
        motions, turns = align_turns(motions, _robot(robot)) if robot else (motions, [])
        repaired = [repair_demonstration(motion) for motion in motions]
        flaws = [*flaws, *turns, *(flaw for _, found in repaired for flaw in found)]
        found = cls(tuple(takes), tuple(motion for motion, _ in repaired), tuple(flaws), robot)
        if found.refusals or not found._kept():
            return found
        rounds = None if closed is False else find_rounds(found._kept(), closed)
        if rounds is not None:
            return replace(found, flaws=(*flaws, *rounds.flaws), rounds=rounds)
        return replace(found, flaws=(*flaws, *found._strangers(), *find_returns(found._kept())))

    @property
    def refusals(self) -> tuple[Flaw, ...]:
        """The flaws for which nothing is learned from the recording as a whole."""
        return tuple(flaw for flaw in self.flaws if flaw.action is Action.REFUSED)

    @property
    def left_out_names(self) -> frozenset[str]:
        """Names of the motions that are not learned from."""
        return frozenset(flaw.demonstration for flaw in self.flaws if flaw.action is Action.LEFT_OUT)

    def demonstrations(self, strict: bool = False) -> Demonstrations | JointDemonstrations:
        """Make the demonstrations to learn from.

        strict : refuse every flaw.

        Raises
        ------
        DemonstrationError : names the first flaw for which the recording is refused, or all that leave too little.
        """
        wrong = [flaw for flaw in self.flaws if flaw.action not in NO_FLAW] if strict else self.refusals
        if wrong:
            more = f" (and {len(wrong) - 1} more: `inspect` lists them)" if len(wrong) > 1 else ""
            rule = "; --strict refuses it" if strict and wrong[0].action is not Action.REFUSED else ""
            raise DemonstrationError(f"demonstration {wrong[0]}{rule}{more}")
        kept = self._kept()
        left = [flaw for flaw in self.flaws if flaw.action is Action.LEFT_OUT and flaw.demonstration in self._names]
        if len(kept) < (1.0 - LARGEST_SHARE_LEFT_OUT) * len(self.motions) or not kept:
            listed = "; ".join(map(str, left[:5])) + (f"; and {len(left) - 5} more" if len(left) > 5 else "")
            raise DemonstrationError(f"{len(kept)} of {len(self.motions)} demonstrations remain: {listed}")
        return self._demonstrations(kept if self.rounds is None else self.rounds.motions)

    def describe(self) -> dict[str, list[dict[str, Any]]]:
        """Describe the demonstrations and the flaws in plain values; times [s], lengths [rad] of joints or [m]."""
        return {
            "demonstrations": [
                {
                    "name": take.name, "from": float(take.times[0]), "to": float(take.times[-1]), "samples": len(take),
                    "rate": float((len(take) - 1) / (take.times[-1] - take.times[0])),
                    "length": float(arc_length(take.values if take.is_of_joints else take.values[:, :3])[-1]),
                    "learned": "no" if take.name in self.left_out_names or self.refusals else "yes",
                }
                for take in self.motions
            ],
            "flaws": [
                {
                    "demonstration": flaw.demonstration, "time": flaw.time, "what": flaw.what,
                    "action": f"{flaw.action.value}: {flaw.how}" if flaw.how else flaw.action.value,
                }
                for flaw in self.flaws
            ],
        }  # fmt: skip

    @property
    def _names(self) -> set[str]:
        return {motion.name for motion in self.motions}

    def _kept(self) -> list[Take]:
        return [motion for motion in self.motions if motion.name not in self.left_out_names]

    def _demonstrations(self, motions: Sequence[Take]) -> Demonstrations | JointDemonstrations:
        return make_joint_demonstrations(motions, self.robot) if self.robot else make_demonstrations(motions)

    def _strangers(self) -> list[Flaw]:
        demonstrations = self._demonstrations(self._kept())
        if not self.robot:
            return find_strangers(demonstrations)
        tool = demonstrations.tool_demonstrations(_robot(self.robot))
        return find_strangers(tool, [item.configurations[[0, -1]] for item in demonstrations])


def _in_base(read: bags.BagTake, robot: str) -> bags.BagTake:
    """The take, and the question where its poses are in another frame than the robot's base."""
    base = RobotDescription.named(robot).base_link
    if read.frame in ("", base):
        return read
    how = f"taken for poses in {base}, the base of {robot}: are they? Otherwise --topic /tf:{base}:TOOL_FRAME"
    flaw = Flaw(read.take.name, 0.0, f"has poses in the frame {brief(read.frame)}", Action.KEPT, how)
    return replace(read, flaws=(*read.flaws, flaw))


def _repaired(take: Take, robot: Robot | None) -> tuple[Take, list[Flaw]]:
    """The take without whole turns and wrong samples; robot : whose joints it has, None: it has poses."""
    take, turns = unwrap_turns(take, robot) if robot else (take, [])
    take, found = repair_samples(take)
    return take, turns + found


def _robot(name: str) -> Robot:
    # compiled kernels, which recordings of poses do without
    from geodesic_motion_ros.robot.kinematics import Robot

    return Robot.named(name)
