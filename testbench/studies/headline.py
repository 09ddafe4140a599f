"""Headline of every study's report, in the same words: the numbers behind its badge, and warnings."""

from collections import Counter

from testbench.report.badge import Badge
from testbench.report.markdown import Markdown, capital
from testbench.report.report import say
from testbench.report.schema import Table, TableColumn
from testbench.report.table import Row, Trials
from testbench.runs.spread import MIN_PERCENTILE_TRIALS, middle

READ = Markdown("docs/study_tables.md says what tables and columns mean.")
NOTHING = Markdown("Nothing is compared.")
FEW = Markdown(f"Fewer than {MIN_PERCENTILE_TRIALS} trials: the tables show ranges in place of percentiles.")


def headline(badge: Badge | None, table: Table) -> Markdown:
    """State what the winner of a badge and its strongest rival reach, in the column that the table is about.

    Args:
        badge: Names both and holds the verdict.
        table: A row for each; numbers over several trials stand by their median.

    Returns:
        One sentence.
    """
    if badge is None:
        return NOTHING
    name, value = table.columns[0], _about(table)
    rows = {name.cell(row): row for row in table.rows}
    told = []
    for own in (badge.winner, badge.rival):
        if own in rows:
            found = value.value(rows[own])
            text = value.text(found if isinstance(found, str) else middle(found))
            told.append(
                f"{own} {text} {value.unit}" if value.unit and text[-1].isdigit() else f"{own} {text}"
            )
    return say("{what}: {told}.", what=capital(value.heading), told="; ".join(told))


def _about(table: Table) -> TableColumn:
    """The column of the headline: the last one unless the table names it."""
    return next((c for c in table.columns if c.key == table.headline), table.columns[-1])


def warnings(trials: Trials, name: str = "name", status: str = "status") -> list[Markdown]:
    """Warn of models that were not solved in some trials, and of too few trials for percentiles.

    Args:
        trials: Rows of models and trials.
        name: Column of the model.
        status: Column of what became of its fit.
    """
    each = zip(trials[name].tolist(), trials[status].tolist(), strict=True)
    lost = Counter(own for own, word in each if word not in (None, "solved"))
    few = [FEW] if len(trials.values("seed")) < MIN_PERCENTILE_TRIALS else []
    said = "{name} was not solved in {lost} of {fits} fits."
    names = trials[name].tolist()
    return [*(say(said, Row(name=n, lost=k, fits=names.count(n))) for n, k in lost.items()), *few]
