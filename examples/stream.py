"""
Stream plans while an obstacle moves
====================================

A hundred times a second the planner gets the place of a sphere, and plans again from the motion that the arm is in.
A sphere comes to where the elbow would swing out; with avoidance the elbow swings to the other side.

    python examples/stream.py     # prints what happens and draws stream.png
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from geodesic_motion_ros import Obstacles, PlannerSettings, ReactivePlanner, Skill
from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance

TICK, SECONDS = 0.01, 9.0
PLACE, VELOCITY = np.array([[0.34, 0.66, 0.80]]), np.array([[-0.022, -0.123, -0.083]])  # of the sphere [m], [m/s]


def sphere(now: float) -> Obstacles:
    """Return a sphere of 5 cm that comes to where the elbow swings out, as a tracker sees it at a time [s]."""
    return Obstacles.of_spheres(PLACE + VELOCITY * now, np.array([0.05]), VELOCITY, now)


def play(skill: Skill, avoidance: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the clearance (n,) [m], the distance of the tool to its goal (n,) [m], and what ticks took (n,) [s]."""
    planner = ReactivePlanner(skill, PlannerSettings(avoidance=avoidance))
    planner.stand_at(skill.mean_configuration("start"), now=0.0)
    planner.set_goal(skill.goal_pose[:3], skill.goal_pose[3:])
    rows, said = [], ""
    for now in TICK * np.arange(round(SECONDS / TICK)):
        planner.take_obstacles(sphere(now))
        begun = time.perf_counter()
        plan = planner.tick(now)  # plan.reference, where there is one, is what a controller plays from plan.begin on
        took = time.perf_counter() - begun
        joints, _, _ = planner.commanded_state(now + TICK)  # the arm follows
        if avoidance and plan.verdict.code.name != said:
            said = plan.verdict.code.name
            print(f"{now:5.2f} s  {said}: {plan.verdict.reason}")
        clearance = obstacle_clearance(planner.collision, planner.robot, joints, sphere(now + TICK))[0]
        rows.append((clearance, np.linalg.norm(planner.robot.forward(joints)[0] - skill.goal_pose[:3]), took))
    return np.array(rows).T


figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
for name, avoidance in (("without avoidance", False), ("with avoidance", True)):
    clearance, distance, took = play(Skill.load("panda_reach_to_grasp"), avoidance)
    least, end = 100 * clearance.min(), 100 * distance[-1]  # [cm]
    print(f"{name}: {least:.1f} cm from the sphere, {end:.1f} cm from the goal, {1000 * np.median(took):.1f} ms a tick")
    above.plot(TICK * np.arange(len(clearance)), 100 * clearance, label=name)
    below.plot(TICK * np.arange(len(clearance)), 100 * distance)
above.axhline(0.0, color="black", linewidth=0.8)
above.set_ylabel("arm to sphere [cm]")
above.legend()
below.set(xlabel="time [s]", ylabel="tool to goal [cm]")
figure.savefig("stream.png", dpi=120)
