"""The face of a node that plans, which hears, shows and answers, whatever plans in it.

The control loop has a thread of its own on the steady clock. Callbacks only check and store (`planner_inputs`),
pictures are drawn by threads of their own, and another one answers the service `plan`.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from nav_msgs.srv import GetPlan
from std_srvs.srv import SetBool, Trigger

from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.nodes.arrival import ArrivalWatch
from geodesic_motion_ros.nodes.background_service import BackgroundService
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput, PoseArrays
from geodesic_motion_ros.nodes.messages import FrameLookup, MessageRefused, path_message, read_pose
from geodesic_motion_ros.nodes.parameters import NodeParameters
from geodesic_motion_ros.nodes.planner_inputs import PlannerInputs
from geodesic_motion_ros.nodes.planner_outputs import PlannerOutputs
from geodesic_motion_ros.nodes.running import STEADY, LoopingNode
from geodesic_motion_ros.nodes.steady_loop import SteadyLoop
from geodesic_motion_ros.nodes.trajectory_action import TrajectoryGoals
from geodesic_motion_ros.nodes.view_thread import ViewThread
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.visualization.latent_view import LatentPicture


@dataclass(frozen=True)
class Subject:
    """What a node plans with, as it tells a person.

    Attributes
    ----------
    name : "skill 'panda_pouring'", or what there is in its place. robot : the name of the arm, or its folder.
    awaited : on which topic it waits for what. inputs : what hears it. end : where the arm then comes to rest.
    """

    name: str
    robot: str
    awaited: Mapping[str, str]
    inputs: type[PlannerInputs] = PlannerInputs
    end: str = "the goal"

    @classmethod
    def of_skill(cls, skill: Skill, robot: Robot) -> Subject:
        """Return a skill, whose goals are poses or configurations."""
        topic = "goal_pose" if robot.takes_poses else "goal_joints"
        return cls(f"skill '{skill.name}'", skill.robot, {topic: "a goal"})


class PlannerFace:
    """Inputs, outputs, loop, pictures and services of a node whose cycles command an arm.

    Attributes
    ----------
    inputs, outputs : what the node hears and says.
    loop : calls the tick as often as the parameter `rate` says.
    view : draws the latent space; None where it is not drawn.
    """

    def __init__(
        self,
        node: LoopingNode,
        options: NodeParameters,
        subject: Subject,
        robot: Robot,
        command_topic: str,
        guarded: str,
        tick: Callable[[int], None],
        died: Callable[[BaseException], None],
        tool_poses: Callable[[object], PoseArrays],
        plan: Callable[[PoseArrays, PoseArrays], tuple[PoseArrays | None, Verdict]] | None,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        """subject : what is planned with. command_topic, guarded : as of `PlannerOutputs`.

        tick : one cycle of the loop, so many periods after the one before. died : what is to be done when an
        exception has ended the loop.
        tool_poses : of a reference: positions (n, 3) [m] and quaternions (n, 4).
        plan : tool poses of a path between two poses under the present obstacles, and the verdict; None: that is no
            service of the node.
        changed : called when something new is known of obstacles, or is offered, from the thread that heard it.
        """
        self._node, self._options, self._tool_poses, self._plan = node, options, tool_poses, plan
        robot = robot.prefixed(options["joint_prefix"])
        armed = options.values.get("armed", True)
        self.inputs = subject.inputs(node, options, robot, subject.robot, changed, armed)
        action = options.values.get("trajectory_action", "")
        self._trajectory_goals = TrajectoryGoals(node, action, self.inputs.refusals) if action else None
        self.outputs = PlannerOutputs(
            node, options["base_frame"], subject.robot, command_topic, guarded, robot.joint_names,
            self.inputs.listener.time, subject.inputs.noun, self._trajectory_goals,
        )  # fmt: skip
        self._log = node.get_logger()
        self._said: dict[str, float] = {}
        self._remarked: set[str] = set()
        self._newest_plan = ""
        self._held: tuple[HeldObject, ...] = ()
        self._arrival = ArrivalWatch(robot.forward, tool_poses, subject.end)
        self._newest: tuple[CycleInputs, CycleOutput] | None = None
        self._period = 1.0 / options["rate"]
        self.loop = SteadyLoop(tick, options["rate"], died, name="planner")
        self._pictures: list[ViewThread] = []
        self.view: LatentPicture | None = None
        self._every(1.0, self._show_health, "/diagnostics")
        self._every(1.0, self._look_at_commands, "the search for other commanders")
        self._every(1.0, self.inputs.obstacles.look_at_publishers, "the look at who publishes obstacles")
        # A plan takes longer than a joint state may be old.
        self._answering: tuple[BackgroundService, ...] = (
            BackgroundService(node, SetBool, "~/hold", self._on_hold, at_once=True),
            BackgroundService(node, Trigger, "~/clear_obstacles", self._on_clear_obstacles, at_once=True),
        )
        if "armed" in options.values:
            self._answering += (BackgroundService(node, SetBool, "~/arm", self._on_arm, at_once=True),)
        if plan is not None:
            self._answering += (BackgroundService(node, GetPlan, "plan", self._on_plan),)
        self._subject = subject

    def introduction(self, moved: str) -> str:
        """Return what the node is ready for, what it publishes and what it waits for. moved : for a person."""
        resolved, unarmed = self._node.resolve_topic_name, self.inputs.arming.unarmed
        awaited = " or ".join(f"{what} on {resolved(topic)}" for topic, what in self._subject.awaited.items())
        return (
            f"ready: {self._subject.name} of {moved}, commands on {self.outputs.command_topic}; "
            f"waits for {resolved('joint_states')}, then for {awaited}" + (f"; {unarmed}" if unarmed else "")
        )

    def start(self) -> None:
        """Begin to plan and command."""
        self.inputs.start()
        if self._trajectory_goals is not None:
            self._trajectory_goals.start()
        self.loop.start()
        for picture in self._pictures:
            picture.start()

    def stop(self) -> None:
        """End the threads; harmless when they have ended or never began."""
        self.loop.stop()
        self.inputs.stop()
        if self._trajectory_goals is not None:
            self._trajectory_goals.stop()
        for picture in self._pictures:
            picture.stop()
        for service in self._answering:
            service.stop()

    @property
    def is_at_rest(self) -> bool:
        """Whether the newest cycle neither moves the arm nor is about to; true before the first."""
        return self._newest is None or (not self._newest[1].verdict.ok and self._newest[1].speed == 0.0)

    @property
    def newest(self) -> tuple[CycleInputs, CycleOutput] | None:
        """The newest cycle; None before the first."""
        return self._newest

    # ------------------------------------------------------------ control loop

    def cycle(
        self, run: Callable[[CycleInputs, float], CycleOutput], stop: Callable[[Refusal], CycleOutput]
    ) -> tuple[CycleInputs | None, CycleOutput]:
        """Run a cycle on what is known now; returns both, None where nothing was ever known.

        run : the cycle, of a period [s]: what is commanded moves on by one, however many were missed: late is better
        than a jump. stop : ends one that failed.
        """
        inputs = None if self._newest is None else self._newest[0]
        self.outputs.begin_cycle()
        try:
            inputs = self.inputs.snapshot()
            self.outputs.begin_cycle(inputs.now)
            return inputs, run(inputs, self._period)
        except Exception as error:  # a fault in the planner must stop the arm, not the node
            self._log.error("".join(traceback.format_exception(error)), throttle_duration_sec=1.0)
            return inputs, stop(Refusal(VerdictCode.BAD_INPUT, f"internal error, see the log: {error!r}"))

    def tell(
        self,
        inputs: CycleInputs | None,
        output: CycleOutput,
        goal_number: int,
        margins: Mapping[str, float | str],
        held: tuple[HeldObject, ...],
    ) -> None:
        """Publish what became of a cycle, and log what is new in it.

        goal_number : of the newest goal. margins : what the certificate counts, and what is said beside it, by name.
        held : the objects in the hand that are counted.
        """
        figures = {**margins, **({} if inputs is None else inputs.figures)}
        self.outputs.publish_status(
            output, goal_number, self.inputs.refusals, self.loop, self._newest_plan, figures, held
        )
        if held != self._held:
            self._held = held
            self._log.info(f"holding {', '.join(map(_held_text, held)) or 'nothing'}")
        if inputs is None:
            return
        previous, self._newest = self._newest, (inputs, output)
        if previous is None or previous[1].verdict.code is not output.verdict.code:
            ended = "" if previous is None or not output.verdict.ok else f"no longer {previous[1].verdict.code.name}: "
            self._say(output.verdict, ended)
        if previous is not None and previous[1].goal_verdict is not output.goal_verdict:
            self._say_goal(output, previous[1].goal_verdict)
        if output.disarms:
            self._disarm(output.disarms)
        if output.news:
            self._log.info(output.news)
        if arrived := self._arrival.observe(inputs, output):
            self._log.info(arrived)
        if previous is None or _path_news(previous, (inputs, output)):
            self._publish_path(output)

    def _publish_path(self, output: CycleOutput) -> None:
        if self.outputs.is_path_watched:
            self.outputs.publish_path(None if output.reference is None else self._tool_poses(output.reference))

    def _say_goal(self, output: CycleOutput, before: Verdict) -> None:
        if output.is_goal_refused:
            self._say(output.goal_verdict, f"newest {self.inputs.noun} refused: ")
        elif output.goal_verdict.ok and not before.ok:  # of a stream of them the first is enough
            self._say(output.goal_verdict, f"newest {self.inputs.noun} accepted: ")

    def _say(self, verdict: Verdict, about: str = "") -> None:
        # The status has every change; the log has each kind of change at most once a second.
        now, kind = time.monotonic(), about + verdict.code.name
        if now - self._said.get(kind, -np.inf) < 1.0:
            return
        self._said[kind] = now
        if verdict.ok:
            self._log.info(about + verdict.sentence)
        else:
            self._log.warning(about + verdict.sentence)

    # ---------------------------------------------------------------- pictures

    def draw_path(self, draw_markers: Callable[[CycleInputs, CycleOutput, np.ndarray], None]) -> None:
        """Publish the path again and again while somebody looks, and have the markers drawn, of tool positions (n, 3)
        [m].
        """

        def is_watched() -> bool:
            return self.outputs.is_path_watched or self.outputs.are_markers_watched

        def draw(inputs: CycleInputs, output: CycleOutput) -> None:
            if output.reference is not None:
                self._publish_path(output)
            if self.outputs.are_markers_watched:
                path = np.zeros((0, 3)) if output.reference is None else self._tool_poses(output.reference)[0]
                draw_markers(inputs, output, path)

        self._draw("path and ~/markers", draw, is_watched, self._options["path_rate"])

    def draw_latent(self, make: Callable[[int], LatentPicture | None]) -> None:
        """Publish a picture of the latent space while somebody looks, where there is one.

        make : makes what draws it, so many pixels wide; None where it cannot be drawn.
        """
        rate = self._options["latent_view_rate"]
        view = self.view = None if rate == 0.0 else make(self._options["latent_view_size"])
        if view is None:
            return

        def draw(inputs: CycleInputs, output: CycleOutput) -> None:
            path = None if output.reference is None else output.reference.latent
            obstacles = inputs.obstacles.moved_on(inputs.heard, 0.0, inputs.now)
            verdict = output.verdict
            is_detour = verdict.figures.displacement > 0.0
            self.outputs.publish_view(view.render(obstacles, path, verdict.code.name, is_detour))

        self._draw("~/latent_view", draw, lambda: self.outputs.is_view_watched, rate)

    def _draw(
        self, name: str, draw: Callable[[CycleInputs, CycleOutput], None], watched: Callable[[], bool], rate: float
    ) -> None:
        """Have a thread draw a picture of the newest cycle while somebody looks.

        It takes milliseconds of the interpreter, an image tens of them: callbacks, which hear the time of a simulation,
        must not wait for that, and nothing is drawn for nobody.
        """

        def guarded() -> None:
            if self._newest is not None:
                with self.inputs.refusals.guard(name):
                    draw(*self._newest)

        def died(error: BaseException) -> None:
            self._log.error(f"no more {name}: " + "".join(traceback.format_exception(error)))

        self._pictures.append(ViewThread(guarded, watched, 1.0 / rate, died, name))

    def _every(self, period: float, work: Callable[[], None], name: str) -> None:
        """Do something every so many seconds; an error in it must not end the node."""

        def guarded() -> None:
            with self.inputs.refusals.guard(name):
                work()

        self._node.create_timer(period, guarded, clock=STEADY)

    def _show_health(self) -> None:
        refusals, remarks = self.inputs.refusals, self.inputs.remarks()
        for kind in remarks.keys() - self._remarked:
            self._log.warning(remarks[kind])
        self._remarked |= remarks.keys()
        self.outputs.publish_diagnostics(
            self.loop.statistics(),
            self._options["rate"],
            self.inputs.ages(),
            refusals.counts,
            "; ".join(filter(None, (refusals.newest(1.0), *remarks.values()))),
            self.inputs.obstacles.clouds.figures,
            *self.inputs.obstacles.take_load(),
        )

    def _look_at_commands(self) -> None:
        self.inputs.set_nodes_on_commands(*self.outputs.look_for_nodes_on_commands())

    # ---------------------------------------------------------------- services

    def _on_plan(self, request: GetPlan.Request, response: GetPlan.Response) -> GetPlan.Response:
        frame, poses = self._options["base_frame"], None
        assert self._plan is not None
        try:
            poses, verdict = self._plan(
                *(_request_pose(request, end, frame, self.inputs.listener.frames) for end in ("start", "goal"))
            )
        except MessageRefused as error:
            verdict = Refusal(VerdictCode.BAD_INPUT, str(error))
        self._newest_plan = verdict.sentence
        if poses is None:
            self._log.warning(f"no plan: {verdict.sentence}")
        else:
            response.plan = path_message(*poses, frame, self._node.get_clock().now().to_msg())
        return response

    def _on_hold(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        def hold() -> str:
            self.inputs.request_hold(request.data)
            return "holding" if request.data else "released"

        return self.inputs.refusals.answer("~/hold", response, hold)

    def _on_clear_obstacles(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        def clear() -> str:
            # First: what stopped for them must not set out.
            disarmed = self._disarm("~/clear_obstacles was called")
            return f"{self.inputs.obstacles.clear()} obstacles forgotten" + ("; disarmed" if disarmed else "")

        return self.inputs.refusals.answer("~/clear_obstacles", response, clear)

    def _on_arm(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        def arm() -> str:
            if not request.data:
                was_armed = self._disarm("~/arm was called with false", by_itself=False)
                return "disarmed: the arm brakes, and is commanded nothing then" if was_armed else "not armed"
            try:
                said = self.inputs.arming.arm()
            except ParameterError as error:
                raise MessageRefused(str(error)) from error
            self._log.info(said)
            return said

        return self.inputs.refusals.answer("~/arm", response, arm)

    def _disarm(self, why: str, by_itself: bool = True) -> bool:
        was_armed = self.inputs.arming.disarm(why, by_itself)
        if was_armed:
            self._log.warning(self.inputs.arming.unarmed)
        return was_armed


def _path_news(before: tuple[CycleInputs, CycleOutput], now: tuple[CycleInputs, CycleOutput]) -> bool:
    """Whether the path is of another goal than before, or has appeared or vanished."""
    had, has = before[1].reference is not None, now[1].reference is not None
    return had != has or before[0].goal_number != now[0].goal_number


def _held_text(held: HeldObject) -> str:
    count, out = len(held.spheres[1]), 1000.0 * held.protrusion
    return f"{held.name} ({held.shape}, covered by {count} spheres that stick out by up to {out:.0f} mm)"


def _request_pose(request: GetPlan.Request, end: str, frame: str, lookup: FrameLookup) -> PoseArrays:
    try:
        return read_pose(getattr(request, end), frame, lookup)
    except MessageRefused as error:
        raise MessageRefused(f"{end}: {error}") from error
