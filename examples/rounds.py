"""
Go round after round
====================

Four wiping rounds of the tool are learned as a closed skill; a goal where the arm stands is then a whole round.
With `periodic` the next round is joined to the present one in motion: the tool does not stop between them.

    python examples/rounds.py     # prints the rounds and draws rounds.png
"""

import matplotlib.pyplot as plt
import numpy as np

from geodesic_motion_ros import Demonstrations, PlannerSettings, ReactivePlanner
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.robot.inverse_kinematics import solve

TICK, ROUNDS, DOWN = 0.02, 3, np.array([0.0, 1.0, 0.0, 0.0])

# Ovals on a table, 20 cm by 12 cm on average, in 3 s each, with the tool pointing down.
angle = -2.0 * np.pi * np.linspace(0.0, 1.0, 150)[:, None]
oval = np.hstack([0.06 * np.cos(angle), 0.10 * np.sin(angle), 0.0 * angle])
wipes = Demonstrations(tuple(
    Demonstration([0.5, 0.0, 0.3] + size * oval, np.tile(DOWN, (150, 1)), np.linspace(0.0, 3.0, 150), f"size {size}")
    for size in (0.85, 0.95, 1.05, 1.15)
))  # fmt: skip
# Small, for a quick look; recordings from files are cut into rounds by `geodesic-motion train`.
settings = TrainingSettings(closed=True, steps=400, precision_iterations=30, kernels=150, samples=100, batch=128)
skill = train_skill(wipes, settings, "wiping")

planner = ReactivePlanner(skill, PlannerSettings(periodic=True, rounds=ROUNDS))
begin = np.array([0.56, 0.0, 0.3])
planner.stand_at(solve(planner.robot, begin, DOWN), now=0.0)
planner.set_goal(begin, DOWN)
tool, number = [], []
for now in TICK * np.arange(500):
    verdict = planner.tick(now).verdict
    if [planner.round] != number[-1:]:
        print(f"{now:5.2f} s  {verdict.code.name}: {verdict.reason}")
    tool.append(planner.robot.forward(planner.commanded_state(now)[0])[0])
    number.append(planner.round)

path, times = np.array(tool), TICK * np.arange(len(tool))
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for item in wipes:
    left.plot(100 * item.positions[:, 1], 100 * item.positions[:, 0], color="0.8")
left.plot(100 * path[:, 1], 100 * path[:, 0], color="black")
for k in range(1, ROUNDS + 1):
    now = np.flatnonzero(np.array(number) == k)
    right.plot(times[now], 100 * np.linalg.norm(np.gradient(path, TICK, axis=0)[now], axis=1), label=f"round {k}")
left.set(xlabel="y [cm]", ylabel="x [cm]", aspect="equal", title="from above; grey: as demonstrated")
right.set(xlabel="time [s]", ylabel="speed of the tool [cm/s]", title="it does not stop between rounds")
right.legend(loc="lower center")
figure.savefig("rounds.png", dpi=120)
