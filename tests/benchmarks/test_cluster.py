"""The same sweep on a real cluster of processes, also when a worker is killed in the middle."""

import platform
import sys
import types

import pytest

import gpx_lcp as gpx
from benchmarks import cluster, exit_codes, store
from tests.benchmarks.fake_suite import FakeSuite, Kills
from tests.benchmarks.test_harness import by_key, call, steady

distributed = pytest.importorskip("distributed", reason="distributed is not installed: pip install 'gpx-lcp[cluster]'")


@pytest.fixture(scope="module")
def address():
    """Two workers of one thread each."""
    with cluster.connected(cluster.LOCAL, workers=2) as client:
        yield client.scheduler.address


def test_a_cluster_gives_the_rows_of_this_process(tmp_path, address):
    suite = FakeSuite(6, 3)
    assert call(suite, tmp_path / "here") == exit_codes.OK
    assert call(suite, tmp_path / "there", scheduler=address) == exit_codes.OK
    here, there = steady(tmp_path / "here"), steady(tmp_path / "there")
    assert by_key(there) == by_key(here) and len(there) == 18
    rows = store.read(tmp_path / "there" / "fake")
    assert {row.where["host"] for row in rows} == {platform.node()}
    assert all((tmp_path / "there" / "fake" / "answers" / row.answer.split(":")[0]).is_file() for row in rows)


def test_attempts_of_a_killed_worker_run_again_and_nothing_is_there_twice(tmp_path, address):
    suite = FakeSuite(5, 2, Kills("scene-2", tmp_path / "killed"))
    assert call(suite, tmp_path / "out", scheduler=address) == exit_codes.OK
    assert (tmp_path / "killed").exists()
    call(FakeSuite(5, 2), tmp_path / "whole")
    assert by_key(steady(tmp_path / "out")) == by_key(steady(tmp_path / "whole"))


@pytest.mark.slow
def test_a_batch_that_kills_every_worker_is_an_error_in_its_rows(tmp_path):
    with cluster.connected(cluster.LOCAL, workers=1) as client:
        suite = FakeSuite(2, 2, Kills("scene-1", tmp_path / "killed", always=True))
        assert call(suite, tmp_path / "out", scheduler=client.scheduler.address) == exit_codes.FAILED
    rows = {(row.scene, row.status) for row in store.read(tmp_path / "out" / "fake")}
    assert rows == {("scene-0", "solved"), ("scene-0", "stalled"), ("scene-1", "error")}


def test_a_worker_with_several_threads_takes_no_times():
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0") as threads,
        distributed.Client(threads) as client,
        pytest.raises(gpx.SettingsError, match="runs 2 tasks at a time"),
    ):
        cluster.require_one_task_at_a_time(client)


def test_what_a_worker_cannot_unpack_is_an_error_in_its_rows(tmp_path, address, monkeypatch):
    ghost = types.ModuleType("ghost")
    ghost.Ghost = type("Ghost", (), {"__module__": "ghost", "__call__": lambda self, attempt: None})
    monkeypatch.setitem(sys.modules, "ghost", ghost)
    assert call(FakeSuite(2, 2, ghost.Ghost()), tmp_path, scheduler=address) == exit_codes.FAILED
    rows = store.read(tmp_path / "fake")
    assert [(row.status, row.message) for row in rows] == [
        ("error", "ModuleNotFoundError: No module named 'ghost'")
    ] * 4


def test_a_worker_without_the_project_is_named():
    class Client:
        def run(self, function, on_error):
            return {"tcp://there:1": ModuleNotFoundError("No module named 'benchmarks'")}

    with pytest.raises(gpx.SettingsError, match=r"tcp://there:1 cannot load the benchmarks .* in a checkout"):
        cluster.require_project(Client())


def test_a_cluster_whose_workers_are_all_gone_is_not_waited_for_for_ever(monkeypatch):
    monkeypatch.setattr(cluster, "LOOK", 0.05)
    monkeypatch.setattr(cluster, "PATIENCE", 0.2)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty,
        distributed.Client(empty) as client,
        pytest.raises(gpx.BackendMissing, match=r"no worker for 0\.2 s; what was measured is kept"),
    ):
        cluster._first_done(client, {client.submit(sum, [1, 2]): None})


def test_an_address_where_nobody_answers_is_named(monkeypatch):
    def refuses(*arguments, **settings):
        raise OSError("timed out")

    monkeypatch.setattr(distributed, "Client", refuses)
    with (
        pytest.raises(gpx.SettingsError, match="no scheduler answers there"),
        cluster.connected("tcp://127.0.0.1:9"),
    ):
        pass
