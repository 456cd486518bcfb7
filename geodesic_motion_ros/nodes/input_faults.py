"""The reasons why the inputs of a cycle do not permit a motion, whatever plans it. Knows nothing of ROS."""

from __future__ import annotations

from dataclasses import dataclass

from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.nodes.cycle import CycleInputs

#: What is reported where a simulated clock is to be followed and there is none.
NO_CLOCK = "use_sim_time is set, and nothing has been received on /clock"
#: A simulated clock that has stood for so long, of real time [s], is one that nobody drives.
CLOCK_STANDS = 1.0


@dataclass(frozen=True)
class Halt:
    """A refusal to plan in a cycle, and why the goal is dropped besides; "" where it stays."""

    refusal: Refusal
    dropping: str = ""


def stale_state(
    inputs: CycleInputs, state_topic: str, state_timeout: float, resume_timeout: float
) -> Halt | None:
    """Return why it is not known where the arm is; None where it is known.

    state_topic : as messages name it. A joint state older than `state_timeout` [s] stops the arm;
    after `resume_timeout` [s] the goal is dropped.
    """
    if not inputs.has_clock:
        return Halt(Refusal(VerdictCode.STALE_STATE, NO_CLOCK))
    if inputs.clock_stood > CLOCK_STANDS:
        reason = f"/clock has stood for more than {CLOCK_STANDS:g} s: the simulation is paused, or has ended; start it"
        return Halt(Refusal(VerdictCode.STALE_STATE, reason))
    fault = inputs.state_fault
    if inputs.measured is None:
        return Halt(Refusal(VerdictCode.STALE_STATE, f"{state_topic}: {fault or 'none has arrived yet'}"))
    if inputs.state_age <= state_timeout:
        return None
    missing = f"joint_states were missing for more than {resume_timeout:g} s"
    reason = f"{state_topic}: the newest state is older than state_timeout, {state_timeout:g} s"
    refusal = Refusal(VerdictCode.STALE_STATE, f"{reason}; {fault}" if fault else reason)
    return Halt(refusal, missing if inputs.state_age > resume_timeout else "")


def rivals(inputs: CycleInputs, command_topic: str) -> Halt | None:
    """Refuse more than one node that commands the arm: which of them it followed would be chance, and drops the goal.
    """
    if len(inputs.publishers) <= 1:
        return None
    names = " and ".join(inputs.publishers)
    refusal = Refusal(VerdictCode.CONFLICT, f"{command_topic} is published by {names}: only one may command the arm")
    return Halt(refusal, f"{command_topic} had more than one publisher, {names}")


def readiness(inputs: CycleInputs, command_topic: str, uncounted: str, without_goal: Refusal | None) -> Verdict:
    """Return OK when a plan may be requested of an arm that is known and nobody else's; else the refusal, the gravest
    first.

    uncounted : which objects in the hand do not count yet; "" where all do. without_goal : why there is no goal; None
    where there is one.
    """
    if inputs.hold:
        return Refusal(VerdictCode.HOLD_REQUESTED, "a hold was requested; release it with ~/hold false")
    if inputs.other_arm:
        return Refusal(VerdictCode.BAD_INPUT, inputs.other_arm)
    if inputs.held_refused:
        reason = f"it is not known what the hand holds: {inputs.held_refused}; send what it holds on ~/held_objects"
        return Refusal(VerdictCode.BAD_INPUT, reason)
    if uncounted:
        return Refusal(VerdictCode.BAD_INPUT, uncounted)
    stale = _stale_obstacles(inputs)
    if stale:
        return Refusal(VerdictCode.STALE_OBSTACLES, stale)
    if without_goal is not None:
        return without_goal
    if inputs.subscribers == ():
        reason = f"no node receives {command_topic}: start the controller of the arm, or remap the topic"
        return Refusal(VerdictCode.BAD_INPUT, reason)
    return Verdict()


def _stale_obstacles(inputs: CycleInputs) -> str:
    """Which obstacle topics are not to be trusted, why, and what would be right; '' when all are."""
    causes = [f"{source}: {why}" for source, why in inputs.unusable_sources.items()]
    if inputs.silent_sources:
        silent = ", ".join(inputs.silent_sources)
        causes.append(
            f"silent: {silent}; publish it again and again, or latched by a node that stays, or declare it in the "
            "scene; call ~/clear_obstacles where nothing is there any more"
        )
    if inputs.late_sources:
        late = ", ".join(inputs.late_sources)
        causes.append(f"stamps lag: {late}; synchronise the clocks, or detect faster")
    return "; ".join(causes)
