"""Episodes that a Ray cluster loses, with a stand-in for Ray: other actors repeat them, up to a limit."""

from types import SimpleNamespace

import pytest

from simpick.errors import SimpickError
from simpick.experiments import ray_runs
from simpick.experiments.config import RunConfig
from simpick.experiments.result_store import EpisodeResult


class RayError(Exception):
    pass


class RayTaskError(RayError):
    def __init__(self, cause: Exception) -> None:
        super().__init__(str(cause))
        self.cause = cause


class Cluster:
    """Two actors that answer an episode with its number; `lost` says what happens to an actor's calls instead."""

    exceptions = SimpleNamespace(RayError=RayError, RayTaskError=RayTaskError)

    def __init__(self, lost) -> None:
        self.lost, self.actors, self.asked = lost, 0, []

    def cluster_resources(self):
        return {"CPU": 2}

    def remote(self, **_):
        def make():
            number, self.actors = self.actors, self.actors + 1

            def run(config, episode, record):
                self.asked.append((number, episode))
                return len(self.asked) - 1

            return SimpleNamespace(run=SimpleNamespace(remote=run))

        return lambda _: SimpleNamespace(remote=make)

    def wait(self, calls, num_returns):
        return calls[:num_returns], calls[num_returns:]

    def get(self, call):
        actor, episode = self.asked[call]
        error = self.lost(actor, episode)
        if error is not None:
            raise error
        return EpisodeResult(episode, episode, (), (), "cleared", {}, "oracle"), None

    def shutdown(self):
        pass


def results(monkeypatch, lost, episodes: int = 4) -> tuple[list[int], Cluster]:
    cluster = Cluster(lost)
    monkeypatch.setattr(ray_runs, "_connect", lambda _: cluster)
    jobs = [(RunConfig(estimator="oracle"), k) for k in range(episodes)]
    return [result.episode for result in ray_runs.results_from_ray(jobs, None, "auto")], cluster


def test_the_other_machine_repeats_what_a_lost_one_ran(monkeypatch) -> None:
    found, cluster = results(monkeypatch, lambda actor, _: RayError("gone") if actor == 1 else None)
    assert sorted(found) == [0, 1, 2, 3]
    assert [actor for actor, _ in cluster.asked].count(1) == 1, "a lost actor is not asked again"


def test_the_last_actor_is_replaced(monkeypatch) -> None:
    found, cluster = results(monkeypatch, lambda actor, _: RayError("gone") if actor < 2 else None)
    assert sorted(found) == [0, 1, 2, 3] and cluster.actors == 3


def test_an_episode_that_is_lost_every_time_ends_the_run(monkeypatch) -> None:
    with pytest.raises(SimpickError, match=r"lost episode 2 of oracle 3 times \(RayError\)"):
        results(monkeypatch, lambda _, episode: RayError("gone") if episode == 2 else None)


def test_an_error_of_the_episode_itself_is_not_repeated(monkeypatch) -> None:
    def fails(_: int, episode: int) -> Exception | None:
        return RayTaskError(SimpickError("the disk is full")) if episode == 1 else None

    with pytest.raises(SimpickError, match="the disk is full"):
        results(monkeypatch, fails)
    with pytest.raises(RuntimeError, match="episode 1 of oracle failed on the Ray cluster: division"):
        results(monkeypatch, lambda _, k: RayTaskError(ZeroDivisionError("division")) if k == 1 else None)
