"""The bench: which estimator predicts best, task by task: ratios of errors with intervals, ranks."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from scipy.stats import rankdata

from testbench.arm.folder import find_arm
from testbench.errors import Array
from testbench.report.badge import MIN_PAIRS, Badge
from testbench.report.colours import look_of
from testbench.report.columns import columns
from testbench.report.figure import Figure, forest
from testbench.report.figures_study import cost_figure
from testbench.report.markdown import Markdown
from testbench.report.report import Report, say
from testbench.report.schema import Table
from testbench.report.table import Row, Trials, number
from testbench.runs.spread import MIN_PERCENTILE_TRIALS, TAIL, spread
from testbench.studies.bench.tasks import (
    DEFAULT,
    DONE,
    JOINTS,
    REAL,
    SKIPPED,
    TASKS,
    BenchOptions,
    BenchSettings,
    EntryRow,
    settings,
    trials,
)
from testbench.studies.campaign.report import dataset
from testbench.studies.campaigns import seeds_of
from testbench.studies.run import READ, headline
from testbench.studies.study import Study
from testbench.workflows.rows import FAILED

DRAWS = 2000  #: Of the bootstrap, the same in every run.
DECIMALS = 6  #: Of a logarithm of errors: entries nearer than that have one rank.
ERROR = "workspace.rms_mm"
Errors = Mapping[str, Array]  #: Of every entry, arm by arm, (arms,) [mm].


def incumbent(prior: bool) -> str:
    """Name whom a class has to beat: the default of `identify`, without a prior joint stiffness only."""
    return DEFAULT if prior else JOINTS


def begins(rows: Trials, words: str) -> Array:
    """Tell which rows have a status that begins with some words.

    Args:
        rows: Rows of the trials.
        words: First words of the status.

    Returns:
        True for such a row, (rows,).
    """
    return np.array([status.startswith(words) for status in rows["status"].tolist()], dtype=bool)


def errors(rows: Trials) -> dict[str, Array]:
    """Collect errors in one task and class, (arms,) [mm]; who fails errs by the whole deflection.

    To skip is to fail, but for who skips every arm: such entries are left out.
    """
    found = {}
    for (name,), group in rows.groups("name"):
        done = group["status"] == DONE
        if done.any() or not begins(group, SKIPPED).all():
            found[name] = np.fmin(group[ERROR], group["deflection_mm"])
    return found


def overall(tasks: Sequence[Errors]) -> dict[str, Array]:
    """Compute geometric means over tasks of those that take part in all of them, (arms,) [mm]."""
    names = [name for name in tasks[0] if all(name in own for own in tasks)]
    return {name: np.exp(np.mean([np.log(own[name]) for own in tasks], axis=0)) for name in names}


def standings(found: Errors, rival: str) -> list[Row]:
    """Rank entries, the best first: errors over the rival's, rank, whether they are tied.

    Both by geometric means over the arms; intervals of 95 % by resampling arms.

    Args:
        found: Errors by entry.
        rival: Name of the rival.

    Returns:
        A row per entry.
    """
    names = list(found)
    L = np.log(np.array([found[name] for name in names])) - np.log(found[rival])
    arms = L.shape[1]
    count = np.random.default_rng(0).multinomial(arms, np.full(arms, 1 / arms), size=DRAWS)
    drawn = count @ L.T / arms  # (draws, names)
    ranks = rankdata(drawn.round(DECIMALS), method="min", axis=1)
    own = rankdata(L.mean(axis=1).round(DECIMALS), method="min")
    ends = np.exp(np.quantile(drawn, (TAIL, 1 - TAIL), axis=0))
    places = np.quantile(ranks, (TAIL, 1 - TAIL), axis=0, method="nearest")
    board: list[Row] = []
    for k in L.mean(axis=1).argsort(kind="stable").tolist():
        place, size = [int(own[k]), *places[:, k].astype(int).tolist()], float(np.exp(L[k].mean()))
        low, high = ends[:, k].tolist()
        row = Row(zip(("rank", "rank_low", "rank_high"), place, strict=True), name=names[k], trials=arms)
        row |= {"ratio": size, "ratio_low": low, "ratio_high": high}
        row |= {"tied": None if names[k] == rival else low <= 1 <= high, "over": spread(np.exp(L[k]))}
        shown = _with(*map("{:.3g}".format, (size, low, high)))
        row |= {"standing": _with(*map(str, place)), "over_default": shown}
        board.append(row)
    return board


def _with(value: str, low: str, high: str) -> str:
    """A number and its interval, where that has a width."""
    return f"{value} ({low} to {high})" if low != high else value


def quantities(rows: Trials) -> Row:
    """Summarise what an entry did beside its ratio, over arms, or over arms and tasks."""
    done, failed = rows.where(status=DONE), int(begins(rows, FAILED).sum() + begins(rows, SKIPPED).sum())
    known = done.pick(np.isfinite(done["cover.covered_percent"].astype(float)))
    return Row(
        rms_mm=number(done[ERROR]) if len(done) else None,
        p95_mm=number(done["workspace.p95_mm"]) if len(done) else None,
        conservative=float(np.mean(done["conservative"].astype(bool))) if len(done) else None,
        covered_percent=float(known["cover.covered_percent"].mean()) if len(known) else None,
        half_mm=float(np.median(known["cover.half_mm"])) if len(known) else None,
        over_ideal=float(np.median(known["cover.half_mm"] / known["cover.ideal_mm"])) if len(known) else None,
        cpu_seconds=float(np.median(done["cpu_seconds"])) if len(done) else None,
        failed=f"{failed} of {len(rows)}" if failed else None,
    )


CLASSES = {True: "with prior", False: "without prior"}
BOARD = "name standing over_default tied conservative covered_percent over_ideal failed cpu_seconds"
SCORES = (
    "task given name standing over_default tied rms_mm p95_mm conservative covered_percent half_mm failed "
    "cpu_seconds"
)
SHORT = "name with_prior without_prior"


def report(asked: BenchSettings, seeds: range, trials: Trials) -> Report:
    """Rank the entries over all tasks, and in each.

    Args:
        asked: Settings of the study.
        seeds: Seeds of the trials.
        trials: Rows of the trials.

    Returns:
        The report.
    """
    simulated = [name for name in asked.tasks if TASKS[name].arm != REAL] or asked.tasks
    boards = {words: _standings(trials, simulated, prior) for prior, words in CLASSES.items()}
    board = boards[CLASSES[True]]
    f = Row(
        seed=seeds_of(seeds),
        trials=len(seeds),
        tasks=[Row(task=name, **vars(TASKS[name])) for name in asked.tasks],
        dataset=dataset(trials),
        board=boards,
        scores=[
            Row(row, task=name, given=CLASSES[prior])
            for name, prior in product(asked.tasks, CLASSES)
            for row in _standings(trials, [name], prior)
        ],
        failures=_failures(trials),
        models=[Row(row, check=None, paper=None, workspace=Row(rms_mm=row.rms_mm)) for row in board],
    )
    best = next(row for row in board if row.name != DEFAULT)
    badge, tables = _badge(best, board, len(seeds)), _tables(f)
    failed: Counter[str] = Counter()
    for row in f.failures:
        failed[row.name] += row["count"]
    return Report(
        scenario=STUDY.name,
        question=Markdown("Which estimator predicts an arm's deflections best?"),
        title=say(
            "{tasks:counted task}, {trials:counted true arm} each; errors of deflection",
            tasks=len(f.tasks),
            trials=f.trials,
        ),
        answer=headline(badge, tables["with_prior"]),
        claims=[say("{name} failed {n:counted time}.", name=name, n=n) for name, n in failed.items()],
        numbers=f,
        tables=tables,
        body=[*tables, READ],
        badge=badge,
    )


def _badge(best: Row, board: Sequence[Row], arms: int) -> Badge:
    """The default beside the best of the others, by the numbers of the table."""
    low, high, names, factor = best.ratio_low, best.ratio_high, (DEFAULT, best.name), best.ratio
    ties = tuple(row.name for row in board if row.tied)
    if factor < 1:
        low, high, names, factor = 1 / high, 1 / low, names[::-1], 1 / factor
    if arms < MIN_PAIRS:
        return Badge(*names, factor, None, arms, "too few", "arm")
    return Badge(*names, factor, (low, high), arms, "holds" if low > 1 else "tie", "arm", ties=ties)


def _errors(trials: Trials, tasks: Sequence[str], *, prior: bool) -> Errors:
    return overall([errors(trials.where(task=name, prior=prior)) for name in tasks])


def _standings(trials: Trials, tasks: Sequence[str], prior: bool) -> list[Row]:
    """The best first, over some tasks."""
    rows = trials.where(task=tuple(tasks), prior=prior)
    found = standings(_errors(trials, tasks, prior=prior), incumbent(prior))
    return [_row(rows, row) for row in found]


def _row(rows: Trials, standing: Row) -> Row:
    trials = rows.where(name=standing.name)
    looked = {key: trials[key].tolist()[0] for key in ("structure", "constraint", "prior")}
    return Row(standing, **quantities(trials), **looked)


def _failures(trials: Trials) -> list[Row]:
    """Every way in which an entry failed, and how often."""
    lost = trials.pick(begins(trials, FAILED))
    keys = zip(*(lost[key].tolist() for key in ("name", "prior", "status")), strict=True)
    return [
        Row(name=name, given=CLASSES[bool(prior)], status=status, count=n)
        for (name, prior, status), n in Counter(keys).items()
    ]


def _tables(f: Row) -> dict[str, Table]:
    board, plain = (f.board[words] for words in CLASSES.values())
    every = {row.name: Row(row, with_prior=None, without_prior=None) for row in [*board, *plain]}
    for key, rows in (("with_prior", board), ("without_prior", plain)):
        for row in rows:
            every[row.name] |= {key: row.over_default}
    title = f"Error over that of the default with a prior, over that of {JOINTS} without"
    return {
        "short": Table(columns(SHORT), [*every.values()], title),
        "with_prior": Table(columns(BOARD), board, "all tasks, with prior", headline="over_default"),
        "without_prior": Table(columns(BOARD), plain, "all tasks, without prior", headline="over_default"),
        "scores": Table(columns(SCORES), f.scores, "task by task", headline="over_default"),
        "tasks": Table(columns("task version poses what"), f.tasks, "tasks"),
        "failures": Table(columns("name given status count"), f.failures, "failures"),
    }


def figures(found: Report) -> Mapping[str, Figure]:
    """Draw the ratios arm by arm."""
    f = Row(found.numbers)
    board = f.board[CLASSES[True]]
    table = found.led(Table(columns("name over"), board))
    words = "Error over that of the default, arm by arm over all tasks; dotted: the default."
    known = {row.name: look_of(row) for row in board}
    return {
        "bench.png": forest(table, {"over": "all simulated tasks, with prior"}, found.title, words, 1.0),
        "time.png": cost_figure(board, known, f"error over that of {DEFAULT}"),
    }


STUDY = Study(
    name="bench",
    about="Rank your estimators beside others, and the default of identify, in frozen tasks.",
    options=BenchOptions,
    settings=settings,
    seeds=(MIN_PERCENTILE_TRIALS, 2),
    row=EntryRow,
    trials=trials,
    report=report,
    printed=("short",),
    figures=figures,
    arms=lambda settings: [
        find_arm(arm) for arm in dict.fromkeys(TASKS[name].arm for name in settings.tasks)
    ],
    size=2,
    own=lambda settings: settings.own,
)
