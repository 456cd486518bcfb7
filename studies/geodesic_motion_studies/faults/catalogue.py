"""All faults, in the order in which they are run."""

from __future__ import annotations

import difflib

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.faults.clock_faults import CLOCK_FAULTS
from geodesic_motion_studies.faults.fault import PLANNER, Fault
from geodesic_motion_studies.faults.goal_faults import GOAL_FAULTS
from geodesic_motion_studies.faults.long_faults import LONG_FAULTS
from geodesic_motion_studies.faults.message_faults import MESSAGE_FAULTS
from geodesic_motion_studies.faults.obstacle_faults import OBSTACLE_FAULTS
from geodesic_motion_studies.faults.offer_faults import OFFER_FAULTS
from geodesic_motion_studies.faults.process_faults import PROCESS_FAULTS
from geodesic_motion_studies.faults.start_faults import START_FAULTS
from geodesic_motion_studies.faults.state_faults import STATE_FAULTS

FAULTS: tuple[type[Fault], ...] = (
    *STATE_FAULTS,
    *GOAL_FAULTS,
    *OBSTACLE_FAULTS,
    *MESSAGE_FAULTS,
    *OFFER_FAULTS,
    *PROCESS_FAULTS,
    *START_FAULTS,
    *CLOCK_FAULTS,
    *LONG_FAULTS,
)


def chosen(names: list[str] | None, long: bool, subject: str = PLANNER) -> list[Fault]:
    """The faults of a subject with these names; without names all, those that take minutes where `long` says so.

    Raises
    ------
    ParameterError : there is no fault of a name.
    """
    known = {fault.name: fault for fault in FAULTS if subject in fault.subjects}
    if names is None:
        return [fault() for fault in known.values() if long or not fault.long]
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {close[0]}?" if close else "--list shows all"
            raise ParameterError(f"there is no fault {name!r} of the {subject}; {hint}")
    return [known[name]() for name in names]
