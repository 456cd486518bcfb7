"""Same skill, same inputs: the same commands, byte for byte, in every run and in every process.

Time is told by hand, for a deadline that has passed ends what a tick may look at.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.nodes.joint_cycle import JointCycle
from geodesic_motion_ros.nodes.obstacle_tracker import ObstacleTracker
from geodesic_motion_ros.nodes.planning_cycle import PlanningCycle
from geodesic_motion_ros.nodes.stream_cycle import CycleInputs, CycleOutput, StreamCycle
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.skill import Skill

REPOSITORY = Path(__file__).resolve().parents[2]
PERIOD, CYCLES, NEW_GOAL, GONE = 0.01, 240, 90, 170
#: Of one planner, in each process.
RUNS = 3


def inputs_at(cycle: int, skill: Skill, tracker: ObstacleTracker) -> CycleInputs:
    """A sphere that goes through the way, another one beside it; a second goal; an emptied table."""
    now = 100.0 + cycle * PERIOD
    middle = 0.5 * (skill.start_pose[:3] + skill.goal_pose[:3])
    if cycle == GONE:
        tracker.delete_all("obstacles", now)
    elif cycle < GONE and cycle % 3 == 0:
        tracker.put("obstacles", ("moving", 0), middle + [0.0, 0.3 - 0.003 * cycle, 0.1], 0.03, now)
        tracker.put("obstacles", ("beside", 1), middle + [0.0, 0.0, -0.25], 0.04, now)
    second = cycle >= NEW_GOAL
    goal = skill.goal_pose[:3] + np.array([0.01, -0.01, 0.01]) * second, skill.goal_pose[3:]
    return CycleInputs(None, 0.0, goal, 1 + second, tracker.current(now), now=now, heard=now)


def digest(
    cycle: StreamCycle, skill: Skill, measured: Callable[[float], object], sent: Callable[[CycleOutput], bytes]
) -> tuple[str, int]:
    """SHA-256 of all that is sent, and how many cycles had a way."""
    found, tracker, ways = hashlib.sha256(), ObstacleTracker(), 0
    for number in range(CYCLES):
        inputs = inputs_at(number, skill, tracker)
        output = cycle.run(dataclasses.replace(inputs, measured=measured(inputs.now)), PERIOD)
        found.update(sent(output))
        ways += output.verdict.ok
    return found.hexdigest(), ways


class Tool:
    """The stream of poses of a tool skill."""

    def __init__(self) -> None:
        self.skill = Skill.load("panda_pouring")
        self.planner = ReactivePlanner(self.skill)

    def run(self) -> tuple[str, int]:
        self.planner.clear_goal()
        self.planner.set_obstacles(np.zeros((0, 3)), np.zeros(0))
        cycle = PlanningCycle(self.planner, 0.1, 1.0, 0.05, 0.3, clock=lambda: 0.0)
        start, follower = (self.skill.start_pose[:3], self.skill.start_pose[3:]), cycle.follower
        return digest(
            cycle,
            self.skill,
            lambda now: (follower.position.copy(), follower.quaternion.copy()) if follower.ready else start,
            lambda output: np.concatenate(output.commanded).tobytes(),
        )


class WholeArm:
    """The joint trajectories of a whole-arm skill, as they go over the wire."""

    def __init__(self) -> None:
        self.skill = Skill.load("panda_reach_to_grasp")
        self.planner = JointSpacePlanner(self.skill)

    def run(self) -> tuple[str, int]:
        self.planner.clear_goal()
        self.planner.set_obstacles(np.zeros((0, 3)), np.zeros(0))
        cycle = JointCycle(self.planner, 0.1, 1.0, tracking_tolerance=0.1, horizon=2.0, clock=lambda: 0.0)
        self.planner.stand_at(self.skill.canonical.start_poles[0], 100.0)
        return digest(cycle, self.skill, lambda now: self.planner.commanded(now)[0], self.sent)

    def sent(self, output: CycleOutput) -> bytes:
        if output.trajectory is None:
            return b""
        reference, begin = output.trajectory
        knots = reference.times, reference.positions, reference.velocities, reference.accelerations
        return joint_trajectory_bytes(self.planner.robot.joint_names, *knots, begin)


#: Runs a file as a node begins: first the package, which keeps BLAS to one thread, and numpy asks only then.
LAUNCH = "import geodesic_motion_ros.nodes, runpy, sys; runpy.run_path(sys.argv.pop(1), run_name='__main__')"


def launched(hash_seed: str) -> subprocess.Popen:
    """A process that prints, for each kind, ways and digests of its runs; its hashes and its memory are its own."""
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    environment |= {"PYTHONHASHSEED": hash_seed, "PYTHONPATH": str(REPOSITORY)}
    command = [sys.executable, "-c", LAUNCH, __file__]
    return subprocess.Popen(command, cwd=REPOSITORY, env=environment, stdout=subprocess.PIPE, text=True)


def test_every_run_and_every_process_sends_the_same_bytes() -> None:
    processes = [launched(hash_seed) for hash_seed in ("1", "2")]
    said = [process.communicate()[0].splitlines() for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert said[0] == said[1]
    for line in said[0]:
        ways, *digests = line.split()
        assert 60 <= int(ways) < CYCLES, "of ways and of stops there must be some"
        assert len(digests) == RUNS + 1
        assert len(set(digests)) == 1
    assert len({line.split()[-1] for line in said[0]}) == 2


def main() -> None:
    """Runs of one planner after the other, and one of a new planner."""
    for kind in (Tool, WholeArm):
        planned = kind()
        found = [*(planned.run() for _ in range(RUNS)), kind().run()]
        print(found[0][1], *(digest for digest, _ in found))


if __name__ == "__main__":
    main()
