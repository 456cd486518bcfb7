"""
Teach a skill from a table
==========================

Five demonstrations of the tool are written to a CSV file, as a motion capture or a teach pendant would, and learned.
The skill plans from the mean start to the mean goal, and around a sphere that stands in that path.

    python examples/teach_from_csv.py     # writes my_task.csv and the folder my_skill, draws teach_from_csv.png
"""

import matplotlib.pyplot as plt
import numpy as np

from geodesic_motion_ros import ReactivePlanner
from geodesic_motion_ros.demonstrations.readers import read_demonstrations
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill

# One row a sample: number of the demonstration, time [s], position [m], unit quaternion with the scalar first.
share = np.linspace(0.0, 1.0, 100)[:, None]
rows = []
for number, bulge in enumerate((-0.08, -0.04, 0.0, 0.04, 0.08)):
    position = [0.45, -0.28, 0.32] + share * [0.03, 0.54, 0.04] + bulge * np.sin(np.pi * share) * [0.8, 0.0, 0.6]
    half = 0.25 * share  # the tool points down and turns by half a radian
    quaternion = np.hstack([0.0 * half, np.cos(half), np.sin(half), 0.0 * half])
    rows.append(np.hstack([np.full_like(share, number), 4.0 * share, position, quaternion]))
header = "demonstration,t,px,py,pz,qw,qx,qy,qz"
np.savetxt("my_task.csv", np.vstack(rows), delimiter=",", header=header, comments="")

demonstrations = read_demonstrations("my_task.csv", units="m")
# Small, for a quick look; without settings it takes some minutes, and the skill is better.
settings = TrainingSettings(steps=400, precision_iterations=30, kernels=150, samples=100, batch=128)
skill = train_skill(demonstrations, settings, "my_skill", robot="panda")
skill.save("my_skill")  # as `geodesic-motion train` does; `geodesic-motion inspect my_skill` shows it
print(f"{len(demonstrations)} demonstrations, {skill.quality['training_position_error_mm']:.1f} mm off them on average")

figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
for item in demonstrations:
    axes.plot(100 * item.positions[:, 1], 100 * item.positions[:, 0], color="0.8")
planner, middle = ReactivePlanner(skill), None
for name in ("free", "around a sphere"):
    plan = planner.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3]))
    tool, _ = plan.tool_poses
    print(f"{name}: {plan.verdict.code.name}, clearance {1000 * plan.verdict.figures.clearance:.0f} mm")
    axes.plot(100 * tool[:, 1], 100 * tool[:, 0], label=name)
    if middle is None:
        middle = tool[len(tool) // 2]
        planner.set_obstacles(centres=[middle], radii=[0.02])
axes.add_patch(plt.Circle(100 * middle[[1, 0]], 2.0, color="0.3"))
axes.set(xlabel="y [cm]", ylabel="x [cm]", aspect="equal", title="the tool, from above; grey: the demonstrations")
figure.legend(loc="outside lower center", ncols=2, title="planned")
figure.savefig("teach_from_csv.png", dpi=120)
