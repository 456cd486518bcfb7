"""What is known of the Franka Emika Panda beside its description files; light, for `--help`."""

from __future__ import annotations

from math import pi

PANDA_READY = (0.0, -pi / 4, 0.0, -3 * pi / 4, 0.0, pi / 2, pi / 4)
