"""Presolve for solvers outside the core: the same answer from parts, whoever solves them."""

from dataclasses import replace
from time import sleep

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

import gpx_lcp as gpx
from gpx_lcp.core_system import core_system, program_residual
from gpx_lcp.solvers import Outcome, Request, Solver, lemke
from gpx_lcp.solvers._reduced import presolving

STEP = 1 / 240
BACKENDS = [name for name in ("osqp", "clarabel", "scs", "daqp", "piqp", "proxqp") if gpx.solvers()[name].installed]
PAIRS = [
    (formulation, name)
    for formulation in ("normal", "cone")
    for name in ("lemke", *BACKENDS)
    if formulation in gpx.solvers()[name].programs
]


def towers(count=3, height=4):
    """Towers that know nothing of each other, each cube with a random velocity, and a ball that touches nothing."""
    scene, rng = gpx.Scene(), np.random.default_rng(3)
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0.0, 9.0, 5.0))
    for place in range(count):
        for level in range(height):
            at, spin = (3.0 * place, 0.0, 0.5 + level), 0.3 * rng.normal(size=3)
            scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=at, velocity=spin, angular_velocity=spin)
    return scene


SCENES = {
    "column": (lambda: gpx.scenes.column(30), 0),
    "tower": (lambda: gpx.scenes.tower(12), 0),
    "wall": (lambda: gpx.scenes.wall(4), 0),
    "smooth pile": (lambda: gpx.scenes.sphere_pile(20, friction=0.0), 150),
    "towers": (towers, 0),
}


def system_of(name):
    make, steps = SCENES[name]
    world = gpx.World(make(), time_step=STEP, presolve=False)
    world.step(steps)
    return world.system()


def both(system, formulation, name, tolerance):
    """Solve as asked and presolved; the velocities that the formulation speaks of agree, as far as they are solved."""
    plain, smaller = (
        gpx.solve(system, formulation, name, tolerance=tolerance, presolve=presolve, time_limit=10.0)
        for presolve in (False, True)
    )
    assert plain.presolve is None
    # Parts are solved wherever the whole is, and else about as well.
    assert smaller.program_residual <= (tolerance if plain.status is gpx.Status.SOLVED else 10 * plain.program_residual)
    spoken_of = 1 if formulation == "normal" else system.rows
    error = np.abs(smaller.velocity - plain.velocity)[:, :spoken_of].max()
    # A residual bounds the error of velocities but for how ill-conditioned A is.
    assert error <= 100 * max(tolerance, plain.program_residual) * np.abs(system.B).max()
    return smaller


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(("formulation", "name"), PAIRS)
def test_scenes_keep_their_velocities(formulation, name, scene):
    both(system_of(scene), formulation, name, 1e-8)


@pytest.mark.parametrize("scene", SCENES)
def test_scenes_keep_their_velocities_to_the_last_digits(scene):
    assert both(system_of(scene), "normal", "lemke", 1e-12).status is gpx.Status.SOLVED


def blocks(seed, sizes, rows=3, friction=0.5):
    """A system by its A alone, of islands with so many contacts."""
    rng = np.random.default_rng(seed)
    factors = [rng.normal(size=(rows * n, rows * n + 3)) for n in sizes]
    count = sum(sizes)
    matrix = sp.block_diag([factor @ factor.T for factor in factors]).toarray()
    return gpx.StackedSystem(matrix, rng.normal(size=rows * count), np.full(count, friction))


@given(st.integers(0, 10**6), st.sampled_from([pair for pair in PAIRS if pair[1] in ("lemke", "clarabel")]))
def test_blocks_of_a_matrix_keep_their_velocities(seed, pair):
    sizes = [int(n) for n in np.random.default_rng(seed).integers(1, 6, size=3)]
    both(blocks(seed, sizes), *pair, 1e-8)


@pytest.mark.parametrize(("formulation", "name"), PAIRS)
def test_what_is_solved_by_hand_needs_no_backend(formulation, name):
    system = gpx.World(gpx.scenes.tower(30), time_step=STEP).system()
    solution = gpx.solve(system, formulation, name, tolerance=1e-12)
    assert (solution.status, solution.iterations) == (gpx.Status.SOLVED, 0)
    assert solution.method == f"{formulation}/{name}"
    assert [item.name for item in solution.presolve.reductions] == ["collinear", "closed form"]
    assert solution.presolve.after == (0, 0, 0)
    assert solution.extras == {}
    loads = 9.81 * STEP * np.repeat(np.arange(30, 0, -1.0), 4) / 4
    np.testing.assert_allclose(solution.impulse[:, 0], loads, rtol=1e-12)


@pytest.mark.parametrize("formulation", ["box", "pyramid"])
def test_polygons_are_solved_as_they_are(formulation):
    system = gpx.World(gpx.scenes.tower(2), time_step=STEP).system()
    assert gpx.solve(system, formulation, "lemke").presolve is None


class Recorder:
    """Lemke's method as a backend like any other, which keeps what it was asked; `change` may spoil what it finds."""

    def __init__(self, change=lambda request, outcome: outcome, **row):
        self.asked: list[Request] = []
        self._change = change
        self.row = presolving(Solver("recorder", "", {"normal": "LCP"}, self._run, **row))

    def _run(self, request: Request) -> Outcome:
        self.asked.append(request)
        found = lemke.SOLVER.run(replace(request, warm_start=None))
        return self._change(request, found)

    def __call__(self, system, **effort):
        known = dict(max_iterations=None, time_limit=None, warm_start=None, facets=8, presolve=True, settings={})
        return self.row.run(Request(system, "normal", **{"tolerance": 1e-8, **known, **effort}))


def walls(count=2):
    """Walls that know nothing of each other: each is reduced to the plane."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    for place in range(count):
        for body in gpx.scenes.wall(3).bodies:
            at = np.add(body.position, (20.0 * place, 0.0, 0.0))
            scene.add_rigid(body.shape, body.mass, position=at, orientation=body.orientation)
    return gpx.World(scene, time_step=STEP).system()


@pytest.mark.parametrize("apart", [True, False])
def test_parts_go_one_by_one_or_those_of_a_shape_together(apart):
    system, solver = blocks(0, [40, 50]), Recorder(apart=apart)
    outcome = solver(system)
    assert [request.system.contacts for request in solver.asked] == ([40, 50] if apart else [90])
    assert outcome.status is gpx.Status.SOLVED
    if apart:
        assert [part["unknowns"] for part in outcome.extras["parts"]] == [40, 50]
        pivots = [lemke.SOLVER.run(request).iterations for request in solver.asked]
        assert outcome.iterations == max(pivots)


def test_without_presolve_the_system_is_solved_as_it_is():
    system, solver = walls(), Recorder()
    assert solver(system, presolve=False).presolved is None
    assert [request.system for request in solver.asked] == [system]


def test_velocities_alone_are_no_gain():
    """Without rotations the bodies of a smooth pile have half the velocities, and the program as many impulses."""
    system, solver = system_of("smooth pile"), Recorder()
    solver(system)
    report = gpx.presolve(system)
    assert report.after.contacts == report.before.contacts and report.after.velocities < report.before.velocities
    assert [request.system for request in solver.asked] == [system]


def disturbed(request, outcome):
    """Spoil an answer until its residual is just within what was asked, where there was no impulse if anywhere."""
    system, impulse = request.system, outcome.impulse
    change = np.zeros(impulse.shape)
    change[:, 0] = (impulse[:, 0] == 0.0) if (impulse[:, 0] == 0.0).any() else 1.0
    low, high = 0.0, 1e3 * np.abs(impulse).max()
    for _ in range(60):
        middle = 0.5 * (low + high)
        residual = program_residual(system, "normal", impulse + middle * change, request.facets)
        low, high = (middle, high) if residual <= request.tolerance else (low, middle)
    return replace(outcome, impulse=impulse + low * change)


def duplicated():
    """Two contacts once, and two of the same island eight times over."""
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(4, 6))
    order = [0, 1, *[2, 3] * 8]
    B = np.array([1e-2, 1e-2, 1.0, 1.0])
    inverse = np.ones(6)
    return gpx.StackedSystem.from_jacobian(rows[order], inverse, B[order], np.zeros(len(order)))


def stiff_tangents():
    """Contacts that move ten times as easily along their tangents, which nobody asks for."""
    system, scale = blocks(1, [3, 40, 8]), np.tile([1.0, 10.0, 10.0], 51)
    return gpx.StackedSystem(scale[:, None] * system.A * scale, system.B * (scale == 1.0), system.friction)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
@pytest.mark.parametrize("make", [walls, duplicated, stiff_tangents])
def test_parts_just_within_their_tolerances_are_within_that_of_the_whole(make, tolerance):
    system, solver = make(), Recorder(disturbed, apart=True)
    outcome = solver(system, tolerance=tolerance)
    residual = program_residual(system, "normal", outcome.impulse, 8)
    assert all(request.system is not system for request in solver.asked)
    assert 0.01 * tolerance <= residual <= tolerance


def test_a_start_is_that_of_the_parts():
    system = walls()
    solution = gpx.solve(system, "normal", "lemke", tolerance=1e-12)
    cold, warm = Recorder(warm_starts=True), Recorder(warm_starts=True)
    cold(system)
    warm(system, warm_start=2.0 * solution.impulse)
    assert [request.warm_start for request in cold.asked] == [None]
    (request,) = warm.asked
    assert program_residual(request.system, "normal", 0.5 * request.warm_start, 8) <= 1e-11


def test_what_starts_from_a_solution_keeps_it():
    system = blocks(0, [40, 50])
    solution = gpx.solve(system, "normal", "lemke", tolerance=1e-12)
    solver = Recorder(apart=True, warm_starts=True)
    kept = solver(system, warm_start=solution.impulse)
    assert (solver.asked, kept.iterations, kept.status) == ([], 0, gpx.Status.SOLVED)
    np.testing.assert_array_equal(kept.impulse, solution.impulse)
    # The second block has none.
    start = np.vstack((solution.impulse[:40], np.zeros((50, 3))))
    found = solver(system, warm_start=start)
    assert [request.system.contacts for request in solver.asked] == [50]
    np.testing.assert_array_equal(found.impulse[:40], solution.impulse[:40])
    np.testing.assert_allclose(found.impulse[40:], solution.impulse[40:], atol=1e-7)
    as_asked = Recorder(warm_starts=True)
    as_asked(system, warm_start=solution.impulse, presolve=False)
    assert len(as_asked.asked) == 1


def test_a_start_that_does_nothing_but_hold_itself_is_not_kept():
    """Two walls hold a body between them that hardly moves towards one; a third contact opens."""
    matrix = [[1.0, -1.0, 0.1], [-1.0, 1.0, -0.1], [0.1, -0.1, 1.0]]
    system, solver = gpx.StackedSystem(matrix, [1e-9, 0.0, -1.0], np.zeros(3)), Recorder(warm_starts=True)
    outcome = solver(system, warm_start=np.array([[1.0], [1.0], [0.0]]))
    assert (solver.asked, outcome.status) == ([], gpx.Status.SOLVED)
    assert not outcome.impulse.any()


@pytest.mark.parametrize("name", [name for name in BACKENDS if gpx.solvers()[name].warm_starts])
def test_a_warm_start_is_a_good_start(name):
    system = gpx.World(gpx.scenes.wall(6), time_step=STEP).system()
    cold = gpx.solve(system, "normal", name)
    warm = gpx.solve(system, "normal", name, warm_start=1.001 * cold.impulse)
    assert warm.presolve is not None
    assert warm.status is gpx.Status.SOLVED
    assert warm.iterations <= max(cold.iterations, 2)
    again = gpx.solve(system, "normal", name, warm_start=warm.impulse)
    assert (again.status, again.iterations) == (gpx.Status.SOLVED, 0)


def test_limits_are_those_of_each_part_and_of_all():
    def slow(request, outcome):
        sleep(0.05)
        return outcome

    system, start = blocks(0, [40, 50]), np.ones((90, 3)) * [1.0, 0.0, 0.0]
    solver = Recorder(slow, apart=True, warm_starts=True)
    outcome = solver(system, time_limit=0.04, warm_start=start)
    (request,) = solver.asked
    assert 0.0 < request.time_limit < 0.04
    assert outcome.status is gpx.Status.MAX_ITERATIONS
    np.testing.assert_array_equal(outcome.impulse[40:], start[40:])
    unhurried = Recorder(slow, apart=True)
    unhurried(system, time_limit=9.0, max_iterations=70)
    assert [request.max_iterations for request in unhurried.asked] == [70, 70]
    first, second = (request.time_limit for request in unhurried.asked)
    assert second <= first - 0.05


def crushed():
    """A mass driven into two walls, every contact twice over, beside one that lies on the ground."""
    rows = np.array([[1.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    return gpx.StackedSystem.from_jacobian(rows, [1.0, 1.0], [1.0, 1.0, 0.5, 0.5, 0.3], np.zeros(5))


@pytest.mark.parametrize("by_matrix", [False, True])
def test_a_part_without_a_solution_proves_that_there_is_none(by_matrix):
    system = crushed()
    if by_matrix:
        system = gpx.StackedSystem(system.A, system.B, system.friction)
    solution = gpx.solve(system, "normal", "lemke")
    assert solution.status is gpx.Status.INFEASIBLE
    assert solution.presolve.after.contacts == (4 if by_matrix else 2)
    y = solution.extras["infeasibility"]
    assert y.min() >= 0.0 and y.max() == 1.0
    np.testing.assert_allclose(system.apply(y), 0.0, atol=1e-12)
    assert system.B @ y.ravel() > 0.0
    # What has a solution is solved.
    np.testing.assert_allclose(solution.impulse[4], [0.3], rtol=1e-12)


@pytest.mark.parametrize("warm_starts", [True, False])
def test_the_whole_has_the_last_word_near_rounding(warm_starts):
    """A column is solved by hand to some 1e-14, which is more than is asked."""
    system, solver = gpx.World(gpx.scenes.column(100), time_step=STEP).system(), Recorder(warm_starts=warm_starts)
    by_hand = solver(system)
    assert not solver.asked
    outcome = solver(system, tolerance=1e-15)
    (request,) = solver.asked
    assert request.system is system
    if warm_starts:
        np.testing.assert_array_equal(request.warm_start, by_hand.impulse)
    else:
        assert request.warm_start is None
    residuals = [program_residual(system, "normal", found.impulse, 8) for found in (by_hand, outcome)]
    assert residuals[1] <= residuals[0]


def test_who_leaves_too_much_of_a_part_is_not_asked_again():
    system = walls()
    solver = Recorder(lambda request, outcome: replace(outcome, impulse=np.zeros(outcome.impulse.shape)), apart=True)
    outcome = solver(system)
    assert all(request.system is not system for request in solver.asked)
    assert np.isfinite(outcome.impulse).all()


@pytest.mark.parametrize("tolerance", [1e-12, 1e-15])
def test_an_island_that_rounding_moves_needs_no_solver(tolerance):
    """The noise of a cube's corners is none on average, and no measure of anything."""
    up, along, across = np.eye(3)[[2, 0, 1]]
    points = [(x, y, -0.5) for y in (0.5, -0.5) for x in (0.5, -0.5)]
    frames = [*[(up, along, across)] * 4, (along, up, across)]
    placed = zip((*points, (-0.5, 0.0, 0.2)), frames, strict=True)
    blocks = [np.hstack((frame, np.cross(point, frame))) for point, frame in placed]
    rng = np.random.default_rng(0)
    jacobian = sp.block_diag((np.vstack(blocks), rng.normal(size=(9, 12))))
    B = np.zeros((8, 3))
    B[:, 0] = [1e-14, -1e-14, -1e-14, 1e-14, 0.0, 1.0, 1.0, 1.0]
    system = gpx.StackedSystem.from_jacobian(jacobian, np.tile(np.eye(6), (3, 1, 1)), B.ravel(), np.zeros(8))
    _, parts, _ = core_system(system).reduced("normal", tolerance, True)
    assert sorted(np.abs(part.target).max() for part in parts) == [0.0, 1.0]
    solver = Recorder(apart=True)
    outcome = solver(system, tolerance=tolerance)
    assert program_residual(system, "normal", outcome.impulse, 8) <= 1e-12
    assert solver.asked[0].system.contacts == 3
    np.testing.assert_array_equal(outcome.impulse[:5], 0.0)


def test_a_part_may_be_less_symmetric_than_a_whole():
    """Six digits of the largest entry are few of the smallest."""
    system = blocks(0, [40, 50], rows=1)
    matrix, B = system.A.copy(), system.B.copy()
    matrix[40:, 40:] *= 1e-4
    B[40:] *= 1e-4
    matrix[40, 41] += 0.1 * matrix[40, 40]
    solver = Recorder(apart=True)
    system = gpx.StackedSystem(matrix, B, system.friction)
    outcome = solver(system)
    assert sorted(request.system.contacts for request in solver.asked) == [40, 50]
    assert program_residual(system, "normal", outcome.impulse, 8) <= 1e-8


@pytest.mark.parametrize("name", BACKENDS)
def test_worlds_step_with_what_is_left(name):
    one, other = (
        gpx.World(gpx.scenes.wall(3), time_step=STEP, solver=name, formulation="normal", presolve=presolve)
        for presolve in (True, False)
    )
    for world in (one, other):
        world.step(5)
    assert one.solution.presolve.after.contacts < one.solution.system.contacts
    assert other.solution.presolve is None
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-6)


def test_worlds_refuse_settings_that_a_backend_does_not_know():
    with pytest.raises(gpx.BackendError, match="osqp failed"):
        gpx.World(gpx.scenes.tower(2), time_step=STEP, solver="osqp", formulation="normal", no_such_setting=1)
