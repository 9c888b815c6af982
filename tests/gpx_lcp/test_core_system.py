"""The core judges by the same residual as `formulations`, whatever form a system comes in."""

import gc
import weakref

import numpy as np
import pytest
import scipy.sparse as sp

import gpx_lcp as gpx
from formulations import RESIDUALS
from gpx_lcp.core_system import core_system, program_residual
from gpx_lcp.errors import ProblemError

PROGRAMS = ("normal", "cone", "coulomb")


def forms(rows):
    """One problem as J and M⁻¹, as a dense A and as a sparse A with indices of both widths."""
    rng = np.random.default_rng(rows)
    jacobian = rng.standard_normal((4, rows, 2, 3))
    jacobian[0, :, 1] = jacobian[2, :, 0] = 0.0
    jacobian = jacobian.reshape(4 * rows, 6)
    B, friction = rng.standard_normal(4 * rows), np.array([0.0, 0.3, 1.0, 2.0])
    mass = np.array([2.0, 1.0, 0.5, 0.0, 1.0, 3.0])
    dense = jacobian @ np.diag(mass) @ jacobian.T
    wide = sp.csr_array(dense)
    wide.indptr, wide.indices = wide.indptr.astype(np.int64), wide.indices.astype(np.int64)
    return {
        "factors": gpx.StackedSystem.from_jacobian(jacobian, mass.reshape(2, 3, 1) * np.eye(3), B, friction),
        "dense": gpx.StackedSystem(dense, B, friction),
        "narrow": gpx.StackedSystem(sp.csr_array(dense), B, friction),
        "wide": gpx.StackedSystem(wide, B, friction),
    }


@pytest.mark.parametrize("rows", [1, 2, 3])
@pytest.mark.parametrize("form", ["factors", "dense", "narrow", "wide"])
@pytest.mark.parametrize("program", PROGRAMS)
def test_the_core_and_formulations_agree(rows, form, program):
    system = forms(rows)[form]
    for seed in range(5):
        impulse = np.random.default_rng(seed).standard_normal((4, rows)) * 10.0 ** (3 * seed - 6)
        expected = RESIDUALS[program](system, impulse, 8)
        assert program_residual(system, program, impulse, 8) == pytest.approx(expected, rel=1e-12)


def test_polyhedral_programs_are_judged_by_formulations(random_system):
    system = random_system(0)
    impulse = np.random.default_rng(0).standard_normal((system.contacts, system.rows))
    for program in set(RESIDUALS) - set(PROGRAMS):
        assert program_residual(system, program, impulse, 8) == RESIDUALS[program](system, impulse, 8)


def test_a_system_is_handed_over_once_and_let_go_with_it():
    system = forms(3)["dense"]
    held = core_system(system)
    assert core_system(system) is held
    gone = weakref.ref(system)
    del system
    gc.collect()
    assert gone() is None


def test_impulses_of_another_length_are_refused():
    system = forms(3)["dense"]
    with pytest.raises(ProblemError, match="impulse has length 3: 12 is needed"):
        core_system(system).residual("coulomb", np.zeros(3))
    with pytest.raises(ProblemError, match=r"no isotropic law named .box."):
        core_system(system).residual("box", np.zeros(12))
