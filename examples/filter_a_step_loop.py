"""
Have the targets of a step loop certified
=========================================

`step(action)` is as of gymnasium, an action is where the joints are to be; an agent that explores drives the arm
through a sphere on a stand. The same actions through `MotionFilter` touch nothing, and `info["verdict"]` says why.

    python examples/filter_a_step_loop.py     # prints what happens and draws filter_a_step_loop.png
"""

import matplotlib.pyplot as plt
import numpy as np

from geodesic_motion_ros import DeclaredScene, MotionFilter, Obstacles
from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance

START, DRIFT = np.array([-0.4, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]), 0.004 * (np.arange(7) == 0)
SPHERE = Obstacles.of_spheres([[0.55, 0.1, 0.45]], [0.08])


class CertifiedArm:
    """An environment of a Panda that plays no action that is not certified; `avoid=False`: the control."""

    def __init__(self, avoid: bool = True, step_time: float = 0.02) -> None:
        self._avoid, self._step_time = avoid, step_time

    def reset(self) -> tuple[np.ndarray, dict]:
        """Place the arm at its start; returns the observation (7,) [rad] and more."""
        self.filter, self.now = MotionFilter("panda", DeclaredScene.empty()), 0.0
        self.filter.stand_at(START, self.now)
        self.filter.observe(SPHERE if self._avoid else Obstacles.none())
        return START.copy(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Play one step towards the positions (7,) [rad] of an action."""
        taken = self.filter.offer(np.zeros(1), action[None])
        verdict = self.filter.tick(self.now).verdict
        self.now += self._step_time
        joints, _, _ = self.filter.commanded_state(self.now)  # send these to your arm
        clearance = obstacle_clearance(self.filter.collision, self.filter.robot, joints, SPHERE)[0]
        info = {"verdict": verdict if taken.ok else taken, "clearance": clearance}
        return joints, -float(np.linalg.norm(action - joints)), clearance <= 0.0, False, info


figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for name, avoid in (("actions alone", False), ("with the filter", True)):
    arm, random = CertifiedArm(avoid), np.random.default_rng(1)
    joints, _ = arm.reset()
    wanted, clearances, said = joints, [], ""
    for _ in range(500):
        wanted = np.clip(wanted + random.normal(DRIFT, 0.02), joints - 0.2, joints + 0.2)
        joints, _, touched, _, info = arm.step(wanted)
        clearances.append(100 * info["clearance"])
        if avoid and info["verdict"].code.name != said:
            said = info["verdict"].code.name
            print(f"{arm.now:5.2f} s  {said}: {info['verdict'].reason}")
    print(f"{name}: {min(clearances):.1f} cm at least between arm and sphere")
    axes.plot(0.02 * np.arange(500), clearances, label=name)
axes.axhline(0.0, color="black", linewidth=0.8)
axes.set(xlabel="time [s]", ylabel="arm to sphere [cm]")
axes.legend()
figure.savefig("filter_a_step_loop.png", dpi=120)
