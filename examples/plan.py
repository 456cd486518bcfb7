"""
Plan a motion around a sphere
=============================

A skill that people demonstrated, pouring, is planned twice from its start to its goal, with a sphere in the path.
Without avoidance the arm runs into the sphere; with it the tool does the same task beside it.

    python examples/plan.py     # prints the verdicts and draws plan.png
"""

import matplotlib.pyplot as plt
import numpy as np

from geodesic_motion_ros import PlannerSettings, ReactivePlanner, Skill

CENTRE, RADIUS = np.array([0.43, -0.20, 0.33]), 0.02  # of the sphere [m], in the frame of the arm's base

skill = Skill.load("panda_pouring")
start, goal = np.split(skill.start_pose, [3]), np.split(skill.goal_pose, [3])  # positions [m], quaternions w, x, y, z
figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
for path in skill.decoder.decode(skill.codes.reshape(-1, 2)).positions.reshape(*skill.codes.shape[:2], 3):
    axes.plot(100 * path[:, 1], 100 * path[:, 2], color="0.85")
for avoidance, colour in ((False, "tab:red"), (True, "tab:blue")):
    planner = ReactivePlanner(skill, PlannerSettings(avoidance=avoidance))
    planner.set_obstacles(centres=[CENTRE], radii=[RADIUS])
    plan = planner.plan(*start, *goal)
    clearance = 1000 * plan.verdict.figures.clearance  # between any part of the arm and the sphere [mm]
    name = "with avoidance" if avoidance else "without avoidance"
    print(f"{name}: {plan.verdict.code.name}, clearance {clearance:.0f} mm, {plan.reference.duration:.1f} s")
    tool, _ = plan.tool_poses
    axes.plot(100 * tool[:, 1], 100 * tool[:, 2], color=colour, label=f"{name}: {clearance:.0f} mm")
axes.add_patch(plt.Circle(100 * CENTRE[1:], 100 * RADIUS, color="0.3"))
axes.set(xlabel="y [cm]", ylabel="z [cm]", aspect="equal", title="the tool, from the side; grey: as demonstrated")
axes.legend(loc="lower right", title="clearance of the whole arm")
figure.savefig("plan.png", dpi=120)
