"""A regular grid over the latent space and its neighbourhood: topology only, no decoder, no weights."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.utils.errors import PlanningError

#: What a graph takes for each lattice point of its grid [bytes]: 570 to 1970 were measured on the shipped skills, whose
#: graphs keep a tenth of them or less.
_BYTES_PER_NODE = 2000
_MEMORY = Path("/proc/meminfo")
#: An axis with a spacing smaller by this factor than that of another has collapsed: what the network has no use for, it
#: codes within a hundredth of what it uses. Of shipped skills the factor is 1.8 at most.
_COLLAPSED = 4.0


def stencil(dimension: int, neighbours: int) -> np.ndarray:
    """Half of the neighbour offsets of a grid node, (neighbours / 2, dimension): each undirected edge once.

    Offsets are the primitive integer vectors (greatest common divisor 1) with entries of at most `reach`: in 2-D
    8, 16, 32 neighbours for reach 1, 2, 3; in 3-D 26, 98. More directions bend the grid's metric less.
    """
    counts = []
    for reach in (1, 2, 3):
        steps = np.array(list(itertools.product(range(-reach, reach + 1), repeat=dimension)))
        primitive = steps[[math.gcd(*map(int, step)) == 1 for step in steps]]
        counts.append(len(primitive))
        if len(primitive) == neighbours:
            return primitive[len(primitive) // 2 :]
    raise PlanningError(f"a {dimension}-D grid has {', '.join(map(str, counts))} neighbours per node, not {neighbours}")


@dataclass(frozen=True)
class LatentGrid:
    """Regular lattice of `shape` nodes spanning the box [lower, upper] in latent space."""

    lower: np.ndarray
    upper: np.ndarray
    shape: tuple[int, ...]

    def __post_init__(self) -> None:
        if not (len(self.lower) == len(self.upper) == len(self.shape)):
            raise PlanningError(
                f"latent box of {len(self.lower)} dimensions, grid shape {self.shape}: both need the same number"
            )
        if min(self.shape) < 2 or not np.all(np.asarray(self.upper) > np.asarray(self.lower)):
            raise PlanningError(
                f"latent box {self.lower} to {self.upper} with shape {self.shape}: "
                "upper must exceed lower and every side needs at least 2 nodes"
            )
        needed, free = _BYTES_PER_NODE * math.prod(map(int, self.shape)), _free_memory()
        if needed > free:
            fitting = [max(2, int(side * (free / needed) ** (1.0 / len(self.shape)))) for side in self.shape]
            raise PlanningError(
                f"a latent grid of {_by(self.shape)} nodes takes about {1e-9 * needed:,.1f} GB, and "
                f"{1e-9 * free:.1f} GB are free: {_by(fitting)} would fit"
            )

    @cached_property
    def spacing(self) -> np.ndarray:
        """Distance between neighbouring nodes along each axis, (d,)."""
        return (np.asarray(self.upper) - self.lower) / (np.array(self.shape) - 1)

    @cached_property
    def step(self) -> float:
        """Distance of the samples of a path, in which smoothing is measured: the smallest spacing of an axis that has
        not collapsed.
        """
        return float(np.min(self.spacing[self.spacing * _COLLAPSED > np.max(self.spacing)]))

    def nodes(self) -> np.ndarray:
        """All lattice points (prod(shape), d), last axis fastest."""
        axes = [np.linspace(*side) for side in zip(self.lower, self.upper, self.shape, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(self.shape))

    def coordinates(self, latent: np.ndarray) -> np.ndarray:
        """Latent points (n, d) in units of the spacing, 0 at `lower`; the form `scipy.ndimage` interpolates in."""
        return (latent - self.lower) / self.spacing

    def numbering(self, kept: np.ndarray) -> np.ndarray:
        """Number of every kept lattice point (mask over all) among the kept, in the grid's shape; -1 elsewhere."""
        number = np.full(self.shape, -1)
        number.reshape(-1)[kept] = np.arange(np.count_nonzero(kept))
        return number

    def edges(self, number: np.ndarray, neighbours: int) -> np.ndarray:
        """Undirected edges (m, 2) between the nodes of a `numbering`, sorted: those of a node stand together."""
        pairs = []
        for offset in stencil(len(self.shape), neighbours):
            here = tuple(slice(max(0, -o), n - max(0, o)) for o, n in zip(offset, self.shape, strict=True))
            there = tuple(slice(max(0, o), n + min(0, o)) for o, n in zip(offset, self.shape, strict=True))
            pair = np.stack([number[here].reshape(-1), number[there].reshape(-1)], axis=1)
            pairs.append(pair[np.all(pair >= 0, axis=1)])
        edges = np.concatenate(pairs)
        return edges[np.lexsort((edges[:, 1], edges[:, 0]))]


def _by(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))


def _free_memory() -> float:
    """Bytes that can be had without swapping, as Linux estimates them; inf where the system does not tell."""
    try:
        lines = _MEMORY.read_text().splitlines()
    except OSError:
        return math.inf
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")), math.inf)


@dataclass(frozen=True)
class Adjacency:
    """Undirected edges in compressed sparse rows: the neighbours of node u are slots first[u] to first[u + 1].

    Attributes
    ----------
    first : (n + 1,) int64; node : (2m,) int32 neighbour in each slot; edge : (2m,) int32 undirected edge of the slot.
    spare_buffers : what searches on the graph write into, those that none is using (`search_buffers.lent_buffers`).
    """

    first: np.ndarray
    node: np.ndarray
    edge: np.ndarray
    spare_buffers: list[Any] = field(default_factory=list, init=False, repr=False, compare=False)

    @classmethod
    def from_edges(cls, edges: np.ndarray, nodes: int) -> Adjacency:
        """Build from undirected edges (m, 2) over `nodes` nodes; neighbours keep the order of the edges."""
        source = np.concatenate([edges[:, 0], edges[:, 1]])
        target = np.concatenate([edges[:, 1], edges[:, 0]])
        number = np.tile(np.arange(len(edges)), 2)
        order = np.lexsort((number, source))
        first = np.zeros(nodes + 1, dtype=np.int64)
        np.cumsum(np.bincount(source, minlength=nodes), out=first[1:])
        return cls(first, target[order].astype(np.int32), number[order].astype(np.int32))
