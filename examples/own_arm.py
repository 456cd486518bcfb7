"""
Move an arm of your own
=======================

A URDF becomes a robot: its bodies are covered with spheres, and pairs of links that can meet are kept apart.
The arm is to swing through a sphere; its motion is certified, it stops before the sphere and takes a detour.

    python examples/own_arm.py     # writes own_arm.urdf and the folder own_arm, draws own_arm.png
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from geodesic_motion_ros import DeclaredScene, MotionFilter, Obstacles, PlannerSettings
from geodesic_motion_ros.robot.making import Limits, make_robot

TICK, CENTRE, RADIUS = 0.01, np.array([0.55, 0.0, 0.36]), 0.06

# Six joints by axis, and the length of the link that each turns [m]; the links are capsules of 4 cm along x or z.
joints = [("0 0 1", 0.15, "z"), ("0 1 0", 0.35, "z"), ("0 1 0", 0.3, "x")]
joints += [("1 0 0", 0.1, "x"), ("0 1 0", 0.1, "x"), ("1 0 0", 0.1, "x")]
parts, at = ['<link name="l0"/>'], "0 0 0"
for number, (axis, length, along) in enumerate(joints, start=1):
    middle, turn = ("0 0 {}", "0 0 0") if along == "z" else ("{} 0 0", "0 1.5708 0")
    parts.append(f"""<link name="l{number}"><collision><origin xyz="{middle.format(length / 2)}" rpy="{turn}"/>
      <geometry><cylinder radius="0.04" length="{length}"/></geometry></collision></link>
    <joint name="j{number}" type="revolute"><parent link="l{number - 1}"/><child link="l{number}"/>
      <origin xyz="{at}"/><axis xyz="{axis}"/><limit lower="-2.8" upper="2.8" velocity="2" effort="50"/></joint>""")
    at = middle.format(length)
Path("own_arm.urdf").write_text(f'<robot name="own_arm">{"".join(parts)}</robot>')
made = make_robot(Path("own_arm.urdf"), "l0", "l6", Path("own_arm"), Limits([8.0] * 6, [500.0] * 6, "chosen"))
print(f"{sum(map(len, made.spheres.values()))} spheres, {len(made.pairs)} pairs of links kept apart")

here, there = np.array([[-0.9, 0.3, -0.1, 0.0, 0.2, 0.0], [0.9, 0.3, -0.1, 0.0, 0.2, 0.0]])
settings = PlannerSettings(patience=0.5, speed_scale=0.5)  # a detour begins after half a second of standing
arm = MotionFilter(str(made.folder), DeclaredScene.empty(), settings, recover="detour")
arm.stand_at(here, now=0.0)
arm.observe(Obstacles.of_spheres(CENTRE[None], np.array([RADIUS])))
arm.offer(times=np.linspace(0.0, 4.0, 100), positions=np.linspace(here, there, 100))
played, said = [], ""
for now in TICK * np.arange(700):
    verdict = arm.tick(now).verdict
    played.append(arm.commanded_state(now)[0])
    if verdict.code.name != said:
        said = verdict.code.name
        print(f"{now:5.2f} s  {said}: {verdict.reason}")

figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
for name, path, style in (("offered", np.linspace(here, there, 100), "--"), ("played", played, "-")):
    tool = np.array([arm.robot.forward(q)[0] for q in path])
    axes.plot(100 * tool[:, 1], 100 * tool[:, 2], style, label=name)
for q in (played[0], played[np.argmax(tool[:, 2])]):  # the arm at the start, and where the tool is highest
    for centre, radius in zip(arm.collision.positions(arm.robot, q[None])[0], arm.collision.radii, strict=True):
        axes.add_patch(plt.Circle(100 * centre[1:], 100 * radius, color="tab:green", alpha=0.15, linewidth=0.0))
axes.add_patch(plt.Circle(100 * CENTRE[1:], 100 * RADIUS, color="0.3"))
axes.set(xlabel="y [cm]", ylabel="z [cm]", aspect="equal", title="the tool, and twice the arm, from the front")
axes.legend(loc="lower right")
figure.savefig("own_arm.png", dpi=120)
