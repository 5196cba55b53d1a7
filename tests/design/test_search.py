"""The search: it improves on the guess, goes on after a kill, shares its storage, and says when there is none."""

import json
import os
import signal
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import optuna
import pytest
from optuna.distributions import FloatDistribution
from optuna.trial import TrialState
from ready_commands import Command
from sizing_requirements import envelope, evaluator, one_beginning

from msl_fem.computing import jobs
from msl_fem.design.sizing import (
    DesignEvaluator,
    SearchResult,
    SearchSettings,
    choose_design,
    closed_search,
    load_requirement,
    pareto_front,
    search,
    search_designs,
)
from msl_fem.design.sizing.evaluation import NOT_BUILT
from msl_fem.design.sizing.in_flight import at_work
from msl_fem.design.sizing.screening import Forecast, Foreseen, gain_beyond
from msl_fem.design.sizing.search import GUESS, first_designs
from msl_fem.design.sizing.trials import asked, open_storage, quiet_optuna, shown
from msl_fem.errors import InputError

REQUIREMENT = """
schema = 1
name = "servo"
objectives = ["mass"]
[force]
minimum = "150 N"
gap = "0.5 mm"
[heat]
current_density = "6 A/mm^2"
"""
Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
LONG = 300.0  # s: nobody waits so long, a loaded machine takes what it takes


def settings(file: Path, trials: int, **more: Any) -> SearchSettings:
    return SearchSettings(f"sqlite:///{file}", trials, **more)


@pytest.fixture(scope="module", autouse=True)
def beginning() -> Iterator[None]:
    with one_beginning():
        yield


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[DesignEvaluator, SearchResult, Path]:
    """Fourteen trials, most of them drawn."""
    file = tmp_path_factory.mktemp("small") / "trials.sqlite3"
    it = evaluator()
    return it, search_designs(it, settings(file, 14)), file


def test_a_small_search_improves_on_the_first_guess(small: tuple[DesignEvaluator, SearchResult, Path]) -> None:
    """Less mass at the same force, verified at fine accuracy; and the front has more than one design."""
    it, found, _ = small
    assert [t.number for t in found.trials] == list(range(14))
    assert found.trials[0].first_design == GUESS
    choice = choose_design(it, found)
    assert choice.guess is not None
    assert choice.guess.performance is not None
    best, first = choice.evaluation.performance, choice.guess.performance
    assert best is not None
    assert choice.evaluation.feasible
    assert best.masses.total < 0.98 * first.masses.total
    assert best.force >= 150.0
    assert best.flux_density <= 1.2
    assert len(choice.front) >= 3
    assert all(1 <= t.solves <= 12 for t in found.trials), "a few at each of a few depths"


def test_the_search_itself_finds_better_than_what_it_began_with(
    small: tuple[DesignEvaluator, SearchResult, Path],
) -> None:
    """Drawn trials stand on the front, beside those of the closed equations."""
    it, found, _ = small
    front = pareto_front(found.trials, it.requirement.objectives)
    assert any(t.first_design is None for t in front)


def test_what_is_foreseen_of_a_design_is_nearly_what_its_field_says(
    small: tuple[DesignEvaluator, SearchResult, Path],
) -> None:
    """Mass and loss of each drawn design from those before it: much nearer than the closed equations alone."""
    it, found, file = small
    study = optuna.load_study(study_name="servo", storage=f"sqlite:///{file}")
    off = []
    for trial in study.trials[10:]:
        forecast = Forecast(it, found.space)
        forecast.learn(study.trials[: trial.number])
        place = forecast.place(trial.params)
        foreseen, closed = forecast.of(place).costs, forecast.closed(place).costs
        assert foreseen is not None
        assert closed is not None
        off.append(np.abs([foreseen - np.log(trial.values), closed - np.log(trial.values)]).max(axis=1))
    corrected, alone = np.mean(off, axis=0)
    assert corrected < 0.012
    assert corrected < alone / 3


def test_the_parts_of_the_iron_carry_what_the_field_says(small: tuple[DesignEvaluator, SearchResult, Path]) -> None:
    """With a judged design's own loads the closed equations find its most loaded section, and all shares of it."""
    it, found, _ = small
    for trial in found.trials[5:8]:
        real = trial.figures["section_flux_densities_T"]
        forecast = Forecast(it, found.space)
        place = forecast.place(trial.parameters)
        plain = forecast.closed(place).flux_densities
        pole = next(iter(plain))
        loads = {name: np.log(real[name] / plain[name] * plain[pole] / real[pole]) for name in plain}
        corrected = forecast.closed(place, loads).flux_densities
        assert max(corrected, key=corrected.__getitem__) == trial.figures["section"]
        for name in plain:
            assert corrected[name] / corrected[pole] == pytest.approx(real[name] / real[pole], rel=1e-3)


def test_a_gap_of_the_front_is_worth_more_than_its_neighbourhood() -> None:
    """Svenson and Santner's improvement by hand, of a front of two designs; and a broken limit weighs more."""

    def judged(*costs: float) -> Any:
        return SimpleNamespace(costs=np.array(costs))

    def worth(*costs: float, alone: bool = False, **broken: float) -> float:
        return gain_beyond([judged(0.0, 1.0), judged(1.0, 0.0)], alone=alone)(Foreseen(None, np.array(costs), broken))

    assert worth(0.4, 0.4) == pytest.approx(0.6)
    assert worth(0.1, 0.9) == pytest.approx(0.1)
    assert worth(1.1, 0.2) == pytest.approx(-0.1)
    assert worth(-0.2, 3.0) == pytest.approx(0.2)
    assert worth(-0.2, 3.0, alone=True) == pytest.approx(0.2)
    assert worth(0.4, 0.4, alone=True) == pytest.approx(-0.4)
    assert worth(0.4, 0.4, current=0.07, voltage=-0.5) == pytest.approx(0.6 - 10 * 0.07)


def test_a_resumed_search_is_the_undisturbed_one(
    small: tuple[DesignEvaluator, SearchResult, Path], tmp_path: Path
) -> None:
    """One process: stopped after 6 of 8 trials and gone on, every trial is the same; the first six are kept."""
    it, whole, _ = small
    file = tmp_path / "trials.sqlite3"
    first = search_designs(it, settings(file, 6))
    second = search_designs(it, settings(file, 8))
    assert (first.reused, second.reused) == (0, 6)
    assert second.trials[:6] == first.trials
    assert [t.parameters for t in second.trials] == [t.parameters for t in whole.trials[:8]]
    assert sum(t.first_design is None for t in first.trials) >= 2, "some are drawn before the stop"
    again = search_designs(it, settings(file, 8))
    assert again.trials == second.trials
    assert again.reused == 8


def test_another_seed_draws_other_designs(
    small: tuple[DesignEvaluator, SearchResult, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "first_designs", first_designs)
    it, whole, _ = small
    firsts = sum(t.first_design is not None for t in whole.trials)
    other = search_designs(it, settings(tmp_path / "t.sqlite3", firsts + 1, seed=2))
    assert other.trials[:firsts] == whole.trials[:firsts], "the closed equations draw nothing"
    assert other.trials[firsts].parameters != whole.trials[firsts].parameters


def test_a_storage_of_another_requirement_is_refused(small: tuple[DesignEvaluator, SearchResult, Path]) -> None:
    _, _, file = small
    with pytest.raises(InputError, match="holds a study 'servo' of another requirement"):
        search_designs(evaluator(flux={"limit": "1.1 T"}), settings(file, 14))


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("sqlite:////nowhere/at/all.sqlite3", "unable to open database file"),
        ("mysql+pymysql://user@127.0.0.1:1/db", "cannot be reached"),
        ("nonsense", "Could not parse"),
        ("", "Could not parse"),
        ("redis://127.0.0.1", "cannot be reached"),
    ],
)
def test_a_storage_that_cannot_be_reached_is_one_line(url: str, said: str) -> None:
    with pytest.raises(InputError, match=r"storage '.*' cannot be reached \(.*\); give an Optuna") as caught:
        search_designs(evaluator(), SearchSettings(url, 5))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


ODD_CONTENT = (
    "delete from trial_values where rowid = (select min(rowid) from trial_values)",
    "update trial_values set value_type = 'nan' where rowid = 1",
    "update trial_values set value = 'x'",
    "update trials set datetime_complete = 'yesterday'",
    "update trials set state = 'DONE'",
    "update trials set number = 'first'",
    "delete from trial_params where param_name = 'coil_aspect'",
    "update trial_params set distribution_json = '{'",
    "update trial_params set param_value = 'wide'",
    "update trial_user_attributes set value_json = '{' where key = 'verdict'",
    "update trial_user_attributes set value_json = '[1]' where key = 'verdict'",
    "update trial_user_attributes set value_json = '{\"judged\": 1}' where key = 'verdict'",
    "update study_user_attributes set value_json = '3' where key = 'space'",
    "update study_user_attributes set value_json = '{\"spans\": {}}' where key = 'space'",
    "update study_user_attributes set value_json = '[3]' where key = 'first_designs'",
    "delete from study_user_attributes where key = 'first_designs'",
    "update study_user_attributes set value_json = cast(x'ff00fe' as text)",
    "update trial_system_attributes set value_json = '3.5' where key = 'fixed_params'",
    "insert into trial_values (trial_id, objective, value, value_type) "
    "select max(trial_id) + 1, 0, 1.0, 'wide' from trials",
    "drop table trial_values",
    "drop table studies",
    "drop table study_directions",
    "delete from study_directions",
    "delete from study_directions where objective = 1",
    "delete from trials; update trial_params set distribution_json = 'x'",
)


@pytest.mark.parametrize("change", ODD_CONTENT)
def test_a_storage_with_odd_content_is_one_line(
    change: str, small: tuple[DesignEvaluator, SearchResult, Path], tmp_path: Path
) -> None:
    """A file from elsewhere can hold anything; nothing is solved on it."""
    it, _, file = small
    odd = tmp_path / "odd.sqlite3"
    with sqlite3.connect(file) as source, sqlite3.connect(odd) as copy:
        source.backup(copy)
        copy.executescript(change)
    with pytest.raises(InputError, match=r"odd\.sqlite3' (holds what no search wrote|cannot be reached)") as refused:
        search_designs(it, settings(odd, 15))
    assert "\n" not in str(refused.value)


def test_a_password_is_never_shown() -> None:
    assert "secret" not in shown("postgresql://me:secret@host/trials")
    assert "me" in shown("postgresql://me:secret@host/trials")


def test_designs_outside_the_envelope_are_recorded_and_never_solved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many fields as designs that can be built; the others have their constraints' sizes in the storage."""
    submitted: list[object] = []

    def count(it: DesignEvaluator, design: Any) -> Any:
        submitted.append(design)
        return solve(it, design)

    solve = DesignEvaluator.solve
    monkeypatch.setattr(DesignEvaluator, "solve", count)
    monkeypatch.setattr(closed_search, "_GENERATIONS", 10)  # for the closest design, which is not looked at
    it, file = evaluator(**envelope("48 mm", "44 mm", "50 mm")), tmp_path / "t.sqlite3"
    found = search_designs(it, settings(file, 14, sampler=lambda seed, *_: optuna.samplers.RandomSampler(seed)))
    unbuilt = [t for t in found.trials if t.stage == NOT_BUILT]
    assert len(unbuilt) >= 3
    assert len(submitted) == 14 - len(unbuilt)
    assert all(t.solves == 0 and not t.feasible and t.values == () for t in unbuilt)
    study = optuna.load_study(study_name="servo", storage=f"sqlite:///{file}")
    for trial in unbuilt:
        stored = study.trials[trial.number]
        assert stored.state == TrialState.PRUNED
        broken = {c.name: c.violation for c in trial.constraints if not c.kept}
        assert stored.constraints == pytest.approx(broken)
        assert min(broken.values()) > 0


def test_force_as_an_objective_is_pushed_up(tmp_path: Path) -> None:
    it = evaluator(objectives=["mass", "force", "inductance"])
    found = search_designs(it, settings(tmp_path / "t.sqlite3", 7))
    front = pareto_front(found.trials, it.requirement.objectives)
    forces = np.array([t.figures["force_N"] for t in front])
    assert forces.min() >= 150.0
    assert forces.max() > 1.2 * 150.0
    masses = np.array([t.figures["mass_kg"] for t in front])
    assert masses[np.argmax(forces)] > masses.min()


# --- processes ---------------------------------------------------------------------------------------------------


def start(folder: Path, *more: str) -> Command:
    (folder / "r.toml").write_text(REQUIREMENT)
    return Command(["size", "r.toml", "-o", "g.toml", "--json", *more], folder)


def finish(process: Command) -> dict[str, Any]:
    out, err = process.communicate(timeout=LONG)
    assert process.returncode == 0, err
    return dict(json.loads(out))


def verdicts(file: Path) -> dict[int, str]:
    """Trial number to verdict, read past Optuna."""
    if not file.exists():
        return {}
    query = (
        "select t.number, a.value_json from trials t join trial_user_attributes a on a.trial_id = t.trial_id "
        "where a.key = 'verdict' and t.state in ('COMPLETE', 'PRUNED')"
    )
    connection = sqlite3.connect(file, timeout=LONG)
    try:
        return dict(connection.execute(query).fetchall())
    except sqlite3.OperationalError:  # the tables are being made
        return {}
    finally:
        connection.close()


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.02)


@pytest.mark.parametrize("killed_at", [0, 5])
def test_a_search_that_was_killed_ends_as_an_undisturbed_one(
    killed_at: int, small: tuple[DesignEvaluator, SearchResult, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The design in flight, a first one or a drawn one, is judged under its own number; nothing is drawn otherwise."""
    it, undisturbed, _ = small
    solve, judged = DesignEvaluator.solve, []

    def killed(evaluator: DesignEvaluator, design: Any) -> Any:
        judged.append(design)
        if len(judged) == killed_at + 1:
            raise KeyboardInterrupt
        return solve(evaluator, design)

    monkeypatch.setattr(DesignEvaluator, "solve", killed)
    with pytest.raises(KeyboardInterrupt):
        search_designs(it, settings(tmp_path / "t.sqlite3", killed_at + 1))
    found = search_designs(it, settings(tmp_path / "t.sqlite3", killed_at + 2))
    assert found.reused == killed_at
    assert found.trials == undisturbed.trials[: killed_at + 2]


def test_a_waiting_design_that_another_search_finishes_first_is_left_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SQLite lets two searches take one waiting design; where the other has finished it before this one has read what
    it asks for, the next design is asked."""
    url, ranges = f"sqlite:///{tmp_path / 't.sqlite3'}", {"x": FloatDistribution(0.0, 1.0)}
    with quiet_optuna():
        study = optuna.create_study(storage=open_storage(url), study_name="s")
        other = optuna.load_study(storage=open_storage(url), study_name="s")
        for x in (0.25, 0.75):
            study.enqueue_trial({"x": x})
        take, finished = study._storage.set_trial_state_values, []

        def finished_by_the_other(*arguments: Any, **named: Any) -> bool:
            taken = take(*arguments, **named)
            if not finished:
                finished.append(other.tell(0, 1.0))
            return bool(taken)

        monkeypatch.setattr(study._storage, "set_trial_state_values", finished_by_the_other)
        trial = asked(study, ranges)
    assert (trial.number, trial.params) == (1, {"x": 0.75})
    assert [t.state for t in study.trials] == [TrialState.COMPLETE, TrialState.RUNNING]


def test_others_begin_once_the_first_has_seen_what_was_lost(
    small: tuple[DesignEvaluator, SearchResult, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A design that a second search has in flight would seem lost to the first, which would judge it as well."""
    it, _, file = small
    entered, alone = threading.Event(), []

    def begin_another() -> None:
        with at_work(f"sqlite:///{file}") as presence:
            alone.append(presence.alone)
            entered.set()

    another = threading.Thread(target=begin_another)

    def while_looking(*_: Any) -> list[Any]:
        another.start()
        assert not entered.wait(0.2)
        return []

    def then(*_: Any) -> None:
        assert entered.wait(LONG)

    monkeypatch.setattr(search, "in_flight", while_looking)
    monkeypatch.setattr(search, "enqueue_first", then)
    search_designs(it, settings(file, 14))
    another.join()
    assert alone == [False]


def test_killed_with_all_its_processes_it_loses_at_most_the_trials_in_flight(msl_fem: Run, tmp_path: Path) -> None:
    """SIGKILL to the group while two workers judge; the same command goes on, and nothing is judged twice."""
    process, file = start(tmp_path, "--trials", "60", "--workers", "2"), tmp_path / ".g.toml.trials.sqlite3"
    wait_until(lambda: len(verdicts(file)) >= 3)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate(timeout=LONG)
    assert not (tmp_path / "g.toml").exists()
    kept = verdicts(file)
    assert 3 <= len(kept) < 60
    number = max(kept) + 1
    connection = sqlite3.connect(file)
    begun = connection.execute("select count(*) from trials where state = 'RUNNING'").fetchone()[0]
    connection.close()
    assert begun <= 2, "those in flight"
    files = (str(tmp_path / "r.toml"), "-o", str(tmp_path / "g.toml"))
    found = msl_fem("size", *files, "--trials", str(len(kept) + 3), "--workers", "1", "--json").json
    assert found["trials_reused"] == len(kept)
    assert found["trials"] == len(kept) + 3
    after = verdicts(file)
    assert {n: after[n] for n in kept} == kept
    assert sum(n >= number for n in after) >= 1
    assert (tmp_path / "g.toml").exists()


def test_two_processes_share_one_storage(tmp_path: Path) -> None:
    """Each draws its own designs; together they make the number asked for, but for what was in flight."""
    file = tmp_path / "shared.sqlite3"
    url = f"sqlite:///{file}"
    process = start(tmp_path, "--trials", "8", "--workers", "1", "--storage", url)
    wait_until(lambda: len(verdicts(file)) >= 1)
    here = search_designs(DesignEvaluator(load_requirement(tmp_path / "r.toml")), SearchSettings(url, 8))
    there = finish(process)
    study = optuna.load_study(study_name="servo", storage=url)
    done = [t for t in study.trials if t.state in (TrialState.COMPLETE, TrialState.PRUNED)]
    assert 8 <= len(done) <= 10
    drawn = [tuple(t.params.values()) for t in done if "first_design" not in t.user_attrs]
    assert len(set(drawn)) == len(drawn) >= 6
    assert all(abs(trials - 8) <= 2 for trials in (len(here.trials), there["trials"]))
    assert here.reused < 8, "this process has judged some too"


def test_on_a_cluster_as_here(
    small: tuple[DesignEvaluator, SearchResult, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The closed equations' designs have the same verdicts from a cluster's workers."""
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' (dask.distributed) is not installed")
    monkeypatch.setattr(jobs, "CONNECT", LONG)
    monkeypatch.setattr(jobs, "FIRST_WORKER", LONG)
    it, whole, _ = small
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        found = search_designs(it, settings(tmp_path / "t.sqlite3", 4, scheduler=cluster.scheduler_address))
    assert [t.values for t in found.trials] == [pytest.approx(t.values) for t in whole.trials[:4]]
