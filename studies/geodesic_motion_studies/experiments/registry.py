"""All studies, by the names of their commands. A study's file is loaded when it is used: it may need torch or ROS."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geodesic_motion_studies.experiments.study import Study


@dataclass(frozen=True)
class Entry:
    """A study: its class and the file of this folder that it stands in, and what it is about, in a line.

    of_recordings : whether it needs recordings, which `experiment all` has not.
    timed : whether it states times: nothing runs beside it.
    """

    file: str
    study: str
    about: str
    of_recordings: bool = False
    timed: bool = False

    def load(self) -> type[Study]:
        """The class."""
        return getattr(import_module(f"geodesic_motion_studies.experiments.{self.file}"), self.study)


STUDIES: dict[str, Entry] = {
    "toy-task": Entry("toy_task", "ToyTask", "a J in the plane, orientations that draw a C: clusters, geodesic, line"),
    "toy-joint": Entry("toy_joint", "ToyJoint", "an arm of two joints draws an S in two postures"),
    "circle": Entry("circle", "Circle", "circles of the whole arm in four postures: two latent dimensions, and three"),
    "geodesics": Entry("geodesics", "Geodesics", "methods for a shortest path: their lengths and times", timed=True),
    "avoidance": Entry("avoidance", "Avoidance", "spheres on the path of held-out demonstrations", True),
    "crossing": Entry("crossing", "CrossingClusters", "what it costs to change between the clusters of q and -q", True),
    "goals": Entry("goals", "Goals", "simulated demonstrations between places that vary: held-out ones predicted"),
    "modes": Entry("modes", "Modes", "a pillar passed on both sides: one mode followed, the other when it is blocked"),
    "whole-arm": Entry("whole_arm", "WholeArm", "spheres on the path of the whole arm, standing and moving"),
    "obstacle-laws": Entry("obstacle_laws", "ObstacleLaws", "laws, strengths and widths of the ambient metric"),
    "grasp-task": Entry("grasp_task", "GraspTask", "reach to grasp, poses of the tool: new targets, paths across"),
    "transfer": Entry("transfer", "Transfer", "one skill of the tool on three arms: planned, played, compared"),
    "pouring-task": Entry("pouring_task", "PouringTask", "three bottles, three cups: pairs, a moving sphere, a chain"),
    "detours": Entry("detours", "Detours", "a sphere on the tool's path, and several largest detours, side by side"),
    "largest-sphere": Entry("largest_sphere", "LargestSphere", "on the tool's path, place by place, by the detour"),
    "chunks": Entry("chunks", "Chunks", "drawn chunks offered to a motion filter: refused, path, duration"),
    "queries": Entry("queries", "Queries", "drawn starts and goals of shipped skills: answered, or refused and why"),
    "limbs": Entry("limbs", "Limbs", "a sphere beside the tool's path: which postures of the arm it hits"),
    "grasp-joint": Entry("grasp_joint", "GraspJoint", "reach to grasp with the whole arm: what is left when blocked"),
    "energy-limit": Entry("energy_limit", "EnergyLimit", "the paper's model of grasp-joint: does energy tell hits?"),
    "pouring-joint": Entry("pouring_joint", "PouringJoint", "pouring with the whole arm through several groups"),
    "volume": Entry("volume", "Volume", "a skill learned without and with the volume term of the lower bound"),
    "dimension": Entry("dimension", "Dimension", "two to six latent dimensions: graphs, paths, ticks", timed=True),
    "rate": Entry("running_nodes", "Rate", "planner and twin as two processes: ticks, times of reaction", timed=True),
    "chunk-time": Entry("running_nodes", "ChunkTime", "a filter as a process: chunk to command, cycles", timed=True),
    "view-rate": Entry("running_nodes", "ViewRate", "a page in the browser: what it costs; drags answered", timed=True),
    "camera": Entry("running_nodes", "Camera", "a camera sees the arm: false stops, costs; a ball", timed=True),
    "literal": Entry("literal", "Literal", "held-out demonstrations by the paper to the letter, beside ours", True),
    "densities": Entry("densities", "Densities", "held-out likelihood and path with each density of the model", True),
    "rounds": Entry("rounds", "RoundsStudy", "closed skills: held-out rounds, the seam, spheres on the path"),
    "reshaped-tubes": Entry("reshaped_tubes", "ReshapedTubes", "a moving sphere reshapes the metric of the whole arm"),
    "paper-rate": Entry("running_nodes", "PaperRate", "ticks of the paper's planner: a second, exact ones", timed=True),
}
