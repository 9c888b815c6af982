import h5py
import numpy as np
import pytest
import scipy.sparse as sp

import gpx_lcp as gpx


@pytest.fixture
def system(random_system):
    dense = random_system(7)
    return gpx.StackedSystem(dense.A, dense.B, dense.friction)


@pytest.fixture
def file(tmp_path, system):
    path = tmp_path / "problem.hdf5"
    gpx.write_fclib(path, system)
    return path


def same(one, other):
    np.testing.assert_array_equal(one.A.indptr, other.A.indptr)
    np.testing.assert_array_equal(one.A.indices, other.A.indices)
    assert one.A.data.tobytes() == other.A.data.tobytes()
    assert one.B.tobytes() == other.B.tobytes()
    assert one.friction.tobytes() == other.friction.tobytes()
    assert one.rows == other.rows


def test_what_is_written_reads_back_bit_by_bit(file, system):
    same(gpx.read_fclib(file), system)


@pytest.mark.parametrize("rows", [2, 3])
def test_both_dimensions_with_guesses_solution_and_texts(tmp_path, random_system, rows):
    base = random_system(8, rows=rows)
    rng = np.random.default_rng(0)
    problem = gpx.FclibProblem(
        base.A,
        base.B,
        base.friction,
        guesses=rng.normal(size=(3, 6, rows)),
        reference=rng.normal(size=(6, rows)),
        title="six",
        description="Zufällige Kontakte",
        math_info="full rank",
    )
    gpx.write_fclib(tmp_path / "p.hdf5", problem)
    back = gpx.read_fclib(tmp_path / "p.hdf5")
    same(back, problem)
    assert [guess.tobytes() for guess in back.guesses] == [guess.tobytes() for guess in problem.guesses]
    assert back.reference.tobytes() == problem.reference.tobytes()
    assert (back.title, back.description, back.math_info) == ("six", "Zufällige Kontakte", "full rank")


def test_a_dense_matrix_reads_back_with_the_same_numbers(tmp_path, system):
    dense = gpx.StackedSystem(system.A.toarray(), system.B, system.friction)
    gpx.write_fclib(tmp_path / "dense.hdf5", dense)
    assert gpx.read_fclib(tmp_path / "dense.hdf5").A.toarray().tobytes() == dense.A.tobytes()


def test_every_storage_of_the_matrix_reads_the_same(file, system):
    coo, csc = sp.coo_array(system.A), sp.csc_array(system.A)
    storages = {
        "triplets": (coo.nnz, coo.col, coo.row, coo.data),
        "columns": (-1, csc.indptr, csc.indices, csc.data),
    }
    for nz, p, i, x in storages.values():
        with h5py.File(file, "a") as edited:
            group = edited["fclib_local/W"]
            for key, value in (("nz", [nz]), ("p", p), ("i", i), ("x", x)):
                del group[key]
                group[key] = np.asarray(value, dtype=np.float64 if key == "x" else np.int32)
        same(gpx.read_fclib(file), system)


def test_all_real_files_read_and_write_back_bit_by_bit(problems, tmp_path):
    files = sorted(problems.glob("friction*/*.hdf5"))
    assert files
    for path in files:
        problem = gpx.read_fclib(path)
        gpx.write_fclib(tmp_path / "again.hdf5", problem)
        same(gpx.read_fclib(tmp_path / "again.hdf5"), problem)


def test_a_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        gpx.read_fclib(tmp_path / "nowhere.hdf5")


def test_a_file_of_another_kind(tmp_path):
    path = tmp_path / "text.hdf5"
    path.write_text("no HDF5")
    with pytest.raises(gpx.ProblemError, match=r"text\.hdf5: not a readable HDF5 file"):
        gpx.read_fclib(path)


def test_a_truncated_file(file):
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(gpx.ProblemError, match=r"problem\.hdf5"):
        gpx.read_fclib(file)


def test_a_foreign_hdf5_file(tmp_path):
    path = tmp_path / "foreign.hdf5"
    with h5py.File(path, "w") as other:
        other["weather"] = [1.0]
    with pytest.raises(gpx.ProblemError, match=r"foreign\.hdf5: no group fclib_local; the file holds weather"):
        gpx.read_fclib(path)


@pytest.mark.parametrize("dataset", ["spacedim", "W/m", "W/n", "W/nz", "W/p", "W/i", "W/x", "vectors/q", "vectors/mu"])
def test_a_missing_dataset_is_named(file, dataset):
    with h5py.File(file, "a") as edited:
        del edited[f"fclib_local/{dataset}"]
    with pytest.raises(gpx.ProblemError, match=rf"problem\.hdf5: dataset fclib_local/{dataset} is missing"):
        gpx.read_fclib(file)


@pytest.mark.parametrize(
    ("dataset", "value", "message"),
    [
        ("spacedim", np.int32([4]), "fclib_local/spacedim is 4"),
        ("spacedim", np.float64([3.0]), "fclib_local/spacedim must be one integer"),
        ("W/nz", np.int32([-5]), "fclib_local/W/nz is -5"),
        ("W/p", np.int32([0, 1]), "fclib_local/W/p must hold 19 pointers"),
        ("W/i", np.full(500, 99, np.int32), r"fclib_local/W/i\[0\] is 99: indices must lie between 0 and 17"),
        ("W/i", np.zeros(3, np.int32), "fclib_local/W/i has length 3"),
        ("W/x", np.zeros(2), "fclib_local/W/x has length 2"),
        ("W/x", np.bytes_(b"words"), "fclib_local/W/x must hold numbers"),
        ("W/i", np.zeros(3), "fclib_local/W/i must be a list of integers"),
        ("W/m", np.int32([21]), "fclib_local/W"),
        ("vectors/q", np.zeros(5), "fclib_local/vectors/q has length 5, but fclib_local/vectors/mu has 6 contacts"),
        ("vectors/mu", np.full(6, -1.0), r"friction\[0\] is -1"),
        ("vectors/q", np.full(18, np.nan), r"B\[0\] is nan.*B is -fclib_local/vectors/q"),
    ],
)
def test_a_broken_dataset_is_named(file, dataset, value, message):
    with h5py.File(file, "a") as edited:
        del edited[f"fclib_local/{dataset}"]
        edited[f"fclib_local/{dataset}"] = value
    with pytest.raises(gpx.ProblemError, match=rf"problem\.hdf5: .*{message}"):
        gpx.read_fclib(file)


def test_broken_guesses_and_solutions_are_named(file):
    with h5py.File(file, "a") as edited:
        edited["solution/r"] = np.zeros(4)
    with pytest.raises(gpx.ProblemError, match="solution/r does not hold 6 x 3"):
        gpx.read_fclib(file)
    with h5py.File(file, "a") as edited:
        del edited["solution"]
        edited["guesses/number_of_guesses"] = np.int32([2])
        edited["guesses/1/r"] = np.zeros(18)
    with pytest.raises(gpx.ProblemError, match="dataset guesses/2/r is missing"):
        gpx.read_fclib(file)


def test_bilateral_constraints_are_refused_by_name(file):
    with h5py.File(file, "a") as edited:
        edited["fclib_local/V/x"] = np.zeros(1)
    with pytest.raises(gpx.ProblemError, match="fclib_local/V holds bilateral constraints"):
        gpx.read_fclib(file)


def test_contacts_of_one_row_cannot_be_written(tmp_path, column):
    with pytest.raises(gpx.ProblemError, match="1 row per contact"):
        gpx.write_fclib(tmp_path / "column.hdf5", column(3))


def test_a_failed_write_leaves_the_old_file(file, system, monkeypatch):
    before = file.read_bytes()
    monkeypatch.setattr("gpx_lcp.fclib._write", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        gpx.write_fclib(file, system)
    assert file.read_bytes() == before
    assert list(file.parent.iterdir()) == [file]
