"""What a search leaves behind: nothing."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid
from geodesic_motion_ros.manifold.heap import put
from geodesic_motion_ros.manifold.search_buffers import SearchBuffers, lent_buffers


def adjacency() -> Adjacency:
    grid = LatentGrid(np.zeros(2), np.ones(2), (6, 6))
    return Adjacency.from_edges(grid.edges(np.arange(36).reshape(6, 6), 8), 36)


def written_in(buffers: SearchBuffers) -> None:
    """As a search does: two nodes with a cost, one of them in a heap, the other closed."""
    buffers.cost[0, 5], buffers.cost[:, 7] = 1.0, -np.inf
    buffers.written[:2], buffers.count[0] = (5, 7), 2
    buffers.size[0] = put(buffers.keys[0], buffers.items[0], buffers.place[0], 0, 5, 1.0)
    buffers.spent[:] = 3


def test_buffers_are_given_back_as_they_were_and_lent_again():
    graph, new = adjacency(), SearchBuffers.of(36)
    with lent_buffers(graph) as buffers:
        written_in(buffers)
    with lent_buffers(graph) as again:
        assert again is buffers
        for name in ("cost", "place", "size", "spent", "count"):
            np.testing.assert_array_equal(getattr(again, name), getattr(new, name))


def test_searches_at_the_same_time_have_one_each():
    graph = adjacency()
    with lent_buffers(graph) as first, lent_buffers(graph) as second:
        assert first is not second
    with lent_buffers(graph) as third:
        assert any(third is one for one in (first, second))
    lent = []

    def lend() -> None:
        with lent_buffers(graph) as buffers:
            lent.append(id(buffers))
            gate.wait(10.0)

    gate = threading.Barrier(4)
    threads = [threading.Thread(target=lend) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(lent)) == 4


def test_what_an_interrupted_search_leaves_is_not_used_again():
    graph = adjacency()
    lent = []

    def search() -> None:
        with lent_buffers(graph) as buffers:
            written_in(buffers)
            lent.append(buffers)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search()
    with lent_buffers(graph) as buffers:
        assert buffers is not lent[0]
