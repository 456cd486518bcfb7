"""Reactive motion generation for robot arms on learned Riemannian manifolds.

What a program begins with is imported from here, and loaded when it is first used:
`from geodesic_motion_ros import Skill`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from geodesic_motion_ros.certification.declared_scene import DeclaredScene
    from geodesic_motion_ros.contract.settings import PlannerSettings
    from geodesic_motion_ros.contract.status import Refusal, VerdictCode
    from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
    from geodesic_motion_ros.filtering.motion_filter import MotionFilter
    from geodesic_motion_ros.obstacles.obstacles import Obstacles
    from geodesic_motion_ros.planning.planner import ReactivePlanner
    from geodesic_motion_ros.robot.kinematics import Robot
    from geodesic_motion_ros.skill.skill import Skill

__all__ = [
    "DeclaredScene", "Demonstrations", "MotionFilter", "Obstacles", "PlannerSettings", "ReactivePlanner", "Refusal",
    "Robot", "Skill", "VerdictCode",
]  # fmt: skip

_MODULES = {
    "DeclaredScene": "certification.declared_scene",
    "Demonstrations": "demonstrations.demonstrations",
    "MotionFilter": "filtering.motion_filter",
    "Obstacles": "obstacles.obstacles",
    "PlannerSettings": "contract.settings",
    "ReactivePlanner": "planning.planner",
    "Refusal": "contract.status",
    "Robot": "robot.kinematics",
    "Skill": "skill.skill",
    "VerdictCode": "contract.status",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
