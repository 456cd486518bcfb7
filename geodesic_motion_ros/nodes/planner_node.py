"""Node `planner`: hears goal, obstacles and joint states, and commands the arm a hundred times a second.

It sends `joint_trajectory`, or streams `target_pose` with `target_posture` (parameter `output`).

The control loop has a thread of its own on the steady clock. Callbacks only check and store
(`planner_inputs`), the loop plans and commands (`joint_cycle`), pictures are drawn by threads of
their own, and another one answers the service `plan`.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from nav_msgs.srv import GetPlan
from std_srvs.srv import SetBool, Trigger

from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.arrival import ArrivalWatch
from geodesic_motion_ros.nodes.background_service import BackgroundService
from geodesic_motion_ros.nodes.messages import FrameLookup, MessageRefused, path_message, read_pose
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.parameters import NodeParameters, Value
from geodesic_motion_ros.nodes.planner_inputs import PlannerInputs
from geodesic_motion_ros.nodes.planner_outputs import PlannerOutputs
from geodesic_motion_ros.nodes.running import STEADY, LoopingNode, run_node
from geodesic_motion_ros.nodes.skill_kinds import SkillKind, kind_of, of_robot, planner_settings
from geodesic_motion_ros.nodes.steady_loop import SteadyLoop
from geodesic_motion_ros.nodes.stream_cycle import CycleInputs, CycleOutput
from geodesic_motion_ros.nodes.view_thread import ViewThread
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError, PlanningError, RobotError, SkillError


class PlannerNode(LoopingNode):
    """The planner as a ROS 2 node.

    Raises
    ------
    ParameterError : a parameter does not exist or does not fit.
    SkillError : the skill is missing, damaged or of another robot.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("planner", **node_options)

    def _build(self) -> None:
        self.kind: SkillKind | None = None
        self._options = NodeParameters(self, PLANNER, self._check_parameters, self._parameters_changed)
        self.get_logger().info(f"loading the skill {self._options['skill']}")
        skill = Skill.load(self._options["skill"])
        try:
            self._options.stand_in(of_robot(skill, self._options.values))
            self.kind = kind_of(skill, self._options.values)
        except RobotError as error:
            raise SkillError(f"{self._options['skill']}: {error}") from error
        robot, prefix = self.kind.robot, self._options["joint_prefix"]
        if skill.tool_frame != robot.tool_link:
            raise SkillError(
                f"skill {skill.name} moves the frame {skill.tool_frame!r}, this node drives {robot.tool_link!r}"
            )
        if self._options["base_frame"] != prefix + skill.base_frame:
            self.get_logger().warning(
                f"base_frame {self._options['base_frame']!r} is taken for the skill's {skill.base_frame!r}"
            )
        robot = robot.prefixed(prefix)
        if self.kind.caution:
            self.get_logger().info(self.kind.caution)
        values = self._options
        self._name = skill.name
        self.cycle = self.kind.cycle
        self.cycle.state_topic = self.resolve_topic_name("joint_states")
        self.inputs = PlannerInputs(self, values, robot, skill.robot, self.kind.place, self._obstacles_changed)
        self.outputs = PlannerOutputs(
            self, values["base_frame"], skill.robot, self.kind.command_topic, self.kind.guarded, robot.joint_names,
            self.inputs.time,
        )
        self._said: dict[str, float] = {}
        self._remarked: set[str] = set()
        self._newest_plan = ""
        self._held: tuple[HeldObject, ...] = ()
        self._arrival = ArrivalWatch(self.kind)
        self._newest: tuple[CycleInputs, CycleOutput] | None = None
        self._period = 1.0 / values["rate"]
        self.loop = SteadyLoop(self._tick, values["rate"], self._died, name="planner")
        draws_path = "path and ~/markers", self._show_path, self._path_is_watched, values["path_rate"]
        self._pictures = [self._drawn(*draws_path)]
        self._make_view(skill)
        self._every(1.0, self._show_health, "/diagnostics")
        self._every(1.0, self._look_at_commands, "the search for other commanders")
        self._every(1.0, self.inputs.look_at_publishers, "the look at who publishes obstacles")
        # A plan takes longer than a joint state may be old.
        self._answering = (
            BackgroundService(self, GetPlan, "plan", self._on_plan),
            BackgroundService(self, SetBool, "~/hold", self._on_hold, at_once=True),
            BackgroundService(self, Trigger, "~/clear_obstacles", self._on_clear_obstacles, at_once=True),
        )

    def _introduction(self) -> str:
        goal = "goal_pose" if self.kind.robot.takes_poses else "goal_joints"
        states, goals = (self.resolve_topic_name(name) for name in ("joint_states", goal))
        return (
            f"ready: skill '{self._name}' of {self.kind.subject}, commands on {self.outputs.command_topic}; "
            f"waits for {states}, then for a goal on {goals}"
        )

    def start(self) -> None:
        """Begin to plan and command."""
        self.inputs.start()
        self.loop.start()
        for picture in self._pictures:
            picture.start()

    def stop(self) -> None:
        """End the threads; harmless when they have ended or never began."""
        self.loop.stop()
        self.inputs.stop()
        for picture in self._pictures:
            picture.stop()
        for service in self._answering:
            service.stop()
        self.kind.close()

    # ------------------------------------------------------------ control loop

    def _tick(self, periods: int) -> None:
        # The commanded pose moves on by one period, however many were missed: late is better than a jump.
        inputs = None if self._newest is None else self._newest[0]
        self.outputs.begin_cycle()
        try:
            inputs = self.inputs.snapshot()
            self.outputs.begin_cycle(inputs.now)
            output = self.cycle.run(inputs, self._period)
        except Exception as error:  # a fault in the planner must stop the arm, not the node
            self._log(error)
            verdict = Verdict(VerdictCode.BAD_INPUT, f"internal error, see the log: {error!r}")
            output = self.cycle.stop(verdict)
        self.kind.send(self.outputs, output)
        held = self.kind.held()
        figures = self.kind.margins() | ({} if inputs is None else inputs.figures)
        self.outputs.status(
            output, self.cycle.goal_number, self.inputs.refusals, self.loop, self._newest_plan, figures, held
        )
        if held != self._held:
            self._held = held
            self.get_logger().info(f"holding {', '.join(map(_held_text, held)) or 'nothing'}")
        if inputs is None:
            return
        previous, self._newest = self._newest, (inputs, output)
        if previous is None or previous[1].verdict.code is not output.verdict.code:
            self._say(output.verdict)
        if previous is not None and previous[1].goal_verdict is not output.goal_verdict:
            self._say_goal(output)
        if arrived := self._arrival.observe(inputs, output):
            self.get_logger().info(arrived)
        if previous is None or _path_news(previous, (inputs, output)):
            self._publish_path(output)

    def _log(self, error: Exception) -> None:
        self.get_logger().error("".join(traceback.format_exception(error)), throttle_duration_sec=1.0)

    def _obstacles_changed(self) -> None:
        if self.kind.may_be_early:
            self.loop.hurry()

    def _publish_path(self, output: CycleOutput) -> None:
        if self.outputs.path_is_watched:
            self.outputs.path(None if output.reference is None else self.kind.tool_poses(output.reference))

    def _say_goal(self, output: CycleOutput) -> None:
        if output.goal_refused:
            self._say(output.goal_verdict, "newest goal refused: ")
        elif output.goal_verdict.ok:
            self._say(output.goal_verdict, "newest goal accepted: ")

    def _say(self, verdict: Verdict, about: str = "") -> None:
        # The status has every change; the log has each kind of change at most once a second.
        now, kind = time.monotonic(), about + verdict.code.name
        if now - self._said.get(kind, -np.inf) < 1.0:
            return
        self._said[kind] = now
        if verdict.ok:
            self.get_logger().info(about + verdict.sentence)
        else:
            self.get_logger().warning(about + verdict.sentence)

    # ---------------------------------------------------------------- pictures

    def _every(self, period: float, work: Callable[[], None], name: str) -> None:
        """Do something every so many seconds; an error in it must not end the node."""

        def guarded() -> None:
            with self.inputs.refusals.guard(name):
                work()

        self.create_timer(period, guarded, clock=STEADY)

    def _drawn(self, name: str, draw: Callable[[], None], watched: Callable[[], bool], rate: float) -> ViewThread:
        """A thread that draws a picture while somebody looks.

        It takes milliseconds of the interpreter, an image tens of them: callbacks, which hear the time of a simulation,
        must not wait for that, and nothing is drawn for nobody.
        """

        def guarded() -> None:
            with self.inputs.refusals.guard(name):
                draw()

        def died(error: BaseException) -> None:
            self.get_logger().error(f"no more {name}: " + "".join(traceback.format_exception(error)))

        return ViewThread(guarded, watched, 1.0 / rate, died, name)

    def _make_view(self, skill: Skill) -> None:
        rate = self._options["latent_view_rate"]
        view = None if rate == 0.0 else self.kind.view(skill, self._options["latent_view_size"])
        if view is not None:
            self.view = view
            self._pictures.append(
                self._drawn("~/latent_view", self._show_view, lambda: self.outputs.view_is_watched, rate)
            )

    def _show_view(self) -> None:
        if self._newest is None:
            return
        inputs, output = self._newest
        path = None if output.reference is None else output.reference.latent
        obstacles = inputs.obstacles.moved_on(inputs.heard, 0.0, inputs.now)
        self.outputs.view(
            self.view.render(obstacles, path, output.verdict.code.name, output.verdict.displacement > 0.0)
        )

    def _path_is_watched(self) -> bool:
        return self.outputs.path_is_watched or self.outputs.markers_are_watched

    def _show_path(self) -> None:
        if self._newest is None:
            return
        inputs, output = self._newest
        if output.reference is not None:
            self._publish_path(output)
        if self.outputs.markers_are_watched:
            path = np.zeros((0, 3)) if output.reference is None else self.kind.tool_poses(output.reference)[0]
            is_detour = output.verdict.displacement > 0.0
            held, tool = (), TaskFrame.identity()
            if output.configuration is not None:
                held, tool = self.kind.held(), TaskFrame(*self.kind.robot.forward(output.configuration))
            body = self.kind.body(output)
            self.outputs.markers(path, is_detour, inputs.obstacles, self.kind.scene, body, held, tool)

    def _show_health(self) -> None:
        refusals, remarks = self.inputs.refusals, self.inputs.remarks()
        for kind in remarks.keys() - self._remarked:
            self.get_logger().warning(remarks[kind])
        self._remarked |= remarks.keys()
        self.outputs.diagnostics(
            self.loop.statistics(),
            self._options["rate"],
            self.inputs.ages(),
            refusals.counts,
            "; ".join(filter(None, (refusals.newest(1.0), *remarks.values()))),
            self.inputs.cloud_figures(),
            *self.inputs.take_obstacle_load(),
        )

    def _look_at_commands(self) -> None:
        self.inputs.set_nodes_on_commands(*self.outputs.look_for_nodes_on_commands())

    # ---------------------------------------------------------------- services

    def _on_plan(self, request: GetPlan.Request, response: GetPlan.Response) -> GetPlan.Response:
        frame, poses = self._options["base_frame"], None
        try:
            poses, verdict = self.kind.plan(
                *(_request_pose(request, end, frame, self.inputs.frames) for end in ("start", "goal"))
            )
        except MessageRefused as error:
            verdict = Verdict(VerdictCode.BAD_INPUT, str(error))
        self._newest_plan = verdict.sentence
        if poses is None:
            self.get_logger().warning(f"no plan: {verdict.sentence}")
        else:
            response.plan = path_message(*poses, frame, self.get_clock().now().to_msg())
        return response

    def _on_hold(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        def hold() -> str:
            self.inputs.request_hold(request.data)
            return "holding" if request.data else "released"

        return self.inputs.refusals.answered("~/hold", response, hold)

    def _on_clear_obstacles(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        def clear() -> str:
            return f"{self.inputs.clear_obstacles()} obstacles forgotten"

        return self.inputs.refusals.answered("~/clear_obstacles", response, clear)

    def _check_parameters(self, values: Mapping[str, Value]) -> None:
        _check_settings(values)
        for name, value in {} if self.kind is None else self.kind.fixed.items():
            if values[name] != value:
                method = values["method"]
                raise ParameterError(f"parameter {name} cannot change while the method is '{method}': start it anew")

    def _parameters_changed(self, values: Mapping[str, Value]) -> None:
        self.kind.update(values)


def _path_news(before: tuple[CycleInputs, CycleOutput], now: tuple[CycleInputs, CycleOutput]) -> bool:
    """Whether the path is of another goal than before, or has appeared or vanished."""
    had, has = before[1].reference is not None, now[1].reference is not None
    return had != has or before[0].goal_number != now[0].goal_number


def _held_text(held: HeldObject) -> str:
    count, out = len(held.spheres[1]), 1000.0 * held.protrusion
    return f"{held.name} ({held.shape}, covered by {count} spheres that stick out by up to {out:.0f} mm)"


def _request_pose(request: GetPlan.Request, end: str, frame: str, lookup: FrameLookup) -> tuple[np.ndarray, np.ndarray]:
    try:
        return read_pose(getattr(request, end), frame, lookup)
    except MessageRefused as error:
        raise MessageRefused(f"{end}: {error}") from error


def _check_settings(values: Mapping[str, Value]) -> None:
    if np.linalg.norm(values["task_frame"][3:]) < 1e-6:
        raise ParameterError("parameter task_frame ends with a zero quaternion: no rotation is 1.0, 0.0, 0.0, 0.0")
    if values["method"] == "paper" and not values["simulation_only"]:
        raise ParameterError(
            "parameter method = 'paper': it certifies nothing and may lead through obstacles; set simulation_only to "
            "true where no real arm hears the commands, or leave method at 'certified'"
        )
    try:
        planner_settings(values)
    except PlanningError as error:
        raise ParameterError(f"parameters do not go together: {error}") from error


def main(args: list[str] | None = None) -> int:
    """Run the planner until SIGINT or SIGTERM; returns the exit code."""
    return run_node("planner", PlannerNode, args)


if __name__ == "__main__":
    sys.exit(main())
