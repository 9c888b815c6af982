"""The suite of convex programs: who is asked what, and how success is judged."""

import io

from rich.console import Console

import gpx_lcp as gpx
from benchmarks import cli, exit_codes, qp, store
from benchmarks.attempts import PROGRAM_RESIDUAL


def test_only_solvers_of_the_convex_program_are_asked():
    assert {"interior_point", "newton", "pgs", "clarabel"} <= set(qp.able("cone"))
    assert not {"lemke", "pgs"} & set(qp.able("pyramid"))
    assert all(program in gpx.solvers()[name].programs for program in qp.PROGRAMS for name in qp.able(program))


def test_success_is_the_residual_of_the_program_not_the_exact_law(tmp_path):
    page = io.StringIO()
    arguments = ["run", "qp", "--scene", "ShakenTower-5", "--solver", "newton", "--solver", "scs", "--quick"]
    assert cli.main([*arguments, "--out", str(tmp_path)], Console(file=page, width=200)) == exit_codes.OK
    rows = store.read(tmp_path / "qp")
    assert {(row.formulation, row.solver) for row in rows} == {
        ("normal", "newton"),
        ("normal", "scs"),
        ("pyramid", "scs"),
        ("cone", "newton"),
        ("cone", "scs"),
    }
    for row in rows:
        assert row.reached == (row.figure(PROGRAM_RESIDUAL) <= row.tolerance), row
    (cone,) = [row for row in rows if (row.formulation, row.solver) == ("cone", "newton")]
    # Cubes slide: what the convex law gives them is not Coulomb's.
    assert cone.reached and cone.natural_map > 1e-3
    assert (tmp_path / "qp" / "profile-1e-6.png").exists()
    assert cli.main(["check", str(tmp_path / "qp")], Console(file=page)) == exit_codes.OK
