"""ClonedPolicy: a small network that was trained on the demonstrations, and sends chunks of joint positions.

It stands for the policies that people deploy: it looks at where the arm is and at the goal, says where the arm is to be
at the next `ACTIONS` instants, and knows of no obstacles. A chunk is trained as what a demonstration does next, from
places on it and beside it, as a share of what is left to the goal: so there it comes to rest.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view

from geodesic_motion_ros.learning.optimisation import descend, one_seeded_thread
from geodesic_motion_studies.comparison.arena import Arena

#: Actions of a chunk, how many there are in a second, and how often a new chunk is asked for [s].
ACTIONS, RATE, RENEWED = 16, 30.0, 0.25
#: Places beside a demonstration from which chunks are trained: standard deviation of the joints there [rad], and how
#: long a chunk takes to come back [s].
BESIDE, COMES_BACK = 0.3, 1.0
#: Of the training. An end is nearer than this [rad].
SEED, WIDTH, STEPS, BATCH, LEARNING_RATE, AT_END = 0, 128, 3000, 256, 2e-3, 1e-3
_AHEAD = np.arange(1, ACTIONS + 1) / RATE


class ClonedPolicy:
    """Chunks of the demonstrations of an arena, by a network of the joints' positions and of those of the goal.

    settings : how it was trained, and how often it is asked.
    """

    def __init__(self, arena: Arena, seed: int = SEED) -> None:
        """Train it: the same in an arena with the same seed, in some ten seconds."""
        random = np.random.default_rng(seed)
        inputs, chunks = _examples(arena, random)
        chunks = chunks.reshape(len(chunks), -1)
        with one_seeded_thread(seed):
            self._network = torch.nn.Sequential(
                torch.nn.Linear(inputs.shape[1], WIDTH), torch.nn.SiLU(), torch.nn.Linear(WIDTH, WIDTH),
                torch.nn.SiLU(), torch.nn.Linear(WIDTH, chunks.shape[1]),
            )  # fmt: skip
            self._train(torch.from_numpy(inputs), torch.from_numpy(chunks))
        self._limits = arena.limits
        self.settings: dict[str, Any] = {
            "actions": ACTIONS, "rate": RATE, "renewed": RENEWED, "beside": BESIDE, "comes_back": COMES_BACK,
            "seed": seed, "width": WIDTH, "steps": STEPS, "batch": BATCH, "learning_rate": LEARNING_RATE,
        }  # fmt: skip

    def _train(self, inputs: torch.Tensor, chunks: torch.Tensor) -> None:
        def loss(step: int) -> torch.Tensor:
            rows = torch.randint(len(inputs), (BATCH,))
            return torch.nn.functional.mse_loss(self._network(inputs[rows]), chunks[rows])

        descend(loss, self._network.parameters(), STEPS, LEARNING_RATE, "policy", None)

    def chunk(self, position: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return times (ACTIONS + 1,) [s] and positions (ACTIONS + 1, eta) [rad] of the next chunk: from where the arm
        is, a position (eta,), on the path to a goal (eta,).
        """
        left = float(np.linalg.norm(goal - position))
        shares = np.zeros((ACTIONS, len(goal)))
        if left > AT_END:
            with torch.no_grad():
                shares = self._network(torch.from_numpy(_inputs(position[None], goal[None]))).numpy()
        actions = position + left * shares.reshape(ACTIONS, -1).astype(float)
        positions = np.concatenate([position[None], np.clip(actions, self._limits.lower, self._limits.upper)])
        return np.append(0.0, _AHEAD), positions


@cache
def cloned_policy(arena: Arena) -> ClonedPolicy:
    """Return the policy of an arena, which is trained once in a process."""
    return ClonedPolicy(arena)


def _inputs(positions: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """What the network is given, (n, 3 eta + 1): positions, what is left to the goals, its direction and length."""
    left = goals - positions
    lengths = np.maximum(np.linalg.norm(left, axis=1, keepdims=True), AT_END)
    return np.hstack([positions, left, left / lengths, np.log(lengths)]).astype(np.float32)


def _examples(arena: Arena, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (n, 3 eta + 1), and chunks (n, ACTIONS, eta) as shares of what is left to the goal: of the nearest
    demonstration from every start to every goal that was shown.
    """
    inputs, chunks = [], []
    for start in arena.shown[:, 0]:
        for goal in arena.shown[:, -1]:
            reference = arena.timed(arena.moved(start, goal)[arena.nearest(start, goal)])
            times = np.arange(0.0, reference.duration, 1.0 / RATE)
            passed = reference.samples(np.arange(len(times) + ACTIONS) / RATE)[0]
            on, ahead = passed[: len(times)], sliding_window_view(passed[1:], ACTIONS, axis=0).transpose(0, 2, 1)
            left = np.linalg.norm(goal - on, axis=1, keepdims=True)
            # Near the goal arms are not far beside.
            beside = random.normal(scale=BESIDE * random.uniform(size=(len(on), 1)), size=on.shape)
            beside *= np.minimum(1.0, left / (3.0 * BESIDE))
            remaining = np.maximum(0.0, 1.0 - _AHEAD / COMES_BACK)[:, None]
            places, wanted = on + beside, ahead + remaining * beside[:, None]
            left = np.linalg.norm(goal - places, axis=1)
            kept = left > AT_END
            inputs.append(_inputs(places[kept], np.repeat(goal[None], int(np.sum(kept)), axis=0)))
            chunks.append((wanted[kept] - places[kept][:, None]) / left[kept][:, None, None])
    return np.concatenate(inputs), np.concatenate(chunks).astype(np.float32)
