"""The names of the laws by which the ambient metric grows towards obstacles (`ambient_metric.py`); light, for
`--help`.
"""

from __future__ import annotations

from typing import Literal, get_args

AmbientLaw = Literal["gaussian", "completed", "hard"]
LAWS: tuple[AmbientLaw, ...] = get_args(AmbientLaw)
