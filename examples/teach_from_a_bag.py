"""
Teach a skill from a bag
========================

A bag of joint states, as ROS records it while an arm is guided by hand there and back, is cut at its standstills.
The motions that lead to the goal are learned, those that lead back are passed over, and the arm makes one of its own.

    python examples/teach_from_a_bag.py     # writes the bag reach_bag, draws teach_from_a_bag.png
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from geodesic_motion_ros import ReactivePlanner, Robot
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.splitting import Split
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.learning.training import train_skill

bag, names = Path("reach_bag"), list(Robot.named("panda").joint_names)
START, GOAL = np.array([-0.6, 0.1, 0.0, -2.1, 0.0, 2.2, 0.8]), np.array([0.6, 0.3, 0.0, -1.7, 0.0, 2.0, 0.8])

# Five times there and back in 3 s each, with 3 s of rest before and after: at 50 Hz, the elbow bent more or less.
share = np.linspace(0.0, 1.0, 150)[:, None]
step = share**2 * (3.0 - 2.0 * share)
motion = [np.tile(START, (150, 1))]
for bend in (-0.3, -0.15, 0.0, 0.15, 0.3):
    there = START + step * (GOAL - START) + bend * np.sin(np.pi * step) * [0.0, 0.5, 0.0, 1.0, 0.0, 0.5, 0.0]
    motion += [there, np.tile(GOAL, (150, 1)), there[::-1], np.tile(START, (150, 1))]
store = get_typestore(Stores.ROS2_JAZZY)
Time, Header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
JointState = store.types["sensor_msgs/msg/JointState"]
with Writer(bag, version=9) as writer:
    connection = writer.add_connection("/joint_states", JointState.__msgtype__, typestore=store)
    for number, joints in enumerate(np.vstack(motion)):
        header, none = Header(Time(number // 50, number % 50 * 20_000_000), ""), np.zeros(0)
        message = JointState(header, names, joints, none, none)
        writer.write(connection, number * 20_000_000, store.serialize_cdr(message, JointState.__msgtype__))

recording = Recording.of_bags([bag], "/joint_states", Split(), "panda")
demonstrations = recording.demonstrations()
# Small, for a quick look; without settings it takes some minutes, and the skill is better.
small = {"steps": 400, "precision_iterations": 30, "kernels": 150, "samples": 100, "batch": 128}
skill = train_skill(demonstrations, JointTrainingSettings(latent_dimension=2, **small), "reach")
plan = ReactivePlanner(skill).plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3]))
print(f"{len(demonstrations)} demonstrations in the bag; planned: {plan.verdict.code.name}")

figure, (above, below) = plt.subplots(2, 1, figsize=(7, 5.5), layout="constrained")
above.plot(recording.takes[0].times, recording.takes[0].values[:, 3], color="0.6")
for item in demonstrations:
    above.axvspan(item.times[0], item.times[-1], color="tab:green", alpha=0.2)
    below.plot(item.times - item.times[0], item.configurations[:, 3], color="0.8")
below.plot(plan.reference.times, plan.reference.positions[:, 3], color="tab:blue")
above.set(xlabel="time in the bag [s]", ylabel="fourth joint [rad]", title="green: found as demonstrations")
below.set(xlabel="time [s]", ylabel="fourth joint [rad]", title="grey: the demonstrations; blue: planned")
figure.savefig("teach_from_a_bag.png", dpi=120)
