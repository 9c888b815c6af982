"""The pieces of the suite fclib: what is counted, and against what."""

import json
from math import inf

import numpy as np
import pytest

import gpx_lcp as gpx
from benchmarks.fclib.baseline import Baseline, PeerProblem, PeerRun, read_baseline
from benchmarks.fclib.batches import Line
from benchmarks.fclib.charts import colours, panels_at
from benchmarks.fclib.problems import ProblemFile, find, rank_ratio, shaken, smallest_of_each_family
from benchmarks.fclib.profiles import geometric_mean, performance_ratios, profile, shifted_mean
from benchmarks.fclib.scores import Scores, against_baseline
from benchmarks.fclib.tables import ratio_table, solver_table
from benchmarks.interface import scientific
from benchmarks.records import Record

# Three problems by three solvers, s; nobody solves the last one. Ratios: 1 2 4; 3 1 -; - - -.
TIMES = [[1.0, 2.0, 4.0], [3.0, 1.0, inf], [inf, inf, inf]]


def test_performance_profile_of_an_example_done_by_hand():
    ratios = performance_ratios(TIMES)
    np.testing.assert_array_equal(ratios, [[1, 2, 4], [3, 1, inf], [inf, inf, inf]])
    steps = [profile(column) for column in ratios.T]
    for (tau, share), (taus, shares) in zip(steps, [([1, 3], [1, 2]), ([1, 2], [1, 2]), ([4], [1])], strict=True):
        np.testing.assert_array_equal(tau, taus)
        np.testing.assert_allclose(share, np.array(shares) / 3)


def test_profile_counts_ties_at_once_and_a_solver_without_success_not_at_all():
    tau, share = profile([1.0, 1.0, 2.0, inf])
    np.testing.assert_array_equal(tau, [1, 2])
    np.testing.assert_array_equal(share, [0.5, 0.75])
    assert profile([inf, inf])[0].size == 0


def test_means_of_numbers_done_by_hand():
    assert shifted_mean([1.0, 7.0], 1.0) == pytest.approx(np.sqrt(2 * 8) - 1)
    assert geometric_mean([0.25, 4.0]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("stem", "family"),
    [
        ("Capsules-i100-1090", "Capsules"),
        ("LMGC_100_PR_PerioBox-i00361", "LMGC"),
        ("FC2D_SliderCrank", "FC"),
        ("Rover4396", "Rover"),
        ("42-x", "42-x"),
    ],
)
def test_a_family_is_the_leading_letters(tmp_path, stem, family):
    assert ProblemFile(stem, tmp_path / "other letters" / f"{stem}.hdf5", 1).family == family
    assert ProblemFile(stem, None, 1).family == family


def test_files_are_found_at_any_depth_and_told_apart(tmp_path):
    for name, size in (("a/Box-1", 9), ("b/Box-1", 2), ("b/c/Box-3", 5), ("Rod_1", 1)):
        path = tmp_path / f"{name}.hdf5"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x" * size)
    (tmp_path / "notes.txt").write_text("not a problem")
    files = find(tmp_path)
    assert [file.name for file in files] == ["Box-3", "Rod_1", "a/Box-1", "b/Box-1"]
    assert [file.name for file in smallest_of_each_family(files)] == ["Rod_1", "b/Box-1"]


def test_a_shaken_tower_is_the_system_of_the_moving_one():
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    system = gpx.World(gpx.scenes.tower(1), time_step=1 / 240).system()
    velocity = np.random.default_rng(3).uniform(-1, 1, 6)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.5), velocity=velocity[:3], angular_velocity=velocity[3:])
    moving = gpx.World(scene, time_step=1 / 240).system()
    found = shaken(system, 3)
    np.testing.assert_allclose((found.A - moving.A).toarray(), 0.0, atol=1e-14)
    np.testing.assert_allclose(found.B, moving.B, atol=1e-12)


def test_rank_ratio_of_four_contacts_under_one_cube_is_two():
    system = gpx.World(gpx.scenes.tower(1), time_step=1 / 240).system()
    assert rank_ratio(system) == 12 / 6
    assert rank_ratio(gpx.StackedSystem(np.zeros((3, 3)), np.ones(3), np.ones(1))) is None


RUNS = {
    "nsgs 1e-04": {"seconds": 0.5, "natural_map_scaled": 2e-4},
    "nsgs 1e-08": {"seconds": 2.0, "natural_map_scaled": 1e-9},
    "two words 1e-08": {"seconds": None, "natural_map_scaled": None},
}


def read(tmp_path, held) -> Baseline:
    path = tmp_path / "peer.json"
    path.write_text(held if isinstance(held, str) else json.dumps(held))
    return read_baseline(path)


def test_a_baseline_is_judged_by_the_natural_map_and_not_by_what_it_was_asked_for(tmp_path):
    baseline = read(tmp_path, {"Box-1": {"runs": RUNS}, "Box-2": {"runs": RUNS, "best_scaled_1e-8_s": 1.5}})
    held = baseline.problems["Box-1"]
    assert held.solvers == ("nsgs", "two words")
    assert held.seconds("nsgs", 1e-4) == 2.0  # its run at 1e-4 missed 1e-4 by our measure
    assert held.seconds("two words", 1e-8) == inf
    assert (held.best(1e-8), baseline.problems["Box-2"].best(1e-8)) == (2.0, 1.5)
    assert baseline.measures(1e-4) and not baseline.measures(1e-6)


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ("{", "cannot be read as JSON"),
        ([], "an object is needed, with a key for each problem"),
        ({"Box-1": {}}, "Box-1: an object with the key 'runs' is needed"),
        ({"Box-1": {"runs": {"nsgs 1e-4": 3}}}, "Box-1: runs: nsgs 1e-4 is 3: an object is needed"),
        ({"Box-1": {"runs": {"nsgs": {}}}}, "a run is named 'solver tolerance'"),
        ({"Box-1": {"runs": {"nsgs 1e-4": {"seconds": "fast"}}}}, "seconds is 'fast': a number"),
        ({"Box-1": {"runs": {"nsgs 1e-4": {"seconds": 0}}}}, "seconds is 0: a time above zero"),
        ({"Box-1": {"runs": {}, "best_scaled_1e-8_s": -1.0}}, "best_scaled_1e-8_s is -1.0: a number that is not neg"),
    ],
)
def test_a_baseline_of_another_format_is_refused_with_the_place(tmp_path, held, message):
    with pytest.raises(gpx.SettingsError, match="peer") as error:
        read(tmp_path, held)
    assert message in str(error.value)


def attempt(problem: str, solver: str, seconds: float, reached: bool = True, contacts: int = 20, **more) -> Record:
    figures = {
        "family": problem.split("-")[0],
        "dimension": more.pop("dimension", 3),
        "rank_ratio": None,
        "time_limit": 16.0,
    }
    return Record(
        suite="fclib",
        scene=problem,
        seed=0,
        engine="gpx-lcp",
        engine_version="1",
        solver=solver,
        formulation="coulomb",
        setting="tolerance 1e-8",
        effort=8.0,
        tolerance=1e-8,
        contacts=contacts,
        figures=figures,
        certificate={"natural_map": 1e-9 if reached else 1e-3},
        **{"status": "solved", "reached": reached, "solve_seconds": seconds, "setup_seconds": seconds, **more},
    )


def peer(*solvers: str, seconds: float = 1.0) -> PeerProblem:
    return PeerProblem(tuple(PeerRun(name, 1e-8, seconds, 1e-9) for name in solvers), {})


PGS, NEWTON = Line("pgs", "coulomb"), Line("newton", "coulomb")
ROWS = [
    attempt("Box-1", "pgs", 4.0),
    attempt("Box-1", "newton", 1.0),
    attempt("Rod-1", "pgs", 1.0, reached=False),
    attempt("Rod-1", "newton", 0.25),
    attempt("Rod-2", "pgs", 1.0, contacts=2),
    attempt("Rod-2", "newton", 1.0, contacts=2),
    attempt("Flat-1", "pgs", 2.0, dimension=2),
    attempt("Flat-1", "newton", 8.0, reached=False, dimension=2),
]
BASELINE = Baseline("peer.json", {"Box-1": peer("nsgs", "prox"), "Rod-1": peer("nsgs"), "Flat-1": peer("flat")})


def test_a_miss_is_charged_the_time_limit_in_the_ratio_and_counted():
    scores = Scores(ROWS, BASELINE)
    both = [subject for subject in scores.subjects if subject.name in ("Box-1", "Rod-1")]
    pgs, newton, best = (against_baseline(scores, line, both, 1e-8) for line in (PGS, NEWTON, None))
    assert (pgs.ratio, pgs.solved, pgs.problems) == (pytest.approx(np.sqrt(4 * 16)), 1, 2)
    assert (newton.ratio, newton.solved) == (pytest.approx(np.sqrt(1 * 0.25)), 2)
    assert best == newton
    assert against_baseline(scores, NEWTON, both, 1e-8, setup=True).ratio == pytest.approx(2 * newton.ratio)


def test_small_problems_and_those_the_baseline_does_not_know_are_left_out_of_the_ratio():
    table = ratio_table(Scores(ROWS, BASELINE))
    assert list(table.columns[0].cells) == ["Box", "Flat", "Rod", "all", "all, set-up counted"]
    assert list(table.columns[1].cells) == ["1", "1", "1", "3", "3"]
    assert ratio_table(Scores(ROWS[4:6], BASELINE)) is None


def test_the_share_counts_every_problem():
    table = solver_table(Scores(ROWS, BASELINE))
    shares = dict(zip(table.columns[0].cells, table.columns[1].cells, strict=True))
    assert shares["pgs"] == shares["newton"] == "3/4 75 %"
    assert shares["fastest of each problem"] == "4/4 100 %"
    assert shares["peer.json: best of each problem"] == "3/3 100 %"


def test_unreadable_and_interrupted_problems_are_no_part_of_the_scores():
    broken = attempt("Broken-1", "pgs", None, False, status="unreadable")
    begun = attempt("Box-9", "pgs", None, False, status="interrupted")
    scores = Scores([*ROWS, broken, begun], None)
    assert [subject.name for subject in scores.subjects] == ["Box-1", "Rod-1", "Rod-2", "Flat-1"]
    assert scores.lines == [PGS, NEWTON]
    assert scores.families() == ["Box", "Flat", "Rod"]


def test_each_panel_holds_one_dimension_and_the_peers_that_tried_it():
    space, plane = panels_at(Scores(ROWS, BASELINE), 1e-8)
    assert (space.problems, plane.problems) == (2, 1)  # the baseline does not know Rod-2
    assert [curve.label for curve in space.peers] == ["nsgs", "prox"]
    assert [curve.label for curve in plane.peers] == ["flat"]
    np.testing.assert_array_equal(space.peers[1].ratios, [1.0, inf])  # prox did not try Rod-1: not solved
    np.testing.assert_array_equal(space.own[0].ratios, [4.0, inf])
    np.testing.assert_array_equal(space.best_peer.ratios, [1.0, 4.0])


def test_without_a_baseline_every_problem_is_in_the_profile():
    space, plane = panels_at(Scores(ROWS, None), 1e-8)
    assert (space.problems, space.peers, space.best_peer) == (3, [], None)
    assert plane.problems == 1


def test_every_line_has_a_colour_of_its_own():
    lines = [Line(solver, program) for program in ("coulomb", "box") for solver in ("automatic", "pgs", "newton")]
    assert len(set(colours(lines[:4]).values())) == 4
    assert set(colours(lines)) == {line.label for line in lines}


@pytest.mark.parametrize(("value", "text"), [(1e-10, "1e-10"), (1e-4, "1e-4"), (2.5e-7, "2.5e-7")])
def test_tolerances_that_differ_are_written_differently(value, text):
    assert scientific(value) == text
