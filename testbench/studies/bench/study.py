"""The bench: which estimator predicts best, task by task, with a prior and without."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

from testbench.arm.folder import find_arm
from testbench.campaign.rows import FAILED
from testbench.report.badge import FEWEST, Badge
from testbench.report.campaigns import seeds_of
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials
from testbench.studies.bench import scores, trial
from testbench.studies.bench.entries import DEFAULT, FLOORS, JOINTS
from testbench.studies.bench.tasks import REAL, TASKS
from testbench.studies.bench.trial import EntryRow, Settings
from testbench.studies.campaign.report import dataset
from testbench.studies.study import Study
from testbench.trials.spread import ENOUGH
from testbench.views.figure import Figure, forest
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Table

CLASSES = {True: "with prior", False: "without prior"}
BOARD = "name standing over_default tied conservative covered_percent over_ideal failed cpu_seconds"
SCORES = (
    "task given name standing over_default tied rms_mm p95_mm conservative covered_percent half_mm failed "
    "cpu_seconds"
)
FEW = 2  #: Entries that the answer names each.
SHORT = "name with_prior without_prior"
HOW = Markdown(
    "## How to read the tables\n\n"
    "The incumbent is the default of `identify`, without a prior joint stiffness only. Ratios are geometric "
    "means over arms; their 95 % intervals, and those of ranks, resample arms. Tied: the interval holds 1. "
    "More than the whole deflection does not count: who fails on an arm errs there by that. Covered: share "
    "of true components of deflection inside the entry's 95 % intervals; the ideal: the narrowest ones, all "
    "alike, that would hold 95 %. The UR10 is one arm: its ratios resample poses, and no mean has it."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Standings over all tasks, and in each."""
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
    given = [row for row in board if row.name not in (*FLOORS, DEFAULT)]
    told = given if 0 < len(given) <= FEW else [best]
    return Report(
        scenario=STUDY.name,
        question=Markdown("Which estimator predicts an arm's deflections best?"),
        title=_title(f),
        answer=say(
            "Over {tasks}, with the prior: {each:list}.",
            tasks=counted(len(simulated), "simulated task"),
            each=[
                f"{row.name} is rank {row.standing}, {row.over_default} times the default's error"
                for row in told
            ],
        ),
        worst=_worst(f, best.name),
        claims=list(_claims(f)),
        numbers=f,
        tables=(tables := _tables(f)),
        body=[*tables, HOW],
        badge=_badge(best, board, len(seeds)),
    )


def _badge(best: Row, board: Sequence[Row], arms: int) -> Badge:
    """The default beside the best of the others, by the numbers of the table."""
    low, high, names, factor = best.ratio_low, best.ratio_high, (DEFAULT, best.name), best.ratio
    ties = tuple(row.name for row in board if row.tied)
    if factor < 1:
        low, high, names, factor = 1 / high, 1 / low, names[::-1], 1 / factor
    if arms < FEWEST:
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
    own = rows.where(name=standing.name)
    looked = {key: own[key].tolist()[0] for key in ("structure", "constraint", "prior")}
    return Row(standing, **scores.quantities(own), **looked)


def _failures(trials: Trials) -> list[Row]:
    """Every way in which an entry failed, and how often."""
    lost = trials.pick(scores.begins(trials, FAILED))
    keys = zip(*(lost[key].tolist() for key in ("name", "prior", "status")), strict=True)
    return [
        Row(name=name, given=CLASSES[bool(prior)], status=status, count=n)
        for (name, prior, status), n in Counter(keys).items()
    ]


def _title(f: Row) -> Markdown:
    tasks, arms = counted(len(f.tasks), "task"), counted(f.trials, "true arm")
    return say("{tasks}, {arms} each; errors of deflection", tasks=tasks, arms=arms)


def _worst(f: Row, name: str) -> Markdown:
    """The task in which an entry does worst beside the incumbent."""
    own = [row for row in f.scores if (row.name, row.given) == (name, CLASSES[True])]
    worst: Row = max(own, key=lambda row: row.ratio)
    return say(
        "Worst task of {name}, mean of its arms: {task}, {over_default} times the error of the default.",
        worst,
    )


def _claims(f: Row) -> Iterator[Markdown]:
    for name in dict.fromkeys(row.name for row in f.failures):
        own = [row for row in f.failures if row.name == name]
        count = sum(row["count"] for row in own)
        why = own[0].status.removeprefix(FAILED).lstrip(": ")
        yield say("{name} failed {times}: {why}.", name=name, times=counted(count, "time"), why=why)
    board, plain = (f.board[words] for words in CLASSES.values())
    tied = [row.name for row in board if row.tied]
    yield say(
        "Tied with the default over all tasks: {names:list}." if tied else "Nobody is tied with the default.",
        names=tied,
    )
    alone = "{name} errs {over_default} times as much as joint stiffness only"
    beaten = plain[0].name != JOINTS
    yield say(f"Without a prior {alone if beaten else 'nobody beats joint stiffness only'}.", plain[0])
    if sure := [row for row in board if row.covered_percent is not None]:
        told = [f"{row.name} {row.covered_percent:.0f} %" for row in sure]
        yield say("True deflections inside 95 % intervals: {told:list}.", told=told)


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
    """Ratios arm by arm."""
    f = Row(found.numbers)
    board = f.board[CLASSES[True]]
    table = found.led(Table(columns("name over"), board))
    words = (
        "Error over that of the default, arm by arm over all tasks; dotted: the default. Labels are medians, "
        "numbers of the table geometric means, where every failure counts."
    )
    return {"bench.png": forest(table, {"over": "all simulated tasks, with prior"}, found.title, words, 1.0)}


STUDY = Study(
    name="bench",
    about="Rank estimators of anybody in frozen tasks, beside the default of identify.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(ENOUGH, 2),
    row=EntryRow,
    trials=trial.trials,
    report=report,
    printed=("short",),
    figures=figures,
    arms=lambda asked: [find_arm(arm) for arm in dict.fromkeys(TASKS[name].arm for name in asked.tasks)],
    size=2,
    own=lambda asked: asked.own,
)
