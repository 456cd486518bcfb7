"""The certificate is a lower bound of what is played between knots, costs little, and names what it objects to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.certification.certificate import ArmCertifier, sphere_bulges
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.requirement import NO_CONTACT, Requirement
from geodesic_motion_ros.geometry.distance_field import DistanceField, field_distances
from geodesic_motion_ros.geometry.quintic import quintic_bounds
from geodesic_motion_ros.geometry.shapes import solid_distances, solid_rows
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.obstacles.swept_spheres import self_clearances, sphere_clearances
from geodesic_motion_ros.robot.body_points import BodyPoints, lever_bounds, place_body_points
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference

ROBOT = Robot.named("panda")
LIMITS = JointLimits.of(ROBOT)
FRAMES = np.array([0, 2, 3, 4, 5, 7, 8, len(ROBOT.link_names) - 1], dtype=np.int64)
OFFSETS = np.random.default_rng(0).uniform(-0.06, 0.06, (len(FRAMES), 3))
RADII = np.linspace(0.04, 0.08, len(FRAMES))
PAIRS = np.array([(0, 4), (0, 6), (1, 5), (1, 7), (2, 7), (3, 7), (0, 7)])
LEVERS = lever_bounds(ROBOT, FRAMES, OFFSETS)


def certifier(radii: np.ndarray = RADII, pairs: np.ndarray = PAIRS) -> ArmCertifier:
    points = BodyPoints(tuple(ROBOT.link_names[frame] for frame in FRAMES), FRAMES, OFFSETS)
    return ArmCertifier(ROBOT, CollisionModel(points, radii, FRAMES > 0, pairs))


CERTIFIER = certifier()
MOVING = np.arange(1, len(FRAMES))  # the first sphere is on the base
HORIZON = 0.3


def centres_at(obstacles: Obstacles, times: np.ndarray) -> np.ndarray:
    """Centres (k, o, 3) of spheres: in linear motion for a while, then at rest."""
    return obstacles.centres + np.minimum(times, HORIZON)[:, None, None] * obstacles.velocities


def scene(seed: int) -> tuple[JointReference, Obstacles]:
    """A fast motion of about half a second to a second, and four obstacles where the arm is."""
    random = np.random.default_rng(seed)
    start = ROBOT.ready + random.uniform(-0.4, 0.4, 7)
    share = np.linspace(0.0, 1.0, 30)[:, None]
    path = start + share * random.normal(scale=0.35, size=7) + np.sin(3.0 * share) * random.normal(scale=0.15, size=7)
    path = np.clip(path, LIMITS.lower + 0.01, LIMITS.upper - 0.01)
    reference = timed_joint_reference(path, np.zeros((30, 1)), LIMITS)
    centres = random.uniform([-0.2, -0.6, 0.0], [0.8, 0.6, 1.0], (4, 3))
    velocities = random.normal(scale=0.5, size=(4, 3))
    return reference, Obstacles.of_spheres(centres, random.uniform(0.02, 0.15, 4), velocities, time=0.0)


def placed_at(reference: JointReference, times: np.ndarray) -> np.ndarray:
    positions = np.ascontiguousarray(reference.samples(times)[0])
    return place_body_points(positions, FRAMES, OFFSETS, ROBOT.chain)


def bulges_of(reference: JointReference) -> np.ndarray:
    _, largest = quintic_bounds(reference.times, reference.positions, reference.velocities, reference.accelerations)
    return sphere_bulges(reference.times, largest[0], largest[1], LEVERS)


def densely(reference: JointReference, obstacles: Obstacles) -> tuple[np.ndarray, np.ndarray]:
    """What 200 samples an interval find: clearance from obstacles and of pairs, (n - 1,) each."""
    times = np.linspace(reference.times[:-1], reference.times[1:], 200, axis=1).ravel()
    spheres = placed_at(reference, times)
    gaps = np.linalg.norm(spheres[:, MOVING, None] - centres_at(obstacles, times)[:, None], axis=3)
    gaps = (gaps - obstacles.radii - RADII[MOVING, None]).min(axis=(1, 2))
    pairs = np.linalg.norm(spheres[:, PAIRS[:, 0]] - spheres[:, PAIRS[:, 1]], axis=2)
    pairs = (pairs - RADII[PAIRS].sum(axis=1)).min(axis=1)
    return gaps.reshape(-1, 200).min(axis=1), pairs.reshape(-1, 200).min(axis=1)


def certified(reference: JointReference, obstacles: Obstacles):
    return CERTIFIER.certify(reference, obstacles, HORIZON)


def test_it_is_never_optimistic_and_costs_a_millimetre():
    costs, own_costs = [], []
    for seed in range(40):
        reference, obstacles = scene(seed)
        certificate = certified(reference, obstacles)
        true, own = densely(reference, obstacles)
        assert np.all(certificate.clearance <= true + 1e-9)
        assert np.all(certificate.self_clearance <= own + 1e-9)
        costs.append(true - certificate.clearance)
        own_costs.append(own - certificate.self_clearance)
    assert np.median(np.concatenate(costs)) < 1e-3
    assert np.median(np.concatenate(own_costs)) < 2e-3
    # An obstacle that stops between knots costs up to a quarter of its path in that interval, here 10 mm at 2 m/s.
    assert np.max(np.concatenate(costs)) < 0.015


def test_it_holds_for_every_velocity_within_the_errors() -> None:
    optimistic = 0
    for seed in range(12):
        reference, spheres = scene(seed)
        solids, off = solids_in(seed), np.random.default_rng(seed).normal(scale=0.2, size=(4, 3))
        errors = np.linalg.norm(off, axis=1)
        truly = replace(spheres, velocities=spheres.velocities + off)
        true, _ = densely(reference, truly)
        uncertain = replace(spheres, velocity_errors=errors)
        assert np.all(certified(reference, uncertain).clearance <= true + 1e-9)
        # So too of what is left of the motion, and as long as moving obstacles count.
        swept, middle = CERTIFIER.sweep(reference), 0.5 * reference.duration
        left = CERTIFIER.certify_swept(swept.since(middle), uncertain, HORIZON).clearance
        assert np.all(left <= densely(reference.rest(middle), truly)[0] + 1e-9)
        counted = reference.times[1:] <= HORIZON
        until = CERTIFIER.certify(reference, uncertain, HORIZON, stand_after_horizon=False).clearance
        assert np.all(until[counted] <= true[counted] + 1e-9)
        optimistic += np.any(certified(reference, spheres).clearance > true + 1e-3)
        truly = replace(solids, solid_velocities=solids.solid_velocities + off)
        true = densely_of_solids(reference, truly)
        assert np.all(certified(reference, replace(solids, solid_velocity_errors=errors)).clearance <= true + 1e-9)
        optimistic += np.any(certified(reference, solids).clearance > true + 1e-3)
    assert optimistic > 8


def test_what_is_left_of_a_motion_is_certified_like_a_motion_of_its_own():
    """But for the interval in which it begins: that counts as a whole."""
    for seed in range(12):
        reference, obstacles = scene(seed)
        swept = CERTIFIER.sweep(reference)
        for time in np.random.default_rng(seed).uniform(0.0, reference.duration, 4):
            left = CERTIFIER.certify_swept(swept.since(time), obstacles, HORIZON)
            own = CERTIFIER.certify(reference.rest(time), obstacles, HORIZON)
            np.testing.assert_allclose(left.clearance[1:], own.clearance[1:], atol=1e-9)
            np.testing.assert_allclose(left.self_clearance[1:], own.self_clearance[1:], atol=1e-9)
            true, own_true = densely(reference.rest(time), obstacles)
            assert left.clearance[0] <= true[0] + 1e-9
            assert left.self_clearance[0] <= own_true[0] + 1e-9
            np.testing.assert_allclose(left.times[1:], own.times[1:], atol=1e-9)
        ended = CERTIFIER.certify_swept(swept.since(reference.duration + 5.0), obstacles, HORIZON)
        stands = CERTIFIER.certify(reference.rest(reference.duration + 5.0), obstacles, HORIZON)
        np.testing.assert_allclose(ended.clearance, stands.clearance, atol=1e-9)


def test_beyond_the_horizon_what_moves_may_be_left_out_but_not_what_stands_nor_what_comes_before():
    """Less certified obstacles give no less clearance; to the horizon, and of what stands, it is the same."""
    gained = 0
    for seed in range(30):
        reference, obstacles = scene(seed)
        obstacles.velocities[:2] = 0.0
        certain = certified(reference, obstacles)
        optimistic = CERTIFIER.certify(reference, obstacles, HORIZON, stand_after_horizon=False)
        standing = certified(reference, obstacles.static_subset)
        later = reference.times[:-1] >= HORIZON
        np.testing.assert_allclose(optimistic.clearance[~later], certain.clearance[~later], atol=1e-12)
        np.testing.assert_allclose(optimistic.clearance[later], standing.clearance[later], atol=1e-12)
        assert np.all(optimistic.clearance >= certain.clearance - 1e-12)
        gained += np.any(optimistic.clearance > certain.clearance + 1e-3)
    assert gained > 2


def test_what_comes_to_where_the_arm_stands_at_the_end_is_counted_to_the_horizon():
    reference, _ = scene(0)
    short = reference.rest(reference.duration - 0.05)
    hand = placed_at(short, np.array([short.duration]))[0, -1]
    coming = Obstacles.of_spheres(
        (hand + [0.0, 0.0, 1.0])[None], np.array([0.05]), np.array([[0.0, 0.0, -1.0 / HORIZON]]), time=0.0,
    )
    assert np.min(CERTIFIER.certify(short, coming, HORIZON).clearance) > 0.1
    assert np.min(CERTIFIER.certify(short, coming, HORIZON, stand_after_horizon=False).clearance) < -0.05
    lasting = CERTIFIER.sweep(short).stand_until(HORIZON)
    assert np.min(CERTIFIER.certify_swept(lasting, coming, HORIZON).clearance) < -0.05


def solids_in(seed: int) -> Obstacles:
    """Four moving solids where the arm is."""
    random = np.random.default_rng(seed)
    solids = solid_rows(
        random.uniform([-0.2, -0.6, 0.0], [0.8, 0.6, 1.0], (4, 3)), Rotation.random(4, random_state=seed).as_matrix(),
        random.uniform(0.0, 0.15, (4, 3)), random.uniform(0.01, 0.05, 4),
    )  # fmt: skip
    return replace(Obstacles.none(), solids=solids, solid_velocities=random.normal(scale=0.5, size=(4, 3)))


def densely_of_solids(reference: JointReference, obstacles: Obstacles) -> np.ndarray:
    """What 60 samples an interval find: clearance from solids, (n - 1,)."""
    times = np.linspace(reference.times[:-1], reference.times[1:], 60, axis=1).ravel()
    spheres = placed_at(reference, times)[:, MOVING]
    moved = [obstacles.at(time, HORIZON) for time in times]
    true = [np.min(solid_distances(s, o.solids) - RADII[MOVING]) for s, o in zip(spheres, moved, strict=True)]
    return np.reshape(true, (-1, 60)).min(axis=1)


def test_among_moving_solids_it_is_never_optimistic_and_costs_little_more():
    costs = []
    for seed in range(15):
        reference, _ = scene(seed)
        obstacles = solids_in(seed)
        certificate = CERTIFIER.certify(reference, obstacles, HORIZON)
        true = densely_of_solids(reference, obstacles)
        assert np.all(certificate.clearance <= true + 1e-9)
        assert np.all(certificate.sphere >= 1)
        costs.append(true - certificate.clearance)
    assert np.median(np.concatenate(costs)) < 2e-3
    # As with spheres: an obstacle that stops between knots.
    assert np.max(np.concatenate(costs)) < 0.016


def test_among_the_points_of_a_cloud_it_is_never_optimistic():
    for seed in range(8):
        reference, spheres = scene(seed)
        random = np.random.default_rng(seed)
        points = np.concatenate([c + random.normal(scale=0.05, size=(100, 3)) for c in spheres.centres[:3]])
        cloud = replace(Obstacles.none(), cloud=DistanceField.of(points, 0.02, 0.01, 0.05))
        certificate = CERTIFIER.certify(reference, cloud, HORIZON)
        times = np.linspace(reference.times[:-1], reference.times[1:], 60, axis=1).ravel()
        dense = placed_at(reference, times)[:, MOVING]
        true = (cKDTree(points).query(dense)[0] - 0.01 - RADII[MOVING]).min(axis=1).reshape(-1, 60).min(axis=1)
        computed = field_distances(dense.reshape(-1, 3), *cloud.cloud).reshape(dense.shape[:2]) - RADII[MOVING]
        assert np.all(certificate.clearance <= true + 1e-9)
        assert np.median(computed.min(axis=1).reshape(-1, 60).min(axis=1) - certificate.clearance) < 3e-3
        both = CERTIFIER.certify(reference, replace(spheres, cloud=cloud.cloud), HORIZON)
        np.testing.assert_allclose(
            both.clearance, np.minimum(certificate.clearance, certified(reference, spheres).clearance), atol=1.1e-3
        )


def test_without_the_bulge_it_would_be_optimistic():
    """The control: the same with straight segments alone."""
    optimistic = 0
    for seed in range(20):
        reference, obstacles = scene(seed)
        spheres = placed_at(reference, reference.times)
        straight = np.zeros((len(reference.times) - 1, len(RADII)))
        clearance, _ = sphere_clearances(
            reference.times, spheres, straight, RADII, MOVING,
            obstacles.centres, obstacles.radii, obstacles.velocities, obstacles.velocity_errors, HORIZON,
        )  # fmt: skip
        true, own = densely(reference, obstacles)
        optimistic += np.any(clearance > true + 1e-6)
        optimistic += np.any(self_clearances(spheres, straight, RADII, PAIRS)[0] > own + 1e-6)
    assert optimistic > 10


def test_bulges_hold_every_sphere_near_its_segment():
    for seed in range(15):
        reference, _ = scene(seed)
        bulges = bulges_of(reference)
        times = np.linspace(reference.times[:-1], reference.times[1:], 41, axis=1)
        spheres = placed_at(reference, times.ravel()).reshape(*times.shape, -1, 3)
        share = np.linspace(0.0, 1.0, 41)[:, None, None]
        straight = (1.0 - share) * spheres[:, :1] + share * spheres[:, -1:]
        off = np.linalg.norm(spheres - straight, axis=3).max(axis=1)
        assert np.all(off <= bulges + 1e-9)
        assert not np.any(bulges[:, 0])
        assert np.median(bulges[:, 1:]) < 2e-3


def test_twice_as_many_knots_have_a_quarter_of_the_bulge():
    reference, _ = scene(0)
    times = np.linspace(0.0, reference.duration, 2 * len(reference.times) - 1)
    halved = JointReference(times, *reference.samples(times), np.zeros((len(times), 1)))
    halved.velocities[-1] = halved.accelerations[-1] = 0.0
    assert bulges_of(halved).mean() == pytest.approx(bulges_of(reference).mean() / 4.0, rel=0.15)


def test_culling_changes_nothing():
    """Against every sphere, obstacle and pair in turn."""
    for seed in range(15):
        reference, obstacles = scene(seed)
        obstacles = replace(obstacles, velocity_errors=np.random.default_rng(seed).uniform(0.0, 0.3, 4))
        certificate = certified(reference, obstacles)
        spheres, bulges = placed_at(reference, reference.times), bulges_of(reference)
        each = [
            sphere_clearances(
                reference.times, spheres, bulges, RADII, np.array([s]),
                obstacles.centres[[o]], obstacles.radii[[o]], obstacles.velocities[[o]],
                obstacles.velocity_errors[[o]], HORIZON,
            )[0]
            for s in MOVING for o in range(4)
        ]  # fmt: skip
        every = np.min(each, axis=0)
        np.testing.assert_allclose(certificate.clearance, every, atol=1e-12)
        by_sphere = np.min(np.reshape(each, (len(RADII) - 1, 4, -1)), axis=1)
        chosen = by_sphere[certificate.sphere - 1, np.arange(len(every))]
        np.testing.assert_allclose(chosen, every, atol=1e-12)
        pairs = np.array([self_clearances(spheres, bulges, RADII, PAIRS[[p]])[0] for p in range(len(PAIRS))])
        np.testing.assert_allclose(certificate.self_clearance, pairs.min(axis=0), atol=1e-12)
        np.testing.assert_allclose(pairs[certificate.pair, np.arange(len(every))], pairs.min(axis=0), atol=1e-12)


def test_an_obstacle_that_moves_away_is_passed_and_one_that_comes_is_not():
    reference, _ = scene(5)
    hand = placed_at(reference, reference.times[[-1]])[0, -1]
    outwards = np.array([0.0, 0.0, 1.0])
    leaving = Obstacles.of_spheres((hand + 0.1 * outwards)[None], np.array([0.05]), 1.0 * outwards[None], time=0.0)
    coming = Obstacles.of_spheres((hand + 0.4 * outwards)[None], np.array([0.05]), -1.0 * outwards[None], time=0.0)
    standing = Obstacles.of_spheres(coming.centres, coming.radii)
    assert certified(reference, leaving).clearance[-1] > 0.1
    assert certified(reference, standing).clearance[-1] > 0.1
    assert certified(reference, coming).clearance[-1] < 0.0


def test_a_prediction_ends_at_its_horizon():
    reference, _ = scene(5)
    hand = placed_at(reference, reference.times[[-1]])[0, -1]
    far, velocity = hand + np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, -2.0]])

    def clearance(centre: np.ndarray, horizon: float) -> float:
        sphere = Obstacles.of_spheres(centre[None], np.array([0.05]), velocity, time=0.0)
        return CERTIFIER.certify(reference, sphere, horizon).clearance[-1]

    assert reference.duration > 0.5
    assert clearance(far, 0.5) < 0.0
    assert clearance(far, 0.2) == pytest.approx(clearance(far + 0.2 * velocity[0], 0.0), abs=1e-12)
    assert clearance(far, 0.2) < clearance(far, 0.0) - 0.2


def test_it_objects_by_name_and_only_with_reason():
    reference, _ = scene(5)
    hand = placed_at(reference, reference.times[[-1]])[0, -1]
    free = CERTIFIER.certify(reference, Obstacles.none(), HORIZON)
    assert np.all(np.isinf(free.clearance))
    assert np.all(free.sphere == -1)
    assert CERTIFIER.objection(free, 0.02) == ""
    small = np.array([0.01])
    touched = CERTIFIER.certify(reference, Obstacles.of_spheres(hand[None], small), HORIZON)
    assert f"'{ROBOT.tool_link}' goes " in CERTIFIER.objection(touched, 0.02)
    near = CERTIFIER.certify(reference, Obstacles.of_spheres(hand[None] + [0.0, 0.0, 0.5], small), HORIZON)
    kept = float(near.clearance.min())
    assert CERTIFIER.objection(near, kept - 0.001) == ""
    assert f"{kept + 0.001:.3f} m are to be kept" in CERTIFIER.objection(near, kept + 0.001)
    wide = certifier(RADII + 0.3)
    complaint = wide.objection(wide.certify(reference, Obstacles.none(), HORIZON))
    assert "touch after" in complaint
    assert any(f"'{ROBOT.link_names[frame]}' and" in complaint for frame in FRAMES)


@pytest.mark.parametrize(
    ("name", "entered"), [("clearance", ""), ("self_clearance", ""), ("scene_clearance", "'hand' enters 'table'")]
)
def test_a_clearance_that_is_no_number_is_objected_to(name, entered):
    reference, _ = scene(5)
    certificate = CERTIFIER.certify(reference, Obstacles.none(), HORIZON)
    assert (CERTIFIER.objection(certificate), CERTIFIER.first_objection(certificate)) == ("", None)
    values = getattr(certificate, name).copy()
    values[7] = np.nan
    unknown = replace(certificate, **{name: values}, entered=entered)
    assert CERTIFIER.objection(unknown)
    assert CERTIFIER.first_objection(unknown) == certificate.times[7]


@pytest.mark.parametrize("name", ["times", "positions", "velocities", "accelerations"])
def test_a_motion_that_is_not_finite_keeps_nothing(name):
    """A comparison with NaN is false: no kernel finds how near it comes, or what limit it breaks."""
    reference, obstacles = scene(5)
    values = getattr(reference, name).copy()
    values[9] = np.nan
    unknown = replace(reference, **{name: values})
    assert reference.keeps(LIMITS)
    assert not unknown.keeps(LIMITS)
    for there in (obstacles, Obstacles.none()):
        certificate = CERTIFIER.certify(unknown, there, HORIZON)
        assert CERTIFIER.objection(certificate, -1.0)
        assert CERTIFIER.first_objection(certificate, -1.0) is not None


def test_what_cannot_move_is_not_checked_against_obstacles_but_against_the_arm():
    reference, _ = scene(5)
    base = placed_at(reference, reference.times[[0]])[0, 0]
    around = CERTIFIER.certify(reference, Obstacles.of_spheres(base[None], np.array([0.01])), HORIZON)
    assert np.all(around.clearance > 0.0)
    own = certifier(RADII + np.eye(len(RADII))[0], np.array([(0, 7)]))
    free = own.certify(reference, Obstacles.none(), HORIZON)
    assert np.all(free.self_clearance < 0.0)


def test_without_pairs_the_arm_is_clear_of_itself():
    reference, _ = scene(5)
    alone = certifier(pairs=np.empty((0, 2), dtype=np.int64))
    certificate = alone.certify(reference, Obstacles.none(), HORIZON)
    assert np.all(np.isinf(certificate.self_clearance))
    assert alone.objection(certificate) == ""


def test_the_real_arm_is_never_nearer_than_certified():
    """PyBullet judges, on the Panda's own meshes; the base, which cannot move, is not part of it."""
    model = CollisionModel.named("panda")
    of_meshes = ArmCertifier(ROBOT, model)
    costs = []
    with ArmWorld() as world:
        for seed in range(8):
            reference, obstacles = scene(seed)
            certificate = of_meshes.certify(reference, obstacles, HORIZON)
            for time in np.random.default_rng(seed).uniform(0.0, reference.duration - 1e-3, 25):
                interval = int(np.searchsorted(reference.times, time, side="right")) - 1
                world.reset(reference.sample(time)[0])
                centres = centres_at(obstacles, np.array([time]))[0]
                spheres = zip(centres, obstacles.radii, strict=True)
                world.set_obstacles({str(number): sphere for number, sphere in enumerate(spheres)})
                real, link = world.clearance()
                # Inside an obstacle the depths of spheres and of meshes are not the same thing.
                if link != "panda_link0" and real > 0.0:
                    assert certificate.clearance[interval] <= real + 1e-3
                    costs.append(real - certificate.clearance[interval])
    assert len(costs) > 60
    assert np.median(costs) < 0.03


def turning(by: float) -> JointReference:
    """The arm turns by an angle [rad] about its base, from rest."""
    path = ROBOT.ready + np.linspace(0.0, by, 30)[:, None] * np.eye(7)[0]
    return timed_joint_reference(path, np.zeros((30, 1)), LIMITS)


@pytest.mark.parametrize(
    ("by", "speed", "standing", "may"),
    [(0.6, 0.1, None, True), (-0.6, 0.1, None, False), (0.0, 0.1, None, False), (0.6, 0.4, None, False),
     (0.6, 0.0, None, False), (0.6, 0.1, (2.0, 0.0), False), (0.6, 0.1, (-0.7, -0.7), True),
     (0.6, 0.1, (0.7, 0.7), False)],
    ids=["away from it", "into it", "it stays", "it is faster", "it stands", "into what stands", "out of what stands",
         "deeper into what stands"],
)  # fmt: skip
def test_an_arm_that_touches_what_moves_may_leave_it(by, speed, standing, may):
    """What is the same for all of them: it is refused as a motion that is to touch nothing."""
    required = Requirement(NO_CONTACT, NO_CONTACT, 1.0, stands_after=False)
    hand = placed_at(JointReference.standing(ROBOT.ready, np.zeros(1)), np.zeros(1))[0, -1]
    beside = RADII[-1] + 0.05 - 0.01
    centres, velocities = [hand - [0.0, beside, 0.0]], [[0.0, speed, 0.0]]
    if standing is not None:
        centres, velocities = [*centres, hand + beside * np.array([0.0, *standing])], [*velocities, [0.0, 0.0, 0.0]]
    obstacles = Obstacles.of_spheres(np.array(centres), np.full(len(centres), 0.05), np.array(velocities), time=0.0)
    stop, swept = JointReference.standing(ROBOT.ready, np.zeros(1)), CERTIFIER.sweep(turning(by))
    assert CERTIFIER.assess(swept, obstacles, required)[1]
    assert (CERTIFIER.assess_leaving(swept, obstacles, required, stop)[1] == "") is may


@pytest.mark.parametrize("seed", range(6))
def test_an_arm_that_leaves_what_moves_is_never_deeper_in_it_than_if_it_had_stopped(seed):
    """Between knots too, and free of it in the end."""
    random = np.random.default_rng(seed)
    required = Requirement(NO_CONTACT, NO_CONTACT, 1.0, stands_after=False)
    stop, left = JointReference.standing(ROBOT.ready, np.zeros(1)), 0
    hand = placed_at(stop, np.zeros(1))[0, -1]
    for _ in range(40):
        reference, direction = turning(random.uniform(-0.8, 0.8)), random.normal(size=3)
        direction /= np.linalg.norm(direction)
        radius, speed = random.uniform(0.02, 0.08), random.uniform(0.02, 0.3)
        touching = hand - (RADII[-1] + radius - random.uniform(0.001, 0.02)) * direction
        obstacles = Obstacles.of_spheres(touching[None], np.array([radius]), speed * direction[None], time=0.0)
        if CERTIFIER.assess_leaving(CERTIFIER.sweep(reference), obstacles, required, stop)[1]:
            continue
        left += 1
        times = np.linspace(0.0, required.horizon, 500)
        centres, apart = touching + times[:, None] * speed * direction, []
        for motion in (reference, stop):
            gaps = np.linalg.norm(placed_at(motion, times)[:, MOVING] - centres[:, None], axis=2)
            apart.append(np.min(gaps - RADII[MOVING] - radius, axis=1))
        assert np.all(apart[0] >= np.minimum(apart[1], 0.0) - 0.002)
        assert apart[0][-1] >= 0.0
    assert left > 0


def test_a_trajectory_has_the_certificate_of_every_interval_and_of_the_time_at_rest():
    """The control: what comes to where it stands counts only where that time was certified."""
    reference, _ = scene(0)
    end = placed_at(reference, reference.times[-1:])[0, -1]
    after = reference.duration + 0.25
    coming = Obstacles.of_spheres(end[None] - [0.0, 0.0, 2.0 * after], [0.05], [[0.0, 0.0, 2.0]], 0.0)
    swept = CERTIFIER.sweep(reference)
    for lasting, horizon, hit in ((swept.stand_until(after), after, True), (swept, reference.duration, False)):
        certificate = CERTIFIER.certify_swept(lasting, coming, horizon, stand_after_horizon=False)
        trajectory = CERTIFIER.judge(reference, certificate)
        assert len(trajectory.clearance) == len(trajectory.self_clearance) == len(reference.times) - 1
        assert trajectory.nearest == np.min(certificate.clearance)
        assert (trajectory.nearest < 0.0) is hit
        assert np.array_equal(trajectory.clearance[:-1], certificate.clearance[: len(reference.times) - 2])


def test_a_trajectory_that_continues_another_keeps_what_was_certified_of_both():
    reference, obstacles = scene(1)
    old = CERTIFIER.judge(reference, CERTIFIER.certify(reference, obstacles, HORIZON))
    since, until = reference.times[3], reference.times[7] + 0.004
    rest = reference.rest(until)
    new = CERTIFIER.judge(rest, CERTIFIER.certify(rest, Obstacles.none(), HORIZON))
    whole = old.continue_by(new, since, until)
    np.testing.assert_array_equal(whole.clearance, [*old.clearance[3:8], *new.clearance])
    np.testing.assert_array_equal(whole.self_clearance, [*old.self_clearance[3:8], *new.self_clearance])
    assert len(whole.clearance) == len(whole.reference.times) - 1
    # Beyond its end the arm stands, with the clearance that it has there.
    later = old.continue_by(new, reference.duration, reference.duration + 1.0)
    assert later.clearance[0] == old.clearance[-1]
    assert new.continue_by(old, 0.0, 0.0).reference is reference


def test_nothing_but_the_certifier_makes_what_may_be_played():
    package = Path(__file__).resolve().parents[2] / "geodesic_motion_ros"
    makers = [file.name for file in package.rglob("*.py") if "JudgedTrajectory(" in file.read_text()]
    assert makers == ["certificate.py"]


def test_a_motion_into_the_declared_scene_is_refused_with_link_part_and_time() -> None:
    """Between two knots too; the same motion beside it is not."""
    model = CollisionModel.named("panda")
    robot = Robot.named("panda")
    swing = robot.ready + np.linspace(-0.6, 0.6, 80)[:, None] * np.eye(7)[0]
    reference = timed_joint_reference(swing, np.zeros((80, 1)), JointLimits.of(robot, 0.3, 0.2))
    tool = robot.forward(robot.ready)[0]

    def objection(away: float) -> str | None:
        box = {"name": "post", "centre": (tool + [away, 0.0, 0.0]).tolist(), "size": [0.02, 0.02, 0.3]}
        certifier = ArmCertifier(robot, model, DeclaredScene.of({"boxes": [box]}))
        certificate = certifier.certify(reference, Obstacles.none(), 1.0)
        assert np.all(np.isinf(certificate.clearance))
        return certifier.objection(certificate)

    assert objection(0.4) == ""
    refusal = objection(0.0)
    assert refusal is not None
    assert "enters 'post' of the scene after" in refusal
    assert "'panda_hand'" in refusal
