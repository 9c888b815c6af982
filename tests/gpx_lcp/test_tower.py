"""The tower of thirty cubes at rest: every solver and formulation against the analytic weight at each interface."""

import numpy as np
import pytest

import gpx_lcp as gpx
from formulations import FORMULATIONS

CUBES, STEP = 30, 1 / 240
WEIGHT = 9.81 * STEP * np.arange(CUBES, 0, -1)
DIRECT = ("lemke", "interior_point")
BACKENDS = ("osqp", "clarabel", "daqp", "piqp", "proxqp", "scs")


@pytest.fixture(scope="module")
def tower():
    world = gpx.World(gpx.scenes.tower(CUBES), time_step=STEP)
    return world.system(), world.contacts


def load_error(contacts, solution):
    """Return the largest relative error of the normal load across an interface; cube k stands on interface k."""
    load = np.zeros(CUBES)
    np.add.at(load, contacts.body_b, solution.impulse[:, 0])
    return np.abs(load / WEIGHT - 1.0).max()


def pairs(names):
    table = gpx.solvers()
    return [(f, n) for n in names if n in table and table[n].installed for f in table[n].programs]


@pytest.mark.parametrize(("formulation", "name"), pairs(DIRECT))
def test_direct_solvers_reach_ten_digits(tower, formulation, name):
    system, contacts = tower
    solution = gpx.solve(system, formulation, name, tolerance=1e-11, presolve=False)
    assert solution.status is gpx.Status.SOLVED
    assert solution.certificate.natural_map <= 1e-10
    assert load_error(contacts, solution) <= 1e-10


@pytest.mark.parametrize(("formulation", "name"), pairs(BACKENDS))
def test_backends_are_as_good_as_they_say(tower, formulation, name):
    """The status is the residual's; on this problem each of them can be believed at 1e-8."""
    system, contacts = tower
    solution = gpx.solve(system, formulation, name, tolerance=1e-8, time_limit=20.0, presolve=False)
    assert (solution.status is gpx.Status.SOLVED) == (solution.program_residual <= 1e-8)
    assert solution.status is gpx.Status.SOLVED
    assert load_error(contacts, solution) <= 1e-6


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_pgs_gets_there_in_thousands_of_sweeps(tower, formulation):
    system, contacts = tower
    solution = gpx.solve(system, formulation, "pgs", presolve=False, tolerance=1e-6, max_iterations=20_000)
    assert solution.status is gpx.Status.SOLVED
    assert load_error(contacts, solution) <= 1e-5


def test_pgs_without_momentum_takes_thousands_of_sweeps(tower):
    system, contacts = tower
    solution = gpx.solve(
        system, "normal", "pgs", presolve=False, tolerance=1e-8, max_iterations=50_000, acceleration=False
    )
    assert solution.status is gpx.Status.SOLVED
    assert 1_000 < solution.iterations
    assert solution.certificate.natural_map <= 1e-6
    assert load_error(contacts, solution) <= 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("formulation", [name for name in FORMULATIONS if name != "normal"])
def test_pgs_without_momentum_takes_millions_of_sweeps_where_there_is_friction(tower, formulation):
    """Friction ties the cubes into a beam, whose bending spreads far slower than the load: that is what sweeps cost."""
    system, contacts = tower
    solution = gpx.solve(
        system, formulation, "pgs", presolve=False, tolerance=1e-6, max_iterations=10_000_000, acceleration=False
    )
    assert solution.status is gpx.Status.SOLVED
    assert load_error(contacts, solution) <= 1e-6
