"""What all tests share: small skills, real recordings where there are any, and the workers of the machine.

The small skills are stored in skills/, for what training finds differs from one processor to the next. A test asks for
one by a fixture that says how it was trained; `python -m pytest -n 0 --remake` trains anew what the chosen tests
ask for, and stores it.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.geometry.quaternions import rotate_by
from geodesic_motion_ros.kernels.compile_ahead import compile_kernels
from geodesic_motion_ros.robot.description import SHIPPED
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference

REPOSITORY = Path(__file__).resolve().parent

# A shell that starts the tests in the background has SIGINT ignored, and programs under test would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


def own_domain() -> int:
    """A ROS domain that no other worker of any run of these tests on this machine has, until this process ends.

    Clocks of two tests in one domain would set each other. 1 to 101 keep clear of the system's ports.
    """
    for number in range(101):
        domain = 1 + (os.getpid() + number) % 101
        file = Path(tempfile.gettempdir()) / f"geodesic_motion_ros_domain_{domain}.lock"
        with suppress(OSError):  # of another run, or of another user
            descriptor = os.open(file, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC)
            try:
                # held until the process ends, which closes the descriptor
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return domain
            except OSError:
                os.close(descriptor)
    raise RuntimeError("all ROS domains from 1 to 101 are taken by other runs of the tests")


# Before rclpy is imported, and for every process that is started: fields are type-checked, nothing leaves this machine.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(own_domain())


#: Begun with: the longest file.
FIRST = "studies/test/benchmarks/test_run.py"
#: Files that are locked, for want of others that all workers have: see `pytest_runtest_protocol`.
DOOR, ROOM = Path(__file__), REPOSITORY / "pyproject.toml"


def pytest_sessionstart() -> None:
    """Compile what is missing for the settings of this run: `make` does it for those of the first one."""
    compile_kernels()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put FIRST first, and what is of time itself last, as one group for one worker."""
    for item in items:
        if _is_of_time(item):
            item.add_marker(pytest.mark.xdist_group("realtime"))
    items.sort(key=lambda item: (_is_of_time(item), not item.nodeid.startswith(FIRST)))


def _is_of_time(item: pytest.Item) -> bool:
    return item.get_closest_marker("realtime") is not None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[object]:
    """Run a test that is of time itself alone: those of other workers wait at the door while it waits, and runs."""
    with DOOR.open() as door, ROOM.open() as room:
        fcntl.flock(door, fcntl.LOCK_EX)
        fcntl.flock(room, fcntl.LOCK_EX if _is_of_time(item) else fcntl.LOCK_SH)
        if not _is_of_time(item):
            fcntl.flock(door, fcntl.LOCK_UN)
        return (yield)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Hand every worker a file at a time, for what the tests of a file share is made once, or a group as a whole."""
    from xdist.scheduler import LoadGroupScheduling

    class FilesAndGroups(LoadGroupScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return super()._split_scope(nodeid).split("::", 1)[0]

    return FilesAndGroups(config, log)


def pytest_addoption(parser: pytest.Parser) -> None:
    stored = "skills, answers, streams"
    parser.addoption("--remake", action="store_true", help=f"make anew what is stored with the tests: {stored}")


@pytest.fixture(scope="session")
def stored(pytestconfig: pytest.Config) -> Callable[[str, Callable[[], Skill]], Skill]:
    """stored(name, train) is the skill of that name in skills/; with --remake it is trained and stored first."""

    def load(name: str, train: Callable[[], Skill]) -> Skill:
        folder = REPOSITORY / "test" / "skills" / name
        if pytestconfig.getoption("--remake"):
            train().save(folder)
        return Skill.load(folder)

    return load


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of real recordings (GEODESIC_DATA, or shared/data beside the clone); skips where there is none."""
    folder = Path(os.environ.get("GEODESIC_DATA", REPOSITORY.parent / "shared" / "data"))
    if not (folder / "robotasks").is_dir():
        pytest.skip(f"no recordings in {folder}: set GEODESIC_DATA to a folder that holds robotasks/")
    return folder


def fan_of_demonstrations() -> Demonstrations:
    """Seven reaches of a Panda from right to left that bulge out differently far, turning the tool by half a radian."""
    share = np.linspace(0.0, 1.0, 120)
    start, goal = np.array([0.45, -0.28, 0.32]), np.array([0.48, 0.26, 0.36])
    down = np.array([0.0, 1.0, 0.0, 0.0])
    items = []
    for number, bulge in enumerate(np.linspace(-0.12, 0.12, 7)):
        line = start + share[:, None] * (goal - start)
        positions = line + np.sin(np.pi * share)[:, None] * bulge * np.array([0.8, 0.0, 0.6])
        turns = share[:, None] * np.array([0.0, 0.0, 0.5]) + bulge * np.array([0.5, 0.0, 0.0])
        quaternions = rotate_by(turns, np.broadcast_to(down, (len(share), 4)))
        items.append(Demonstration(positions, quaternions, 4.0 * share, f"reach {number}"))
    return Demonstrations(tuple(items))


#: Of a skill small enough to be trained in seconds and stored with the tests.
SMALL = {
    "steps": 800, "hidden": (64, 32), "samples": 100, "kernels": 100, "precision_samples": 2,
    "precision_iterations": 60,
}  # fmt: skip


def shifted(demonstration: Demonstration, start: np.ndarray, goal: np.ndarray) -> Demonstration:
    """A demonstration with offsets (6,) of its start and goal, translation [m] and rotation vector [rad], that blend
    linearly with the sample's number."""
    share = np.linspace(0.0, 1.0, len(demonstration))[:, None]
    blend = (1.0 - share) * start + share * goal
    return replace(
        demonstration,
        positions=demonstration.positions + blend[:, :3],
        quaternions=rotate_by(blend[:, 3:], demonstration.quaternions),
    )


def fan_with_varying_ends(seed: int = 0) -> Demonstrations:
    """The fan, with starts and goals that vary by some centimetres and tenths of a radian."""
    random = np.random.default_rng(seed)
    scale = np.repeat([0.025, 0.08], 3)
    items = [shifted(item, *random.uniform(-scale, scale, (2, 6))) for item in fan_of_demonstrations()]
    return Demonstrations(tuple(items))


@pytest.fixture(scope="module")
def brief_training() -> Iterator[None]:
    """Trainings by the command are brief: small networks and latent graphs, and one place for a sphere in the report.

    The command has no option for them. What is learned so briefly is supported nearly everywhere: a graph of the usual
    size would take longest of all.
    """
    from geodesic_motion_ros.learning import training
    from geodesic_motion_ros.manifold import sampled_nodes
    from geodesic_motion_ros.skill import skill
    from geodesic_motion_ros.visualization import skill_report

    small = {"hidden": (48, 32), "samples": 60, "batch": 128, "precision_samples": 2, "precision_iterations": 40}

    def brief(train: Callable[..., Skill]) -> Callable[..., Skill]:
        return lambda shown, *given: train(
            shown, *(replace(each, **small) if hasattr(each, "precision_iterations") else each for each in given)
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "train_skill", brief(training.train_skill))
        patch.setattr(skill_report, "PLACES", 1)
        patch.setattr(sampled_nodes, "MOST_NODES", 500)
        for dimension, shape in ((1, (100,)), (2, (30, 30)), (3, (9, 9, 9))):
            patch.setitem(skill.GRID_SHAPES, dimension, shape)
        yield


@pytest.fixture(scope="session")
def fan() -> Demonstrations:
    """What fan_skill was learned from."""
    return fan_of_demonstrations()


def trained(demonstrations: Demonstrations, name: str, **settings: Any) -> Skill:
    """A small skill of tool poses. What trains it is loaded only where one is trained anew."""
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.learning.training import train_skill

    return train_skill(demonstrations, TrainingSettings(**settings, **SMALL), name=name)


@pytest.fixture(scope="session")
def fan_skill(stored, fan: Demonstrations) -> Skill:
    """A skill for a Panda on the raw sheet."""
    return stored("fan", lambda: trained(fan, "fan", sheet="raw"))


@pytest.fixture(scope="session")
def varying_fan() -> Demonstrations:
    """What canonical_fan_skill was learned from."""
    return fan_with_varying_ends()


@pytest.fixture(scope="session")
def canonical_fan_skill(stored, varying_fan: Demonstrations) -> Skill:
    """A skill for a Panda on the canonical sheet, learned from demonstrations whose starts and goals vary."""
    return stored("canonical_fan", lambda: trained(varying_fan, "canonical fan"))


def reaches(count_per_family: int, connected: bool, seed: int = 0) -> JointDemonstrations:
    """Reaches to grasp in two families, elbow out to the left or to the right: as commanded, without physics."""
    from geodesic_motion_ros.simulation.joint_teacher import configurations, reach_guidances

    robot = Robot.named("panda")
    items = [
        JointDemonstration(configurations(robot, guidance), guidance.motion.times, guidance.motion.name)
        for guidance in reach_guidances(count_per_family, seed, families=2, connected=connected)
    ]
    return JointDemonstrations(tuple(items), robot.joint_names, "panda")


@pytest.fixture(scope="session")
def reach_demonstrations() -> JointDemonstrations:
    """What reach_skill was learned from: four demonstrations of each family, which begin and end alike."""
    return reaches(4, connected=True)


@pytest.fixture(scope="session")
def endless_reach_skill(reach_skill: Skill, tmp_path_factory: pytest.TempPathFactory) -> Skill:
    """reach_skill of a Panda whose last joint has no ends."""
    folder = tmp_path_factory.mktemp("robots") / "endless"
    shutil.copytree(SHIPPED / "panda", folder)
    urdf, last = folder / "panda.urdf", '<joint name="panda_joint7" type="{}">'
    urdf.write_text(urdf.read_text().replace(last.format("revolute"), last.format("continuous")))
    return replace(reach_skill, robot=str(folder))


@pytest.fixture(scope="session")
def separated_demonstrations() -> JointDemonstrations:
    """Three demonstrations of each family, whose elbows stay on their sides from start to goal."""
    return reaches(3, connected=False)


@pytest.fixture(scope="session")
def reach_skill(stored, request: pytest.FixtureRequest) -> Skill:
    """A joint-space skill of the whole Panda on the canonical sheet, with two families."""

    def train() -> Skill:
        from geodesic_motion_ros.learning.settings import JointTrainingSettings
        from geodesic_motion_ros.learning.training import train_skill

        shown = request.getfixturevalue("reach_demonstrations")
        settings = JointTrainingSettings(batch=128, **SMALL)
        return train_skill(shown, settings, name="reach")

    return stored("reach", train)


class Motions:
    """Random motions of a Panda that begin at rest, and what every motion must keep."""

    def __init__(self) -> None:
        self.robot = Robot.named("panda")
        self.limits = JointLimits.of(self.robot)

    def inside(self, path: np.ndarray) -> bool:
        return bool(np.all(path > self.limits.lower) and np.all(path < self.limits.upper))

    def random_path(self, random: np.random.Generator) -> np.ndarray:
        """A smooth path (100, 7) through four configurations inside the limits."""
        while True:
            through = self.robot.ready + random.normal(scale=0.5, size=(4, 7))
            path = CubicSpline(np.linspace(0.0, 1.0, 4), through)(np.linspace(0.0, 1.0, 100))
            if self.inside(path):
                return path

    def timed(self, path: np.ndarray, velocity=None, acceleration=None) -> JointReference | None:
        share = np.linspace(0.0, 1.0, len(path))
        return timed_joint_reference(path, np.stack([share, 1.0 - share], axis=1), self.limits, velocity, acceleration)

    def references(self, count: int, seed: int = 0) -> Iterator[tuple[np.random.Generator, JointReference]]:
        """Seeded generators and references from rest."""
        for number in range(count):
            random = np.random.default_rng([seed, number])
            yield random, self.timed(self.random_path(random))

    def detour(
        self, random: np.random.Generator, reference: JointReference, time: float, kink: float
    ) -> np.ndarray | None:
        """What is left of a reference's path from `time` on, bent off it, with another goal.

        It begins at an angle [rad], the kink.
        """
        rest = reference.rest(time)
        dense = rest.samples(np.linspace(0.0, rest.duration, 400))[0]
        passed = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1)))
        share = np.linspace(0.0, 1.0, 100)
        path = np.stack([np.interp(share * passed[-1], passed, joint) for joint in dense.T], axis=1)
        sideways = random.normal(size=7)
        sideways /= np.linalg.norm(sideways)
        path += np.outer(np.sin(np.pi * share) ** 2, random.normal(scale=0.1, size=7))
        path += np.outer(share**2 * (3.0 - 2.0 * share), random.normal(scale=0.05, size=7))
        path += np.outer(share * (1.0 - share) ** 2, sideways * np.tan(kink) * passed[-1])
        return path if passed[-1] > 0.3 and self.inside(path) else None

    def assert_plays_within_limits(self, reference: JointReference) -> None:
        """At 20 times between knots, by differences of what is played, not by the bounds that the package trusts."""
        assert reference.keeps(self.limits)
        fine = np.unique(np.concatenate([np.linspace(a, b, 21) for a, b in pairwise(reference.times)]))
        positions, velocities, accelerations = reference.samples(fine)
        assert np.all((positions >= self.limits.lower - 1e-6) & (positions <= self.limits.upper + 1e-6))
        assert np.all(np.abs(velocities) <= self.limits.velocity * 1.00001)
        assert np.all(np.abs(accelerations) <= self.limits.acceleration * 1.00001)
        steps = np.diff(fine)[:, None]
        # Rounding of accelerations over a step of 0.2 ms.
        assert np.all(np.abs(np.diff(accelerations, axis=0)) <= (self.limits.jerk * 1.00001) * steps + 1e-6)
        means = 0.5 * (velocities[1:] + velocities[:-1])
        np.testing.assert_allclose(np.diff(positions, axis=0) / steps, means, atol=2e-3)
        assert not np.any(reference.velocities[-1])
        assert not np.any(reference.accelerations[-1])
        assert np.all(np.diff(reference.times) > 0.0)


@pytest.fixture(scope="session")
def motions() -> Motions:
    return Motions()


class BagWriter:
    """Writes bags of every kind: topics with messages as plain values, one tuple for each message.

    bag.write(path, {"/joint_states": [(received, stamp, {"joint1": 0.1, ...}), ...]}) with times in seconds. A pose is
    ("frame", (x, y, z, qw, qx, qy, qz)), transforms are [(parent, child, pose), ...], a marker is None, True or a text.
    """

    def write(self, path: Path, topics: dict[str, list[tuple[float, float, Any]]]) -> Path:
        """The kind by the ending: .bag is ROS 1, .mcap a folder with that storage, others a folder of sqlite3."""
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore

        old = path.suffix == ".bag"
        store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_JAZZY)
        plugin = rosbag2.StoragePlugin.MCAP if path.suffix == ".mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag1.Writer(path) if old else rosbag2.Writer(path, version=9, storage_plugin=plugin)
        if old:
            from rosbags.typesys import get_types_from_msg

            text = "geometry_msgs/TransformStamped[] transforms"
            store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        with writer:
            for topic, rows in topics.items():
                messages = [self._message(store, stamp, value) for _, stamp, value in rows]
                connection = writer.add_connection(topic, messages[0].__msgtype__, typestore=store)
                encode = store.serialize_ros1 if old else store.serialize_cdr
                for (received, _, _), message in zip(rows, messages, strict=True):
                    writer.write(connection, round(received * 1e9), encode(message, message.__msgtype__))
        return path

    def _message(self, store: Any, stamp: float, value: Any) -> Any:
        types = store.types

        def header(frame: str = "") -> Any:
            nanoseconds = round(stamp * 1e9)
            time = types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
            kind = types["std_msgs/msg/Header"]
            return kind(0, time, frame) if "seq" in kind.__dataclass_fields__ else kind(time, frame)

        def placed(vector: str, pose: Any) -> tuple[Any, Any]:
            x, y, z, qw, qx, qy, qz = map(float, pose)
            turned = types["geometry_msgs/msg/Quaternion"](qx, qy, qz, qw)
            return types[f"geometry_msgs/msg/{vector}"](x, y, z), turned

        if isinstance(value, dict):
            none = np.zeros(0)
            return types["sensor_msgs/msg/JointState"](header(), list(value), np.array([*value.values()]), none, none)
        if isinstance(value, tuple):
            return types["geometry_msgs/msg/PoseStamped"](
                header(value[0]), types["geometry_msgs/msg/Pose"](*placed("Point", value[1]))
            )
        if isinstance(value, list):
            moved = types["geometry_msgs/msg/Transform"]
            one = types["geometry_msgs/msg/TransformStamped"]
            return types["tf2_msgs/msg/TFMessage"](
                [one(header(parent), child, moved(*placed("Vector3", pose))) for parent, child, pose in value]
            )
        if value is None:
            return types["std_msgs/msg/Empty"]()
        return types["std_msgs/msg/Bool" if isinstance(value, bool) else "std_msgs/msg/String"](value)


@pytest.fixture(scope="session")
def bag() -> BagWriter:
    return BagWriter()


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small file in centimetres: four reaches that bulge differently far and turn the tool."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    items = []
    for bulge in (-8.0, -3.0, 3.0, 8.0):
        bent = bulge * np.sin(np.pi * share) * [0.8, 0.0, 0.6]
        positions = [45.0, -28.0, 32.0] + share * [3.0, 54.0, 4.0] + bent
        half = 0.25 * share
        zero = np.zeros_like(half)
        items.append(np.hstack([positions, zero, np.cos(half), np.sin(half), zero]))
    path = tmp_path_factory.mktemp("recording") / "reach.npy"
    np.save(path, np.array(items))
    return path


#: Six joints in a row: base, shoulder, elbow, and three of a wrist.
SIX = """<robot name="six"><link name="l0"/>{}</robot>"""
AXES, LENGTHS = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1"), (0.3, 0.1, 0.4, 0.2, 0.2, 0.05)


@pytest.fixture(scope="session")
def six(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    joints = "".join(
        f'<link name="l{i + 1}"/><joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 {length}"/><axis xyz="{axis}"/>'
        '<limit lower="-2.8" upper="2.8" velocity="2" effort="9"/></joint>'
        for i, (axis, length) in enumerate(zip(AXES, LENGTHS, strict=True))
    )
    file = tmp_path_factory.mktemp("six") / "six.urdf"
    file.write_text(SIX.format(joints))
    return Robot.from_urdf(file, "l0", "l6")
