from __future__ import annotations

import pytest

from geodesic_motion_studies.benchmarks.engine import SearchProblem
from geodesic_motion_studies.benchmarks.synthetic import synthetic_problem


@pytest.fixture(scope="session")
def problem() -> SearchProblem:
    return synthetic_problem((16, 16, 16))
