"""Plots for `doc/controller.md`: what is played of what the planner sends.

python doc/controller_plots.py    # into doc/controller/; prints the figures that the page states

Nothing is drawn by hand. The cycles of the planner node run in simulated time on a shipped skill. What they send is
played by the rules of joint_trajectory_controller (`TrajectoryPlayer`), by the commands that the driver of an FR3 makes
of it (`CommandStream`), and by the twin's arm, with motors in PyBullet (`ArmWorld`).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.hardware.command_stream import CommandStream
from geodesic_motion_ros.nodes.cycle import CycleInputs
from geodesic_motion_ros.nodes.parameter_tables import TABLES
from geodesic_motion_ros.nodes.planner_cycle import PlannerCycle
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory_player import Discontinuity, JointWaypoints, TrajectoryPlayer
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION

SKILL = "fr3_reach_to_grasp"
#: [s] from one cycle of the planner to the next; from one command of a controller to the next.
TICK, STEP = 0.01, 0.001
PLANNER, TWIN = ({each.name: each.default for each in TABLES[node]} for node in ("planner", "twin"))
#: A sphere of this radius [m] appears at this time [s] where the elbow would be at that one.
RADIUS, APPEARS, ELBOW_AT = 0.05, 1.2, 3.0
#: How long a late message takes [s].
LATE = 0.12
#: When the planner falls silent [s].
SILENT = 2.0


@dataclass(frozen=True)
class Message:
    """A trajectory that a cycle has sent, and when: its begin and takeover from the one before [s]."""

    sent: float
    begin: float
    takeover: float
    waypoints: JointWaypoints


@dataclass(frozen=True)
class Cycle:
    """What a cycle at a time [s] has commanded: the configuration (eta,), and a trajectory where there is a new one."""

    now: float
    configuration: np.ndarray
    message: Message | None


@dataclass(frozen=True)
class Request:
    """What is requested at a time [s]."""

    hold: bool = False
    speed_override: float = 1.0


@dataclass(frozen=True, eq=False)
class Motion:
    """Times (n,) [s], positions, velocities and, where they are known, accelerations (n, k, eta) of joints."""

    times: np.ndarray
    states: np.ndarray


class Planner:
    """The cycles of the planner node, with an arm that is where it is commanded, from time 0 on."""

    def __init__(self) -> None:
        self.skill = Skill.load(SKILL)
        self.planner = ReactivePlanner(self.skill, PlannerSettings())
        self.robot, self.start = self.planner.robot, self.skill.canonical.start_poles[0]
        self._goal = GoalRequest(configuration=self.skill.canonical.goal_poles[0])

    def run(
        self,
        until: float,
        sphere: np.ndarray | None = None,
        request: Callable[[float], Request] = lambda now: Request(),
        output: str = "joint_trajectory",
        transit: float = 0.0,
    ) -> list[Cycle]:
        """Run cycles; sphere : where one appears (3,) [m]. transit : how long messages of the arm take [s]."""
        planner, tracker, cycles = self.planner, ObstacleTracker(), []
        planner.clear_goal()
        planner.set_obstacles(np.zeros((0, 3)), np.zeros(0))
        planner.stand_at(self.start, 0.0)
        cycle = PlannerCycle(
            planner, PLANNER["state_timeout"], PLANNER["resume_timeout"], PLANNER["tracking_tolerance_joint"],
            PLANNER["horizon"], output, clock=lambda: 0.0,
        )  # fmt: skip
        measured = self.start
        for now in TICK * np.arange(round(until / TICK)):
            if sphere is not None and abs(now - APPEARS) < 0.5 * TICK:
                tracker.put("obstacles", ("", 1), sphere, RADIUS, now)
            requested = request(now)
            # as the node does where speed_override changes
            cycle.changes = {"speed_override": requested.speed_override or 1.0}
            cycle.paused = "" if requested.speed_override else "speed_override is 0"
            inputs = CycleInputs(
                measured, 0.0, self._goal, 1, tracker.current(now), hold=requested.hold, now=now, heard=now,
                drive=measured, simulated=True, transit=transit,
            )  # fmt: skip
            found, message = cycle.run(inputs, TICK), None
            if found.trajectory is not None:
                reference, begin = found.trajectory
                knots = reference.times, reference.positions, reference.velocities, reference.accelerations
                message = Message(now, begin, max(planner.takeover, begin), JointWaypoints(*knots))
            state = planner.commanded_state(now + TICK)
            cycles.append(Cycle(now, measured if found.configuration is None else found.configuration, message))
            measured = measured if state is None else state[0]
        return cycles


def messages(cycles: Sequence[Cycle]) -> list[tuple[float, Message]]:
    """The trajectories that were sent, with the times of their arrival [s]: at once."""
    return [(cycle.now, cycle.message) for cycle in cycles if cycle.message is not None]


def late_stop(cycles: Sequence[Cycle], late: float = LATE) -> list[tuple[float, Message]]:
    """What was sent until the sphere appeared, in time, and what was sent then, so late [s], with their arrivals."""
    found = [message for _, message in messages(cycles)]
    first = next(number for number, message in enumerate(found) if message.sent >= APPEARS - 0.5 * TICK)
    return [*((one.sent, one) for one in found[:first]), (found[first].sent + late, found[first])]


def controlled(
    start: np.ndarray, arrivals: Sequence[tuple[float, Message]], until: float, since: float = 0.0
) -> tuple[Motion, list[Discontinuity]]:
    """What joint_trajectory_controller plays of messages, and where that steps."""
    player, waiting, states, steps = TrajectoryPlayer(start, np.zeros(len(start))), list(arrivals), [], []
    times = np.arange(since, until, STEP)
    for now in times:
        while waiting and waiting[0][0] <= now:
            message = waiting.pop(0)[1]
            steps.append(player.replace(message.waypoints, message.begin, now))
        states.append(player.sample(now))
    return Motion(times, np.array(states)), [step for step in steps if step is not None]


def alone(message: Message, until: float) -> Motion:
    """What one trajectory leads to by itself, from its takeover on."""
    begin = message.begin
    return controlled(message.waypoints.positions[0], [(begin, message)], until, max(begin, message.takeover))[0]


def driven(planner: Planner, arrivals: Sequence[tuple[float, Message]], until: float) -> tuple[Motion, list[str]]:
    """What the driver of an FR3 commands, and why it refuses a trajectory."""
    robot = planner.robot
    stream = CommandStream(planner.start, JointLimits.of(robot), robot.joint_names)
    waiting, states, refused = list(arrivals), [], []
    times = np.arange(0.0, until, STEP)
    for now in times:
        while waiting and waiting[0][0] <= now:
            message = waiting.pop(0)[1]
            stream.receive(message.waypoints, message.begin, now)
        state, why = stream.command(now)
        states.append(state)
        refused += [why] if why else []
    return Motion(times, np.array(states)), refused


def simulated(
    planner: Planner, commands: Sequence[tuple[float, Callable[[ArmWorld], object]]], until: float
) -> tuple[Motion, Motion]:
    """What the twin's motors are commanded, and what is measured of its arm; commands come at their times [s]."""
    waiting, times, commanded, measured = list(commands), [], [], []
    with ArmWorld(rate_hz=TWIN["physics_rate"], robot=planner.skill.robot) as world:
        world.reset(planner.start)
        while world.time < until:
            while waiting and waiting[0][0] <= world.time:
                waiting.pop(0)[1](world)
            world.step()
            times.append(world.time)
            commanded.append((world.commanded_positions, world.commanded_velocities))
            measured.append((world.joint_positions, world.joint_velocities))
    return Motion(np.array(times), np.array(commanded)), Motion(np.array(times), np.array(measured))


def as_trajectories(arrivals: Sequence[tuple[float, Message]]) -> list[tuple[float, Callable[[ArmWorld], object]]]:
    """The twin's commands."""
    return [(time, partial(_follow, message=message)) for time, message in arrivals]


def _follow(world: ArmWorld, message: Message) -> None:
    world.set_joint_trajectory(message.waypoints, message.begin)


def as_poses(planner: Planner, cycles: Sequence[Cycle]) -> list[tuple[float, Callable[[ArmWorld], object]]]:
    """A stream of poses with their postures; `command_timeout` after its end the twin holds, as its node does."""
    stream = [(cycle.now, partial(_reach, pose=planner.robot.forward(cycle.configuration), posture=cycle.configuration))
              for cycle in cycles]  # fmt: skip
    return [*stream, (cycles[-1].now + TWIN["command_timeout"], ArmWorld.hold)]


def _reach(world: ArmWorld, pose: tuple[np.ndarray, np.ndarray], posture: np.ndarray) -> None:
    world.set_target_pose(*pose, posture)


# ------------------------------------------------------------------------------------------------------- the plots


def axes(rows: int, labels: Sequence[str], height: float = 1.6, same: bool = True) -> tuple[Figure, list[Axes]]:
    """A figure of panels above each other, with the labels of their ordinates; same : whether they show one time."""
    figure = Figure(figsize=(7.2, height * rows + 0.5), layout="constrained")
    panels = list(figure.subplots(rows, 1, sharex=same))
    for panel, label in zip(panels, labels, strict=True):
        panel.set_ylabel(label)
        panel.grid(alpha=0.25)
        panel.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("time [s]")
    return figure, panels


def mark(panels: Sequence[Axes], time: float, text: str, colour: str = GREY) -> None:
    """A time [s], named above the first panel."""
    for panel in panels:
        panel.axvline(time, color=colour, linewidth=0.9, linestyle=":")
    above = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    panels[0].annotate(text, (time, 1.0), (2, 3), fontsize=8, color=colour, **above)


def fastest(motion: Motion) -> int:
    """The joint that moves the fastest."""
    return int(np.argmax(np.max(np.abs(motion.states[:, 1]), axis=0)))


UNITS = ("position [rad]", "velocity [rad/s]", "acceleration [rad/s²]")


def draw_takeover(planner: Planner, avoiding: list[Cycle], out: Path) -> list[str]:
    """A trajectory that takes over in the middle of the one before."""
    arrivals = messages(avoiding)
    until = 5.0
    motion, steps = controlled(planner.start, arrivals, until)
    first = next(number for number, (time, _) in enumerate(arrivals) if time >= APPEARS - 0.5 * TICK)
    before, stop, path = (message for _, message in arrivals[first - 1 : first + 2])
    joint = fastest(Motion(motion.times, motion.states[motion.times > path.takeover]))
    figure, panels = axes(3, UNITS)
    names = ((before, BLUE, "sent before"), (stop, VERMILION, "a stop"), (path, GREEN, "another path"))
    for message, colour, name in names:
        each = alone(message, until)
        for order, panel in enumerate(panels):
            panel.plot(each.times, each.states[:, order, joint], color=colour, linestyle="--", label=name)
    for order, panel in enumerate(panels):
        panel.plot(motion.times, motion.states[:, order, joint], color="black", linewidth=1.8, label="played")
    mark(panels, stop.takeover, "1", VERMILION)
    mark(panels, path.takeover, "2", GREEN)
    panels[0].legend(fontsize=8, frameon=False)
    panels[0].set_xlim(1.0, until)
    figure.savefig(out / "takeover.png", dpi=100)
    worst = np.max(np.abs(np.diff(motion.states[:, 2], axis=0)))
    return [
        f"takeover: {planner.robot.joint_names[joint]}, sent {stop.sent:.2f} and {path.sent:.2f} s, take over at "
        f"{stop.takeover:.2f} and {path.takeover:.2f} s; {len(steps)} steps; acceleration changes by at most "
        f"{worst:.3f} rad/s^2 in a millisecond"
    ]


def draw_late(planner: Planner, avoiding: list[Cycle], expected: list[Cycle], out: Path) -> list[str]:
    """The stop of a trajectory that arrives late: unexpected, and expected."""
    until = 4.0
    late = late_stop(avoiding)
    in_time, _ = controlled(planner.start, late_stop(avoiding, 0.0), until)
    stepping, steps = controlled(planner.start, late, until)
    refusing, refused = driven(planner, late, until)
    commanded, _ = simulated(planner, as_trajectories(late), until)
    foreseen, none = controlled(planner.start, late_stop(expected), until)
    joint = fastest(in_time)
    figure, panels = axes(2, (UNITS[1], "the same, nearer"), 2.4, same=False)
    for panel in panels:
        for motion, colour, style, name in (
            (in_time, "black", "-", "in time"),
            (stepping, VERMILION, "-", f"{1e3 * LATE:.0f} ms late, joint_trajectory_controller: a step"),
            (commanded, ORANGE, "--", "the same, the twin's motors"),
            (refusing, BLUE, "-", "the same, the driver of an FR3: refused, rest at the end of the one before"),
            (foreseen, GREEN, "-", "as late, where the planner has measured that: a later takeover"),
        ):
            panel.plot(motion.times, motion.states[:, 1, joint], color=colour, linestyle=style, label=name)
        panel.axvline(APPEARS, color=GREY, linewidth=0.9, linestyle=":")
        panel.axvline(APPEARS + LATE, color=GREY, linewidth=0.9, linestyle=":")
    panels[0].set_xlim(1.0, until)
    panels[1].set_xlim(APPEARS - 0.05, APPEARS + 0.6)
    panels[1].set_ylim(*panels[0].get_ylim())
    panels[1].annotate("sent", (APPEARS, 0.2), fontsize=8, color=GREY)
    panels[1].annotate("heard", (APPEARS + LATE, 0.2), fontsize=8, color=GREY)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", fontsize=8, frameon=False)
    figure.savefig(out / "late.png", dpi=100)
    return [
        *(f"late: {planner.robot.joint_names[one.joint]} steps by {one.velocity:.3f} rad/s" for one in steps),
        f"late, expected: {len(none)} steps",
        *(f"late, driver: {why}" for why in refused),
    ]


def draw_silence(planner: Planner, free: list[Cycle], poses: list[Cycle], out: Path) -> list[str]:
    """The planner dies in motion."""
    until = SILENT + 3.5
    heard = [cycle for cycle in free if cycle.now < SILENT]
    motion, _ = controlled(planner.start, messages(heard), until)
    going_on, _ = controlled(planner.start, messages(free), until)
    stream = as_poses(planner, [cycle for cycle in poses if cycle.now < SILENT])
    _, stopped = simulated(planner, stream, until)
    joint = fastest(motion)
    figure, panels = axes(2, UNITS[:2], 1.9)
    for order, panel in enumerate(panels):
        for each, colour, style, name in (
            (going_on, GREY, "--", "without silence"),
            (motion, BLUE, "-", "joint_trajectory"),
            (stopped, VERMILION, "-", "target_pose, the twin's arm"),
        ):
            panel.plot(each.times, each.states[:, order, joint], color=colour, linestyle=style, label=name)
    mark(panels, SILENT, "last message")
    panels[1].legend(fontsize=8, frameon=False)
    panels[0].set_xlim(0.0, until)
    figure.savefig(out / "silence.png", dpi=100)

    def rest(each: Motion) -> float:
        return float(each.times[np.flatnonzero(np.max(np.abs(each.states[:, 1]), axis=1) > 1e-3)[-1]]) - SILENT

    return [f"silence: rest {rest(motion):.2f} s after the last message, of poses {rest(stopped):.2f} s"]


def draw_poses(planner: Planner, poses: list[Cycle], out: Path) -> list[str]:
    """A stream of poses, and the twin's arm."""
    until = poses[-1].now
    _, measured = simulated(planner, as_poses(planner, poses), until)
    times = np.array([cycle.now for cycle in poses])
    sent = np.array([planner.robot.forward(cycle.configuration)[0] for cycle in poses])
    tool = np.array([planner.robot.forward(state[0])[0] for state in measured.states])
    axis = int(np.argmax(np.ptp(sent, axis=0)))
    target = np.stack([np.interp(measured.times, times, sent[:, one]) for one in range(3)], axis=1)
    distance = 1e3 * np.linalg.norm(tool - target, axis=1)
    labels = f"tool, {'xyz'[axis]} [m]", "60 ms of it [m]", "distance [mm]"
    figure, (whole, near, error) = axes(3, labels, same=False)
    whole.plot(times, sent[:, axis], color=BLUE, linewidth=3.0, alpha=0.35, label="target_pose")
    whole.plot(measured.times, tool[:, axis], color="black", linewidth=1.2, label="measured tool")
    middle = times[int(np.argmax(np.linalg.norm(np.diff(sent, axis=0), axis=1)))]
    part, some = (np.abs(each - middle) < 0.03 for each in (times, measured.times))
    near.step(times[part], sent[part, axis], color=BLUE, where="post", alpha=0.6, marker="o", markersize=3)
    near.plot(measured.times[some], tool[some, axis], color="black", linewidth=1.2, marker=".", markersize=4)
    error.plot(measured.times, distance, color=VERMILION, linewidth=1.2)
    whole.legend(fontsize=8, frameon=False)
    figure.savefig(out / "target_pose.png", dpi=100)
    return [f"poses: the tool is at most {distance.max():.1f} mm from its target, at the end {distance[-1]:.2f} mm"]


def slower(now: float) -> Request:
    """Half of the speed, none, all of it, a hold, all of it."""
    if 2.0 <= now < 3.0:
        return Request(speed_override=0.5)
    if 3.0 <= now < 4.0:
        return Request(speed_override=0.0)
    return Request(hold=5.0 <= now < 6.0)


def draw_hold(planner: Planner, free: list[Cycle], held: list[Cycle], out: Path) -> list[str]:
    """speed_override and hold."""
    until = held[-1].now
    motion, steps = controlled(planner.start, messages(held), until)
    unhindered, _ = controlled(planner.start, messages(free), until)
    joint = fastest(unhindered)
    figure, panels = axes(2, UNITS[:2], 1.9)
    for order, panel in enumerate(panels):
        panel.plot(unhindered.times, unhindered.states[:, order, joint], color=GREY, linestyle="--", label="without")
        panel.plot(motion.times, motion.states[:, order, joint], color=BLUE, linewidth=1.6, label="played")
    for time, text in ((2.0, "override 0.5"), (3.0, "     0.0"), (4.0, "1.0"), (5.0, "hold"), (6.0, "released")):
        mark(panels, time, text)
    panels[0].legend(fontsize=8, frameon=False)
    panels[0].set_xlim(0.0, until)
    figure.savefig(out / "hold.png", dpi=100)
    path = np.array([planner.robot.forward(state[0])[0] for state in unhindered.states[::5]])
    tool = np.array([planner.robot.forward(state[0])[0] for state in motion.states[::50]])
    beside = 1e3 * np.max(np.min(np.linalg.norm(tool[:, None] - path[None], axis=2), axis=1))
    return [f"hold: {len(steps)} steps, the tool is at most {beside:.1f} mm beside the path without"]


def main() -> None:
    """Draw all of them."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "controller", help="doc/controller")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    planner = Planner()
    free = planner.run(9.0)
    at = free[round(ELBOW_AT / TICK)].configuration
    avoiding, expected = (planner.run(9.0, elbow_position(planner.robot, at), transit=late) for late in (0.0, LATE))
    poses = planner.run(9.0, output="target_pose")
    held = planner.run(9.0, request=slower)
    for line in (
        *draw_takeover(planner, avoiding, out), *draw_late(planner, avoiding, expected, out),
        *draw_silence(planner, free, poses, out), *draw_poses(planner, poses, out),
        *draw_hold(planner, free, held, out),
    ):  # fmt: skip
        print(line)


if __name__ == "__main__":
    main()
