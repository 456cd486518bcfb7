"""Families of scenes: which spheres are drawn to block the demonstrations.

Spheres are drawn on demonstrations, not on any planner's path: on one that is drawn, at an instant that is drawn, and
there on a link that moves. Radii are 3 to 6 cm. All spheres are in sight from the beginning, and an arm that waits at
the start until those that move have vanished is never touched.

- *none*: the control.
- *static*: one to three spheres that stand on a demonstration; start and goal stay free of them.
- *elbow*: one that blocks the arm, while the hand keeps `FREE_HAND` from it; likewise. Only where
  all of the arm is guarded.
- *crossing*: one to three that pass a place of the body at the same time as the body, in a straight line.
- *chasing*: one or two that move towards the tool or, where all of the arm is guarded, the elbow, wherever it is, until
  an arm that had stayed at the start would be near.
- *gate*: two pairs that close on the hand's path from two sides about when it passes, and open `GATE_STAYS` later.
- *crowd*: ten, five that stand and five that cross.
- *table*: three to six things on the table of config/scenes/table.yaml, which is declared to every method that plans. A
  thing is a column of equal spheres: the lowest rests on the table, the topmost ends at a place of the body. Hands of
  the shipped skills stay at least 14 cm above the table, higher than one such sphere reaches. Start and goal stay free
  of the table too.

Where demonstrations are *spared*, spheres are drawn again until at least half of the demonstrations stay free of them;
those that stand or cross, and things on the table, block at least one, but in a crowd. With a skill of the tool all
demonstrations are played in one family of postures of the arm, and an elbow's sphere blocks nearly all of them: there
those are spared whose hand keeps `FREE_HAND` from it, as the arm may carry it in another posture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Literal

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.shared_files import find_shared
from geodesic_motion_studies.comparison.demonstrated_motions import DemonstratedMotions
from geodesic_motion_studies.comparison.guard import Guard
from geodesic_motion_studies.experiments.moving_spheres import RADII, MovingSphere

Family = Literal["none", "static", "elbow", "crossing", "chasing", "gate", "crowd", "table"]
Spheres = tuple[MovingSphere, ...]
Draw = Callable[[DemonstratedMotions, np.random.Generator], Spheres | None]

#: Speeds of crossing and of chasing spheres [m/s].
CROSSING_SPEEDS, CHASING_SPEEDS = (0.05, 0.5), (0.05, 0.15)
#: Kept from standing spheres by start and goal, from moving ones by the start, at any time and when they begin, and by
#: the hand from an elbow's [m].
FREE_END, FREE_START, FREE_BEGIN, FREE_HAND = 0.015, 0.03, 0.10, 0.10
#: A chasing sphere begins so far from a place of the point that it chases [m].
CHASE_FROM = 0.25
#: A crossing sphere is taken away so long after it was met, a chasing one after it gave up [s].
VANISHES_AFTER = 2.0
#: A gate: the radius of its spheres, half the distance of those of a pair, and how far off they begin [m]; how long
#: it stays closed [s], and when it is, as a share of the time at which the hand passes.
GATE_RADIUS, GATE_HALF_WIDTH, GATE_OFFSET, GATE_STAYS, GATE_CLOSED = 0.05, 0.06, 0.25, 3.0, (0.7, 2.0)
#: A thing on the table is no taller than this [m].
TALLEST = 0.45
#: Share of the demonstrations that stay free where they are spared.
SPARED = 0.5
#: Spheres that are drawn before it is said that there is no place for them.
_PLACES = 3000


def draw_standing(demonstrated: DemonstratedMotions, random: np.random.Generator) -> Spheres | None:
    """One sphere that stands on a demonstration and leaves start and goal free; None where the one drawn does not."""
    radius = random.uniform(*RADII)
    _, _, centre = demonstrated.place(random)
    return _standing(demonstrated, centre[None], radius)


def _standing(demonstrated: DemonstratedMotions, centres: np.ndarray, radius: float) -> Spheres | None:
    """Spheres that stand at centres (n, 3) [m]; None where they do not leave start and goal free."""
    if min(demonstrated.start_clearance(centres, radius), demonstrated.goal_clearance(centres, radius)) < FREE_END:
        return None
    return tuple(MovingSphere(radius, 0.0, math.inf, centre, np.zeros(3), False) for centre in centres)


def _at_the_elbow(demonstrated: DemonstratedMotions, random: np.random.Generator) -> Spheres | None:
    index, _, _ = demonstrated.place(random)
    standing = draw_standing(demonstrated, random)
    if standing is None:
        return None
    apart = demonstrated.clearances(index, standing[0].begin, standing[0].radius)
    fits = np.min(apart[demonstrated.hand]) >= FREE_HAND and np.min(apart[~demonstrated.hand]) < 0.0
    return standing if fits else None


def _crossing(demonstrated: DemonstratedMotions, random: np.random.Generator) -> Spheres | None:
    radius, speed = random.uniform(*RADII), random.uniform(*CROSSING_SPEEDS)
    _, meeting, place = demonstrated.place(random)
    # Rather from the sides than from above or below.
    direction = random.normal(size=3) * [1.0, 1.0, 0.5]
    velocity = speed * direction / np.linalg.norm(direction)
    sphere = MovingSphere(radius, 0.0, meeting + VANISHES_AFTER, place - meeting * velocity, velocity, False)
    return (sphere,) if _spares_the_start(demonstrated, sphere) else None


def _chasing(demonstrated: DemonstratedMotions, random: np.random.Generator) -> Spheres | None:
    radius, speed = random.uniform(*RADII), random.uniform(*CHASING_SPEEDS)
    direction = random.normal(size=3)
    begin = demonstrated.chased(random) + CHASE_FROM * direction / np.linalg.norm(direction)
    apart = demonstrated.start_clearance(begin[None], radius)
    rests = (apart - FREE_START) / speed
    sphere = MovingSphere(radius, 0.0, rests + VANISHES_AFTER, begin, np.array([speed, 0.0, 0.0]), True, rests)
    return (sphere,) if apart >= FREE_BEGIN else None


def _gate(demonstrated: DemonstratedMotions, random: np.random.Generator) -> Spheres | None:
    time, middle, along = demonstrated.hand_motion(random)
    across = np.cross(along, [0.0, 0.0, 1.0])
    closed = time * random.uniform(*GATE_CLOSED)
    first = random.uniform(0.0, 2.0 * np.pi)
    spheres = []
    for angle in (first, first + random.uniform(0.5, 1.5) * np.pi):
        side = np.cos(angle) * across + [0.0, 0.0, np.sin(angle)]
        beside = GATE_HALF_WIDTH * np.cross(along, side)
        for end in (middle + GATE_RADIUS * side + beside, middle + GATE_RADIUS * side - beside):
            begin, velocity = end + GATE_OFFSET * side, -GATE_OFFSET / closed * side
            spheres.append(MovingSphere(GATE_RADIUS, 0.0, closed + GATE_STAYS, begin, velocity, False, closed))
    return tuple(spheres) if all(_spares_the_start(demonstrated, sphere) for sphere in spheres) else None


def _on_the_table(demonstrated: DemonstratedMotions, random: np.random.Generator) -> Spheres | None:
    """A thing as tall as a place of the body is high above the table, of as few spheres as can be."""
    _, _, place = demonstrated.place(random)
    table = declared_in("table").solids[0]
    top = table[2] + table[5]
    height = float(place[2] - top)
    if not 2.0 * RADII[0] <= height <= TALLEST:
        return None
    count = math.ceil(height / (2.0 * RADII[1]))
    radius = height / (2.0 * count)
    heights = top + radius * (1.0 + 2.0 * np.arange(count))
    return _standing(demonstrated, np.column_stack([np.full((count, 2), place[:2]), heights]), radius)


def _spares_the_start(demonstrated: DemonstratedMotions, sphere: MovingSphere) -> bool:
    """Whether an arm that stays at the start is never touched by a sphere that moves in a straight line."""
    moves_for = min(sphere.rests, sphere.vanishes) - sphere.appears
    centres = sphere.begin + np.linspace(0.0, moves_for, 50)[:, None] * sphere.velocity
    begins = demonstrated.start_clearance(centres[:1], sphere.radius)
    return begins >= FREE_BEGIN and demonstrated.start_clearance(centres, sphere.radius) >= FREE_START


def _draws(family: Family, random: np.random.Generator) -> Sequence[Draw]:
    """What is drawn one after the other."""
    several: dict[Family, tuple[Draw, int, int]] = {
        "static": (draw_standing, 1, 3), "elbow": (_at_the_elbow, 1, 1), "crossing": (_crossing, 1, 3),
        "chasing": (_chasing, 1, 2), "gate": (_gate, 1, 1), "table": (_on_the_table, 3, 6),
    }  # fmt: skip
    if family == "none":
        return []
    if family == "crowd":
        return [draw_standing] * 5 + [_crossing] * 5
    draw, least, most = several[family]
    return [draw] * int(random.integers(least, most + 1))


#: A new one comes last: what a scene draws depends on the place of its family.
FAMILIES: tuple[Family, ...] = ("none", "static", "elbow", "crossing", "chasing", "gate", "crowd", "table")


class NoPlaceError(ParameterError):
    """There is no place for the spheres of a scene on the demonstrations."""


@cache
def declared_in(family: Family) -> DeclaredScene:
    """What always stands around the arm in scenes of a family, besides the spheres."""
    if family != "table":
        return DeclaredScene.empty()
    return DeclaredScene.load(find_shared("config/scenes/table.yaml"))


def families_of(guard: Guard) -> tuple[Family, ...]:
    """Those that there are with a guard."""
    return tuple(family for family in FAMILIES if family != "elbow" or guard == "arm")


def check_families(skill: str, guard: Guard, families: Iterable[Family]) -> None:
    """ParameterError where there is one of which no scenes are drawn for a skill, by its name, and a guard."""
    known = families_of(guard)
    for family in families:
        if family not in known:
            raise ParameterError(
                f"there is no '{family}' with '{skill}' while the tool alone is guarded: choose from "
                f"{', '.join(known)}, or guard all of the arm"
            )


def draw_family(
    family: Family, demonstrated: DemonstratedMotions, random: np.random.Generator, spared: bool, of_tool: bool = False
) -> tuple[Spheres, np.ndarray]:
    """The spheres of a scene and which demonstrations stay free, (N,) bool.

    of_tool : whether the demonstrations are of the tool, which the arm carries in postures of its own.

    Raises
    ------
    NoPlaceError : there is no place for the spheres on these demonstrations.
    """
    if demonstrated.scene_clearance < FREE_END:
        raise NoPlaceError(
            f"start or goal comes nearer than {FREE_END:g} m to what is declared in a scene '{family}': choose other "
            "families"
        )
    spheres: Spheres = ()
    free = demonstrated.free_of(spheres)
    for draw in _draws(family, random):
        for _ in range(_PLACES):
            drawn = draw(demonstrated, random)
            if drawn is None:
                continue
            left = demonstrated.free_of(drawn)
            blocks = family not in ("static", "crossing", "table") or not np.all(left)
            passable = demonstrated.hand_keeps(FREE_HAND, drawn) if of_tool and family == "elbow" else free & left
            if not spared or (blocks and np.mean(passable) >= SPARED):
                break
        else:
            raise NoPlaceError(f"no place was found for the spheres of a scene '{family}' on these demonstrations")
        spheres, free = (*spheres, *drawn), free & left
    return spheres, free
