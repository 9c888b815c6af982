import signal

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

import gpx_lcp as gpx
from formulations import FORMULATIONS, RESIDUALS
from formulations.cones import project_friction_cone

FRICTIONAL = [name for name in FORMULATIONS if name != "normal"]
GRAVITY_STEP = 9.81 / 240
# Sweeps without momentum: what the theory of Gauss-Seidel is about.
PLAIN = {"acceleration": False}


def pgs(system, formulation="coulomb", **settings):
    """Sweep over the system as it is."""
    return gpx.solve(system, formulation, "pgs", presolve=False, **settings)


def explicit(system):
    """The same system by its matrix."""
    return gpx.StackedSystem(system.A, system.B, system.friction)


def tower(n, friction=0.5, seed=0, jolt=0.0):
    """n unit cubes on one another and on the ground, four contacts at each interface, after one step of gravity."""
    blocks, bodies, start = [], [], [0]
    frame = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for level in range(n):
        for corner in np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]]):
            for body, sign in ((level - 1, -1.0), (level, 1.0)):
                if body >= 0:
                    arm = np.array([*corner, level - body - 0.5])
                    blocks.append(sign * np.hstack((frame, -frame @ np.cross(np.eye(3), -arm))))
                    bodies.append(body)
            start.append(len(bodies))
    jacobian = sp.bsr_array((np.array(blocks), np.array(bodies), np.array(start)), shape=(12 * n, 6 * n))
    free = np.tile([0.0, 0.0, -GRAVITY_STEP, 0.0, 0.0, 0.0], n)
    free += jolt * np.random.default_rng(seed).normal(size=6 * n)
    inverse_mass = np.tile([1.0, 1.0, 1.0, 6.0, 6.0, 6.0], n)
    return gpx.StackedSystem.from_jacobian(
        jacobian, _blocks(inverse_mass, 6), -jacobian @ free, np.full(4 * n, friction), free_velocity=free
    )


def _blocks(diagonal, size):
    return diagonal.reshape(-1, size)[:, :, None] * np.eye(size)


def towers_apart(count):
    """Towers of 20 that move in space, and know nothing of each other."""
    rng = np.random.default_rng(1)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    for place in range(count):
        for level in range(20):
            linear, angular = 0.3 * rng.normal(size=(2, 3))
            position = (3.0 * place, 0.0, 0.5 + level)
            scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=position, velocity=linear, angular_velocity=angular)
    return scene


def point_mass(velocity, friction, mass=2.0):
    """One contact of a point mass with the ground; `velocity` is its free velocity, normal first."""
    return gpx.StackedSystem(np.eye(len(velocity)) / mass, -np.asarray(velocity), [friction])


# ---- answers known on paper


@pytest.mark.parametrize("n, sweeps", [(5, 183), (10, 743), (20, 2983)])
def test_column_contracts_as_theory_says(column, n, sweeps):
    """The error of Gauss-Seidel on a column of n equal masses shrinks by cos²(π/2n) a sweep."""
    system = column(n)
    exact = GRAVITY_STEP * np.arange(n, 0, -1.0)
    counts = np.array([4 * n * n // 10 * 10, 6 * n * n // 10 * 10])
    errors = [
        np.linalg.norm(pgs(system, "normal", tolerance=1e-15, max_iterations=int(count), **PLAIN).impulse[:, 0] - exact)
        for count in counts
    ]
    rate = np.cos(np.pi / (2 * n)) ** 2
    assert (errors[1] / errors[0]) ** (1.0 / (counts[1] - counts[0])) == pytest.approx(rate, rel=1e-3)
    predicted = np.log(errors[0] / 1e-8 / np.linalg.norm(exact)) / -np.log(rate) + counts[0]
    assert predicted == pytest.approx(sweeps, rel=0.05)
    solution = pgs(system, "normal", tolerance=1e-8, **PLAIN)
    assert solution.status is gpx.Status.SOLVED
    assert solution.iterations == pytest.approx(sweeps, rel=0.1, abs=10)


@pytest.mark.parametrize("ratio", [10, 100, 1000])
def test_heavy_on_light_contracts_by_ratio(column, ratio):
    system = column(2, top=ratio)
    exact = GRAVITY_STEP * np.array([ratio + 1.0, ratio])
    first, second = 10 * ratio // 10 * 10, 10 * ratio // 10 * 10 + 5 * ratio
    errors = [
        np.linalg.norm(pgs(system, "normal", tolerance=1e-15, max_iterations=count, **PLAIN).impulse[:, 0] - exact)
        for count in (first, second)
    ]
    assert (errors[1] / errors[0]) ** (1.0 / (second - first)) == pytest.approx(ratio / (ratio + 1.0), rel=1e-6)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_contact_separates_when_nothing_closes(formulation):
    solution = pgs(point_mass([1.0, 2.0, -1.0], 0.3), formulation)
    # Only the convex cone exerts an impulse here: its contacts must open at μ times their speed.
    if formulation == "cone":
        solution = pgs(point_mass([1.0, 2.0, -1.0], 0.3 * np.sqrt(0.2)), formulation)
    assert not solution.impulse.any()


@pytest.mark.parametrize("formulation", FRICTIONAL)
def test_contact_sticks_inside_every_cone(formulation):
    solution = pgs(point_mass([-1.0, 0.2, -0.1], 0.5), formulation)
    np.testing.assert_allclose(solution.impulse, [[2.0, -0.4, 0.2]], rtol=1e-15)


@pytest.mark.parametrize("angle", np.linspace(0.0, np.pi, 7))
def test_coulomb_slides_alike_in_every_direction(angle):
    direction = np.array([np.cos(angle), np.sin(angle)])
    solution = pgs(point_mass([-1.0, *(3.0 * direction)], 0.5))
    np.testing.assert_allclose(solution.impulse, [[2.0, *(-1.0 * direction)]], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("angle", np.linspace(0.0, np.pi, 7))
def test_cone_opens_while_sliding(angle):
    """p_n = m (g dt + μ v)/(1 + μ²), ‖p_t‖ = μ p_n: isotropic, but the contact opens at μ times its slip."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    solution = pgs(point_mass([-1.0, *(3.0 * direction)], 0.5), "cone")
    normal = 2.0 * (1.0 + 0.5 * 3.0) / 1.25
    np.testing.assert_allclose(solution.impulse, [[normal, *(-0.5 * normal * direction)]], rtol=1e-14, atol=1e-14)
    slip = np.linalg.norm(solution.velocity[0, 1:])
    assert solution.velocity[0, 0] == pytest.approx(0.5 * slip)


@pytest.mark.parametrize("degrees", [0.0, 10.0, 30.0, 45.0, 80.0, 200.0])
def test_box_bounds_each_axis_by_itself(degrees):
    direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    free = 3.0 * direction
    solution = pgs(point_mass([-1.0, *free], 0.5), "box")
    np.testing.assert_allclose(solution.impulse[0], [2.0, *np.clip(-2.0 * free, -1.0, 1.0)], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("facets", [3, 4, 8, 13])
@pytest.mark.parametrize("degrees", [1.0, 13.0, 22.0, 100.0, 333.0])
def test_pyramid_pushes_from_the_corner_that_opposes_slip_best(facets, degrees):
    direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    solution = pgs(point_mass([-1.0, *(30.0 * direction)], 0.5), "pyramid", facets=facets)
    angles = 2.0 * np.pi * np.arange(facets) / facets
    corners = np.column_stack((np.cos(angles), np.sin(angles)))
    best = corners[(corners @ -direction).argmax()]
    np.testing.assert_allclose(solution.impulse[0], [2.0, *best], rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("formulation", FRICTIONAL)
@pytest.mark.parametrize("speed", [0.4, 3.0, -3.0])
def test_contacts_in_the_plane(formulation, speed):
    solution = pgs(point_mass([-1.0, speed], 0.5), formulation)
    normal = 2.0 * (1.0 + 0.5 * abs(speed)) / 1.25 if formulation == "cone" and abs(speed) > 1.0 else 2.0
    np.testing.assert_allclose(solution.impulse, [[normal, -np.sign(speed) * min(2.0 * abs(speed), 0.5 * normal)]])


def test_tower_carries_the_weight_above():
    solution = pgs(tower(5), tolerance=1e-9)
    assert solution.status is gpx.Status.SOLVED
    loads = solution.impulse[:, 0].reshape(5, 4).sum(axis=1)
    np.testing.assert_allclose(loads, GRAVITY_STEP * np.arange(5, 0, -1), rtol=1e-7)


# ---- what holds for every problem


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("rows", [1, 2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_residual_agrees_with_the_formulations(random_system, formulation, rows, seed):
    """The kernel's residual and the judge's are the same number, on A and on Ĵ, solved or not."""
    system = random_system(seed, contacts=8, bodies=3, rows=rows)
    for form in (system, explicit(system)):
        for sweeps in (0, 3, 200):
            solution = pgs(form, formulation, max_iterations=sweeps, tolerance=1e-14)
            judged = RESIDUALS[formulation](form, solution.impulse, 8)
            if solution.status is gpx.Status.MAX_ITERATIONS:
                assert solution.history[-1][1] == pytest.approx(judged, rel=1e-9, abs=1e-14)
            assert solution.program_residual == pytest.approx(judged, rel=1e-9, abs=1e-14)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("rows", [1, 2, 3])
def test_matrix_and_jacobian_give_the_same_answer(random_system, formulation, rows):
    system = random_system(11, contacts=6, bodies=4, rows=rows)
    first, second = pgs(system, formulation), pgs(explicit(system), formulation)
    assert first.status is second.status is gpx.Status.SOLVED
    assert first.iterations == second.iterations
    np.testing.assert_allclose(first.impulse, second.impulse, atol=1e-9)


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_every_body_size_has_a_kernel(size):
    """Bodies of `size` velocities each, with dense inverse masses; two of a size have no kernel of their own."""
    rng = np.random.default_rng(size)
    bodies, contacts = 6, 4
    jacobian = rng.normal(size=(3 * contacts, size * bodies))
    factors = rng.normal(size=(bodies, size, size))
    inverse_mass = factors @ factors.transpose(0, 2, 1) + np.eye(size)
    system = gpx.StackedSystem.from_jacobian(
        jacobian, inverse_mass, rng.normal(size=3 * contacts), np.full(contacts, 0.4)
    )
    first, second = pgs(system), pgs(explicit(system))
    assert first.status is gpx.Status.SOLVED
    np.testing.assert_allclose(first.impulse, second.impulse, atol=1e-8)


def test_contact_of_three_bodies_is_solved_on_the_matrix():
    rng = np.random.default_rng(2)
    system = gpx.StackedSystem.from_jacobian(
        rng.normal(size=(6, 18)), np.tile(np.eye(6), (3, 1, 1)), rng.normal(size=6), [0.4, 0.4]
    )
    solution = pgs(system)
    assert solution.status is gpx.Status.SOLVED
    np.testing.assert_allclose(solution.impulse, pgs(explicit(system)).impulse, atol=1e-12)


@given(
    seed=st.integers(0, 10_000),
    friction=st.sampled_from([0.0, 1e-9, 0.05, 0.5, 1.0]),
    formulation=st.sampled_from(FORMULATIONS),
    rows=st.integers(1, 3),
    spread=st.floats(0.0, 5.0),
)
def test_one_contact_is_solved_at_once(seed, friction, formulation, rows, spread):
    """A single contact with any positive definite block takes one visit, unless strong coupling allows no answer."""
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.normal(size=(rows, rows)))[0]
    A = basis @ np.diag(10.0 ** rng.uniform(-spread / 2, spread / 2, rows)) @ basis.T
    A = 0.5 * (A + A.T)
    # Where friction times coupling exceeds the normal stiffness, Coulomb's laws may have no answer (Painlevé).
    coupling = friction * np.sqrt(2.0) * np.linalg.norm(A[0, 1:])
    if formulation not in ("normal", "cone") and coupling >= 0.99 * A[0, 0]:
        A[0, 1:] *= 0.9 * A[0, 0] / coupling
        A[1:, 0] = A[0, 1:]
        if np.linalg.eigvalsh(A)[0] <= 1e-7 * np.abs(A).max():
            A += np.eye(rows) * np.abs(A).max()
    system = gpx.StackedSystem(A, rng.normal(size=rows), [friction])
    solution = pgs(system, formulation, max_iterations=1, tolerance=1e-300)
    assert solution.program_residual < 1e-10
    assert solution.certificate.cone_violation < 1e-15 or formulation == "box"


@given(seed=st.integers(0, 10_000), formulation=st.sampled_from(["normal", "cone", "coulomb", "pyramid"]))
def test_random_contacts_are_solved(random_system, seed, formulation):
    solution = pgs(random_system(seed, contacts=5, bodies=5), formulation, tolerance=1e-8, max_iterations=20_000)
    assert np.isfinite(solution.impulse).all()
    assert solution.status in (gpx.Status.SOLVED, gpx.Status.MAX_ITERATIONS, gpx.Status.STALLED)
    assert solution.status is gpx.Status.SOLVED or formulation != "normal" or solution.program_residual < 1e-3


@pytest.mark.parametrize("relaxation", [0.5, 1.5])
@pytest.mark.parametrize("formulation", ["normal", "cone"])
def test_relaxation_finds_the_same_velocities(formulation, relaxation):
    """The convex programs have unique velocities; Coulomb's law may have several answers once contacts slide."""
    system = tower(2, jolt=0.02)
    solution = pgs(system, formulation, relaxation=relaxation, tolerance=1e-10, **PLAIN)
    assert solution.status is gpx.Status.SOLVED
    np.testing.assert_allclose(solution.velocity, pgs(system, formulation, tolerance=1e-10).velocity, atol=1e-8)


@pytest.mark.parametrize("power", [-200, -30, 30, 200])
def test_velocities_of_any_size_give_the_same_digits(power):
    system = tower(3, jolt=0.02)
    scaled = gpx.StackedSystem.from_jacobian(
        system.jacobian, system.inverse_mass, system.B * 2.0**power, system.friction
    )
    first, second = pgs(system, tolerance=1e-6), pgs(scaled, tolerance=1e-6)
    assert (second.impulse == first.impulse * 2.0**power).all()


def test_same_input_gives_the_same_bits():
    first, second = (pgs(tower(4, jolt=0.05), tolerance=1e-7) for _ in range(2))
    assert first.impulse.tobytes() == second.impulse.tobytes()
    assert first.history == second.history


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("acceleration", [False, True])
def test_number_of_threads_changes_no_bit(formulation, acceleration):
    """A pyramid of 33 has 4 356 contacts: work for all of the threads."""
    system = gpx.World(gpx.scenes.pyramid(33), 1 / 240).system()
    effort = {"max_iterations": 25, "acceleration": acceleration}
    alone, *teams = (pgs(system, formulation, threads=threads, **effort) for threads in (1, 2, 4))
    for solution in teams:
        assert solution.impulse.tobytes() == alone.impulse.tobytes()
        assert solution.history == alone.history


def test_number_of_threads_changes_no_bit_of_a_world():
    """A pyramid of 24 has 300 boxes and 2 304 contacts: work for two threads."""
    worlds = [gpx.World(gpx.scenes.pyramid(24), 1 / 240, solver="pgs", iterations=20, threads=t) for t in (1, 2)]
    for world in worlds:
        world.step(10)
    assert worlds[0].positions.tobytes() == worlds[1].positions.tobytes()


@pytest.mark.parametrize("threads", [0, -1, 1.0, True, "two", 1000])
def test_wrong_number_of_threads_is_refused(threads):
    with pytest.raises(gpx.SettingsError, match="threads"):
        pgs(tower(1), threads=threads)


def test_momentum_that_runs_in_circles_is_lost():
    """Under a table on four legs, with friction, full momentum goes round at 1e-3 for good."""
    world = gpx.World(gpx.scenes.table(4), 1 / 240, solver="pgs")
    world.step(5)
    assert world.unsolved_steps == 0


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_acceleration_finds_a_solution_of_the_same_program(formulation):
    system = tower(8)
    solution = pgs(system, formulation, acceleration=True)
    assert solution.status is gpx.Status.SOLVED
    assert solution.program_residual == pytest.approx(
        RESIDUALS[formulation](system, solution.impulse, 8), rel=1e-9, abs=1e-14
    )
    plain = pgs(system, formulation, max_iterations=30_000, **PLAIN)
    assert 2 * solution.iterations < plain.iterations
    np.testing.assert_allclose(solution.velocity, plain.velocity, atol=1e-7)


def test_acceleration_brings_a_tower_of_thirty_to_1e_6():
    solution = pgs(tower(30), tolerance=1e-6, acceleration=True)
    assert solution.status is gpx.Status.SOLVED
    loads = solution.impulse[:, 0].reshape(30, 4).sum(axis=1)
    np.testing.assert_allclose(loads, GRAVITY_STEP * np.arange(30, 0, -1), rtol=1e-4)


# ---- stopping


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_solved_warm_start_costs_no_sweep(formulation):
    system = tower(2)
    solution = pgs(system, formulation, tolerance=1e-9)
    again = pgs(system, formulation, tolerance=1e-8, warm_start=solution.impulse)
    assert again.status is gpx.Status.SOLVED
    assert again.iterations == 0
    assert len(again.history) == 1


def test_warm_start_saves_sweeps():
    system = tower(4)
    rough = pgs(system, tolerance=1e-4)
    assert 0 < pgs(system, tolerance=1e-5, warm_start=rough.impulse).iterations < pgs(system, tolerance=1e-5).iterations


def test_warm_start_outside_the_cone_is_projected():
    system = tower(1)
    guess = np.tile([-1.0, 5.0, 0.0], (4, 1))
    solution = pgs(system, max_iterations=0, warm_start=guess)
    np.testing.assert_allclose(solution.impulse, project_friction_cone(guess, system.friction), atol=1e-15)


@pytest.mark.parametrize("guess", [np.zeros((4, 2)), np.zeros(12), np.full((4, 3), np.nan)])
def test_wrong_warm_start_is_refused(guess):
    with pytest.raises(gpx.ProblemError, match="warm_start"):
        pgs(tower(1), warm_start=guess)


@pytest.mark.parametrize("relaxation", [0.0, 2.0, -1.0, float("nan"), "fast", True])
def test_wrong_relaxation_is_refused(relaxation):
    with pytest.raises(gpx.SettingsError, match="relaxation"):
        pgs(tower(1), relaxation=relaxation)


@pytest.mark.parametrize("acceleration", [1, "yes", None])
def test_wrong_acceleration_is_refused(acceleration):
    with pytest.raises(gpx.SettingsError, match="acceleration"):
        pgs(tower(1), acceleration=acceleration)


def test_history_ends_with_the_residual_and_falls():
    solution = pgs(tower(4), tolerance=1e-9)
    sweeps, residuals = zip(*solution.history, strict=True)
    assert list(sweeps) == list(range(0, solution.iterations + 1, 10))
    assert residuals[-1] == pytest.approx(solution.program_residual, rel=1e-6)
    assert (np.diff(np.log(residuals[5:])) < 0.1).all()


def test_stops_at_the_limit_of_sweeps():
    solution = pgs(tower(10), max_iterations=17, tolerance=1e-12)
    assert solution.status is gpx.Status.MAX_ITERATIONS
    assert solution.iterations == 17
    assert [sweeps for sweeps, _ in solution.history] == [0, 10, 17]


def test_stops_at_the_limit_of_time():
    solution = pgs(tower(30), max_iterations=10**9, tolerance=1e-14, time_limit=0.05, **PLAIN)
    assert solution.status is gpx.Status.MAX_ITERATIONS
    assert solution.extras["stopped_by"] == "time_limit"


@pytest.mark.parametrize("presolve", [False, True])
@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_ends_a_long_run(presolve, threads):
    system = gpx.World(towers_apart(3), 1 / 240).system()
    handler = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(KeyboardInterrupt):
            gpx.solve(
                system, solver="pgs", max_iterations=10**9, tolerance=1e-14, time_limit=20.0, acceleration=False,
                presolve=presolve, threads=threads,
            )  # fmt: skip
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)


def test_rounding_floor_is_a_stall_with_the_best_iterate():
    solution = pgs(tower(2), tolerance=1e-300, max_iterations=100_000)
    assert solution.status is gpx.Status.STALLED
    assert solution.program_residual < 1e-14
    best = min(residual for sweeps, residual in solution.history if sweeps > 0)
    assert solution.program_residual == pytest.approx(best, abs=1e-15)


# ---- awkward systems


def test_locked_bodies_leave_an_impulse_of_zero():
    """Nothing moves a contact between locked bodies: fine where it opens, an honest residual where it closes."""
    jacobian, inverse_mass = np.eye(3), np.zeros((1, 3, 3))
    opening = pgs(gpx.StackedSystem.from_jacobian(jacobian, inverse_mass, [-1.0, 0.0, 0.0], [0.5]))
    assert opening.status is gpx.Status.SOLVED
    closing = pgs(gpx.StackedSystem.from_jacobian(jacobian, inverse_mass, [1.0, 0.0, 0.0], [0.5]))
    assert closing.status is gpx.Status.STALLED
    assert not closing.impulse.any()
    assert closing.program_residual == pytest.approx(1.0)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_locked_tangent_is_no_obstacle(formulation):
    system = gpx.StackedSystem(np.diag([1.0, 1.0, 0.0]), [1.0, -0.2, 0.0], [0.5])
    solution = pgs(system, formulation)
    assert solution.status is gpx.Status.SOLVED
    np.testing.assert_allclose(solution.impulse, [[1.0, 0.0 if formulation == "normal" else -0.2, 0.0]], atol=1e-12)


@pytest.mark.parametrize("formulation", ["cone", "coulomb", "pyramid"])
def test_asymmetric_and_indefinite_matrices_are_solved_as_given(formulation):
    """Files carry six digits and lose definiteness by rounding; the answer solves A as it is given."""
    system = tower(3)
    A = system.A.toarray()
    rng = np.random.default_rng(4)
    rounded = A * (1.0 + 1e-6 * rng.uniform(-1.0, 1.0, A.shape)) - 1e-8 * np.eye(len(A)) * np.diag(A).max()
    solution = pgs(gpx.StackedSystem(rounded, system.B, system.friction), formulation, tolerance=1e-4)
    assert solution.status is gpx.Status.SOLVED


@pytest.mark.parametrize("formulation", FRICTIONAL)
def test_indefinite_matrix_ends_with_finite_impulses(formulation):
    system = gpx.StackedSystem([[1.0, 5.0, 0.0], [5.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 1.0, 0.3], [1.0])
    solution = pgs(system, formulation)
    assert np.isfinite(solution.impulse).all()


def test_jammed_contacts_have_no_solution_and_say_so():
    """Two walls close on one body (F13): any impulses leave a residual, and none of it is called solved."""
    system = gpx.StackedSystem([[1.0, -1.0], [-1.0, 1.0]], [1.0, 1.0], [0.0, 0.0])
    solution = pgs(system, "normal")
    assert solution.status is not gpx.Status.SOLVED
    assert np.isfinite(solution.impulse).all()
    assert solution.program_residual > 0.1


# ---- real problems


@pytest.mark.parametrize("folder", ["friction2d", "friction3d"])
def test_real_problems_to_engineering_accuracy(problems, folder):
    """Block Gauss-Seidel is the method of choice at 1e-4; RockPile and one OneObject cycle above it without damping."""
    unsolved = set()
    for file in sorted((problems / folder).glob("*.hdf5")):
        solution = pgs(gpx.read_fclib(file), tolerance=1e-4, time_limit=5.0)
        assert np.isfinite(solution.impulse).all()
        if solution.status is not gpx.Status.SOLVED:
            unsolved.add(file.stem)
    assert unsolved <= {"RockPile_tob1", "OneObject-i100000-499"}


def test_load_that_passes_between_contacts_of_unequal_gaps_does_not_take_forever():
    """Gaps of bricks on bricks differ by nanometres: some contact must open, and load leaves it sweep by sweep."""
    world = gpx.World(gpx.scenes.wall(10), 1 / 60, solver="pgs", tolerance=1e-6)
    most = 0
    for _ in range(100):
        world.gravity = gpx.scenes.swinging_gravity(world.time)
        world.step()
        most = max(most, world.solution.iterations)
    assert world.unsolved_steps == 0
    assert most < 3000
