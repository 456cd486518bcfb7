"""What a planner's status says, in words and figures for a person who looks at the arm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from geodesic_motion_ros.contract.mode import Mode
from geodesic_motion_ros.contract.status import VerdictCode

_DOING = {
    Mode.FOLLOWING: "Moving", Mode.STOPPING: "Stopping on its path",
    Mode.WAITING: "Waiting: no path is free", Mode.EVADING: "Making room",
    Mode.APPROACHING: "As near to the covered goal as is free", Mode.HOLDING: "Standing",
    Mode.IDLE: "Standing, without a goal",
}  # fmt: skip
_GREEN, _AMBER, _RED, _GREY = "#2b8a3e", "#c25e00", "#c92a2a", "#868e96"
#: Codes of an arm that is well and stands, and of one that waits for what leaves by itself.
_CALM = (VerdictCode.NO_GOAL, VerdictCode.HOLD_REQUESTED)
_WAITING = (VerdictCode.NO_FEASIBLE_PATH, VerdictCode.DEADLINE_MISSED)
#: A rate is counted over so long [s].
_COUNTED = 1.0


@dataclass(frozen=True)
class SaidStatus:
    """A status in words.

    Attributes
    ----------
    stamp : [s]. code : of the verdict. title : what the arm does. reason : why, "" where all is well.
    colour : of the title, for CSS. figures : names and values with their units.
    has_arrived : whether the arm is at its goal, at rest.
    """

    stamp: float
    code: str
    title: str
    reason: str
    colour: str
    figures: Mapping[str, str]
    has_arrived: bool

    @property
    def markdown(self) -> str:
        """The same for the page."""
        rows = "".join(f"| {name} | **{value}** |\n" for name, value in self.figures.items())
        said = f"`{self.code}` {self.reason}" if self.reason else ""
        return f'### <span style="color:{self.colour}">{self.title}</span>\n{said}\n\n| | |\n|---|---|\n{rows}'


#: What is said where no status comes.
SILENT = SaidStatus(-math.inf, "", "No planner is heard", "start one in this ROS domain", _RED, {}, False)


class StatusReader:
    """A reader of statuses, one after the other: of two of them the planner's rate is known."""

    def __init__(self) -> None:
        self._counted: list[tuple[float, int]] = []

    def read(self, stamp: float, message: str, values: Mapping[str, str]) -> SaidStatus:
        """Return a status of a time [s] in words; message, values : as `~/status` has them."""
        code = VerdictCode[values["code"]]
        mode = Mode(values["mode"]) if values["mode"] else Mode.HOLDING
        to_go, speed = float(values["time_to_goal"]), float(values["speed"])
        has_arrived = code is VerdictCode.OK and to_go == 0.0 and speed == 0.0
        title = "At the goal" if has_arrived else _DOING[mode]
        if code is VerdictCode.OK and to_go > 0.0:
            title += f", {to_go:.1f} s to go"
        colour = (
            _GREEN if code is VerdictCode.OK else _GREY if code in _CALM else _AMBER if code in _WAITING else _RED
        )
        # The message has more than the reason of the verdict: a goal that was refused meanwhile.
        reason = "" if message == VerdictCode.OK.name else message.removeprefix(f"{code.name}: ")
        figures = {
            "clearance": _millimetres(1e3 * float(values["clearance"])),
            "detour": _millimetres(float(values["detour_mm"])),
            "off its path": _millimetres(1e3 * float(values["tracking_error"])),
            "fastest joint": f"{speed:.2f} rad/s",
            "planning": f"{self._rate(stamp, int(values['tick']))}, {float(values['last_tick_work_ms']):.1f} ms each",
        }
        return SaidStatus(stamp, code.name, title, reason, colour, figures, has_arrived)

    def _rate(self, stamp: float, tick: int) -> str:
        if self._counted and (tick < self._counted[-1][1] or stamp <= self._counted[-1][0]):
            self._counted.clear()  # another planner, or another time
        self._counted.append((stamp, tick))
        while stamp - self._counted[min(1, len(self._counted) - 1)][0] > _COUNTED:
            self._counted.pop(0)
        begin, first = self._counted[0]
        return f"{(tick - first) / (stamp - begin):.0f} Hz" if stamp - begin > 0.5 * _COUNTED else "..."


def _millimetres(value: float) -> str:
    return f"{value:.0f} mm" if math.isfinite(value) else "-"
