"""Whether Coulomb's law has a solution in the plane."""

import itertools

import numpy as np
import pytest

import formulations as f


def random_system(rng, contacts):
    """Return contacts that close, one coordinate short of an A that is regular.

    With a regular A there always is a solution (V. Acary, F. Cadoux, C. Lemaréchal, J. Malick, ZAMM 91 (2011)). With
    this one the equations of each way have one answer at most, and those of sticking everywhere as a rule have none.
    """
    jacobian = rng.normal(size=(2 * contacts, 2 * contacts - 1))
    B = np.column_stack((rng.uniform(0.1, 1.0, contacts), rng.normal(size=contacts)))
    return f.StackedSystem(jacobian @ jacobian.T, B.ravel(), rng.uniform(0.2, 2.0, contacts))


def refuted_system(seed):
    rng = np.random.default_rng(seed)
    systems = (random_system(rng, 2) for _ in range(50))
    return next((system, proof) for system in systems if (proof := f.refutation(system)) is not None)


def obeys(system, ways):
    """Solve the equations of one way for each contact, and look at its inequalities."""
    equations, values = np.eye(2 * system.contacts), np.zeros(2 * system.contacts)
    for contact, way in enumerate(ways):
        n, t = 2 * contact, 2 * contact + 1
        if way != "open":
            equations[n], values[n] = system.A[n], system.B[n]
        if way == "stick":
            equations[t], values[t] = system.A[t], system.B[t]
        elif way != "open":
            equations[t, n] = way * system.friction[contact]
    p = np.linalg.lstsq(equations, values)[0]
    if np.abs(equations @ p - values).max() > 1e-9:
        return False
    p = p.reshape(-1, 2)
    u = system.velocity(p)
    fine = []
    for (p_n, p_t), (u_n, u_t), way, mu in zip(p, u, ways, system.friction, strict=True):
        if way == "open":
            fine.append(u_n >= 0.0)
        elif way == "stick":
            fine.append(abs(p_t) <= mu * p_n)
        else:
            fine.append(p_n >= 0.0 and way * u_t >= 0.0)
    return all(fine)


@pytest.mark.parametrize("contacts", [2, 3])
def test_it_agrees_with_every_way_solved_by_itself(contacts):
    rng = np.random.default_rng(contacts)
    found = {True: 0, False: 0}
    for _ in range(40):
        system = random_system(rng, contacts)
        ways = itertools.product(("open", "stick", 1.0, -1.0), repeat=contacts)
        exists = any(obeys(system, way) for way in ways)
        assert (f.refutation(system) is None) == exists
        found[exists] += 1
    assert min(found.values()) > 0


def test_the_proof_has_no_unit():
    system, proof = refuted_system(2)
    assert proof.margin > 1e-4
    assert proof.programs > 4
    scaled = f.StackedSystem(1e5 * system.A, 1e-3 * system.B, system.friction)
    other = f.refutation(scaled)
    assert other is not None
    assert other.programs == proof.programs
    assert other.margin == pytest.approx(proof.margin, rel=1e-6)


def test_no_impulses_are_closer_to_the_law_than_the_margin():
    """Random impulses within the cones: the worst of their violations, in the proof's own units."""
    system, proof = refuted_system(3)
    normalised, _ = system.normalised()
    rng = np.random.default_rng(3)
    normal = rng.exponential(size=(2000, 2))
    slope = rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], size=(2000, 2)) * normalised.friction
    for p in np.stack((normal, slope * normal), axis=2):
        assert f.coulomb_residual(normalised, p) > proof.margin / 10.0


def test_what_rests_has_a_solution():
    assert f.refutation(f.StackedSystem(np.eye(4), [1.0, 0.1, 1.0, 0.0], [0.5, 0.0])) is None
    assert f.refutation(f.StackedSystem(np.eye(2), [0.0, 0.0], [0.5])) is None


def test_walls_that_close_on_a_point_leave_no_way():
    """Nothing moves the point, and both walls want to: A = [[1, -1], [-1, 1]] in the normals."""
    A = np.zeros((4, 4))
    A[np.ix_([0, 2], [0, 2])] = [[1.0, -1.0], [-1.0, 1.0]]
    A[[1, 3], [1, 3]] = 1.0
    proof = f.refutation(f.StackedSystem(A, [1.0, 0.0, 1.0, 0.0], [0.5, 0.5]))
    assert proof is not None
    # With t = 1/√2 of B, both walls are given way to.
    assert proof.margin == pytest.approx(np.sqrt(0.5), rel=1e-9)


@pytest.mark.parametrize("rows", [1, 3])
def test_it_is_for_two_rows(rows):
    with pytest.raises(f.ProblemError, match=rf"system has {rows} rows a contact"):
        f.refutation(f.StackedSystem(np.eye(rows), np.ones(rows), [0.5]))
