"""Standings of the bench are those of its trials, of trials that are made up."""

import numpy as np
import pytest
from legible import check_legible
from made_up import of_one_trial
from reports import check, table_of

from testbench.studies.bench import (
    DEFAULT,
    DONE,
    JOINTS,
    SKIPPED,
    STUDY,
    BenchSettings,
    EntryRow,
    covariance,
    errors,
    half_widths,
    overall,
    standings,
)
from testbench.workflows.model_names import row_words
from testbench.workflows.rows import NO_ERRORS, DatasetRow, ErrorRow

TASKS, SEEDS, WHOLE = ("gravity-8", "loads"), range(1, 25), 700.0
TIMES = dict(
    zip("joints least-squares ridge prior good alike shaky".split(), (3, 8, 5, 40, 0.8, 1, 0.9), strict=True)
)
"""Error over the default's in every arm; half of the arms of shaky fail."""


def answer(name, task, seed, prior, k):
    rng = np.random.default_rng([seed, *map(ord, task)])  # the same for all entries
    size = float(np.exp(rng.normal()))
    own = np.random.default_rng([seed, *map(ord, name + task)])
    mm = 0.1 * size * TIMES.get(name, 1.0)
    mm *= 1 if name in (DEFAULT, "alike") else np.exp(0.05 * own.normal())
    status = DONE
    if name == "shaky" and seed % 2:
        status = "failed: raised ValueError: odd"
    if name == "prior" and not prior:
        status = f"{SKIPPED}needs a prior"
    done = status == DONE
    first = (seed, task, prior, k) == (SEEDS[0], TASKS[0], False, 0)
    fixed = {"name": name, "task": task, "prior": prior, "status": status}
    fixed |= {
        "deflection_mm": WHOLE,
        "cover": None,
        "structure": f"own {k + 1}",
        "constraint": "own",
        "true_arm": "cast",
        "data_file": None,
    }
    fixed |= {"workspace": of_one_trial(ErrorRow, own, rms_mm=mm) if done else NO_ERRORS}
    fixed |= {"conservative": True if done else None, "cpu_seconds": 0.01 if done else None}
    fixed |= {"measured": of_one_trial(DatasetRow, own) if first else None}
    return of_one_trial(EntryRow, own, **fixed)


def rows(seed):
    for task in TASKS:
        for prior in (False, True):
            for k, name in enumerate([*TIMES, *([DEFAULT] if prior else [])]):
                yield answer(name, task, seed, prior, k)


@pytest.fixture(scope="module")
def trials():
    return table_of(SEEDS, lambda seed: list(rows(seed)))


def made(trials):
    return STUDY.report(BenchSettings(TASKS, (1, 1), (), 1), SEEDS, trials)


def test_tables_and_picture_hold_what_the_trials_hold(trials):
    found = made(trials)
    check(found, ("short",))
    board = {row.name: row for row in found.numbers["board"]["with prior"]}
    for name, times in TIMES.items():
        own = [errors(trials.where(task=task, prior=True)) for task in TASKS]
        logs = np.mean([np.log(e[name] / e[DEFAULT]) for e in own], axis=0)
        assert board[name].ratio == pytest.approx(np.exp(logs.mean()), rel=1e-12)
        if name != "shaky":
            assert board[name].ratio == pytest.approx(times, rel=0.04)
            assert board[name].ratio_low <= times <= board[name].ratio_high
    assert found.winner == "good"
    assert board["good"].rank == board["good"].rank_high == 1
    assert (board["alike"].rank, board[DEFAULT].rank, board["alike"].tied) == (2, 2, True)
    assert board[DEFAULT].tied is None
    assert next(row.name for row in found.numbers["board"]["with prior"]) == "good"
    assert "prior" not in {row.name for row in found.numbers["board"]["without prior"]}
    text = found.whole()
    assert "| shaky | with prior | failed: raised ValueError: odd | 24 |" in text
    drawn = STUDY.figures(found)["bench.png"].axes[0]
    assert next(label.get_text().split()[0] for label in drawn.get_yticklabels()) == "good"
    time = STUDY.figures(found)["time.png"]
    time.draw_without_rendering()
    check_legible(time)
    [axes] = time.axes
    dots = {
        line.get_label(): line.get_xydata()[0].tolist()
        for line in axes.get_lines()
        if line.get_linestyle() == "None"
    }
    timed = {name: [row.cpu_seconds, row.ratio] for name, row in board.items() if row.cpu_seconds}
    assert dots == {row_words(name): own for name, own in timed.items()}
    ends = [line.get_ydata().tolist() for line in axes.get_lines() if line.get_linestyle() == "-"]
    assert all([board[name].ratio_low, board[name].ratio_high] in ends for name in timed)
    said = f"{time.get_suptitle()} {time.get_supxlabel()}".replace(",", "").split()
    for name, (t, e) in timed.items():
        beaten = any(b <= t and a <= e and (b, a) != (t, e) for b, a in timed.values())
        assert " " in name or (name in said) == (not beaten), name


def test_who_fails_errs_by_the_whole_deflection_and_who_skips_always_takes_no_part(trials):
    rows = trials.where(task=TASKS[0], prior=True)
    own = errors(rows)["shaky"]
    assert (own[::2] == WHOLE).all()
    assert (own[1::2] < WHOLE).all()
    small = errors(rows.add(deflection_mm=np.full(len(rows), 0.01)))
    assert max(size.max() for size in small.values()) == 0.01  # no more counts
    without = errors(trials.where(task=TASKS[0], prior=False))
    assert "prior" not in without
    assert "ridge" in without
    once = rows.add(
        status=[f"{SKIPPED}odd" if s.startswith("failed") else s for s in rows["status"].tolist()]
    )
    np.testing.assert_array_equal(errors(once)["shaky"], own)  # to skip hard arms is to fail


def test_an_entry_of_one_task_is_in_no_standing_over_two():
    tasks = [{"a": np.array([1.0, 4.0]), "b": np.array([1.0, 1.0])}, {"a": np.array([4.0, 1.0])}]
    assert overall(tasks).keys() == {"a"}
    np.testing.assert_allclose(overall(tasks)["a"], [2.0, 2.0])


def test_intervals_of_a_ratio_hold_the_truth_as_often_as_they_say():
    """100 draws of 40 arms: of 95 % intervals at least 88 hold it (fewer have a chance of 1 in 400)."""
    inside = 0
    for seed in range(1000, 1100):
        L = np.random.default_rng(seed).normal(0.1, 0.4, 40)
        [row] = [r for r in standings({"a": np.exp(L), JOINTS: np.ones(40)}, JOINTS) if r.name == "a"]
        inside += row.ratio_low <= np.exp(0.1) <= row.ratio_high
    assert inside >= 88


def test_half_widths_are_those_of_a_normal_distribution():
    rng = np.random.default_rng(3)
    B, rows = rng.normal(size=(4, 4)), rng.normal(size=(5, 2, 3, 4))
    drawn = rng.multivariate_normal(np.zeros(4), B @ B.T, size=100_000)
    spread = np.quantile(np.abs(np.einsum("abcn,kn->kabc", rows, drawn)), 0.95, axis=0)
    np.testing.assert_allclose(half_widths(rows, B @ B.T), spread, rtol=0.03)
    with pytest.raises(Exception, match="wrong shape of the covariance"):
        covariance(np.eye(3), 4)
    with pytest.raises(Exception, match="variances of at least 0"):
        covariance(-np.eye(4), 4)
