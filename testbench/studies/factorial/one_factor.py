"""The report of a study with one factor: errors by its levels, one model beside its rivals at one level."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from testbench.report.badge import of_models
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials
from testbench.studies.factorial import compare
from testbench.studies.factorial.trial import FitRow
from testbench.studies.study import Study
from testbench.trials.spread import middle, span
from testbench.views.figure import Figure, sweeps
from testbench.views.markdown import Markdown, capital, counted
from testbench.views.schema import Table

S = TypeVar("S")


@dataclass(frozen=True)
class NoFlags:
    """Of a study without flags of its own."""


@dataclass(frozen=True)
class OneFactor:
    """What a study asks of one factor."""

    name: str  #: Of the study.
    question: str
    how: str  #: What is simulated, a sentence.
    factor: str  #: Its column, such as "payload_kg".
    level: float  #: The level of the answer.
    ours: str  #: The model of the answer.

    def study(
        self, settings: Callable[[bool, int], S], trials: Callable[..., list[list[FitRow]]]
    ) -> Study[NoFlags, S, FitRow]:
        """The whole study.

        Args:
            settings: What is tried, by whether it has to be quick and the first seed; it names the `arm`.
            trials: Rows of some seeds: see `each_seed`.
        """
        return Study(
            name=self.name,
            about=self.question,
            options=NoFlags,
            settings=lambda _, quick, seeds: settings(quick, seeds[0]),
            seeds=(100, 4),
            row=FitRow,
            trials=trials,
            report=lambda _, seeds, rows: self.report(seeds, rows),
            printed=("errors",),
            figures=self.figures,
            models="name",
        )

    def report(self, seeds: range, trials: Trials) -> Report:
        """Errors by model and level; at one of these, one model beside least squares and joints alone."""
        cells, factor = compare.cells(trials, self.factor), KNOWN[self.factor]
        at = {self.factor: self.level}
        here = [row for row in cells if row[self.factor] == self.level]
        f = Row(
            compare.head(seeds, trials),
            cells=cells,
            gains=compare.gains(trials.where(**at), here, self.ours),
            duels=compare.duels(trials, [(self.ours, "Joints")], self.factor),
            models=compare.contract(here, where=self._where(self.level)),
        )
        worst = max(f.duels, key=lambda row: middle(row.ratio))
        how = "{how} {n}. {arms} RMS errors of predicted deflection, medians ({ends})."
        ends = span(len(seeds))
        title = f"RMS error, um, by {factor.heading}"
        return Report(
            scenario=self.name,
            question=Markdown(self.question),
            title=say(
                how, how=self.how, n=counted(len(seeds), "trial"), arms=compare.arms_told(f), ends=ends
            ),
            answer=lines([f"{self._where(self.level)}:", *compare.beside_rivals(f.gains)]),
            worst=say(
                "{where} is the worst beside joint stiffness only: {ours} has {ratio:~.2f} times the error.",
                worst,
                where=self._where(worst[self.factor]),
            ),
            numbers=f,
            tables={"errors": compare.errors(cells, "name", self.factor, title)},
            body=["errors"],
            badge=of_models(trials.where(**at), here, self.ours, compare.ERROR),
        )

    def _where(self, level: float) -> str:
        factor = KNOWN[self.factor]
        return f"{capital(factor.heading)} {factor.text(level)} {factor.unit}".strip()

    def figures(self, found: Report) -> Mapping[str, Figure]:
        """Error over the levels of the factor, a line a model."""
        f, [name, factor] = Row(found.numbers), columns(f"name {self.factor}")
        table = Table((name, factor, compare.RMS), f.cells)
        answer = f"{self._where(self.level)}: {compare.gains_told(f.gains)}"
        reading = (
            f"Marks: medians of {f.trials} trials; bands: {span(f.trials)}. Filled and dashed: with a prior."
        )
        return {f"{self.name}.png": sweeps({self.question: table}, answer, reading)}
