"""A folder that takes of one task are recorded into, one file each, judged as `train` will judge them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration
from geodesic_motion_ros.demonstrations.flaws import repair_samples
from geodesic_motion_ros.demonstrations.message_samples import JointSamples
from geodesic_motion_ros.demonstrations.readers import make_joint_demonstrations, read_joint_takes
from geodesic_motion_ros.demonstrations.recorded_tables import find_files
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.splitting import Split, split_take
from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take
from geodesic_motion_ros.demonstrations.turns import unwrap_turns
from geodesic_motion_ros.demonstrations.writers import save_take
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Flaws for which a demonstration is not learned from.
_UNUSABLE = (Action.LEFT_OUT, Action.REFUSED)


class TakeFolder:
    """Takes of a robot's joints, those of earlier sessions included; a file is there whole, or not at all.

    Raises
    ------
    DemonstrationError : a file that stands in the folder cannot be read. RobotError : there is no such robot.
    """

    def __init__(self, folder: Path, robot: str, prefix: str = "") -> None:
        """prefix : before the names of the joints in messages; takes have them without it."""
        self.folder = folder
        self._robot = Robot.named(robot)
        self._joints_heard = self._robot.prefixed(prefix).joint_names
        self._robot_name = robot
        self._takes = read_joint_takes(folder, robot) if find_files(folder) else []
        recorded = Recording.of_files(self._takes, robot).motions if self._takes else ()
        self._motions = {motion.name: self._tool_motion(motion) for motion in recorded}
        self._recorded: list[str] = []
        # compiled now, not while a take waits for its verdict
        self._robot.forward(self._robot.ready)

    def __len__(self) -> int:
        return len(self._takes)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in messages."""
        return self._joints_heard

    @property
    def next_name(self) -> str:
        """Name of the next take: take_001, or one more than the highest number, those of another session included."""
        names = [*(take.name for take in self._takes), *(file.stem for file in find_files(self.folder))]
        numbers = [int(found[1]) for name in names if (found := re.fullmatch(r"take_(\d+)", name))]
        return f"take_{max(numbers, default=0) + 1:03d}"

    def keep(self, samples: JointSamples) -> str:
        """Cut a take to its motion, judge it beside the others and write it; returns what was kept, in one line.

        Raises
        ------
        DemonstrationError : why it is refused; nothing was written.
        """
        name = self.next_name
        if not len(samples):
            raise DemonstrationError(f"{name}: {samples.lacking()}")
        read = samples.take(name)
        if read.breaks:
            raise DemonstrationError(f"{read.flaws[0]}: was the simulation reset?")
        take, found = self._cut(replace(read.take, names=self._robot.joint_names)), read.flaws
        recording = Recording.of_files([*self._takes, take], self._robot_name)
        own = [*found, *(flaw for flaw in recording.flaws if flaw.demonstration == name)]
        if wrong := [flaw for flaw in own if flaw.action in _UNUSABLE]:
            raise DemonstrationError(str(wrong[0]))
        motion = self._tool_motion(recording.motions[-1])
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DemonstrationError(f"{self.folder}: cannot be written ({error.strerror or error})") from error
        save_take(take, self._file(name))
        line = self._line(motion, own, recording)
        self._takes.append(take)
        self._motions[name] = motion
        self._recorded.append(name)
        return line

    def delete_last(self) -> str:
        """Delete the newest take of this session; DemonstrationError where there is none, or it cannot be deleted."""
        if not self._recorded:
            raise DemonstrationError(f"no take of this session to delete; {len(self)} of before stand in {self.folder}")
        name = self._recorded[-1]
        try:
            self._file(name).unlink(missing_ok=True)
        except OSError as error:
            raise DemonstrationError(f"{self._file(name)}: cannot be deleted ({error.strerror or error})") from error
        self._recorded.pop()
        self._takes = [take for take in self._takes if take.name != name]
        del self._motions[name]
        return f"deleted {self._file(name)}; {len(self)} takes stand there"

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.csv"

    def _cut(self, take: Take) -> Take:
        """The take from its last standstill before the motion to the first after it, samples as they were recorded."""
        if len(take) < 2:
            raise DemonstrationError(f"{take.name} has {len(take)} sample: was the driver started just now?")
        repaired, flaws = repair_samples(unwrap_turns(take, self._robot)[0])
        if wrong := [flaw for flaw in flaws if flaw.action in _UNUSABLE]:
            raise DemonstrationError(str(wrong[0]))
        whole = Split(times=((float(repaired.times[0]), float(repaired.times[-1])),))
        (motion,), _ = split_take(repaired, whole)
        return take.part((take.times >= motion.times[0]) & (take.times <= motion.times[-1]))

    def _tool_motion(self, motion: Take) -> Demonstration:
        """The motion of the tool, of a repaired one; DemonstrationError: joints outside their limits."""
        return make_joint_demonstrations([motion], self._robot_name).tool_demonstrations(self._robot)[0]

    def _line(self, motion: Demonstration, own: Sequence[Flaw], recording: Recording) -> str:
        """kept take_002: 6.2 s, 1.10 m; starts 30 mm and ends 8 mm from the nearest other."""
        line = f"kept {motion.name}: {motion.times[-1] - motion.times[0]:.1f} s, {motion.length:.2f} m"
        if self._motions:
            apart = [
                min(float(np.linalg.norm(motion.positions[end] - other.positions[end])) for other in
                    self._motions.values())
                for end in (0, -1)
            ]  # fmt: skip
            line += f"; starts {1e3 * apart[0]:.0f} mm and ends {1e3 * apart[1]:.0f} mm from the nearest other"
        others = [flaw for flaw in recording.flaws if flaw.demonstration != motion.name and flaw.action in _UNUSABLE]
        return "; ".join([line, *map(str, own), *(f"beside it {flaw}" for flaw in others)])
