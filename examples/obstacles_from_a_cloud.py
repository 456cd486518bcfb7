"""
Plan around what a depth camera sees
====================================

A bottle stands in the path, and a camera shows the half of it that faces the camera, as points with noise.
The planner keeps clear of every cube that holds a point: no object has to be recognised, and none has a model.

    python examples/obstacles_from_a_cloud.py     # prints the verdicts and draws obstacles_from_a_cloud.png
"""

import matplotlib.pyplot as plt
import numpy as np

from geodesic_motion_ros import Obstacles, PlannerSettings, ReactivePlanner, Skill

FOOT, RADIUS, HEIGHT, VOXEL = np.array([0.42, -0.20, 0.0]), 0.03, 0.33, 0.01  # of the bottle [m], and of the cubes


def see_bottle() -> np.ndarray:
    """Return points (n, 3) [m] in the frame of the arm's base, 2 mm off, of the side that faces the camera (x > 0)."""
    random = np.random.default_rng(0)
    angle, height = random.uniform(-np.pi / 2, np.pi / 2, 3000), random.uniform(0.0, HEIGHT, 3000)
    wall = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), height], axis=1)
    top = RADIUS * np.sqrt(random.uniform(0.0, 1.0, (600, 1))) * np.stack([np.cos(angle[:600]), np.sin(angle[:600])], 1)
    points = np.vstack([wall, np.column_stack([top, np.full(600, HEIGHT)])])
    return FOOT + points + random.normal(0.0, 0.002, points.shape)


skill = Skill.load("panda_pouring")
points = see_bottle()
obstacles = Obstacles.of_cloud(points, voxel=VOXEL)
print(f"{len(points)} points in {len(obstacles.cloud.occupied)} cubes")
figure, axes = plt.subplots(figsize=(7, 4.4), layout="constrained")
axes.plot(*100 * points[:, 1:].T, ".", color="0.5", markersize=1)
for avoidance, colour in ((False, "tab:red"), (True, "tab:blue")):
    planner = ReactivePlanner(skill, PlannerSettings(avoidance=avoidance))
    planner.take_obstacles(obstacles)
    plan = planner.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3]))
    clearance = 1000 * plan.verdict.figures.clearance  # between any part of the arm and any cube [mm]
    name = "with avoidance" if avoidance else "without avoidance"
    print(f"{name}: {plan.verdict.code.name}, clearance {clearance:.0f} mm")
    tool, _ = plan.tool_poses
    axes.plot(100 * tool[:, 1], 100 * tool[:, 2], color=colour, label=f"{name}: {clearance:.0f} mm")
axes.set(xlabel="y [cm]", ylabel="z [cm]", ylim=(12, 44), aspect="equal", title="tool and points, from the side")
axes.legend(loc="lower right", title="clearance of the whole arm")
figure.savefig("obstacles_from_a_cloud.png", dpi=120)
