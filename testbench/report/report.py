"""A report: numbers, sentences and tables, each said once; every view is made of it.

The folder of a run, all of it or nothing: numbers, words, picture, recording, page, manifest.

User estimators that failed in some trials of a study: counted, and left out of its other numbers.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from string import Formatter
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.progress import stepwise
from testbench.report.badge import Badge
from testbench.report.markdown import (
    MAX_STATEMENTS,
    Markdown,
    as_markdown,
    counted,
    ended,
    grid,
    listed,
    titled,
)
from testbench.report.scene import PageContent, typical_first
from testbench.report.schema import Table, TableColumn, columns, looks, show, written_out
from testbench.report.table import TRIAL, Row, Trials, find, plain
from testbench.runs import manifest as files
from testbench.runs.manifest import digests
from testbench.runs.spread import Spread, middle
from testbench.runs.whole import whole_folder
from testbench.workflows.rows import FAILED

if TYPE_CHECKING:  # importing matplotlib takes long, and not every command leaves a folder
    from testbench.report.figure import Figure

FORMS = {"list": listed, "counted": counted}
"""What a sentence may ask for beside a format of numbers."""
PARTS = ("question", "title", "answer", "worst")  #: Of one line each.
LISTS = ("statements", "more", "body")


class _Sentence(Formatter):
    """{x:.3f} is a number with its spread, {x:~.3f} its median; words are escaped.

    {n:counted pose} is such as "1 pose" or "5,132 poses", {names:list} names with commas and an "and".
    """

    def format_field(self, value: Any, spec: str) -> str:
        name, _, rest = spec.partition(" ")
        if name in FORMS:
            return as_markdown(FORMS[name](value, *filter(None, [rest])))  # type: ignore[operator]
        if spec.startswith("~"):
            return as_markdown(show(middle(value), spec[1:]))
        return value if isinstance(value, Markdown) else as_markdown(show(value, spec or "g"))


def say(sentence: str, numbers: Mapping[str, Any] = {}, /, **more: Any) -> Markdown:
    """Write a sentence with its numbers.

    Args:
        sentence: Of ours, Markdown; in braces names of numbers, with their form (see `FORMS`): {rms_mm:.3f}.
        numbers: By name; those of others are `{check.rms_mm:.3f}`.
        more: The same.

    Returns:
        The sentence.
    """
    return Markdown(written_out(_Sentence().vformat(" ".join(sentence.split()), (), {**numbers, **more})))


def lines(sentences: Iterable[str]) -> Markdown:
    """Join sentences on one line."""
    return Markdown(" ".join(filter(None, sentences)))


def bullets(texts: Iterable[str]) -> Markdown:
    """List sentences; what is no Markdown is a stranger's."""
    markdowns = [text if isinstance(text, Markdown) else say("{text}", text=ended(text)) for text in texts]
    return Markdown("\n".join(f"- {text}" for text in markdowns))


@dataclass(frozen=True)
class Report:
    """Hold what was found: numbers, tables, one headline with the verdict, and warnings."""

    scenario: str
    question: Markdown
    title: Markdown  #: What was measured.
    numbers: Mapping[str, Any]  #: report.json beside sentences and tables.
    tables: Mapping[str, Table]
    body: Sequence[Markdown | str]  #: The rest of report.md: Markdown, and names of tables.
    answer: Markdown = field(default=Markdown())  #: Empty where the badge is all of it.
    claims: Sequence[Markdown] = ()  #: What else there is to say, what matters most first.
    worst: Markdown = field(default=Markdown())  #: Where it is worst, empty for none.
    badge: Badge | None = None  #: Who wins; None where nothing is compared.

    def __post_init__(self) -> None:
        """Every table that names what the badge is about, and marks nothing else, is led by it."""
        found = {name: self.led(table) for name, table in self.tables.items()}
        object.__setattr__(self, "tables", found)

    def led(self, table: Table) -> Table:
        """Put what the badge is about on top of a table that marks nothing, and mark it if it wins."""
        if table.bold or not table.columns or not self.badge:
            return table
        return replace(table.led_by(self.badge.winner), bold=self.badge.marked)

    @property
    def headline(self) -> Markdown:
        """Answer the question in a line: the answer, or the badge where there is no other."""
        return self.answer or self.block("badge")

    @property
    def winner(self) -> str:
        """Name what the badge marks; empty where nothing wins."""
        return self.badge.marked if self.badge else ""

    def block(self, name: str) -> Markdown:
        """Return a part in Markdown: badge, `PARTS` or `LISTS`; statements are the first claims."""
        if name == "badge":
            return self.badge.words if self.badge else Markdown()
        if name in PARTS:
            return Markdown(getattr(self, name))
        if name == "body":
            return self._rest()
        markdowns = {"statements": self.claims[:MAX_STATEMENTS], "more": self.claims[MAX_STATEMENTS:]}[name]
        return Markdown("\n".join(f"- {claim}" for claim in markdowns))

    def _rest(self) -> Markdown:
        """What stands below the first sentences in report.md."""
        parts = [part if isinstance(part, Markdown) else self._titled(part) for part in self.body]
        more = self.block("more")
        return Markdown("\n\n".join(filter(None, [*parts, "## More" if more else "", more])))

    def _titled(self, name: str) -> Markdown:
        table = self.tables[name]
        title = f"## {as_markdown(table.title[:1].upper() + table.title[1:])}" if table.title else ""
        return Markdown("\n\n".join(filter(None, [title, grid(table)])) if table.rows else "")

    def whole(self) -> str:
        """Write report.md."""
        head = [
            f"# {titled(self.scenario)}",
            self.title,
            Markdown(f"**{self.answer}**" if self.answer else ""),
        ]
        badge = Markdown(f"> {self.block('badge')}" if self.badge else "")
        parts = [*head[:2], badge, *head[2:], self.worst, self.block("statements"), self._rest()]
        return "\n\n".join(filter(None, parts)) + "\n"

    def json(self) -> dict[str, Any]:
        """Write report.json: all that any view is made of; a number that is not finite is null."""
        said = {name: getattr(self, name) for name in (*PARTS, "claims")}
        body = [part if isinstance(part, Markdown) else {"table": part} for part in self.body]
        tables = {name: _packed(table) for name, table in self.tables.items()}
        badge = self.badge and self.badge.json()
        head = {"scenario": self.scenario, "badge": badge}
        found = {**head, **self.numbers, **head, "said": {**said, "body": body}, "tables": tables}
        data: dict[str, Any] = plain(found)
        return data


DEFAULTS = {f.name: f.default for f in fields(TableColumn) if f.name != "called"}
LEFT = ("key", "paper", "scale")
"""Of a column whose cells are data by place and in its unit."""


def _packed(table: Table) -> dict[str, Any]:
    """A table as data: its columns, and of each row the cells and the paper's numbers."""
    columns = [
        {
            name: own
            for name, own in asdict(column).items()
            if name not in LEFT and own != DEFAULTS.get(name, {})
        }
        for column in table.columns
    ]
    shown = table.looks or looks(table.rows, table.columns[0])
    keys = [column.key for column in table.columns]
    return {
        **{name: own for name in ("title", "bold", "across") if (own := getattr(table, name))},
        **({"headline": table.headline} if table.headline in keys else {}),
        "keys": keys,
        "columns": columns,
        "rows": [[_cell(column.value(row)) for column in table.columns] for row in table.rows],
        "paper": [[column.known_value(row) for column in table.columns] for row in table.rows],
        "looks": {name: asdict(look) for name, look in shown.items()},
    }


def _cell(value: Any) -> Any:
    """A quantity as data; of many trials with their own numbers, which are drawn, in four digits."""
    if not isinstance(value, Spread):
        return value
    own = {"values": [float(f"{x:.4g}") for x in value.values], "interval": value.interval}
    return {**plain(value), **{key: each for key, each in own.items() if each}}


FAILURES = "failures"  #: Name of the table.
Failures = Mapping[tuple[str, int], str]
"""Why an estimator failed in a trial, by its name and the seed; of several cases the first."""


def failures(trials: Trials, model: str) -> Failures:
    """Find the user's estimators that failed in a trial.

    Args:
        trials: Rows of the trials.
        model: Column of the model.

    Returns:
        Reason by model and seed.
    """
    found: dict[tuple[str, int], str] = {}
    status = ".".join([*model.split(".")[:-1], "status"])
    for name, seed, why in zip(*(trials[own].tolist() for own in (model, TRIAL, status)), strict=True):
        if why and why.startswith(FAILED):
            found.setdefault((name, seed), why)
    return found


def fitted(trials: Trials, model: str, lost: Failures) -> Trials:
    """Select the other rows: who failed in one case of a trial has none of that trial, so that cases compare.

    Args:
        trials: Rows of the trials.
        model: Column of the model.
        lost: What failed.

    Returns:
        The rows.
    """
    keys = zip(trials[model].tolist(), trials[TRIAL].tolist(), strict=True)
    return trials.pick(np.array([key not in lost for key in keys], dtype=bool))


def with_failures(report: Report, lost: Failures, trials: int) -> Report:
    """Say first in a report who failed, how often, and why in the first of these trials.

    Args:
        report: The report.
        lost: What failed.
        trials: Number of trials.

    Returns:
        The report.
    """
    rows = [Row(name=name, seed=seed, status=why) for (name, seed), why in lost.items()]
    count = Counter(row.name for row in rows)
    first = [Row(find(rows, name=name), failed=f"{n} of {trials}") for name, n in count.items()]
    sentence = "Your estimator '{name}' failed in {failed} trials, which its numbers leave out."
    return replace(
        report,
        numbers={**report.numbers, FAILURES: rows},
        tables={**report.tables, FAILURES: Table(columns("name failed seed status"), first, "Failures")},
        body=[*report.body, FAILURES],
        claims=[*(say(sentence, row) for row in first), *report.claims],
    )


# --- The folder of a run, all of it or nothing: numbers, words, picture, recording, page, manifest ----------

More = Callable[[Path], Mapping[str, object] | None]
"""Writes what else a command leaves into the folder; what it returns goes into manifest.json."""

Draw = Callable[[Report, PageContent], "Mapping[str, Figure]"]
"""Draws the figures of a command, by name."""

MAP = "error_map.png"  #: The maps of a command that has some.


@dataclass(frozen=True)
class RunRequest:
    """Describe what was asked of a command, of what, and what it leaves."""

    command: str  #: As manifest.json names it, such as "testbench check".
    name: str  #: Of what the run is about: arm, file or program.
    flags: Mapping[str, object]  #: Plain data, without places of results.
    arms: Sequence[Path]  #: Folders of the arms.
    picture: str  #: Name of the PNG.
    seeds: range = range(0)
    more: More | None = None  #: What else the command leaves.
    stem: str = "report"  #: Name of its numbers and words without suffix.
    map: str = ""  #: Title of error_map.png, empty for none.
    #: Draws the figures, by name, in place of the overview, which is `picture`; None for the overview.
    draw: Draw | None = None
    recording: bool = True  #: Whether the run leaves a recording.


def write_run(out: Path, run_request: RunRequest, report: Report, page: PageContent) -> None:
    """Write a run; InputError when its folder cannot be written.

    Args:
        out: Folder of the results.
        run_request: What was asked.
        report: The report.
        page: What the page draws.
    """
    with whole_folder(out) as folder:
        found = (run_request.more(folder) if run_request.more else None) or {}
        files.write_json(report.json(), folder / f"{run_request.stem}.json")
        (folder / f"{run_request.stem}.md").write_text(report.whole(), encoding="utf-8")
        for view in stepwise(_views(folder, run_request, report, page), "writing"):
            view()
        files.write_log(folder)
        files.write_manifest(
            folder,
            command=run_request.command,
            scenario=dict(run_request.flags),
            seeds=run_request.seeds,
            models=digests(run_request.arms),
            tables=(),
            **found,
        )


def _views(
    folder: Path, run_request: RunRequest, report: Report, page: PageContent
) -> list[Callable[[], object]]:
    """List what draws a run into its folder: figures, map, recording and page."""
    _shorten_matplotlib_docstrings()
    from testbench.report.figure import save  # here: matplotlib and rerun take half a second, and not
    from testbench.report.page import write_page  # every command leaves a folder
    from testbench.report.run_figure import error_map, overview, silhouette

    tables = page.tables or [table for table in report.tables.values() if table.rows]
    drawn = typical_first(replace(page, tables=tables))

    def write_figures() -> None:
        asked = run_request.draw
        figures = dict(asked(report, drawn) if asked else {run_request.picture: overview(report, drawn)})
        places = page.map
        if run_request.map and places and any(np.isfinite(line.values).any() for line in places.lines):
            figures[MAP] = error_map(places, run_request.map, silhouette(drawn, places))
        for name, figure in figures.items():
            save(figure, folder / name)

    def write_recording() -> None:
        from testbench.report.recording.run import write_run
        from testbench.report.recording.stream import RecordingHeader

        flags = json.dumps(run_request.flags, sort_keys=True)
        header = RecordingHeader(run_request.command, flags, next(iter(run_request.seeds), 0))
        write_run(folder / "recording.rrd", header, report, drawn, {})

    return [
        write_figures,
        *([write_recording] if run_request.recording else []),
        lambda: write_page(folder, f"{run_request.command}: {run_request.name}", report, drawn),
    ]


def _shorten_matplotlib_docstrings() -> None:
    """Keep tables of properties out of matplotlib's docstrings; to be called before figures are imported.

    Every class of artists lists all of its setters in the signature and docstring of `set` and in several
    other docstrings: a fifth of the time of the import.
    """
    import matplotlib.artist

    def none(artist: object) -> str:
        """Stand in for `matplotlib.artist.kwdoc`, the table of an artist's properties."""
        del artist
        return ""

    matplotlib.artist.kwdoc = none
    matplotlib.artist.Artist._update_set_signature_and_docstring = classmethod(none)  # type: ignore[attr-defined]
