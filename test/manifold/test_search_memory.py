"""What a search leaves behind: nothing."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid
from geodesic_motion_ros.manifold.heap import put
from geodesic_motion_ros.manifold.search_memory import SearchMemory, lent_memory


def adjacency() -> Adjacency:
    grid = LatentGrid(np.zeros(2), np.ones(2), (6, 6))
    return Adjacency.from_edges(grid.edges(np.arange(36).reshape(6, 6), 8), 36)


def written_in(memory: SearchMemory) -> None:
    """As a search does: two nodes with a cost, one of them in a heap, the other closed."""
    memory.cost[0, 5], memory.cost[:, 7] = 1.0, -np.inf
    memory.written[:2], memory.count[0] = (5, 7), 2
    memory.size[0] = put(memory.keys[0], memory.items[0], memory.place[0], 0, 5, 1.0)
    memory.spent[:] = 3


def test_a_memory_is_given_back_as_it_was_and_lent_again():
    graph, new = adjacency(), SearchMemory.of(36)
    with lent_memory(graph) as memory:
        written_in(memory)
    with lent_memory(graph) as again:
        assert again is memory
        for name in ("cost", "place", "size", "spent", "count"):
            np.testing.assert_array_equal(getattr(again, name), getattr(new, name))


def test_searches_at_the_same_time_have_one_each():
    graph = adjacency()
    with lent_memory(graph) as first, lent_memory(graph) as second:
        assert first is not second
    with lent_memory(graph) as third:
        assert any(third is one for one in (first, second))
    lent = []

    def lend() -> None:
        with lent_memory(graph) as memory:
            lent.append(id(memory))
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
        with lent_memory(graph) as memory:
            written_in(memory)
            lent.append(memory)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search()
    with lent_memory(graph) as memory:
        assert memory is not lent[0]
