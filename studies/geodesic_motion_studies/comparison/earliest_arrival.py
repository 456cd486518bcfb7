"""How much time waits may cost among crossing spheres: against who knows how the spheres will move, on the same path.

    python -m geodesic_motion_studies.comparison.earliest_arrival --skill panda_pouring --scenes 20 --seed 862

Scenes of the family `crossing` in which ours waits for longer than `WAITED`. The *earliest arrival* is that of an arm
on the path that ours takes without obstacles, no faster than there, which may wait anywhere on it and go back, without
limits of acceleration, and knows all that the spheres will do: its collision spheres keep `CLEAR` from where they are.
No schedule along that path arrives earlier; a better path may.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.chasing import sphere_centres
from geodesic_motion_studies.comparison.execution import LONGEST, Stage
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.scene import draw_scene
from geodesic_motion_studies.comparison.scene_table import print_scene_table
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

#: Scenes count in which the arm stood for longer [s]: no joint moved faster than `SLOW` [rad/s].
WAITED, SLOW = 0.5, 0.02
#: What the arm keeps from the spheres [m], and the steps of its schedule [s], which are those of the kept postures.
CLEAR, STEP = 0.005, 0.02


def waited(postures: np.ndarray) -> float:
    """For how long [s] an arm stood, of postures (n, eta) [rad] one `STEP` apart."""
    return STEP * float(np.sum(np.max(np.abs(np.diff(postures, axis=0)), axis=1) < SLOW * STEP))


def earliest_arrival(free: np.ndarray) -> float:
    """When the end of a path is reached at the earliest [s], inf for never.

    free : (n, m) whether the arm may be at each of m places on its path at each of n times, one `STEP` apart. In a step
        it stays, or gets to a neighbouring place.
    """
    there = np.zeros(free.shape[1], dtype=bool)
    there[0] = True
    for step in range(1, len(free)):
        reached = there.copy()
        reached[1:] |= there[:-1]
        reached[:-1] |= there[1:]
        there = reached & free[step]
        if there[-1]:
            return STEP * step
    return math.inf


def free_of(positions: np.ndarray, radii: np.ndarray, spheres: Sequence[MovingSphere]) -> np.ndarray:
    """`earliest_arrival`'s table for spheres that cross, of body spheres at (m, S, 3), of radii (S,) [m]."""
    times = np.arange(0.0, LONGEST, STEP)
    free = np.ones((len(times), len(positions)), dtype=bool)
    for sphere in spheres:
        centres = sphere_centres(sphere, times, positions[:, 0])
        for step in np.flatnonzero((times >= sphere.appears) & (times < sphere.vanishes)):
            apart = np.linalg.norm(positions - centres[step], axis=-1) - radii - sphere.radius
            free[step] &= np.min(apart, axis=1) > CLEAR
    return free


def measured(arena: Arena, count: int, seed: int) -> str:
    """Of so many scenes of the family those in which ours waits: when it arrives, and who knows what comes."""
    stage, method, rows = Stage(arena), Geodesics(arena), []
    for number in range(count):
        scene = draw_scene(arena, "crossing", number, seed)
        outcome, postures = stage.play(scene, method)
        if not outcome.success or waited(postures) <= WAITED:
            continue
        _, undisturbed = stage.play(replace(scene, spheres=()), method)
        positions = arena.collision.positions(arena.robot, undisturbed)
        earliest = earliest_arrival(free_of(positions, arena.collision.radii, scene.spheres))
        rows.append([number, outcome.duration, waited(postures), STEP * len(undisturbed), earliest])
    if not rows:
        return f"{arena.skill.name}: in none of {count} scenes ours waits for longer than {WAITED:g} s; play more"
    cells = [[f"{value:.2f}" if isinstance(value, float) else value for value in row] for row in rows]
    gains = [row[1] - row[4] if math.isfinite(row[4]) else 0.0 for row in rows]
    table = text_table([arena.skill.name, "arrives [s]", "waited", "without spheres", "earliest"], cells)
    return f"{table}\n{len(rows)} scenes; ours is later than the earliest by {np.median(gains):.2f} s in the median"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    return print_scene_table("earliest_arrival", __doc__, measured, argv)


if __name__ == "__main__":
    sys.exit(main())
