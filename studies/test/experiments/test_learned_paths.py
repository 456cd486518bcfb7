"""Paths through the whole latent box: their energies are those of their edges, and walls are dear."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_studies.experiments.learned_paths import LearnedPaths, whole_box


@pytest.mark.parametrize("space", ["task", "joint"])
def test_energy_and_length_fit_together_and_there_is_a_path_everywhere(fan_skill, reach_skill, space) -> None:
    skill = fan_skill if space == "task" else reach_skill
    shape = (25, 25) if space == "task" else (12, 12, 12)
    paths = LearnedPaths(whole_box(skill, shape))
    assert len(paths.graph.latent) == np.prod(shape)
    inside = paths.shortest(skill.codes[0, 0], skill.codes[0, -1])
    corner = paths.shortest(skill.codes[0, 0], skill.latent_upper)
    for path in (inside, corner):
        edges = len(path.nodes) - 1
        # Cauchy-Schwarz: equal where all edges are equally long.
        assert path.length**2 <= path.energy * (1.0 + 1e-9)
        assert path.energy <= edges**2 * path.dearest * (1.0 + 1e-9)
    begin = paths.graph.latent[inside.nodes[0]]
    np.testing.assert_array_less(np.abs(begin - skill.codes[0, 0]), paths.graph.grid.spacing)
    assert corner.dearest > inside.dearest


def test_a_path_to_where_it_is_costs_nothing(fan_skill) -> None:
    path = LearnedPaths(whole_box(fan_skill, (25, 25))).shortest(fan_skill.codes[0, 0], fan_skill.codes[0, 0])
    assert (path.length, path.energy, path.dearest) == (0.0, 0.0, 0.0)
