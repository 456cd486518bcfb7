"""Bags of ROS 2 (sqlite3, mcap) and of ROS 1 -> takes. Knows no ROS: bags are read by the library `rosbags`.

Messages are decoded by the definitions that the library brings, never by those in a bag: what a bag declares is not
turned into code.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.demonstrations.clocks import Clock
from geodesic_motion_ros.demonstrations.message_samples import JointSamples, ReceivedTake, Samples, stack_rows, stamp_of
from geodesic_motion_ros.demonstrations.takes import POSE, Flaw, Take
from geodesic_motion_ros.geometry.curves import interpolate
from geodesic_motion_ros.geometry.quaternions import continuous_signs, multiply, normalise, to_rotation
from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Of files; a folder with files of these kinds, or with metadata.yaml, is a bag of ROS 2.
SUFFIXES = (".db3", ".mcap", ".bag")
JOINTS, POSES = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped"
#: The old name is that of ROS 1; the messages have the same fields.
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
EMPTY, BOOL, STRING = "std_msgs/msg/Empty", "std_msgs/msg/Bool", "std_msgs/msg/String"
STATIC = "/tf_static"
#: What saves the messages of a damaged file, by its ending.
_REMEDIES = {
    ".db3": "`sqlite3 FILE .recover | sqlite3 NEW.db3`",
    ".mcap": "`mcap recover FILE -o NEW.mcap`",
    ".bag": "`rosbag reindex FILE`",
}
#: Of files that `ros2 bag record --compression-mode file` writes; its folder says what is in them.
COMPRESSED = (".zstd", ".zst", ".lz4")
#: Of one topic: half an hour at 1 kHz.
MOST_MESSAGES = 2_000_000
#: Frames from the base to the tool.
LONGEST_CHAIN = 100
#: Of each child frame, by its parents, when it was received, stamped [ns] and where it was (7,).
_Edges = dict[str, dict[str, list[tuple[int, int, np.ndarray]]]]


@dataclass(frozen=True)
class Topic:
    """A topic in a bag: its name, the type of its messages as ROS 2 writes it, and how many there are."""

    name: str
    kind: str
    count: int

    def __str__(self) -> str:
        return f"{self.name} ({self.kind.replace('/msg/', '/')}, {self.count})"


@dataclass(frozen=True)
class Source:
    """A source that --topic names: a topic, and for transforms the frames of the base and of the tool."""

    topic: str
    base: str = ""
    tool: str = ""

    @classmethod
    def parse(cls, text: str) -> Source:
        """Read `/joint_states`, or `/tf:BASE:TOOL`; DemonstrationError for other forms."""
        parts = text.split(":")
        if len(parts) not in (1, 3) or not all(parts):
            raise DemonstrationError(
                f"topic {brief(text)}: give a topic, as /joint_states, or for transforms /tf:BASE_FRAME:TOOL_FRAME"
            )
        return cls(*parts)


@dataclass(frozen=True)
class BagTake:
    """A take out of a bag, what was found while reading it, and what marks demonstrations in it.

    markers : times [s] as in the take, and the values: None of Empty, True or False of Bool, the text of String.
    frame : of poses, as their headers have it; "" of others, and where these have none.
    breaks : times [s] at which the stamps began again: no motion leads past them.
    """

    take: Take
    flaws: tuple[Flaw, ...]
    markers: tuple[tuple[float, bool | str | None], ...] = ()
    frame: str = ""
    breaks: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Message:
    """received : [ns] of the recorder's clock."""

    received: int
    content: Any


def is_bag(path: Path) -> bool:
    """Tell whether a path looks like a bag: a file by its ending, or a folder of ROS 2."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(_storage_files(path))
    return path.suffix.lower() in SUFFIXES or _is_compressed(path)


def _is_compressed(path: Path) -> bool:
    return path.suffix.lower() in COMPRESSED and Path(path.stem).suffix.lower() in SUFFIXES


def read_topics(path: Path) -> tuple[Topic, ...]:
    """List the topics of a bag, by name. DemonstrationError: it cannot be read."""
    with _opened(path) as bag:
        return bag.topics


def choose_source(path: Path, requested: str | None) -> tuple[Source, Topic]:
    """Choose the topic that is requested, or the only one of joint states or poses in the bag.

    Raises
    ------
    DemonstrationError : lists the topics of the bag where the requested one is absent or of another type, or where
        several could be meant.
    """
    there = read_topics(path)
    listed = ", ".join(map(str, there)) or "no topics"
    if requested is None:
        usable = [topic for topic in there if topic.kind in (JOINTS, POSES) and topic.count]
        if len(usable) != 1:
            several = "several topics" if usable else "no topic with messages"
            raise DemonstrationError(
                f"{path}: {several} of joint states or poses; say which with --topic (transforms: /tf:BASE:TOOL). "
                f"The bag has {listed}"
            )
        return Source(usable[0].name), usable[0]
    source = Source.parse(requested)
    (found,) = [topic for topic in there if topic.name == source.topic] or (None,)
    if found is None or found.count == 0:
        absent = "has no topic" if found is None else "has no message on"
        raise DemonstrationError(f"{path}: {absent} {source.topic}. The bag has {listed}")
    kinds = TRANSFORMS if source.base else (JOINTS, POSES)
    if found.kind not in kinds:
        if found.kind in TRANSFORMS:
            raise DemonstrationError(f"{path}: {source.topic} has transforms; say of which frames: --topic "
                                     f"{source.topic}:BASE_FRAME:TOOL_FRAME")
        raise DemonstrationError(
            f"{path}: {source.topic} has messages of type {found.kind}; needed is "
            f"{' or '.join(kind.replace('/msg/', '/') for kind in kinds)}. The bag has {listed}"
        )
    return source, found


def read_take(path: Path, source: Source, joint_names: Sequence[str] = (), marker: str = "") -> BagTake:
    """Read one topic of a bag.

    Parameters
    ----------
    source : as `choose_source` found it.
    joint_names : those that are wanted of joint states, in their order; messages without one of them are passed over.
    marker : a topic of std_msgs/Empty, Bool or String that marks demonstrations; "": none.

    Returns
    -------
    The take, its times from its first message on: of the headers' stamps, or of the recorder's clock where these are
    not set.

    Raises
    ------
    DemonstrationError : names what is missing, and what is there.
    """
    with _opened(path) as bag:
        kind = bag.kind(source.topic)
        messages = bag.messages(source.topic)
        frame = ""
        if kind == JOINTS:
            read = _joints(messages, tuple(joint_names), path).take(path.stem)
        else:
            if kind == POSES:
                frame, samples = _only_frame(messages, path), _poses(messages)
            else:
                samples = _transforms(messages, _static_edges(bag, source.topic), source, path)
            received, stamps, values = samples
            values = np.hstack([values[:, :3], continuous_signs(values[:, 3:])])
            read = ReceivedTake.of((received, stamps, values), POSE, path.stem)
        marks = bag.messages(marker) if marker else []
    at = np.interp([mark.received for mark in marks], read.received, read.take.times) if marks else []
    markers = tuple((float(time), getattr(mark.content, "data", None)) for time, mark in zip(at, marks, strict=True))
    return BagTake(read.take, read.flaws, markers, frame, read.breaks)


def _joints(messages: list[_Message], names: tuple[str, ...], path: Path) -> JointSamples:
    samples = JointSamples(names)
    for message in messages:
        samples.add(message.received, message.content)
    if not len(samples):
        question = "; are they those of another robot? Name it with --robot" if samples.missing_joints else ""
        raise DemonstrationError(f"{path}: {samples.lacking()}{question}")
    return samples


def _poses(messages: list[_Message]) -> Samples:
    rows = []
    for message in messages:
        pose = message.content.pose
        rows.append((message.received, stamp_of(message.content.header), _pose(pose.position, pose.orientation)))
    return stack_rows(rows)


def _only_frame(messages: list[_Message], path: Path) -> str:
    """The frame of all poses; DemonstrationError: there are several."""
    frames = [_frame(message.content.header.frame_id) for message in messages]
    for message, frame in zip(messages, frames, strict=True):
        if frame != frames[0]:
            since = (message.received - messages[0].received) / 1e9
            raise DemonstrationError(
                f"{path}: the poses are in {brief(frames[0])}, and from {since:.2f} s on in {brief(frame)}: they must "
                "be in one frame, the robot's base"
            )
    return frames[0]


def _transforms(messages: list[_Message], static: _Edges, source: Source, path: Path) -> Samples:
    """Poses of the tool's frame in the base's, through all frames between, whenever the last moving one was published.

    The others are interpolated to those times, and held before their first and after their last.
    """
    edges = static | _edges(messages)
    chain, frame = [], _frame(source.tool)
    while frame != _frame(source.base):
        if frame not in edges or len(chain) == LONGEST_CHAIN:
            frames = sorted({*edges, *(parent for parents in edges.values() for parent in parents)})
            raise DemonstrationError(
                f"{path}: no transforms lead from {brief(source.base)} to {brief(source.tool)}, none has the child "
                f"{brief(frame)}; the frames there are {brief(', '.join(frames), 300)}"
            )
        if len(edges[frame]) > 1:
            raise DemonstrationError(
                f"{path}: the frame {brief(frame)} is placed in {brief(' and in '.join(edges[frame]), 200)}: two "
                "programs publish it, or it changed its parent while this was recorded"
            )
        ((frame, rows),) = edges[frame].items()
        chain.append(stack_rows(rows))
    if not chain:
        raise DemonstrationError(f"{path}: {source.topic}: the frames of base and tool are both {brief(source.base)}")
    moving = [edge for edge in chain if len(edge[0]) > 1]
    received, stamps, _ = moving[0] if moving else chain[0]
    unset = "" if all(np.all(edge[1] > 0) for edge in moving) else "without stamps"
    clock = Clock.of(received, stamps, unset=unset)
    at = clock.nanoseconds(received, stamps).astype(float)
    position, rotation = np.zeros((len(at), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(at), 1))
    for edge in chain:
        there, turn = _at(clock.nanoseconds(*edge[:2]).astype(float), edge[2], at)
        position = there + to_rotation(turn).apply(position)
        rotation = multiply(turn, rotation)
    return received, np.zeros_like(stamps) if unset else stamps, np.hstack([position, rotation])


def _edges(messages: list[_Message]) -> _Edges:
    edges: _Edges = {}
    for message in messages:
        for transform in message.content.transforms:
            moved, parents = transform.transform, edges.setdefault(_frame(transform.child_frame_id), {})
            rows = parents.setdefault(_frame(transform.header.frame_id), [])
            rows.append((message.received, stamp_of(transform.header), _pose(moved.translation, moved.rotation)))
    return edges


def _static_edges(bag: _Bag, topic: str) -> _Edges:
    """Static transforms beside a topic: those of its own namespace before those of none.

    Latched ones are published again for nodes that join later: the last counts.
    """
    own = f"{topic.rpartition('/')[0]}{STATIC}"
    edges: _Edges = {}
    for name in dict.fromkeys((STATIC, own)):
        if bag.has(name) and name != topic:
            edges |= _edges(bag.messages(name))
    return {child: {parent: rows[-1:] for parent, rows in parents.items()} for child, parents in edges.items()}


def _at(times: np.ndarray, poses: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and unit quaternions of poses (T, 7) at other times (n,); held outside of theirs."""
    times, first = np.unique(times, return_index=True)
    quaternions = continuous_signs(normalise(poses[first, 3:]))
    if len(times) == 1:
        return np.tile(poses[first, :3], (len(at), 1)), np.tile(quaternions, (len(at), 1))
    return interpolate(times, poses[first, :3], quaternions, np.clip(at, times[0], times[-1]))


def _pose(position: Any, rotation: Any) -> np.ndarray:
    return np.array([position.x, position.y, position.z, rotation.w, rotation.x, rotation.y, rotation.z])


def _frame(name: str) -> str:
    """ROS 1 wrote frames with a slash before them."""
    return name.removeprefix("/")


class _Bag:
    """The readers of one bag, and how its messages are decoded."""

    def __init__(self, readers: Sequence[Any], decode: Callable[[bytes, str], Any]) -> None:
        self._readers, self._decode = readers, decode
        found: dict[str, Topic] = {}
        for reader in readers:
            for connection in reader.connections:
                before = found.get(connection.topic, Topic(connection.topic, connection.msgtype, 0))
                count = before.count + connection.msgcount
                found[connection.topic] = Topic(before.name, before.kind, count)
        self._topics: Mapping[str, Topic] = found

    @property
    def topics(self) -> tuple[Topic, ...]:
        return tuple(self._topics[name] for name in sorted(self._topics))

    def has(self, topic: str) -> bool:
        return topic in self._topics

    def kind(self, topic: str) -> str:
        return self._topics[topic].kind

    def messages(self, topic: str) -> list[_Message]:
        """All of a topic, as they were received."""
        if not self.has(topic) or self._topics[topic].count > MOST_MESSAGES:
            raise DemonstrationError(
                f"has no topic {topic}; it has {', '.join(map(str, self.topics))}" if not self.has(topic)
                else f"{topic} has {self._topics[topic].count} messages; at most {MOST_MESSAGES} are read"
            )
        kind = self.kind(topic)
        read = []
        for reader in self._readers:
            own = [each for each in reader.connections if each.topic == topic and each.msgtype == kind]
            if own:
                read += [self._message(own[0], time, data) for _, time, data in reader.messages(own)]
        return sorted(read, key=lambda message: message.received)

    def _message(self, connection: Any, received: int, data: bytes) -> _Message:
        try:
            return _Message(received, self._decode(data, connection.msgtype))
        except Exception as error:  # on rubbish the decoder raises what its step at hand happens to raise
            since = (received - min(reader.start_time for reader in self._readers)) / 1e9
            raise DemonstrationError(
                f"a message on {connection.topic}, {since:.2f} s after the bag begins, is damaged or no "
                f"{connection.msgtype} ({_reason(error)})"
            ) from error


@contextmanager
def _opened(path: Path) -> Iterator[_Bag]:
    """Open a bag. Whatever its readers raise on rubbish becomes a DemonstrationError of one line."""
    # loaded here, for most commands and `--help` do without
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    if not path.exists():
        raise DemonstrationError(f"{path}: cannot be read (No such file or directory)")
    if _is_compressed(path):
        raise DemonstrationError(
            f"{path}: is a compressed file of a bag: give its folder, {path.parent}, where metadata.yaml says what is "
            f"in it; without that, decompress it first (`zstd -d {path.name}`)"
        )
    if not is_bag(path) or not (path.is_dir() or path.is_file()):
        raise DemonstrationError(f"{path}: is no bag: a folder of ROS 2, or a file that ends in {', '.join(SUFFIXES)}")
    try:
        with ExitStack() as stack:
            if path.suffix.lower() == ".bag":
                store = get_typestore(Stores.ROS1_NOETIC)
                store.register(_old_transforms(store))
                readers, decode = [stack.enter_context(rosbag1.Reader(path))], store.deserialize_ros1
            else:
                whole = not path.is_dir() or (path / "metadata.yaml").exists()
                # A recorder that was killed leaves no metadata: its files are read one by one.
                parts = [path] if whole else _storage_files(path)
                readers = [stack.enter_context(rosbag2.Reader(part)) for part in parts]
                decode = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
            yield _Bag(readers, decode)
    except DemonstrationError as error:
        raise error if str(error).startswith(str(path)) else DemonstrationError(f"{path}: {error}") from error
    except Exception as error:
        raise DemonstrationError(
            f"{path}: is no readable bag, damaged or cut short ({_reason(error)}){_remedy(path)}"
        ) from error


def _reason(error: Exception) -> str:
    return brief(" ".join(str(error).split()), 160) if str(error) else type(error).__name__


def _remedy(path: Path) -> str:
    """What saves the messages of a damaged bag; "" where its files are not there."""
    files = _storage_files(path) if path.is_dir() else [path]
    if not files:
        return ""
    reindexed = "its metadata.yaml by `ros2 bag reindex`, " if path.is_dir() else ""
    return f"; perhaps it can be saved: {reindexed}its messages by {_REMEDIES[files[0].suffix.lower()]}"


def _storage_files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in (".db3", ".mcap") and file.is_file())


def _old_transforms(store: Any) -> Mapping[str, Any]:
    """Definitions of the messages of transforms that ROS 1 has beside the library's."""
    from rosbags.typesys import get_types_from_msg

    return {
        name: definition
        for kind in TRANSFORMS
        for name, definition in get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind).items()
        if name not in store.fielddefs
    }
