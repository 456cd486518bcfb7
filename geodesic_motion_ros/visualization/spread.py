"""Picture of a skill's tube: demonstrations, the planner's motion and the decoder's spread, coordinate by coordinate.

All are drawn along their arcs as the training counts them: those of poses by `pose_arc_length`, those of configurations
by `body_arc`.
"""

from __future__ import annotations

import os

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from geodesic_motion_ros.demonstrations.canonical import body_arc
from geodesic_motion_ros.geometry.curves import pose_arc_length
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.kinematics import Robot, contiguous
from geodesic_motion_ros.skill.sheet import METRES_PER_RADIAN
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.visualization.joint_plots import FAMILY_COLOURS
from geodesic_motion_ros.visualization.plots import BLUE, demonstrations_of, legend_below, write_figure

#: Standard deviations of the decoder to either side of the motion.
DEVIATIONS = 2.0
_TOOL = ("x [cm]", "y [cm]", "z [cm]", "turn since the start [deg]")


def draw_spread(path: str | os.PathLike[str], skill: Skill, motion: JointReference) -> None:
    """A panel for each coordinate: of the tool, or the joints of a skill of configurations.

    Demonstrations are those that were learned from: without their start and goal offsets on the canonical sheet,
    decoded from their codes on the raw one.

    motion : the planner's between the mean start and the mean goal.
    """
    robot = Robot.named(skill.robot)
    names = tuple(f"{name} [deg]" for name in robot.joint_names) if skill.space == "joint" else _TOOL
    figure = Figure(figsize=(11.0, 1.9 * -(-len(names) // 2) + 0.7), layout="constrained")
    panels = figure.subplots(-(-len(names) // 2), 2, sharex=True, squeeze=False).ravel()
    modes = np.zeros(len(demonstrations_of(skill)), int) if skill.canonical is None else skill.canonical.modes
    for (share, values), mode in zip(_demonstrated(skill, robot), modes, strict=True):
        for axes, column in zip(panels, values.T, strict=False):
            axes.plot(100.0 * share, column, color=FAMILY_COLOURS[mode % len(FAMILY_COLOURS)], lw=0.8, alpha=0.8)
    share, values, spread = _planned(skill, robot, motion)
    for axes, column, deviation, name in zip(panels, values.T, DEVIATIONS * spread.T, names, strict=False):
        axes.fill_between(100.0 * share, column - deviation, column + deviation, color=BLUE, alpha=0.18, linewidth=0.0)
        axes.plot(100.0 * share, column, color=BLUE, linewidth=1.8)
        axes.set_ylabel(name, fontsize=9)
        axes.grid(alpha=0.3)
        axes.margins(x=0.0)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    for axes in panels[len(panels) - 2 : len(names)]:
        axes.set_xlabel("share of the arc [%]", fontsize=9)
    panels[len(names) - 2].tick_params(labelbottom=True)  # the last one of its column
    single = np.max(modes) == 0
    handles = [
        *(
            Line2D([], [], color=FAMILY_COLOURS[mode % len(FAMILY_COLOURS)], lw=0.9,
                   label="demonstrations" if single else f"demonstrations, family {mode}")
            for mode in np.unique(modes)
        ),
        Line2D([], [], color=BLUE, lw=1.8, label="the planner's motion along the geodesic"),
        Patch(color=BLUE, alpha=0.18, label=f"{DEVIATIONS:g} standard deviations of the decoder"),
    ]  # fmt: skip
    legend_below(figure, handles)
    write_figure(figure, path)


def _demonstrated(skill: Skill, robot: Robot) -> list[tuple[np.ndarray, np.ndarray]]:
    """Shares of the arc (S,) and coordinates (S, C) of every demonstration."""
    codes, sheet = demonstrations_of(skill), skill.canonical
    if skill.space == "joint":
        curves = [skill.decoder.configurations(code) for code in codes] if sheet is None else sheet.configurations
        return [(_share(body_arc(curve, robot, skill.metric)), np.degrees(curve)) for curve in curves]
    poses = [skill.decoder.poses(code) for code in codes]
    if sheet is not None:
        poses = list(zip(sheet.positions, sheet.quaternions, strict=True))
    return [_along(*pose) for pose in poses]


def _planned(skill: Skill, robot: Robot, motion: JointReference) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shares of the arc (n,), coordinates and the decoder's standard deviations (n, C) at the knots of a motion."""
    if skill.space == "joint":
        share = _share(body_arc(motion.positions, robot, skill.metric))
        return share, np.degrees(motion.positions), np.degrees(skill.decoder.uncertainty(motion.latent))
    share, values = _along(*end_effector_poses(contiguous(motion.positions), robot.chain))
    decoded = skill.decoder.decode(motion.latent)
    return share, values, np.column_stack([100.0 * decoded.sigma, np.degrees(decoded.spread)])


def _along(positions: np.ndarray, quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turned = np.degrees(angle_between(quaternions, quaternions[:1]))
    arc = pose_arc_length(positions, quaternions, METRES_PER_RADIAN)
    return _share(arc), np.column_stack([100.0 * positions, turned])


def _share(arc: np.ndarray) -> np.ndarray:
    """An arc (n,) as shares of its length; of something that stays where it is, of its samples."""
    return arc / arc[-1] if arc[-1] > 0.0 else np.linspace(0.0, 1.0, len(arc))
