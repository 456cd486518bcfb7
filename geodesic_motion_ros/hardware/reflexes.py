"""Why a Franka stopped itself, in plain words, and what to do: by the names of libfranka's errors."""

from __future__ import annotations

from collections.abc import Sequence

#: What a network and a machine that are good enough reach of commands that are in time.
ENOUGH = 0.98

_LIMITS = "lower speed_scale or acceleration_scale of what commands it"
_STEP = "nothing but this driver may command the arm: look who else does; else report it, with the log"
_CONTACT = "free the arm and look what it touched, look at the load that is set in Desk"

#: For each error what happened, and what to do before `~/recover`.
REFLEXES: dict[str, tuple[str, str]] = {
    "joint_position_limits_violation": ("a joint is beyond its range", "move it back in guiding mode"),
    "cartesian_position_limits_violation": ("the hand left the space that Desk allows", "move it back in guiding mode"),
    "self_collision_avoidance_violation": ("the arm came too near to itself", "move it apart in guiding mode"),
    "joint_velocity_violation": ("a joint was faster than it may be", _LIMITS),
    "cartesian_velocity_violation": ("the hand was faster than it may be", _LIMITS),
    "force_control_safety_violation": ("a limit of force control was left", _CONTACT),
    "joint_reflex": ("a joint felt a torque from outside, as of a collision", _CONTACT),
    "cartesian_reflex": ("the arm felt a force from outside, as of a collision", _CONTACT),
    "max_goal_pose_deviation_violation": ("the arm is far from where it should be at the end", _CONTACT),
    "max_path_pose_deviation_violation": ("the arm is far from its path", _CONTACT),
    "cartesian_velocity_profile_safety_violation": ("the hand was faster than the safety settings allow", _LIMITS),
    "joint_position_motion_generator_start_pose_invalid": ("the first command was not where the arm stood", _STEP),
    "joint_motion_generator_position_limits_violation": ("a command was beyond the range of a joint", _STEP),
    "joint_motion_generator_velocity_limits_violation": ("a command was too fast for a joint where it is", _LIMITS),
    "joint_motion_generator_velocity_discontinuity": ("a command stepped: its acceleration was over the limit", _STEP),
    "joint_motion_generator_acceleration_discontinuity": ("the acceleration of commands stepped over the limit", _STEP),
    "controller_torque_discontinuity": ("the torques of the arm's controller stepped", _CONTACT),
    "communication_constraints_violation": (
        "20 commands in a row did not arrive within a millisecond each",
        "connect the arm by a cable of its own, use a kernel with PREEMPT_RT, and let nothing else have the processor",
    ),
    "power_limit_violation": ("the arm would have taken too much power", _LIMITS),
    "tau_j_range_violation": ("a joint would have needed more torque than it has", "lower the load or the speed"),
    "instability_detected": ("the arm swings", "look at the load that is set in Desk, and at what the arm stands on"),
    "joint_move_in_wrong_direction": ("a joint beyond its range was moved further out", "move it back in guiding mode"),
}
_UNKNOWN = "libfranka's name for it is all there is", "look it up in the manual of the arm"


def explained(names: Sequence[str]) -> str:
    """Say in a sentence what libfranka's errors mean, and what to do."""
    if not names:
        return "the arm stopped itself and does not say why: look at its Desk"
    return "; ".join(
        f"{name}: {what}; {remedy}" for name, (what, remedy) in ((name, REFLEXES.get(name, _UNKNOWN)) for name in names)
    )


def late_commands(success: float) -> str:
    """Say what it means where too many commands were late before a reflex, else nothing; success : share of the last
    100 that reached the arm in time.
    """
    if success >= ENOUGH:
        return ""
    return (
        f"; before that {100.0 * (1.0 - success):.0f} of 100 commands did not reach it in time, and to an arm that "
        "goes on by itself meanwhile the next one is a step: look at the network, and at what keeps this machine busy"
    )


def errors_of(errors: object) -> list[str]:
    """Names of those of libfranka's errors that are set."""
    return [name for name in dir(errors) if not name.startswith("_") and getattr(errors, name) is True]
