"""Settings: each is judged by its type and its range, whatever is given."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.utils.errors import PlanningError

#: Nothing that any setting may be.
NOTHING = ["a", ..., 1j, [np.nan], {}]


@pytest.mark.parametrize("name", [field.name for field in fields(PlannerSettings)])
@pytest.mark.parametrize("value", NOTHING, ids=repr)
def test_what_no_setting_may_be_is_refused_by_name(name, value) -> None:
    with pytest.raises(PlanningError, match=name.replace("_", "[_ ]").replace("radii", "radi|tool points")):
        PlannerSettings(**{name: value})


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ({"patience": "a"}, "patience is 'a', must be a real number"),
        ({"cost_cap": True}, "cost_cap is True, must be a real number"),
        ({"maximum_joint_offset": None}, "maximum_joint_offset is None, must be a real number"),
        ({"refine": 2}, "refine is 2, must be True or False"),
        ({"avoidance": None}, "avoidance is None, must be True or False"),
        ({"prediction": np.nan}, "prediction is nan, must be finite and 0 or positive"),
        ({"latency": np.inf}, "latency is inf, must be finite and positive"),
        ({"speed": "fast"}, "speed is 'fast', must be a real number"),
        ({"detour": 0.5}, "detour is 0.5 m, must be at most 0.3 m"),
        ({"grid_shape": (1, 1, 1)}, "must be whole numbers from 2 on"),
        ({"grid_shape": (30.5, 30, 30)}, "must be whole numbers from 2 on"),
        ({"grid_shape": 30}, "must be whole numbers from 2 on"),
        ({"neighbours": 0}, "must be a positive whole number"),
        ({"tool_points": ((0.0, 0.0),)}, r"tool_points has shape \(1, 2\): expected \(K, 3\)"),
        ({"tool_radii": (-0.04,)}, r"tool radius \[m\] is -0.04"),
        ({"tool_radii": (0.04, 0.04)}, "1 tool points and 2 tool radii"),
    ],
)
def test_a_setting_that_does_not_fit_says_what_would(setting, said) -> None:
    with pytest.raises(PlanningError, match=said):
        PlannerSettings(**setting)


def test_numbers_of_every_kind_are_taken() -> None:
    settings = PlannerSettings(
        prediction=2, patience=np.float64(1.0), speed=None, grid_shape=(30, np.int64(30)), neighbours=8, refine=False
    )
    assert settings.patience == 1.0
