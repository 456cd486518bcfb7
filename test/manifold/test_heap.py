"""The heap against sorting."""

import numpy as np

from geodesic_motion_ros.manifold.heap import TAKEN, WAITING, put, take


def empty(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.empty(count), np.empty(count, dtype=np.int32), np.full(count, WAITING, dtype=np.int32)


def test_items_are_taken_in_the_order_of_their_keys():
    random = np.random.default_rng(0)
    count = 200
    keys, items, place = empty(count)
    wanted, size = random.random(count), 0
    for item in random.permutation(count):
        size = put(keys, items, place, size, item, 1.0 + wanted[item])
    # Every second one falls.
    for item in range(0, count, 2):
        size = put(keys, items, place, size, item, wanted[item])
    wanted[1::2] += 1.0
    taken = []
    while size:
        taken.append(int(items[0]))
        assert keys[0] == wanted[taken[-1]]
        size = take(keys, items, place, size)
        np.testing.assert_array_equal(items[place[items[:size]]], items[:size])
    assert taken == np.argsort(wanted).tolist()
    assert np.all(place == TAKEN)


def test_putting_and_taking_may_alternate():
    random = np.random.default_rng(1)
    keys, items, place = empty(500)
    kept: dict[int, float] = {}
    size = 0
    for item in range(500):
        kept[item] = float(random.random())
        size = put(keys, items, place, size, item, kept[item])
        if random.random() < 0.6:
            least = min(kept, key=kept.__getitem__)
            assert int(items[0]) == least
            size = take(keys, items, place, size)
            del kept[least]
        assert size == len(kept)
