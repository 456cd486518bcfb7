"""Skill: everything the planner needs of a learned task, saved in and loaded from one folder.

The folder holds `skill.yaml` (format version, robot, frames, thresholds, quality, provenance, and the SHA-256 of the
other files), `weights.safetensors` (decoder and encoder) and `latent.npz` (codes and box). Nothing is ever unpickled;
a truncated, altered or foreign folder is refused with the reason.
"""

from __future__ import annotations

import hashlib
import math
import os
import shutil
import tempfile
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from safetensors.numpy import save_file

from geodesic_motion_ros.manifold.configuration_graph import (
    ConfigurationGraph,
    JointMetricSettings,
    build_configuration_graph,
)
from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.pose_graph import MetricSettings, PoseGraph
from geodesic_motion_ros.manifold.sampled_nodes import NEIGHBOURS as NEAREST
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT, shipped_robots
from geodesic_motion_ros.skill.description import (
    DESCRIPTION,
    FILES,
    FORMAT_VERSION,
    LATENT,
    METADATA,
    WEIGHTS,
    check_thresholds,
)
from geodesic_motion_ros.skill.folder import LARGEST_DESCRIPTION, LATENT_ARRAYS, read_folder
from geodesic_motion_ros.skill.kept_graph import read_or_build_graph
from geodesic_motion_ros.skill.sheet import CanonicalSheet, JointSheet
from geodesic_motion_ros.skill.space import SPACES
from geodesic_motion_ros.utils.checked_files import PlainDumper, brief
from geodesic_motion_ros.utils.errors import GeodesicMotionError, SkillError
from geodesic_motion_ros.utils.shared_files import find_shared

#: The grids that energy_per_edge is calibrated on, and the default ones, by the latent dimension: of more, nodes are
#: sampled.
GRID_SHAPES = {1: (1000,), 2: (100, 100), 3: (50, 50, 50)}
#: The same of a closed skill, along one round: of three rounds the graph is not much larger.
ROUND_SHAPES = {2: (200, 60), 3: (34, 25, 25)}
#: Directions per node of the default grids.
NEIGHBOURS = {1: 2, 2: 16, 3: 26}
#: The support ends where rms sigma exceeds this multiple of its 99th percentile on the demonstrations.
SUPPORT_MULTIPLE = 5.0
#: Ends of a path are chosen closer to the demonstrations than the rim of the support.
ENDPOINT_MULTIPLE = 3.0


@dataclass(frozen=True, kw_only=True)
class LearnedModel:
    """The result of a training: the decoder, and all else that the latent graph is made of.

    Attributes
    ----------
    space : "task", what is learned are poses of the tool, or "joint", configurations of the whole arm.
    name, robot : what it is called, and of which robot it is: the name of a shipped one, or the path of a folder.
    decoder : numpy decoder.
    codes : (N, T, d) latent means of the demonstrations by arc length; with antipodal doubling both signs, (2N, T, d).
    canonical : the endpoint-normalised demonstrations and the offsets that were taken out of them before the training;
        None on the raw sheet, that of the paper: there they are learned as they were recorded.
    latent_lower, latent_upper : (d,) the box that is turned into a graph.
    metric : weights of the pull-back metric.
    orientation_model : "two_cluster" (q and -q have codes of their own) or "sign_blind"; "none" in joint space.
    sigma_support : 99th percentile of rms sigma [m], in joint space [rad], on the demonstrations' codes.
    """

    name: str
    decoder: TaskSpaceDecoder | JointSpaceDecoder
    codes: np.ndarray
    latent_lower: np.ndarray
    latent_upper: np.ndarray
    sigma_support: float
    space: Literal["task", "joint"] = "task"
    robot: str = DEFAULT_ROBOT
    metric: MetricSettings | JointMetricSettings = field(default_factory=MetricSettings)
    canonical: CanonicalSheet | JointSheet | None = None
    orientation_model: Literal["two_cluster", "sign_blind", "none"] = "two_cluster"

    @property
    def sigma_limit(self) -> float:
        """Largest rms sigma [m], in joint space [rad], inside the support."""
        return SUPPORT_MULTIPLE * self.sigma_support

    @property
    def sheet(self) -> Literal["canonical", "raw"]:
        """Whether start and goal offsets were taken out of the demonstrations before the training."""
        return "raw" if self.canonical is None else "canonical"

    @property
    def fade(self) -> float:
        """Exponent with which the offset of a query's start fades along a motion; 1, linear, on the raw sheet."""
        return 1.0 if self.canonical is None else self.canonical.fade

    @property
    def pace(self) -> np.ndarray | None:
        """The mean time (S,) [s] at which demonstrations had come so far along; None where it was not recorded, and on
        the raw sheet.
        """
        return None if self.canonical is None else self.canonical.pace

    @property
    def mean_paths(self) -> MeanPaths | None:
        """Mean paths of the demonstrations; None on the raw sheet, and for a single demonstration."""
        if self.canonical is None or not self.canonical.has_mean_paths:
            return None
        return MeanPaths.of_codes(self.codes, self.canonical.modes)

    @property
    def period(self) -> float | None:
        """How far apart latent points on the first axis are one place of a round; None: the skill is not closed."""
        return float(self.decoder.period) if self.decoder.is_closed else None

    @property
    def grid_shape(self) -> tuple[int, ...] | None:
        """That of the default graph: of GRID_SHAPES, or ROUND_SHAPES; None: its nodes are sampled."""
        dimension = len(self.latent_lower)
        if self.period is None:
            return GRID_SHAPES.get(dimension)
        shape = ROUND_SHAPES[dimension]
        along = shape[0] * (self.latent_upper[0] - self.latent_lower[0]) / self.period
        return (1 + round(along), *shape[1:])

    def graph(
        self, shape: tuple[int, ...] | None = None, neighbours: int | None = None
    ) -> PoseGraph | ConfigurationGraph:
        """Decode the latent box into its graph, by default that of GRID_SHAPES and NEIGHBOURS, or of sampled nodes:
        for a large one seconds, which a skill takes once (`read_or_build_graph`).

        Raises
        ------
        SkillError : nothing of the box is supported.
        """
        try:
            return self._graph(shape, neighbours)
        except SkillError as error:
            raise SkillError(f"skill {self.name}: {error}") from error

    def _graph(self, shape: tuple[int, ...] | None, neighbours: int | None) -> PoseGraph | ConfigurationGraph:
        dimension = len(self.latent_lower)
        shape = shape or self.grid_shape
        neighbours = neighbours or NEIGHBOURS.get(dimension, NEAREST)
        recipe = {
            "decoder": self.decoder, "codes": self.codes, "lower": self.latent_lower, "upper": self.latent_upper,
            "metric": self.metric, "sigma_limit": self.sigma_limit, "shape": shape, "neighbours": neighbours,
            "energy_limit": self._energy_limit(shape), "mean_paths": self.mean_paths,
        }  # fmt: skip
        return SPACES[self.space].build_graph(self, recipe, self._configuration_graph)

    def _configuration_graph(self, **recipe: Any) -> ConfigurationGraph:
        """The graph of a recipe, as of `build_configuration_graph`."""
        return build_configuration_graph(**recipe)

    def _energy_limit(self, shape: tuple[int, ...] | None) -> float:
        """Largest squared length of one edge that a path may have: none yet, it is calibrated on the graph itself."""
        return math.inf


@dataclass(frozen=True, kw_only=True)
class Skill(LearnedModel):
    """A trained skill: what was learned, and what a path through its graph may cost.

    Attributes
    ----------
    energy_per_edge : largest obstacle-free squared length of one edge of the default graph that a path may have.
    start_pose, goal_pose : (7,) mean first and last tool pose of the demonstrations: x, y, z [m], w, x, y, z; in joint
        space of those of the first family.
    base_frame, tool_frame : whose poses it speaks of.
    encoder_arrays : weights of the encoder by name, for re-encoding demonstrations.
    quality, provenance : figures on held-out demonstrations; data, licence, source, seed, settings.
    scene : what stood around the arm as it was demonstrated, as a file of config/scenes says it; None: not said.
    """

    energy_per_edge: float
    start_pose: np.ndarray
    goal_pose: np.ndarray
    base_frame: str
    tool_frame: str
    encoder_arrays: dict[str, np.ndarray] = field(default_factory=dict)
    quality: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    scene: dict[str, Any] | None = None

    def mean_configuration(self, end: Literal["start", "goal"]) -> np.ndarray:
        """Return the mean start, or goal, (eta,) [rad] of the first group of demonstrations; on the raw sheet that of
        the first demonstration.

        Raises
        ------
        SkillError : the skill is of poses of the tool.
        """
        if self.space != "joint":
            raise SkillError(f"skill {self.name} is of poses of the tool, not of joint angles: it has {end}_pose")
        if self.canonical is not None:
            return getattr(self.canonical, f"{end}_poles")[0].copy()
        latent = self.codes[0, :1] if end == "start" else self.codes[0, -1:]
        return self.decoder.configurations(latent)[0]

    @classmethod
    def of(cls, model: LearnedModel, energy_per_edge: float, **attributes: Any) -> Skill:
        """Make a skill of what was learned, its other attributes by name; SkillError where no file could hold it."""
        check_thresholds({"sigma_support": model.sigma_support, "energy_per_edge": energy_per_edge})
        learned = {item.name: getattr(model, item.name) for item in fields(model)}
        return cls(**learned, energy_per_edge=energy_per_edge, **attributes)

    def _configuration_graph(self, **recipe: Any) -> ConfigurationGraph:
        """That of a trained skill is kept for the next program."""
        return read_or_build_graph(self.name, recipe)

    def _energy_limit(self, shape: tuple[int, ...] | None) -> float:
        """energy_per_edge for edges of another grid: squared lengths grow with the square of the spacing."""
        calibrated = self.grid_shape
        if shape is None or calibrated is None:
            return self.energy_per_edge
        coarser = max((reference - 1) / (side - 1) for reference, side in zip(calibrated, shape, strict=False))
        return self.energy_per_edge * max(1.0, coarser**2)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the folder, all or nothing: an interrupted save leaves what was there before. Returns the folder.

        Over an older skill only the files of the skill change: a model card and pictures beside them stay. The folder
        of a robot is written relative to that of the skill, so that both can be moved together.

        Raises
        ------
        SkillError : its description is longer than what is read.
        """
        target = Path(folder).absolute()
        target.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
        try:
            weights = {f"decoder.{name}": array for name, array in self.decoder.arrays().items()}
            weights |= {f"encoder.{name}": np.asarray(a, float) for name, a in self.encoder_arrays.items()}
            save_file({k: np.array(v, order="C") for k, v in weights.items()}, draft / WEIGHTS)
            latent = {name: getattr(self, name) for name in LATENT_ARRAYS}
            described = {"format_version": FORMAT_VERSION, "sheet": self.sheet}
            if self.canonical is not None:
                named = SPACES[self.space].canonical_arrays
                latent |= {f"canonical_{name}": getattr(self.canonical, name) for name in named}
                if self.canonical.times is not None:
                    latent["canonical_times"] = self.canonical.times
                described["regression_penalty"] = self.canonical.penalty
                described["offset_fade"] = self.canonical.fade
            np.savez(draft / LATENT, **latent)
            described |= {name: getattr(self, name) for name in METADATA} | {"metric": asdict(self.metric)}
            described["robot"] = _relative_robot(self.robot, target)
            if self.scene is not None:
                described["scene"] = self.scene
            described["sha256"] = {name: hashlib.sha256((draft / name).read_bytes()).hexdigest() for name in FILES}
            text = yaml.dump(described, Dumper=PlainDumper, sort_keys=False, width=110)
            if len(text.encode()) > LARGEST_DESCRIPTION:
                raise SkillError(
                    f"skill {self.name}: {DESCRIPTION} would have {len(text) >> 10} kB, and no more than "
                    f"{LARGEST_DESCRIPTION >> 10} kB are read: its scene or provenance is too long"
                )
            (draft / DESCRIPTION).write_text(text)
            draft.chmod(0o755)
            for file in draft.iterdir():
                file.chmod(0o644)
            _replace_folder(draft, target)
        finally:
            shutil.rmtree(draft, ignore_errors=True)
        return target

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Skill:
        """Read a skill folder, or a shipped skill by its bare name ("panda_pouring").

        Raises
        ------
        SkillError : missing folder or file, wrong checksum, unknown format version, unreadable content, numbers that
            no skill has; the message names the file, the entry and the reason.
        """
        return cls(**read_folder(_resolve(folder)))


def _replace_folder(draft: Path, target: Path) -> None:
    """Put a finished folder in the place of an old skill; the old one survives until the new one stands."""
    if not target.exists():
        draft.rename(target)
        return
    if not (target / "skill.yaml").is_file() and any(target.iterdir()):
        raise SkillError(f"{target} exists and is not a skill folder: choose another name, nothing was overwritten")
    for entry in target.iterdir():
        if not (draft / entry.name).exists():
            (shutil.copytree if entry.is_dir() else shutil.copy2)(entry, draft / entry.name)
    old = Path(tempfile.mkdtemp(prefix=f".{target.name}-old-", dir=target.parent)) / "skill"
    target.rename(old)
    draft.rename(target)
    shutil.rmtree(old.parent)


def _relative_robot(robot: str, folder: Path) -> str:
    """A shipped robot's name, or the path of its folder relative to a skill's."""
    if robot in shipped_robots():
        return robot
    return Path(os.path.relpath(Path(robot).expanduser().resolve(), folder.resolve())).as_posix()


def _resolve(folder: str | os.PathLike[str]) -> Path:
    path = Path(folder).expanduser()  # a shell leaves the ~ of skill:=~/my_skill as it is
    try:
        if path.is_dir():
            return path
    except OSError as error:
        raise SkillError(f"skill folder {brief(folder)} cannot be opened ({error.strerror})") from error
    if path.parent == Path("."):
        try:
            return find_shared(f"models/{path.name}")
        except GeodesicMotionError as error:
            shipped = shipped_skills()
            said = f"not one that is shipped ({', '.join(shipped)})" if shipped else f"not shipped ({error})"
            raise SkillError(f"no skill {str(folder)!r}: not a folder, and {said}") from error
    raise SkillError(f"no skill folder {str(folder)!r}: give a folder with skill.yaml, or the name of a shipped skill")


def shipped_skills() -> list[str]:
    """List the names of the skills that this installation has, sorted."""
    try:
        return sorted(file.parent.name for file in find_shared("models").glob("*/skill.yaml"))
    except GeodesicMotionError:
        return []
