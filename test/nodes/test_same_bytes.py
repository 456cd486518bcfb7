"""Same skill, same inputs: the same commands, byte for byte, in 6 runs, half of them in another process.

A run of either kind of skill holds 45 ticks in 1.8 s: the goal is another one after 0.6 s and the first again after
1.5 s; of two spheres, published in every tick, one stands beside the path, the other comes and goes through it at 0.3
m/s, so that the arm stops and sets out again more than once; after 1.2 s both are deleted.

Time is set by hand, for a deadline that has passed ends what a tick may look at.
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

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput
from geodesic_motion_ros.nodes.planner_cycle import PlannerCycle
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill

REPOSITORY = Path(__file__).resolve().parents[2]
PERIOD, CYCLES = 0.04, 45
#: In these ticks the goal is another one; from this one on no obstacle is left.
OTHER_GOAL, NO_OBSTACLE = range(15, 38), 30
#: Of one planner, in each process; one of a new planner follows.
RUNS = 2
#: Where the sphere that goes through the path sets out, seen from between start and goal [m].
BEGINS = {"panda_pouring": (0.5, 0.0, 0.1), "panda_reach_to_grasp": (0.35, -0.1, 0.0)}


def inputs_at(cycle: int, skill: Skill, tracker: ObstacleTracker) -> CycleInputs:
    """A sphere that goes through the path, another one beside it; another goal for a while; an emptied table."""
    now = 100.0 + cycle * PERIOD
    middle = 0.5 * (skill.start_pose[:3] + skill.goal_pose[:3])
    if cycle == NO_OBSTACLE:
        tracker.delete_all("obstacles", now)
    elif cycle < NO_OBSTACLE:
        across = np.array(BEGINS[skill.name]) - [0.3 * cycle * PERIOD, 0.0, 0.0]
        tracker.put("obstacles", ("moving", 0), middle + across, 0.04, now)
        tracker.put("obstacles", ("beside", 1), middle + [0.0, 0.0, -0.3], 0.04, now)
    position = skill.goal_pose[:3] + np.array([0.01, -0.01, 0.01]) * (cycle in OTHER_GOAL)
    goal = GoalRequest(Pose(position, skill.goal_pose[3:]))
    number = 1 + (cycle >= OTHER_GOAL.start) + (cycle >= OTHER_GOAL.stop)
    return CycleInputs(None, 0.0, goal, number, tracker.current(now), now=now, heard=now)


def digest(
    cycle: PlannerCycle, skill: Skill, measured: Callable[[float], object], sent: Callable[[CycleOutput], bytes]
) -> tuple[str, str]:
    """SHA-256 of all that is sent, and for each cycle whether it had a path: 1 or 0."""
    found, tracker, found_paths = hashlib.sha256(), ObstacleTracker(), []
    for number in range(CYCLES):
        inputs = inputs_at(number, skill, tracker)
        output = cycle.run(dataclasses.replace(inputs, measured=measured(inputs.now)), PERIOD)
        found.update(sent(output))
        found_paths.append(str(int(output.verdict.ok)))
    return found.hexdigest(), "".join(found_paths)


class Arm:
    """The joint trajectories of a skill, as they go over the wire."""

    def __init__(self, name: str) -> None:
        self.skill = Skill.load(name)
        # With what is seen so far ahead the arm stops, and goes on, more than once in so few cycles.
        self.planner = ReactivePlanner(self.skill, PlannerSettings(prediction=1.6))
        planned = self.planner.plan(*np.split(self.skill.start_pose, [3]), *np.split(self.skill.goal_pose, [3]))
        self.start = planned.reference.positions[0]

    def run(self) -> tuple[str, str]:
        self.planner.clear_goal()
        self.planner.set_obstacles(np.zeros((0, 3)), np.zeros(0))
        cycle = PlannerCycle(self.planner, 0.1, 1.0, tracking_tolerance=0.1, horizon=2.0, clock=lambda: 0.0)
        self.planner.stand_at(self.start, 100.0)
        return digest(cycle, self.skill, lambda now: self.planner.commanded_state(now)[0], self.sent)

    def sent(self, output: CycleOutput) -> bytes:
        if output.trajectory is None:
            return b""
        reference, begin = output.trajectory
        knots = reference.times, reference.positions, reference.velocities, reference.accelerations
        return joint_trajectory_bytes(self.planner.robot.joint_names, *knots, round(1e9 * begin))


#: Runs a file as a node begins: first the package, which keeps BLAS to one thread, and numpy asks only then.
LAUNCH = "import geodesic_motion_ros.nodes, runpy, sys; runpy.run_path(sys.argv.pop(1), run_name='__main__')"


def launched(hash_seed: str) -> subprocess.Popen:
    """A process that prints, for each kind, paths and digests of its runs; its hashes and its memory are its own."""
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
        found_paths, *digests = line.split()
        assert found_paths[:NO_OBSTACLE].count("10") > 1, "the arm is to stop more than once while there are obstacles"
        assert found_paths[:NO_OBSTACLE].count("01") > 0, "and to go on among them"
        assert found_paths.endswith("1")
        assert len(digests) == RUNS + 1
        assert len(set(digests)) == 1
    assert len({line.split()[-1] for line in said[0]}) == 2


def main() -> None:
    """Runs of one planner after the other, and one of a new planner."""
    for name in ("panda_pouring", "panda_reach_to_grasp"):
        planned = Arm(name)
        found = [*(planned.run() for _ in range(RUNS)), Arm(name).run()]
        print(found[0][1], *(digest for digest, _ in found))


if __name__ == "__main__":
    main()
