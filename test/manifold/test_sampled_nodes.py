"""Sampled nodes cover the tube around the codes, are joined to their nearest, and are always the same."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from geodesic_motion_ros.manifold import sampled_nodes
from geodesic_motion_ros.manifold.latent_graph import connected_pieces
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.sampled_nodes import SampledNodes, nearest_beside, sample_nodes

WIDTH = 0.3
#: What is embedded moves by so much along each axis.
SLOPES = np.array([1.0, 1.0, 1.0, 0.2])


def bundle(dimension: int = 4) -> np.ndarray:
    """Codes (5, 60, d) of five curves beside each other, that wind."""
    random, s = np.random.default_rng(0), np.linspace(0.0, 4.0, 60)
    curve = np.stack([s, np.sin(s), *np.zeros((dimension - 2, 60))], axis=1)
    return curve + random.normal(0.0, 0.2, (5, 1, dimension))


def embedded(latent: np.ndarray) -> np.ndarray:
    return latent * SLOPES[: latent.shape[1]]


def within(codes: np.ndarray):
    """Whether latent points are near a code."""
    tree = cKDTree(codes.reshape(-1, codes.shape[-1]))
    return lambda latent: tree.query(latent)[0] <= 2.0 * WIDTH


@pytest.fixture(scope="module", params=[True, False], ids=["mean paths", "codes"])
def sampled(request):
    codes = bundle()
    mean_paths = MeanPaths.of_codes(codes, np.zeros(5, dtype=int)) if request.param else None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampled_nodes, "MOST_NODES", 1500)
        found = [sample_nodes(codes, mean_paths, WIDTH, within(codes), embedded, 12) for _ in range(2)]
    return codes, *found


def test_they_are_the_same_every_time(sampled):
    _, once, again = sampled
    for one, other in zip(once, again, strict=True):
        np.testing.assert_array_equal(one, other)


def test_they_are_supported_joined_and_no_more_than_allowed(sampled):
    codes, (latent, edges, _), _ = sampled
    assert 500 < len(latent) <= 1500
    assert np.all(within(codes)(latent))
    assert np.bincount(connected_pieces(edges, len(latent))).max() > 0.98 * len(latent)
    assert np.all(edges[:, 0] < edges[:, 1])
    assert len(np.unique(edges, axis=0)) == len(edges)


def test_every_code_has_one_near_and_no_two_are_close(sampled):
    """Where they are compared: as they are embedded, and a little as they lie."""
    codes, (latent, _, _), _ = sampled
    apart = cKDTree(embedded(latent)).query(embedded(latent), k=2)[0][:, 1]
    away = cKDTree(embedded(latent)).query(embedded(codes.reshape(-1, 4)))[0]
    assert away.max() < 2.0 * np.median(apart)
    assert np.median(apart) < 2.0 * np.percentile(apart, 5.0)


def test_the_ends_of_a_mean_path_are_nodes_and_edges_lead_along_it():
    """Even where each node is joined to one other alone."""
    codes = bundle()
    mean_paths = MeanPaths.of_codes(codes, np.zeros(5, dtype=int))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampled_nodes, "MOST_NODES", 1500)
        latent, edges, _ = sample_nodes(codes, mean_paths, WIDTH, within(codes), embedded, 1)
    away, ends = cKDTree(latent).query(mean_paths.centres[0, [0, -1]])
    np.testing.assert_array_equal(away, 0.0)
    piece = connected_pieces(edges, len(latent))
    assert piece[ends[0]] == piece[ends[1]]


def test_of_points_that_decode_alike_the_one_nearest_to_the_mean_path_is_kept():
    """The last axis decodes to nothing."""
    codes = bundle()
    mean_paths = MeanPaths.of_codes(codes, np.zeros(5, dtype=int))
    slopes, off = np.array([1.0, 1.0, 1.0, 0.0]), {}
    for paths in (None, mean_paths):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sampled_nodes, "MOST_NODES", 1500)
            latent, _, _ = sample_nodes(codes, paths, WIDTH, within(codes), lambda points: points * slopes, 12)
        off[paths is None] = np.mean(np.log(mean_paths.conformal_factors(latent, 1.0)))
    assert off[False] < off[True]


def test_where_little_is_decoded_they_are_farther_apart(sampled):
    _, (_, _, spacing), _ = sampled
    assert spacing[3] > 2.0 * spacing[:3].max()
    box = SampledNodes(np.zeros(4), np.ones(4), spacing)
    assert box.step == spacing.min()
    np.testing.assert_allclose(box.coordinates(spacing[None]), np.ones((1, 4)))


def test_of_each_the_nearest_stand_beside_it_itself_first(sampled):
    _, (latent, _, spacing), _ = sampled
    beside = nearest_beside(latent / spacing)
    np.testing.assert_array_equal(beside[:, 0], np.arange(len(latent)))
    away = np.linalg.norm((latent[beside] - latent[:, None]) / spacing, axis=2)
    assert np.all(np.diff(away, axis=1) >= 0.0)


def test_where_nothing_is_supported_there_are_none():
    codes = bundle()
    latent, edges, _ = sample_nodes(codes, None, WIDTH, lambda points: np.zeros(len(points), dtype=bool), embedded)
    assert len(latent) == len(edges) == 0
