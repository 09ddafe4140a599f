"""The report of every campaign: tables of its trials, rivals pair by pair, and one headline.

A preset says as data what is tabulated; what a table means is static text in docs/studies.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from testbench.identify.estimate import Constraint
from testbench.report.badge import incumbents, of_rivals
from testbench.report.figure import Figure
from testbench.report.markdown import Markdown, counted, listed
from testbench.report.report import Report, say
from testbench.report.schema import KNOWN, Table, best_of, columns, pivot
from testbench.report.table import SHARED, TRIAL, Row, Trials, aligned, merged, number, shared
from testbench.runs.spread import Number, Spread, middle, span, wins
from testbench.studies.campaigns import seeds_of
from testbench.studies.study import DEFAULT_WITHOUT_CONE, Study, own_arm, own_cell
from testbench.workflows.models import DEFAULT, JOINTS_ONLY

O = TypeVar("O")  # noqa: E741 - options
S = TypeVar("S")
W = TypeVar("W")
Where = Mapping[str, object]
"""Values of columns; of a set one of them."""

ERROR = "rms_um"  #: What models are judged by.
FIT = ("parameters", "rank", "min_eigenvalue", "f_m", "f_m_floor", "duality_gap", "solve_seconds")
JUDGED = (
    *("name", "structure", "constraint", "prior", ERROR, "p95_um", "max_um", "conservative", "solved"),
    "status",
    *FIT,
    "identification.",
)
"""Columns of a model whatever the factors are."""
PAIRS = (
    ("MGCO56", "MLS56"),
    (DEFAULT, DEFAULT_WITHOUT_CONE),
    ("MGCO56", JOINTS_ONLY),
    (DEFAULT, JOINTS_ONLY),
)
"""What the cone does without a prior and to the default; GCO and the default beside the incumbent."""
METHODS: Mapping[Constraint, str] = {
    "none": "least squares",
    "psd": "GCO",
    "free": "least squares, conservative of equal fit",
    "ridge": "ridge regression",
    "clipped": "least squares, clipped to the cone",
    "own": "own estimator",
}
RIVALS = "rivals"  #: Name of the table of pairs.


@dataclass(frozen=True)
class TrialTable:
    """Describe a table of the trials: one quantity by two factors, or several quantities of each row."""

    title: str
    down: str = "name"  #: Column that names the rows.
    across: str = ""  #: Factor whose levels head the columns; empty for a list of `columns`.
    value: str = ERROR  #: What stands in the cells.
    columns: str = ""  #: Keys of a list, blanks between; of a grid what does not vary across.
    where: Where = field(default_factory=dict)  #: Of which rows of the trials.
    by: str = ""  #: Other factors that tell cells apart, blanks between.
    form: str = ""  #: Of the cells, where it is not that of the quantity.
    #: Makes the rows of those trials in place of medians.
    rows: Callable[[Trials], Iterable[Row]] | None = None

    def cells(self, trials: Trials) -> list[Row]:
        """Compute medians with their spread, one row per model and cell."""
        own = trials.where(**self.where)
        if not len(own):
            return []
        if self.rows:
            return list(self.rows(own))
        by = tuple(dict.fromkeys(filter(None, ("name", self.down, self.across, *self.by.split()))))
        return _existing(merged(own.keep(*JUDGED, *by, self.value, *self.columns.split(), SHARED), *by))

    def table(self, rows: Sequence[Row]) -> Table:
        """Show these rows."""
        known = KNOWN[self.value]
        value = replace(known, form=self.form or (".0f" if self.value == ERROR else known.form))
        if not self.across:
            shown = columns(self.columns)
            return Table(tuple(value if c == known else c for c in shown), rows, self.title)
        down, across = columns(f"{self.down} {self.across}")
        heads = replace(across, unit=across.heading) if across.form == "d" else across  # such as 8 poses
        return pivot(Table((), rows, self.title), down, heads, value, *columns(self.columns))


@dataclass(frozen=True, kw_only=True)
class Preset(Generic[O, S, W]):
    """Describe a campaign as data: what is asked and tried, how it is judged, tabulated and drawn."""

    name: str  #: Of the scenario.
    question: str
    how: str  #: What is simulated, a sentence.
    options: type[O]  #: Of these five see `Study`.
    settings: Callable[[O, bool, range], S]
    seeds: tuple[int, int]
    row: type[W]
    trial: Callable[..., Iterable[W]]
    #: Tables by name.
    tables: Callable[[S], Mapping[str, TrialTable]]
    #: Cells whose models report.json lists, by words behind their names; the first one is the headline's.
    cells: Callable[[S, Trials], Mapping[str, Where]]
    figures: Callable[[Report], Mapping[str, Figure]]
    printed: str  #: Name of the table that the terminal shows.
    ours: str = DEFAULT  #: The model of the headline; that of least error if empty.
    rivals: tuple[str, ...] = ()  #: Its rivals; all incumbents of its class if empty.
    pairs: tuple[tuple[str, str], ...] = PAIRS  #: Compared beside ours and its rivals.
    #: Rows of which ours and its rivals are names, if they are not models of the headline's cell.
    compared: Callable[[Trials], Trials] | None = None
    check: str = ""  #: The cell of `cells` that is judged at check poses; the others over the workspace.
    derived: Callable[[S, Trials], Trials] = lambda _, trials: trials  #: Adds columns, picks fits.
    listed: str = ""  #: Table whose rows are report.json's models, where rows hold all of the contract.
    also: str = ""  #: Other columns of report.json's models, blanks between.
    page: str = ""  #: Where it is written what its tables and columns mean.
    value: str = ERROR  #: Column of the error by which models are judged.
    size: int = 1  #: Of these four see `Study`.
    shared: Callable[[S], object] = own_cell
    models: str = "name"
    arms: Callable[[S], Sequence[Path]] = own_arm

    def study(self) -> Study[O, S, W]:
        """Make the study."""
        return Study(
            name=self.name,
            about=self.question,
            options=self.options,
            settings=self.settings,
            seeds=self.seeds,
            row=self.row,
            trial=self.trial,
            shared=self.shared,
            report=self.report,
            printed=(self.printed,),
            figures=self.figures,
            models=self.models,
            size=self.size,
            arms=self.arms,
        )

    def report(self, asked: S, seeds: range, trials: Trials) -> Report:
        """Tabulate all trials and judge ours beside the strongest rival.

        Args:
            asked: Settings of the study.
            seeds: Seeds of the trials.
            trials: Rows of the trials.

        Returns:
            The report.
        """
        own = self.derived(asked, trials)
        grids, cells = self.tables(asked), self.cells(asked, own)
        found = {name: grid.cells(own) for name, grid in grids.items()}
        listed = TrialTable("", columns=self.also)
        models = {words: replace(listed, where=where).cells(own) for words, where in cells.items()}
        first, where = next(iter(cells.items()))
        at = self.compared(own) if self.compared else own.where(**where)
        ours = self.ours or least(models[first])
        rivals = self.rivals or incumbents(models[first], ours)
        pairs = dict.fromkeys([*((ours, theirs) for theirs in rivals), *self.pairs])
        beside = duels(at, [*pairs], self.value)
        numbers = Row(
            _head(seeds, own),
            ours=ours,
            at=dict(where),
            cells=found,
            rivals=beside,
            models=found[self.listed]
            if self.listed
            else [
                model
                for words, rows in models.items()
                for model in _contract(rows, "check" if words and words == self.check else "workspace", words)
            ],
        )
        n, ends = counted(len(seeds), "trial"), span(len(seeds))
        spread = ", medians ({ends})." if len(seeds) > 1 else "."
        how = say("{how} {n}" + spread, how=self.how, n=n, ends=ends)
        tables = {name: grid.table(found[name]) for name, grid in grids.items()} | {
            RIVALS: _rivals_table(beside, self.value)
        }
        return Report(
            scenario=self.name,
            question=Markdown(self.question),
            title=how,
            numbers=numbers,
            tables=tables,
            body=[*tables, *([Markdown(f"What tables and columns mean: {self.page}.")] if self.page else [])],
            claims=warnings(found[self.listed] if self.listed else models[first]),
            badge=of_rivals(at, ours, rivals, self.value, "case" if SHARED in own else "trial"),
        )


def least(models: Sequence[Row]) -> str:
    """Name the model of least error; of those alike one by GCO."""
    constraints = {m.name: m.constraint for m in models}
    alike = best_of({m.name: m[ERROR] for m in models})
    return min(alike, key=lambda name: constraints[name] != "psd")


def warnings(models: Sequence[Row]) -> list[Markdown]:
    """Warn of what speaks against models of the headline's cell whatever their errors are."""
    stalled = [m.name for m in models if m.constraint != "free" and m.status != "solved"]
    unheld = [m.name for m in models if m.get("held_by_trace_weight", 0) > 0.5]
    found = {
        "Not solved in every trial: {names}.": stalled,
        "In directions that no reading determines, only the trace weight limits {names}.": unheld,
    }
    return [say(sentence, names=listed(names)) for sentence, names in found.items() if names]


def _existing(rows: Sequence[Row]) -> list[Row]:
    """Drop completions that exist in no trial with noise: they are least squares once more."""
    there = {row.name for row in rows if row.get("sigma_um", 1) > 0 and row.conservative is not False}
    return [row for row in rows if row.constraint != "free" or row.name in there]


def duels(trials: Trials, pairs: Sequence[tuple[str, str]], value: str = ERROR) -> list[Row]:
    """Compare two models in the same trials or cases: both errors, their ratio, how often ours is smaller.

    Args:
        trials: Of one cell.
        pairs: Names of ours and theirs; pairs that are not both there are left out.
        value: Column of the error.

    Returns:
        A row per pair.
    """
    rows = []
    for ours, theirs in pairs:
        both = aligned(trials, (ours, theirs), value)
        if ours == theirs or not len(both):
            continue
        labels = shared(trials, (ours, theirs))
        a, b = both.T
        n = len(both)
        worst = int((a / b).argmax())
        seeds = aligned(trials, (ours, theirs), SHARED if SHARED in trials else TRIAL)
        rows.append(
            Row(
                ours=ours,
                theirs=theirs,
                ours_error=number(a, labels),
                theirs_error=number(b, labels),
                error_ratio=number(a / b, labels),
                won=wins(a, b) / n,
                tied=(n - wins(a, b) - wins(b, a)) / n,
                trials=n,
                worst_ratio=float(a[worst] / b[worst]),
                worst_seed=int(seeds[worst, 0]),
            )
        )
    return rows


def _rivals_table(rows: Sequence[Row], value: str) -> Table:
    """Tabulate pairs of models at the cell of the headline."""
    error = replace(KNOWN[value], form=".0f" if value == ERROR else KNOWN[value].form, short="")
    ours, theirs, *others = columns("ours theirs error_ratio won worst_ratio worst_seed")
    both = (replace(error, key=f"{who}_error", heading=f"{words} error") for who, words in WHO.items())
    return Table((ours, theirs, *both, *others), rows, "Pairs in the same trials")


def lines(found: Report, name: str, axes: str, drawn: Callable[[Row], bool] = lambda _: True) -> Table:
    """Select the rows of a table as they were before they were pivoted, for a figure.

    Args:
        found: The report; it may be one that was read back.
        name: Of the table.
        axes: Keys of what names a line and of what is swept, then of what is drawn if not the error in um.
        drawn: Whether a row is.

    Returns:
        The table.
    """
    shown = columns(axes)
    value = () if len(shown) == 3 else (replace(KNOWN[ERROR], form=".0f"),)
    return Table((*shown, *value), [row for row in Row(found.numbers).cells[name] if drawn(row)])


def by_levels(table: Table) -> tuple[Table, dict[str, str]]:
    """Prepare a table of errors by the levels of a factor for a forest: a pane a level, and their titles."""
    name, *levels = table.columns
    errors = (replace(KNOWN[ERROR], key=column.key, form=".0f") for column in levels)
    return replace(table, columns=(name, *errors)), {column.key: column.heading for column in levels}


WHO = {"ours": "its", "theirs": "the other's"}


def by_case(trials: Trials, *by: str) -> Trials:
    """Name every case of a trial that has several by these columns.

    Args:
        trials: Rows of the trials.
        by: Names of the columns.

    Returns:
        The rows.
    """
    keys = zip(*(trials[name].tolist() for name in (TRIAL, *by)), strict=True)
    return trials.add(**{TRIAL: [" ".join(map(str, key)) for key in keys], SHARED: trials[TRIAL]})


def _head(seeds: range, trials: Trials) -> Row:
    """Collect what report.json says first: seeds, true arms with their trials, the first seed's dataset."""
    each = trials.keep("true_arm", TRIAL).groups("true_arm")
    arms = {arm: len(own.values(TRIAL)) for (arm,), own in each if arm}
    return Row(seed=seeds_of(seeds), noise=True, trials=len(seeds), true_arms=arms, dataset=dataset(trials))


def _contract(models: Sequence[Row], judged: str, where: str) -> list[Row]:
    """Make the rows of report.json's `models` of one cell.

    Args:
        models: The models.
        judged: What judges: "check" or "workspace".
        where: Words behind every name.

    Returns:
        The rows.
    """
    none = {"check": None, "workspace": None, "paper": None}
    return [
        Row(
            m | none,
            name=f"{m.name}, {where}" if where else m.name,
            method=METHODS[m.constraint],
            **{judged: Row({f"{key}_mm": _mm(m[f"{key}_um"]) for key in ("rms", "p95", "max")})},
        )
        for m in models
    ]


def _mm(um: Number) -> Number:
    return um.scaled(1e-3) if isinstance(um, Spread) else middle(um) / 1e3


def dataset(trials: Trials) -> Row | None:
    """Summarise the dataset of the first seed that has one."""
    known = trials.keep("measured.")
    shown = np.isfinite(known["measured.runs"]).nonzero()[0][:1] if "measured.runs" in known else np.array([])
    return merged(known.pick(shown))[0].measured if len(shown) else None
