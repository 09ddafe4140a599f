"""The bench: which estimator predicts best, task by task, with a prior and without."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import product

from testbench.arm.folder import find_arm
from testbench.report.badge import MIN_PAIRS, Badge
from testbench.report.campaigns import seeds_of
from testbench.report.colours import look_of
from testbench.report.columns import columns
from testbench.report.figure import Figure, forest
from testbench.report.figures_study import cost_figure
from testbench.report.markdown import Markdown
from testbench.report.report import Report, say
from testbench.report.schema import Table
from testbench.report.table import Row, Trials
from testbench.runs.spread import MIN_PERCENTILE_TRIALS
from testbench.studies.bench import scores, trial
from testbench.studies.bench.tasks import DEFAULT, JOINTS, REAL, TASKS
from testbench.studies.bench.trial import BenchSettings, EntryRow
from testbench.studies.campaign.report import dataset
from testbench.studies.run import READ, headline
from testbench.studies.study import Study
from testbench.workflows.rows import FAILED

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


def _errors(trials: Trials, tasks: Sequence[str], *, prior: bool) -> scores.Errors:
    return scores.overall([scores.errors(trials.where(task=name, prior=prior)) for name in tasks])


def _standings(trials: Trials, tasks: Sequence[str], prior: bool) -> list[Row]:
    """The best first, over some tasks."""
    rows = trials.where(task=tuple(tasks), prior=prior)
    found = scores.standings(_errors(trials, tasks, prior=prior), scores.incumbent(prior))
    return [_row(rows, row) for row in found]


def _row(rows: Trials, standing: Row) -> Row:
    trials = rows.where(name=standing.name)
    looked = {key: trials[key].tolist()[0] for key in ("structure", "constraint", "prior")}
    return Row(standing, **scores.quantities(trials), **looked)


def _failures(trials: Trials) -> list[Row]:
    """Every way in which an entry failed, and how often."""
    lost = trials.pick(scores.begins(trials, FAILED))
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
    options=trial.BenchOptions,
    settings=trial.settings,
    seeds=(MIN_PERCENTILE_TRIALS, 2),
    row=EntryRow,
    trials=trial.trials,
    report=report,
    printed=("short",),
    figures=figures,
    arms=lambda settings: [
        find_arm(arm) for arm in dict.fromkeys(TASKS[name].arm for name in settings.tasks)
    ],
    size=2,
    own=lambda settings: settings.own,
)
