"""The rows of the comparison by their names, and what each of them needs to be installed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING

from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.method import Method

if TYPE_CHECKING:
    from geodesic_motion_ros.filtering.motion_filter import Recovery
    from geodesic_motion_studies.comparison.methods.detoured_base import BaseName
    from geodesic_motion_studies.comparison.methods.geodesic import Part


@dataclass(frozen=True)
class Row:
    """One method of the comparison: one row of its tables, and how the method is made.

    Attributes
    ----------
    make : makes the method in an arena, and imports the modules that it needs.
    description : the method in a line. needs : modules that must be installed.
    by_name : whether it is played only where it, or its study, is named.
    """

    make: Callable[[Arena], Method]
    description: str
    needs: tuple[str, ...] = ()
    by_name: bool = False

    @property
    def missing(self) -> str:
        """The first module that is needed and not installed, or ''."""
        return next((name for name in self.needs if find_spec(name) is None), "")


_PRIMITIVES = ("movement_primitives", "pytransform3d")


def _geodesics(arena: Arena, part: Part) -> Method:
    from geodesic_motion_studies.comparison.methods.geodesic import Geodesics

    return Geodesics(arena, part)


def _paper(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.papers_planner import PapersPlanner

    return PapersPlanner(arena)


def _replay(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.replay import Replay

    return Replay(arena)


def _free_demonstration(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.free_demonstration import FreeDemonstration

    return FreeDemonstration(arena)


def _detoured(arena: Arena, base: BaseName) -> Method:
    from geodesic_motion_studies.comparison.methods.detoured_base import DetouredBase

    return DetouredBase(arena, base)


def _dmp(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.dmp import DynamicPrimitive

    return DynamicPrimitive(arena)


def _promp(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.promp import Primitives

    return Primitives(arena)


def _rrt_connect(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.rrt_connect import RapidTrees

    return RapidTrees(arena)


def _barriers(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.barriers import BarrierKinematics

    return BarrierKinematics(arena)


def _policy(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.policy import PolicyAlone

    return PolicyAlone(arena)


def _filtered_policy(arena: Arena, recover: Recovery, braking: bool = False) -> Method:
    from geodesic_motion_studies.comparison.methods.filtered import Braking, FilteredPolicy

    return FilteredPolicy(arena, recover, Braking) if braking else FilteredPolicy(arena, recover)


def _policy_among_barriers(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.barriers import PolicyAmongBarriers

    return PolicyAmongBarriers(arena)


def _plans(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.rapid_plans import PlanFollower

    return PlanFollower(arena)


def _filtered_plans(arena: Arena) -> Method:
    from geodesic_motion_studies.comparison.methods.filtered import FilteredPlans

    return FilteredPlans(arena)


_BARRIERS = ("pinocchio", "pink", "daqp")

ROWS: dict[str, Row] = {
    "ours": Row(
        partial(_geodesics, part="whole"),
        "geodesics of the learned metric, hard and soft, left by a detour where obstacles block all of them",
    ),
    "ours, detour 0": Row(partial(_geodesics, part="demonstrated"), "the same without detours: it waits there"),
    "ours, hard": Row(
        partial(_geodesics, part="hard"), "ours, detour 0, without the soft metric: nodes removed, references certified"
    ),
    "ours, soft": Row(
        partial(_geodesics, part="soft"),
        "the soft metric alone: ours without the hard part, nothing removed or certified; not the paper's planner",
    ),
    "paper": Row(_paper, "the paper's planner with the paper's model of the same task, its ends moved", by_name=True),
    "replay": Row(_replay, "the nearest demonstration, blind: the control"),
    "free demonstration": Row(
        _free_demonstration, "the nearest demonstration that is free, another one joined where it is blocked"
    ),
    "mean demonstration + detour": Row(
        partial(_detoured, base="mean demonstration"),
        "the mean of the nearest demonstration's mode, left by our detour where it is blocked",
    ),
    "ProMP + detour": Row(
        partial(_detoured, base="ProMP"), "the mean of a conditioned ProMP, left likewise", _PRIMITIVES
    ),
    "nearest demonstration + detour": Row(
        partial(_detoured, base="nearest demonstration"), "the nearest demonstration, left likewise"
    ),
    "DMP": Row(_dmp, "its dynamic movement primitive with a coupling term for obstacles", _PRIMITIVES),
    "ProMP": Row(_promp, "probabilistic movement primitives, sampled for a free motion", _PRIMITIVES),
    "RRT-Connect": Row(_rrt_connect, "sampling-based, planned again where the path is blocked, smoothed", ("ompl",)),
    "barriers": Row(
        _barriers, "differential inverse kinematics along the nearest demonstration, with control barriers", _BARRIERS
    ),
    "policy": Row(
        _policy, "chunks of a policy cloned from the demonstrations, which knows of no obstacles", ("torch",), True
    ),
    "policy + filter": Row(
        partial(_filtered_policy, recover="wait"), "its chunks through the motion filter, which waits", ("torch",), True
    ),
    "policy + filter + detour": Row(
        partial(_filtered_policy, recover="detour"), "the same with a filter that passes around", ("torch",), True
    ),
    "policy + braking": Row(
        partial(_filtered_policy, recover="wait", braking=True),
        "the same with braking alone: a stop at once where a chunk is not free", ("torch",), True,
    ),
    "policy + barriers": Row(
        _policy_among_barriers, "its chunks followed among control barriers", ("torch", *_BARRIERS), True
    ),
    "RRT-Connect, 10 Hz": Row(
        _plans, "plans of roboplan, looked at ten times a second, and made anew where blocked", ("roboplan",), True
    ),
    "RRT-Connect + filter": Row(
        _filtered_plans, "the same plans through the motion filter, which waits", ("roboplan",), True
    ),
}
#: Rows by the name of what they are played for together.
STUDIES = {
    "filter": (
        "policy", "policy + filter", "policy + filter + detour", "policy + braking", "policy + barriers",
        "RRT-Connect, 10 Hz", "RRT-Connect + filter",
    ),
}  # fmt: skip


def chosen(names: tuple[str, ...] | None) -> tuple[str, ...]:
    """Rows by their names, or those of a study; without any all whose libraries are installed, but those that are
    played by name only.

    Raises
    ------
    ParameterError : there is no such row. GeodesicMotionError : a row that was asked for lacks a library.
    """
    if names is None:
        return tuple(name for name, row in ROWS.items() if not row.missing and not row.by_name)
    names = tuple(dict.fromkeys(row for name in names for row in STUDIES.get(name, (name,))))
    for name in names:
        if name not in ROWS:
            raise ParameterError(f"there is no method '{name}': choose from {'; '.join((*ROWS, *STUDIES))}")
        if ROWS[name].missing:
            raise GeodesicMotionError(
                f"the method '{name}' needs {ROWS[name].missing}, which is not installed: "
                "pip install 'geodesic_motion_studies[benchmark]'"
            )
    return names
