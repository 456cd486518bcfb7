"""
Have the chunks of a policy certified
=====================================

A policy as of LeRobot gives chunks of actions (16, joints) at 30 Hz, and looks at no obstacle: put yours in its place.
A sphere crosses. Filtered, the arm brakes along the policy's own path, and goes on when the sphere has passed.

    python examples/filter_a_policy.py     # prints what happens and draws filter_a_policy.png
"""

import matplotlib.pyplot as plt
import numpy as np

from geodesic_motion_ros import DeclaredScene, MotionFilter, Obstacles
from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance

START, GOAL = np.array([[-0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8], [0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]])
FREQUENCY, CHUNK, TICK = 30.0, 16, 0.01


def policy(joints: np.ndarray) -> np.ndarray:
    """Return the next actions (16, 7) [rad] from where the joints are observed: at most 0.5 rad/s towards the goal."""
    steps = np.arange(1, CHUNK + 1)[:, None] * 0.5 / FREQUENCY
    return joints + np.clip(GOAL - joints, -steps, steps)


def sphere(now: float) -> Obstacles:
    """Return a sphere of 6 cm that crosses the path of the hand, as a tracker sees it at a time [s]."""
    place, velocity = np.array([[0.6, 0.0, 0.9 - 0.2 * now]]), np.array([[0.0, 0.0, -0.2]])
    return Obstacles.of_spheres(place, [0.06], velocity, time=now)


def play(filtered: bool, seconds: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the first joint (n,) [rad] and the arm's clearance from the sphere (n,) [m] at every tick."""
    motion_filter = MotionFilter("panda", DeclaredScene.empty())
    motion_filter.stand_at(START, now=0.0)
    joints, said, rows = START, "", []
    for tick in range(int(seconds / TICK)):
        now, seen = tick * TICK, sphere(tick * TICK)
        if tick % 25 == 0:  # four chunks a second; each begins where the arm is, and the next one comes before it ends
            answer = motion_filter.offer(np.arange(1, CHUNK + 1) / FREQUENCY, policy(joints), begin=now)
        motion_filter.observe(seen if filtered else Obstacles.none())
        verdict = motion_filter.tick(now).verdict if answer.ok else answer
        joints, _, _ = motion_filter.commanded_state(now + TICK)  # send these to your arm
        if filtered and verdict.code.name != said:
            said = verdict.code.name
            print(f"{now:5.2f} s  {said}: {verdict.reason}")
        rows.append((joints[0], obstacle_clearance(motion_filter.collision, motion_filter.robot, joints, seen)[0]))
    return np.array(rows).T


figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
for name, filtered in (("policy alone", False), ("with the filter", True)):
    joint, clearance = play(filtered)
    above.plot(TICK * np.arange(len(joint)), joint, label=name)
    below.plot(TICK * np.arange(len(joint)), 100 * clearance)
    print(f"{name}: {100 * clearance.min():.1f} cm from the sphere, at the end {abs(GOAL[0] - joint[-1]):.3f} rad off")
below.axhline(0.0, color="black", linewidth=0.8)
above.set(ylabel="first joint [rad]")
below.set(xlabel="time [s]", ylabel="arm to sphere [cm]")
above.legend()
figure.savefig("filter_a_policy.png", dpi=120)
