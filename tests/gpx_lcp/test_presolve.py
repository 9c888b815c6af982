"""Presolve: smaller systems, the same answer."""

from time import perf_counter

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

import gpx_lcp as gpx

SCENES = {
    "tower": lambda: gpx.scenes.tower(12),
    "wall": lambda: gpx.scenes.wall(4),
    "pyramid": lambda: gpx.scenes.pyramid(4),
    "heavy on light": lambda: gpx.scenes.heavy_on_light(5, 100.0),
    "table": lambda: gpx.scenes.table(6),
    "slope that holds": lambda: gpx.scenes.incline(0.4, 0.5),
    "slope that does not": lambda: gpx.scenes.incline(0.6, 0.5),
    "cradle": lambda: gpx.scenes.cradle(5),
    "rolling": lambda: gpx.scenes.rolling_sphere(),
    "pile": lambda: gpx.scenes.sphere_pile(20),
    "frictionless pile": lambda: gpx.scenes.sphere_pile(20, friction=0.0),
    "column": lambda: gpx.scenes.column(30),
    "wedge": lambda: gpx.scenes.wedge(0.2, speed=1.0),
    "arch": lambda: gpx.scenes.arch(9),
    "card house": lambda: gpx.scenes.card_house(2),
    "cylinders": lambda: gpx.scenes.cylinders(),
    "bricks": lambda: gpx.scenes.bricks(4),
    "rocking block": lambda: gpx.scenes.rocking_block(1.5),
    "superball": lambda: gpx.scenes.superball(10.0),
    "break shot": lambda: gpx.scenes.break_shot(),
}
MODELS = {
    "tower": ["collinear", "closed form"],
    "wall": ["planar"],
    "pyramid": ["planar"],
    "slope that does not": ["planar"],
    "cradle": ["collinear", "closed form"],
    "rolling": ["planar", "closed form"],
    "column": ["collinear", "closed form"],
    "arch": ["planar"],
    "card house": ["planar"],
    "cylinders": ["planar"],
    # All its normals are parallel, and it turns in the plane of the second of its tangents.
    "rocking block": ["planar"],
    "break shot": ["planar"],
}


def assert_same_velocities(system: gpx.StackedSystem, **options: object) -> gpx.Solution:
    """Both ways are solved to 1e-12, or as far as rounding lets either, and agree to 1e-10 of the largest velocity."""
    plain = gpx.solve(system, tolerance=1e-12, presolve=False, **options)
    smaller = gpx.solve(system, tolerance=1e-12, **options)
    assert plain.presolve is None
    assert smaller.program_residual <= max(1e-12, plain.program_residual)
    largest = np.abs(system.B).max(initial=0.0)
    np.testing.assert_allclose(smaller.velocity, plain.velocity, rtol=0, atol=1e-10 * largest)
    return smaller


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_of_the_library_keeps_its_velocities(name):
    world = gpx.World(SCENES[name](), time_step=1 / 240, presolve=False, tolerance=1e-10)
    assert_same_velocities(world.system())
    world.step(25)
    assert_same_velocities(world.system())


def swept(system: gpx.StackedSystem, **options: object) -> list[gpx.Solution]:
    """Solve by sweeps to 1e-10, as asked and presolved."""
    effort = {"tolerance": 1e-10, "max_iterations": 100_000, "time_limit": 10.0}
    return [gpx.solve(system, solver="pgs", presolve=presolve, **effort, **options) for presolve in (False, True)]


def assert_swept_alike(system: gpx.StackedSystem, **options: object) -> gpx.Solution:
    """Sweeps reach the velocities of the exact methods with presolve wherever they do without, and oftener."""
    plain, smaller = swept(system, **options)
    assert plain.presolve is None
    assert smaller.program_residual <= max(1e-10, plain.program_residual)
    if plain.status is gpx.Status.SOLVED:
        # A residual bounds the error of velocities but for how ill-conditioned A is.
        largest = np.abs(system.B).max(initial=0.0)
        np.testing.assert_allclose(smaller.velocity, plain.velocity, rtol=0, atol=1e-7 * largest)
    return smaller


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_of_the_library_keeps_its_velocities_under_sweeps(name):
    world = gpx.World(SCENES[name](), time_step=1 / 240, presolve=False, tolerance=1e-10)
    assert_swept_alike(world.system())
    world.step(25)
    assert_swept_alike(world.system())


@pytest.mark.parametrize("name", MODELS)
def test_scenes_are_recognised(name):
    report = gpx.presolve(SCENES[name]())
    assert [reduction.name for reduction in report.reductions] == MODELS[name]
    removed = np.sum([reduction.removed for reduction in report.reductions], axis=0)
    np.testing.assert_array_equal(np.subtract(report.before, removed), report.after)


def test_a_tower_is_a_column_with_a_quarter_of_the_load_at_each_corner():
    system = gpx.World(gpx.scenes.tower(30), time_step=1 / 240).system()
    solution = gpx.solve(system, tolerance=1e-12)
    loads = 9.81 / 240 * np.repeat(np.arange(30, 0, -1.0), 4) / 4
    np.testing.assert_allclose(solution.impulse[:, 0], loads, rtol=1e-12)
    np.testing.assert_array_equal(solution.impulse[:, 1:], 0.0)
    assert solution.iterations == 0
    assert solution.presolve.before == (120, 360, 180)
    assert solution.presolve.after == (0, 0, 0)


def chain(masses, speeds, floor=True):
    """Point masses on one axis, each above the one before; u is the velocity of each relative to that before."""
    n = len(masses)
    rows = np.eye(n) - np.eye(n, k=-1)
    rows = rows if floor else rows[1:]
    return gpx.StackedSystem.from_jacobian(
        rows, 1.0 / np.asarray(masses), -rows @ np.asarray(speeds), np.zeros(len(rows)), free_velocity=speeds
    )


def test_bodies_that_stay_together_move_with_their_centre_of_mass():
    """Three masses, the first of which runs into the second, and both into the third."""
    masses, speeds = np.array([3.0, 1.0, 2.0]), np.array([6.0, 0.0, 1.0])
    solution = gpx.solve(chain(masses, speeds, floor=False))
    np.testing.assert_allclose(solution.velocity, 0.0, atol=1e-14)
    common = masses @ speeds / masses.sum()
    np.testing.assert_allclose(solution.impulse[:, 0], [3.0 * (6.0 - common), 2.0 * (common - 1.0)], rtol=1e-14)
    assert solution.presolve.after.contacts == 0


@given(st.integers(0, 10**6), st.booleans())
def test_chains_are_solved_by_hand(seed, floor):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 12))
    system = chain(10.0 ** rng.uniform(-2, 2, n), rng.normal(size=n), floor)
    solution = assert_same_velocities(system)
    assert solution.presolve.after.contacts == 0
    np.testing.assert_array_equal(gpx.solve(system, solver="pgs").impulse, solution.impulse)


def test_a_chain_crushed_between_two_walls_has_no_solution():
    rows = np.array([[1.0, 0.0], [-1.0, 1.0], [0.0, -1.0]])
    system = gpx.StackedSystem.from_jacobian(rows, [1.0, 1.0], [1.0, 0.0, 1.0], np.zeros(3))
    solution = gpx.solve(system)
    assert solution.status is gpx.Status.INFEASIBLE
    ray = solution.extras["infeasibility"]
    assert np.abs(system.apply(ray)).max() <= 1e-9
    assert system.B @ ray.ravel() > 0.0
    assert ray.min() >= 0.0


def planar_blocks(rng, bodies, contacts):
    """Rows of contacts in the plane x-z, each of them once or as a pair on both sides of it, in random frames."""
    blocks, targets, pairs, friction = [], [], [], []
    free = np.zeros((bodies, 6))
    free[:, [0, 2, 4]] = rng.normal(size=(bodies, 3))
    for _ in range(contacts):
        first, second = sorted(rng.choice(bodies, 2, replace=False))
        angle, mu, depth = rng.uniform(0, 2 * np.pi), rng.uniform(0.0, 0.3), rng.choice([0.0, 0.3])
        normal = np.array([np.cos(angle), 0.0, np.sin(angle)])
        arms = {body: np.array([rng.normal(), 0.0, rng.normal()]) for body in (first, second)}
        for side in (-1.0, 1.0) if depth else (0.0,):
            turn = rng.uniform(0, 2 * np.pi)
            plane, across = np.cross(normal, [0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0])
            frame = [normal, np.cos(turn) * plane + np.sin(turn) * across, np.cos(turn) * across - np.sin(turn) * plane]
            shift = np.array([0.0, side * depth, 0.0])
            both = [
                sign * np.hstack((frame, np.cross(arms[body] + shift, frame)))
                for body, sign in ((first, -1.0), (second, 1.0))
            ]
            blocks.append(both)
            pairs.append((first, second))
            targets.append(-(both[0] @ free[first] + both[1] @ free[second]))
            friction.append(mu)
    return blocks, pairs, targets, friction, free


def stacked(parts, rng):
    """One system of several parts, the contacts in a random order, one body free."""
    blocks, pairs, targets, friction, inverse = [], [], [], [], [np.eye(6)]
    for part, mass in parts:
        start = len(inverse)
        blocks += part[0]
        pairs += [(first + start, second + start) for first, second in part[1]]
        targets += part[2]
        friction += part[3]
        inverse += list(mass)
    n = len(blocks)
    jacobian = np.zeros((3 * n, 6 * len(inverse)))
    for row, contact in enumerate(rng.permutation(n)):
        for body, block in zip(pairs[contact], blocks[contact], strict=True):
            jacobian[3 * row : 3 * row + 3, 6 * body : 6 * body + 6] = block
        pairs[contact] = (row, contact)
    order = [contact for _, contact in sorted(pairs)]
    B = np.concatenate([targets[contact] for contact in order])
    return gpx.StackedSystem.from_jacobian(
        sp.csr_array(jacobian), np.array(inverse), B, np.array([friction[contact] for contact in order])
    )


@given(st.integers(0, 10**6))
def test_random_planes_keep_their_velocities(seed):
    rng = np.random.default_rng(seed)
    bodies, contacts = int(rng.integers(2, 5)), int(rng.integers(1, 7))
    masses = np.zeros((bodies, 6, 6))
    # A principal axis of inertia across the plane, the others anyhow.
    for mass in masses:
        mass[:3, :3] = rng.uniform(0.5, 2.0) * np.eye(3)
        root = rng.normal(size=(2, 2))
        mass[np.ix_([3, 5], [3, 5])] = root @ root.T + np.eye(2)
        mass[4, 4] = rng.uniform(0.5, 2.0)
    system = stacked([(planar_blocks(rng, bodies, contacts), masses)], rng)
    solution = assert_same_velocities(system, formulation="cone")
    assert_swept_alike(system, formulation="cone")
    report = solution.presolve
    assert {"planar", "collinear", "inactive"} & {reduction.name for reduction in report.reductions}
    assert report.after.rows <= 2 * contacts


@given(st.integers(0, 10**6))
def test_random_islands_keep_their_velocities(seed):
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(int(rng.integers(1, 4))):
        part = planar_blocks(rng, 3, int(rng.integers(1, 5)))
        if rng.random() < 0.3:
            # Out of its plane.
            part[2][0] = part[2][0] + 0.1
        if rng.random() < 0.3:
            part = (*part[:3], [0.0] * len(part[3]), part[4])
        if rng.random() < 0.3:
            # A duplicate.
            for items in part[:4]:
                items.append(items[-1])
        parts.append((part, np.tile(np.diag([1.0, 1.0, 1.0, 2.0, 3.0, 4.0]), (3, 1, 1))))
    system = stacked(parts, rng)
    assert_same_velocities(system, formulation="cone")
    assert_swept_alike(system, formulation="cone")


@given(seed=st.integers(0, 10**6))
def test_random_systems_that_cannot_be_reduced_are_solved_as_they_are(seed, random_system):
    solution = assert_same_velocities(random_system(seed % 1000, contacts=8), formulation="cone")
    assert solution.presolve is None or solution.presolve.islands > 1


def test_an_axis_of_inertia_out_of_the_plane_is_seen():
    """A cube on two edges, moving in a plane, whose inertia would turn it out of that plane."""
    rng = np.random.default_rng(4)
    straight = np.tile(np.diag([1.0, 1.0, 1.0, 2.0, 3.0, 4.0]), (3, 1, 1))
    skew = straight.copy()
    skew[:, 3, 4] = skew[:, 4, 3] = 0.5
    part = planar_blocks(rng, 3, 6)
    names = [{item.name for item in gpx.presolve(stacked([(part, mass)], rng)).reductions} for mass in (straight, skew)]
    assert "planar" in names[0]
    assert "planar" not in names[1]


def test_contacts_that_lie_unequally_about_the_plane_are_weighed():
    """A beam that rests on two points at y = -1 and y = 2 m, its centre of mass at y = 0: 2/3 and 1/3 of the load."""
    rows = []
    for y in (-1.0, 2.0):
        frame = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        rows.append(np.hstack((frame, np.cross([0.0, y, -0.5], frame))))
    free = np.array([0.3, 0.0, -1.0, 0.0, 0.0, 0.0])
    jacobian = np.vstack(rows)
    system = gpx.StackedSystem.from_jacobian(jacobian, [np.eye(6)], -jacobian @ free, [0.05, 0.05])
    solution = assert_same_velocities(system)
    assert [item.name for item in solution.presolve.reductions] == ["planar", "closed form"]
    assert solution.impulse[0, 0] == pytest.approx(2.0 * solution.impulse[1, 0])


@pytest.mark.parametrize("formulation", ["normal", "cone", "coulomb"])
def test_one_contact_is_solved_by_hand(formulation):
    rng = np.random.default_rng(11)
    for _ in range(50):
        jacobian = rng.normal(size=(3, 6))
        B = rng.normal(size=3)
        system = gpx.StackedSystem.from_jacobian(jacobian, np.ones(6), B, [rng.uniform(0.0, 0.8)])
        solution = gpx.solve(system, formulation, tolerance=1e-13)
        assert solution.status is gpx.Status.SOLVED
        assert solution.iterations == 0


def test_duplicates_share_equally():
    rng = np.random.default_rng(3)
    one = rng.normal(size=(3, 6))
    other = rng.normal(size=(3, 6))
    jacobian = np.vstack((one, other, one))
    B = np.concatenate(([1.0, 0.1, 0.0], [0.5, 0.0, 0.2], [1.0, 0.1, 0.0]))
    system = gpx.StackedSystem.from_jacobian(jacobian, np.ones(6), B, [0.3, 0.2, 0.3])
    solution = assert_same_velocities(system)
    assert [item.name for item in solution.presolve.reductions] == ["duplicates"]
    np.testing.assert_array_equal(solution.impulse[0], solution.impulse[2])


def islands(count, height=6):
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    rng = np.random.default_rng(5)
    for place in range(count):
        for level in range(height):
            scene.add_rigid(
                gpx.Box(1, 1, 1),
                1.0,
                position=(3.0 * place, 0.0, 0.5 + level),
                velocity=rng.normal(size=3),
                angular_velocity=rng.normal(size=3),
            )
    return scene


@pytest.mark.parametrize("solver", ["interior_point", "pgs"])
def test_islands_do_not_depend_on_the_number_of_threads(solver):
    system = gpx.World(islands(8), time_step=1 / 240).system()
    alone = gpx.solve(system, solver=solver)
    assert alone.presolve.islands == 8
    assert alone.status is gpx.Status.SOLVED
    for threads in (2, 3):
        other = gpx.solve(system, solver=solver, threads=threads)
        np.testing.assert_array_equal(other.impulse, alone.impulse)
        assert other.iterations == alone.iterations
        assert other.history == alone.history


def test_a_large_wall_is_as_planar_on_any_number_of_threads():
    """Its pieces are worked out by the threads, and put together again."""
    system = gpx.World(gpx.scenes.wall(24), time_step=1 / 240).system()
    effort = {"solver": "pgs", "tolerance": 1e-15, "max_iterations": 5}
    alone = gpx.solve(system, **effort)
    assert [item.name for item in alone.presolve.reductions] == ["planar"]
    for threads in (2, 3):
        other = gpx.solve(system, threads=threads, **effort)
        np.testing.assert_array_equal(other.impulse, alone.impulse)
        assert other.presolve == alone.presolve
    newton = [gpx.solve(system, solver="newton", tolerance=1e-12, presolve=presolve) for presolve in (True, False)]
    np.testing.assert_allclose(newton[0].velocity, newton[1].velocity, atol=1e-10)


@pytest.mark.parametrize("formulation", ["normal", "cone", "coulomb"])
def test_threads_share_a_large_part_and_small_ones_alike(formulation):
    """One island of 2 800 contacts that is most of the system, swept by threads, beside some that are handed out."""
    scene = islands(6)
    for level in range(40):
        for place in range(12):
            scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(20.0 + place, 20.0, 0.5 + level), velocity=(0, 0, -level))
    system = gpx.World(scene, time_step=1 / 240).system()
    effort = {"solver": "pgs", "max_iterations": 30, "tolerance": 1e-15}
    alone = gpx.solve(system, formulation, **effort)
    assert alone.presolve.islands > 1
    for threads in (2, 4):
        np.testing.assert_array_equal(gpx.solve(system, formulation, threads=threads, **effort).impulse, alone.impulse)


def test_what_a_twentieth_would_leave_is_not_taken_apart():
    """A large island that stays as it is, with one small one: solving them apart gains nothing."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    rng = np.random.default_rng(8)
    for level in range(30):
        spin = 0.1 * rng.normal(size=3)
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.5 + level), velocity=spin, angular_velocity=spin)
    scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(9, 0, 0.5), velocity=(1, 1, 0))
    system = gpx.World(scene, time_step=1 / 240).system()
    solution = gpx.solve(system, solver="pgs", tolerance=1e-3)
    assert gpx.presolve(system).islands == 2
    assert gpx.presolve(system).after.contacts == system.contacts
    assert solution.presolve is None


def test_a_body_that_nothing_moves_joins_no_islands():
    jacobian = np.array([[1.0, -1.0, 0.0], [0.0, -1.0, 1.0]])
    joined = gpx.StackedSystem.from_jacobian(jacobian, [1.0, 1.0, 1.0], [1.0, 1.0], [0.0, 0.0])
    apart = gpx.StackedSystem.from_jacobian(jacobian, [1.0, 0.0, 1.0], [1.0, 1.0], [0.0, 0.0])
    assert gpx.presolve(joined).islands == 1
    assert gpx.presolve(apart).islands == 2
    np.testing.assert_allclose(gpx.solve(apart).impulse, 1.0)


def test_nothing_that_closes_needs_no_impulse():
    system = gpx.StackedSystem.from_jacobian(np.eye(3), np.ones(3), [-1.0, 0.5, 0.0], [0.5])
    solution = gpx.solve(system)
    np.testing.assert_array_equal(solution.impulse, 0.0)
    assert solution.presolve.reductions[0].name == "inactive"
    # The convex law couples sliding and opening: there, sliding faster than it opens, it needs one.
    fast = gpx.StackedSystem.from_jacobian(np.eye(3), np.ones(3), [-0.1, 0.5, 0.0], [0.5])
    assert gpx.solve(fast, "cone").impulse[0, 0] > 0.0


@pytest.mark.parametrize("name", ["wall", "slope that does not", "tower", "arch"])
def test_a_start_that_is_solved_is_only_judged(name):
    system = gpx.World(SCENES[name](), time_step=1 / 240).system()
    first = gpx.solve(system, solver="pgs", tolerance=1e-9)
    again = gpx.solve(system, solver="pgs", tolerance=1e-8, warm_start=first.impulse)
    assert first.presolve is not None
    assert again.presolve is None
    assert again.iterations == 0
    np.testing.assert_array_equal(again.impulse, first.impulse)


def test_sweeps_start_from_the_impulses_of_the_whole():
    system = gpx.World(SCENES["arch"](), time_step=1 / 240).system()
    rough = gpx.solve(system, solver="pgs", tolerance=1e-3)
    cold = gpx.solve(system, solver="pgs", tolerance=1e-5)
    warm = gpx.solve(system, solver="pgs", tolerance=1e-5, warm_start=rough.impulse)
    assert cold.presolve is not None
    assert 0 < warm.iterations < cold.iterations


def test_each_part_has_all_sweeps_to_itself():
    """The status is that of the worst part, the number of sweeps that of the longest."""
    system = gpx.World(islands(3, 10), time_step=1 / 240).system()
    solution = gpx.solve(system, solver="pgs", tolerance=1e-12, max_iterations=20)
    assert solution.status is gpx.Status.MAX_ITERATIONS
    assert solution.iterations == 20
    assert solution.extras["stopped_by"] == "max_sweeps"
    sweeps, residual = solution.history[-1]
    assert sweeps == 20
    assert residual >= solution.program_residual * (1.0 - 1e-6)


def test_islands_that_start_from_a_solution_keep_it():
    """Whatever must be solved beside them."""
    system = gpx.World(islands(5), time_step=1 / 240).system()
    island = np.repeat(np.arange(5), system.contacts // 5)
    start = gpx.solve(system, tolerance=1e-10).impulse.copy()
    start[island == 3] *= 0.9
    effort = {"solver": "pgs", "tolerance": 1e-8}
    again = gpx.solve(system, **effort, warm_start=start)
    assert again.status is gpx.Status.SOLVED
    (resting,) = (reduction for reduction in again.presolve.reductions if reduction.name == "resting")
    assert resting.islands == 4
    assert resting.removed.contacts == (island != 3).sum()
    # Starts are brought into their cones, by rounding where they were solutions.
    np.testing.assert_allclose(again.impulse[island != 3], start[island != 3], rtol=1e-14, atol=1e-15)
    assert np.abs(again.impulse - start)[island == 3].max() > 1e-3
    cold = gpx.solve(system, **effort, warm_start=0.5 * start)
    assert cold.status is gpx.Status.SOLVED
    assert "resting" not in {reduction.name for reduction in cold.presolve.reductions}


@pytest.mark.parametrize("settings", [dict(solver="newton"), dict(solver="pgs", tolerance=1e-5)], ids=str)
def test_a_wall_rests_beside_a_box_whose_load_changes(settings):
    """It keeps its impulses, native and staged alike, and stands as it would alone."""
    scene = gpx.scenes.wall(6)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(-20.0, 0.0, 0.5))
    native, staged = (gpx.World(scene, time_step=1 / 240, **settings) for _ in range(2))
    staged._native = None
    resting = 0
    for step in range(120):
        for world in (native, staged):
            world.forces[-1, 2] = -3.0 * np.sin(0.3 * step)
            world.step()
            assert world.unsolved_steps == 0
        assert np.array_equal(native.positions, staged.positions)
        assert np.array_equal(native.contacts.impulse, staged.contacts.impulse)
        report = native.solution.presolve
        if step >= 60 and report is not None:
            resting += any(reduction.name == "resting" for reduction in report.reductions)
    assert resting > 40
    assert np.abs(native.velocities[:-1]).max() < 1e-5


def test_islands_are_swept_as_one_until_most_are_done():
    """Then the slow one goes on by itself, and is within what the whole may leave."""
    scene = islands(40, height=2)
    rng = np.random.default_rng(3)
    for level in range(20):
        motion = 0.3 * rng.normal(size=(2, 3))
        scene.add_rigid(
            gpx.Box(1, 1, 1), 1.0, position=(-3.0, 0.0, 0.5 + level), velocity=motion[0], angular_velocity=motion[1]
        )
    system = gpx.World(scene, time_step=1 / 240).system()
    one, other = (gpx.solve(system, solver="pgs", tolerance=1e-8, presolve=p) for p in (False, True))
    assert one.status is other.status is gpx.Status.SOLVED
    assert one.presolve is None
    assert other.presolve.islands == 41
    sweeps, residuals = zip(*other.history, strict=True)
    assert list(sweeps) == sorted(sweeps)
    assert sweeps[-1] == other.iterations > 160
    assert residuals[-1] <= 1e-8
    # The whole was looked at after every ten sweeps, the rest in the end.
    assert 10 * len(sweeps) < other.iterations
    difference = system.velocity(one.impulse) - system.velocity(other.impulse)
    assert np.abs(difference).max() < 1e-6 * np.abs(system.B).max()


@pytest.mark.parametrize("formulation", ["box", "pyramid"])
def test_polygons_are_swept_as_they_are(formulation):
    system = gpx.World(SCENES["wall"](), time_step=1 / 240).system()
    one, other = (gpx.solve(system, formulation, "pgs", tolerance=1e-6, presolve=p) for p in (False, True))
    assert other.presolve is None
    np.testing.assert_array_equal(one.impulse, other.impulse)


@pytest.mark.parametrize("seed", range(3))
def test_a_slow_island_may_leave_what_the_others_do_not(seed):
    """What counts is the residual of the whole: parts need no more sweeps for it than the whole does."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    rng = np.random.default_rng(seed)
    for place in range(20):
        for level in range(8):
            linear, angular = 0.3 * rng.normal(size=(2, 3))
            at = (3.0 * place, 0.0, 0.5 + level)
            scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=at, velocity=linear, angular_velocity=angular)
    system = gpx.World(scene, time_step=1 / 240).system()
    whole, parts = (gpx.solve(system, solver="pgs", tolerance=1e-4, presolve=p) for p in (False, True))
    assert parts.presolve.islands == 20
    assert parts.status is whole.status is gpx.Status.SOLVED
    assert parts.iterations <= 1.2 * whole.iterations


def test_quick_islands_beside_a_slow_one_come_to_the_same_velocities():
    """Most are left alone long before the tall tower is done."""
    scene = islands(12, 4)
    rng = np.random.default_rng(6)
    for level in range(30):
        at, spin = (0.0, 20.0, 0.5 + level), 0.3 * rng.normal(size=3)
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=at, velocity=spin, angular_velocity=spin)
    system = gpx.World(scene, time_step=1 / 240).system()
    effort = {"solver": "pgs", "tolerance": 1e-9, "max_iterations": 100_000}
    solution, whole = (gpx.solve(system, "cone", presolve=presolve, **effort) for presolve in (True, False))
    assert solution.status is whole.status is gpx.Status.SOLVED
    assert solution.iterations > 400
    np.testing.assert_allclose(solution.velocity, whole.velocity, atol=1e-6)


def test_a_system_by_its_matrix_is_swept_by_islands():
    system = gpx.World(islands(4, 10), time_step=1 / 240).system()
    system = gpx.StackedSystem(system.A, system.B, system.friction)
    solution = assert_swept_alike(system, formulation="cone")
    assert solution.presolve.islands == 4


def test_contacts_of_three_bodies_are_presolved_too():
    """Two contacts, each twice over."""
    rng = np.random.default_rng(2)
    jacobian, B = np.tile(rng.normal(size=(6, 18)), (2, 1)), np.tile(rng.normal(size=6), 2)
    system = gpx.StackedSystem.from_jacobian(jacobian, np.tile(np.eye(6), (3, 1, 1)), B, [0.4] * 4)
    solution = assert_swept_alike(system, formulation="cone")
    assert [item.name for item in solution.presolve.reductions] == ["duplicates"]


def test_the_limit_of_time_is_that_of_all_parts():
    system = gpx.World(islands(3, 30), time_step=1 / 240).system()
    endless = {"solver": "pgs", "tolerance": 1e-15, "max_iterations": 10**9, "acceleration": False}
    tick = perf_counter()
    solution = gpx.solve(system, time_limit=0.05, **endless)
    assert perf_counter() - tick < 1.0
    assert solution.status is gpx.Status.MAX_ITERATIONS
    assert solution.extras["stopped_by"] == "time_limit"


@pytest.mark.parametrize("solver", ["newton", "interior_point", "pgs"])
@pytest.mark.parametrize("name", ["wall", "slope that does not", "tower", "frictionless pile"])
def test_worlds_move_the_same(name, solver):
    effort = {"iterations": 100_000} if solver == "pgs" else {}
    worlds = [
        gpx.World(SCENES[name](), time_step=1 / 240, solver=solver, presolve=presolve, tolerance=1e-12, **effort)
        for presolve in (False, True)
    ]
    for world in worlds:
        world.step(20)
    np.testing.assert_allclose(worlds[0].velocities, worlds[1].velocities, atol=1e-10)
    np.testing.assert_allclose(worlds[0].positions, worlds[1].positions, atol=1e-11)
    assert worlds[0].solution.presolve is None


def test_balls_without_friction_are_not_turned():
    """Three velocities a ball, whatever it spins about; a ball that is no ball to the law of inertia, too."""
    scene = gpx.Scene()
    smooth = gpx.Material(0.0)
    scene.add_static(gpx.Box(4, 4, 1), position=(0, 0, -0.5), material=smooth)
    scene.add_static(gpx.HalfSpace((-0.6, 0.0, 0.8)), position=(1.0, 0.0, 0.0), material=smooth)
    for k, inertia in enumerate([None, (0.1, 0.12, 0.2)]):
        options = dict(velocity=(1.0, 0.2, -1.0), angular_velocity=(1.0, 2.0, 3.0), inertia=inertia)
        scene.add_rigid(gpx.Sphere(0.4), 1.0, position=(0.3 * k, 0.1, 0.5 + 0.9 * k), material=smooth, **options)
    small, plain = (gpx.World(scene, 1 / 240, presolve=presolve) for presolve in (True, False))
    for _ in range(120):
        small.step()
        plain.step()
        np.testing.assert_allclose(small.velocities, plain.velocities, atol=1e-10)
        np.testing.assert_allclose(small.orientations, plain.orientations, atol=1e-10)
    assert small.contacts.impulse.any()
    assert small.system().jacobian.shape[1] == 6 and plain.system().jacobian.shape[1] == 12


def tower_that_sways(height):
    """A tower whose cubes all move in the plane x-z."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    rng = np.random.default_rng(3)
    for level in range(height):
        across, along, turn = 0.3 * rng.normal(size=3)
        position, velocity = (0.0, 0.0, 0.5 + level), (across, 0.0, along)
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=position, velocity=velocity, angular_velocity=(0.0, turn, 0.0))
    return scene


@pytest.mark.parametrize("solver", ["newton", "pgs"])
@pytest.mark.parametrize("scene", [gpx.scenes.wall(4), tower_that_sways(3)], ids=["wall", "tower"])
def test_what_moves_in_a_plane_stays_in_it_for_a_thousand_steps(scene, solver):
    """Lifted impulses mirror each other, and what they add to velocities cancels to the last bit."""
    world = gpx.World(scene, 1 / 240, solver=solver, tolerance=1e-6, warm_start=False)
    world.step(1000)
    assert [reduction.name for reduction in world.solution.presolve.reductions] == ["planar"]
    assert np.abs(world.velocities[:, [1, 3, 5]]).max() < 1e-25


@pytest.mark.parametrize(("solver", "tolerance"), [("newton", 1e-8), ("pgs", 1e-5)])
@pytest.mark.parametrize(
    "scene", [gpx.scenes.wall(4), gpx.scenes.arch(), gpx.scenes.card_house()], ids=["wall", "arch", "cards"]
)
def test_what_stands_in_a_plane_stays_in_it_under_a_changing_load(scene, solver, tolerance):
    """Also where steps begin from the impulses of the last one, and a few sweeps do; also where faces are oblique."""
    world = gpx.World(scene, 1 / 240, solver=solver, tolerance=tolerance)
    planar = 0
    for step in range(600):
        world.gravity = (0.0, 0.0, -9.81 * (1.0 + 0.3 * np.sin(0.05 * step)))
        world.step()
        report = world.solution.presolve
        planar += report is not None and report.reductions[0].name == "planar"
    assert planar > 500
    assert np.abs(world.velocities[:, [1, 3, 5]]).max() < 1e-25


def two_columns():
    """A tower of cubes beside a column of balls: every contact has a constant row, to the last bit."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    for level in range(4):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0.0, 0.0, 0.5 + level))
        scene.add_point_mass(1.0, position=(3.0, 0.0, 0.5 + level), shape=gpx.Sphere(0.5))
    return scene


@pytest.mark.parametrize("solver", ["newton", "pgs"])
@pytest.mark.parametrize(
    "scene", [gpx.scenes.column(12), gpx.scenes.tower(6), two_columns()], ids=["balls", "cubes", "both"]
)
def test_what_is_remembered_of_a_structure_changes_no_bit(scene, solver):
    """Loads that swing, push aside, lift and come back: as by stages, which remember nothing."""
    native, staged = (gpx.World(scene, 1 / 240, solver=solver, tolerance=1e-8) for _ in range(2))
    staged._native = None
    closed = 0
    for step in range(60):
        lean, lift = (2.0 if 20 <= step < 24 else 0.0), (15.0 if 40 <= step < 43 else 0.0)
        for world in (native, staged):
            world.gravity = (lean, 0.0, lift - 9.81 * (1.0 + 0.5 * np.sin(0.3 * step)))
            world.step()
        assert np.array_equal(native.velocities, staged.velocities), step
        assert np.array_equal(native.contacts.impulse, staged.contacts.impulse), step
        one, other = native.solution.presolve, staged.solution.presolve
        assert str(one) == str(other), step
        closed += one is not None and one.after.contacts == 0
    assert closed > 15


def test_a_step_tells_what_presolve_did():
    world = gpx.World(gpx.scenes.wall(3), time_step=1 / 240, warm_start=False)
    world.step()
    assert [reduction.name for reduction in world.solution.presolve.reductions] == ["planar"]


def test_the_report_prints_as_a_table():
    text = str(gpx.presolve(gpx.scenes.wall(2)))
    assert text.splitlines()[0].split() == ["islands", "contacts", "rows", "velocities"]
    assert [line.split()[0] for line in text.splitlines()[1:]] == ["before", "planar", "after"]


@pytest.mark.parametrize(
    ("options", "message"),
    [({"presolve": 1}, "presolve is 1"), ({"threads": 0}, "threads is 0"), ({"threads": True}, "threads is True")],
)
def test_bad_settings_are_refused(options, message):
    with pytest.raises(gpx.SettingsError, match=message):
        gpx.solve(chain([1.0], [-1.0]), **options)


def test_what_cannot_be_reduced_is_refused():
    with pytest.raises(gpx.ProblemError, match="what is a ndarray"):
        gpx.presolve(np.eye(3))
    with pytest.raises(gpx.SettingsError, match="formulation is 'box'"):
        gpx.presolve(gpx.scenes.tower(1), "box")
