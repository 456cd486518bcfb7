"""Spheres that move through the tool's way: a task-space skill in the twin's physics, judged by exact distances.

With such a skill the tool alone avoids obstacles: it is the spheres that the planner is told of, where the arm that
follows the stream of poses, as the twin does, is measured to hold it. The moving spheres, and what their contacts count
as, are those of `moving_spheres.py`; chasing ones chase the tool's origin. A scene begins where one demonstration began
and its goal is where another one ended, both drawn. The planner ticks at 100 Hz of simulated time and is told true
positions and velocities; its answer is sent at once, so that the latency is 0, as the planner node's stream does. The
control is the same planner without being told.

The command is judged, too: its acceleration over the limit, 100 times a second, and *freezes*, where there was no
reference to stop along and the pose was held in full motion.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.demonstrations.curves import Pose
from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.moving_spheres import (
    LONGEST,
    STEP,
    STEP_HZ,
    STEPS_PER_TICK,
    MovingScene,
    MovingSphere,
    NominalMotion,
    SpheresInMotion,
    draw_clearances,
    draw_spheres,
    moving_figures,
    needed_room,
    play_scenes,
)
from geodesic_motion_ros.experiments.trained import check_seeds
from geodesic_motion_ros.graph.tool_points import tool_points
from geodesic_motion_ros.graph.transport import carried
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.plots import write_figure
from geodesic_motion_ros.pose_smoothing import SMOOTHING
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.reference import ReferenceFollower, TaskSpaceReference
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.simulation.world import PandaWorld
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import text_table

#: A tool slower than this [m/s] rests; a goal is reached within so much [m], [rad].
RESTING, REACHED = 5e-3, 2e-3
#: Of the planner's ticks [s].
PERIOD = STEPS_PER_TICK * STEP
#: How often a start and a goal are drawn before it is said that there are none.
_ATTEMPTS = 50


@dataclass(frozen=True, kw_only=True)
class MovingToolScene(MovingScene):
    """What happened in one scene.

    Attributes
    ----------
    seed : of the scene. stops : how often the tool came to rest on the way; freezes : how often it was held in motion.
    strain : largest acceleration of the command over the limit.
    lag : largest distance [m] of the tool from its command.
    """

    seed: int
    stops: int
    freezes: int
    strain: float
    lag: float


def draw_ends(planner: ReactivePlanner, random: np.random.Generator) -> tuple[Pose, Pose, TaskSpaceReference]:
    """The start of one demonstration and the goal of another, drawn, with the planner's way without obstacles.

    Raises
    ------
    ParameterError : the skill is on the raw sheet, or no start and goal was found between which there is a way.
    """
    sheet = planner.skill.canonical
    if sheet is None:
        raise ParameterError("the skill is on the raw sheet: this experiment wants a canonical one")
    planner.take_obstacles(Obstacles.none())
    for _ in range(_ATTEMPTS):
        first, last = random.integers(len(sheet.modes), size=2)
        start, goal = (
            carried(sheet.positions[i, at][None], sheet.quaternions[i, at][None], offsets[i][None])
            for i, at, offsets in ((first, 0, sheet.start_offsets), (last, -1, sheet.goal_offsets))
        )
        ends = (start[0][0], start[1][0]), (goal[0][0], goal[1][0])
        reference = planner.plan(*ends[0], *ends[1]).reference
        if reference is not None:
            return *ends, reference
    raise ParameterError(f"no way was found between any of {_ATTEMPTS} starts and goals that were drawn")


def nominal_tool(settings: PlannerSettings, nominal: TaskSpaceReference) -> NominalMotion:
    """The spheres of a tool that follows a reference; its origin is chased."""

    def spheres(times: np.ndarray) -> np.ndarray:
        positions, quaternions = zip(*map(nominal.sample, times), strict=True)
        return tool_points(np.array(positions), np.array(quaternions), np.array(settings.tool_points))

    return NominalMotion(nominal.duration, np.array(settings.tool_radii), spheres, lambda now: nominal.sample(now)[0])


class MovingToolRun:
    """One scene being played: the arm in physics, the stream of poses, the spheres, the planner, and the judge."""

    def __init__(
        self,
        planner: ReactivePlanner,
        world: PandaWorld,
        start: Pose,
        goal: Pose,
        spheres: Sequence[MovingSphere],
        told: bool = True,
    ) -> None:
        """told : of the spheres; False for a control."""
        self._planner, self._world, self._goal = planner, world, goal
        self._count, self._told = len(spheres), told
        self._points, self._radii = np.array(planner.settings.tool_points), np.array(planner.settings.tool_radii)
        self._follower = ReferenceFollower(planner.settings.speed)
        self._follower.reset(*start)
        world.reset(solve(world.robot, *start))
        self._tool = world.tool_pose()
        self._spheres = SpheresInMotion(spheres, lambda: self._tool[0])
        planner.take_obstacles(Obstacles.none())
        planner.clear_goal()
        planner.set_goal(*goal)
        self._commanded = [start[0]]
        self._ticks: list[float] = []
        self._stood, self._stops, self._freezes, self._lag = 0.0, 0, 0, 0.0

    def play(self, number: int, seed: int, longest: float = LONGEST) -> MovingToolScene:
        """Until the goal is reached, or the longest time [s] is over."""
        moved, reached, step = False, False, 0
        while step * STEP < longest and not reached:
            if step % STEPS_PER_TICK == 0:
                self._tick(step * STEP)
            step += 1
            before = self._placed()
            self._world.step()
            self._tool = self._world.tool_pose()
            pace = float(np.max(np.linalg.norm(self._placed() - before, axis=1))) / STEP
            moves = pace > RESTING
            self._spheres.move(step * STEP)
            self._spheres.judge(step * STEP, moves, self._distance)
            reached = not moves and self._at_goal()
            if not (moves or reached):
                self._stood += STEP
                self._stops += moved
            moved = moves
        accelerations = np.linalg.norm(np.diff(self._commanded, 2, axis=0), axis=1) / PERIOD**2
        return MovingToolScene(
            number=number, spheres=self._count, contacts=tuple(self._spheres.contacts), reached=reached,
            duration=step * STEP, clearance=float(self._spheres.clearance), stood=self._stood,
            ticks=tuple(self._ticks), seed=seed, stops=self._stops, freezes=self._freezes, lag=self._lag,
            strain=float(np.max(accelerations, initial=0.0)) / self._planner.settings.acceleration,
        )  # fmt: skip

    def _tick(self, now: float) -> None:
        stream, planner = self._follower, self._planner
        here = stream.position, stream.quaternion, stream.speed
        obstacles = Obstacles.of_spheres(*self._spheres.seen(now, partial(self._has_room, now)), now)
        self._lag = max(self._lag, float(np.linalg.norm(self._tool[0] - stream.commanded[0])))
        began = time.thread_time()
        if self._told:
            planner.take_obstacles(obstacles)
        plan = planner.tick(*here, now=now)
        self._ticks.append(time.thread_time() - began)
        if plan.reference is None:
            self._freezes += stream.speed > RESTING
            stream.hold()
        else:
            stream.accept(plan.reference)
        self._world.set_target_pose(*stream.advance(PERIOD))
        self._commanded.append(stream.commanded[0])

    def _has_room(self, now: float, centre: np.ndarray, radius: float, speed: float) -> bool:
        """Whether a sphere is far enough for a stop when it is first there."""
        stream = self._follower
        travel, rest = float(np.linalg.norm(stream.position - self._tool[0])), SMOOTHING
        stop = self._planner.stop(stream.position, stream.quaternion, stream.speed, now)
        if stop is not None:
            placed = tool_points(stop.positions, stop.quaternions, self._points)
            travel += float(np.max(np.sum(np.linalg.norm(np.diff(placed, axis=0), axis=-1), axis=0)))
            rest += stop.duration
        return self._distance(centre, radius) > needed_room(travel, rest, speed)

    def _placed(self) -> np.ndarray:
        """Centres (K, 3) of the tool's spheres."""
        position, quaternion = self._tool
        return tool_points(position[None], quaternion[None], self._points)[0]

    def _distance(self, centre: np.ndarray, radius: float) -> float:
        return float(np.min(np.linalg.norm(self._placed() - centre, axis=1) - self._radii)) - radius

    def _at_goal(self) -> bool:
        (position, quaternion), (there, turned) = self._tool, self._goal
        off = float(np.linalg.norm(position - there))
        return off < REACHED and float(angle_between(quaternion, turned)) < REACHED


class MovingToolStage:
    """What all scenes of one process are played with; number i is scene i // len(seeds) of one of the seeds."""

    def __init__(self, skill: Skill, settings: PlannerSettings, seeds: tuple[int, ...]) -> None:
        self.planner, self.seeds = ReactivePlanner(skill, settings), seeds
        self.world = PandaWorld(rate_hz=STEP_HZ)

    def scene(self, number: int) -> MovingToolScene:
        """Draw and play one scene; it depends on nothing else but its number and its seed."""
        number, which = divmod(number, len(self.seeds))
        seed = self.seeds[which]
        random = np.random.default_rng([seed, number])
        start, goal, nominal = draw_ends(self.planner, random)
        spheres = draw_spheres(nominal_tool(self.planner.settings, nominal), random)
        stage = self.planner, self.world, start, goal, spheres
        control = MovingToolRun(*stage, told=False).play(number, seed)
        scene = MovingToolRun(*stage).play(number, seed)
        return replace(scene, control=control.contacts.count("moving"))


@dataclass(frozen=True)
class MovingToolSettings:
    """How many scenes of each seed are played with every tool.

    `tools` are the planner's settings under the tool's names. `processes` play scenes at once, which does not change
    them.
    """

    tools: Mapping[str, PlannerSettings]
    scenes: int = 40
    seeds: tuple[int, ...] = (0,)
    processes: int = 1

    def __post_init__(self) -> None:
        for name in ("scenes", "processes"):
            if getattr(self, name) < 1:
                raise ParameterError(f"{name} is {getattr(self, name)}; at least 1 is needed")
        if not self.tools:
            raise ParameterError("no tool is given; at least 1 is needed")
        check_seeds(self.seeds)


@dataclass(frozen=True)
class MovingToolReport:
    """All scenes of one skill, by tool."""

    skill: str
    settings: MovingToolSettings
    scenes: dict[str, list[MovingToolScene]]

    def summary(self, tool: str) -> dict[str, float | int]:
        """The figures of one tool."""
        scenes = self.scenes[tool]
        return moving_figures(scenes) | {
            "stops": sum(scene.stops for scene in scenes),
            "median_stood_s": float(np.median([scene.stood for scene in scenes])),
            "freezes": sum(scene.freezes for scene in scenes),
            "acceleration_share": max(scene.strain for scene in scenes),
            "largest_lag_mm": 1e3 * max(scene.lag for scene in scenes),
        }

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        tools = {
            tool: {
                "planner": asdict(self.settings.tools[tool]),
                "summary": self.summary(tool),
                "scenes": [scene.told() for scene in scenes],
            }
            for tool, scenes in self.scenes.items()
        }
        return {"skill": self.skill, "seeds": self.settings.seeds, "tools": tools}

    def table(self) -> str:
        """The table as plain text: a column for each tool."""
        columns = [self.summary(tool) for tool in self.scenes]
        rows = [[name.replace("_", " "), *(column[name] for column in columns)] for name in columns[0]]
        return text_table([f"moving spheres, {self.skill}", *self.scenes], rows)


def measure_moving_tool(skill: Skill, settings: MovingToolSettings, show_progress: bool = True) -> MovingToolReport:
    """Draw, plan, play and judge.

    Raises
    ------
    ParameterError : the skill is not of task space, or there are no such scenes with it.
    """
    if skill.space != "task":
        raise ParameterError(
            f"'{skill.name}' is a skill of {skill.space} space: this experiment is of task space; "
            "moving spheres for a whole arm are a part of whole-arm"
        )
    count = settings.scenes * len(settings.seeds)
    scenes = {
        tool: play_scenes(MovingToolStage, (skill, chosen, settings.seeds), count, settings.processes, show_progress)
        for tool, chosen in settings.tools.items()
    }
    return MovingToolReport(skill.name, settings, scenes)


def draw_moving_tool(report: MovingToolReport, path: Path) -> None:
    """The least clearance of the moving tool in every scene."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4.5), layout="constrained")
    axes = figure.subplots()
    clearances = {
        f"{tool}, {{}} of {len(scenes)} in which it moved": [
            scene.clearance for scene in scenes if np.isfinite(scene.clearance)
        ]
        for tool, scenes in report.scenes.items()
    }
    draw_clearances(axes, clearances)
    axes.set(xlabel="least clearance of the moving tool [mm]", ylabel="scenes", title=report.skill)
    write_figure(figure, path)
