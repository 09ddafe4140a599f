"""Runs beside one another: report.json of a comparison as typed rows, the unit in the name."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.bench.compare_inputs import NONE, InputRow
from testbench.bench.compare_map import WorstPlace
from testbench.bench.compare_models import KINDS, ModelPair
from testbench.bench.compare_numbers import Difference, Verdict

LETTERS = "ABCDEFGH"  #: What the runs are called, in the order in which they were named.


@dataclass(frozen=True)
class RunRow:
    """A run."""

    letter: str
    folder: str  #: As it was named.
    command: str  #: What made it.
    seeds: str  #: In words.
    answer: str  #: Its own, empty where its report has none that can be read.

    @property
    def made(self) -> str:
        """What made it, with its seeds."""
        if self.seeds == NONE:
            return self.command
        return f"{self.command}, {'seeds' if ' ' in self.seeds else 'seed'} {self.seeds}"


@dataclass(frozen=True)
class NumberPair:
    """A number of a table of two runs."""

    table: str  #: What the table shows.
    row: str  #: Which row it is in.
    quantity: str  #: Heading and unit of its column.
    a: str  #: As the tables show it.
    b: str
    found: Difference

    @property
    def what(self) -> str:
        """Which number it is."""
        return ", ".join(filter(None, [self.row, self.quantity]))


@dataclass(frozen=True)
class Counts:
    """Numbers of tables."""

    every: int = 0
    same: int = 0
    beyond: int = 0  #: Those that differ by more than their spread.
    unsure: int = 0  #: Those that differ by more than 2 % and have no spread.


@dataclass(frozen=True)
class Beside:
    """A run beside the first one."""

    a: str  #: Letter of the first one.
    b: str
    models: list[ModelPair]  #: Of every kind of error, what matters most first.
    lead: ModelPair | None  #: The model to judge the runs by; None without models in common.
    only: list[list[str]]  #: Models of the first run alone, and of the other alone.
    numbers: list[NumberPair]  #: Those of the tables that differ most; no models of `models` are in it.
    counts: Counts  #: Of all numbers of the tables.
    unread: str  #: Why tables are not compared, empty where they are.
    equal: bool  #: Whether the two reports are the same to the last digit.

    @property
    def lead_name(self) -> str:
        """Name of that model, empty without one."""
        return self.lead.name if self.lead else ""

    @property
    def led(self) -> list[ModelPair]:
        """Models by the kind of error that matters most."""
        return [pair for pair in self.models if self.lead and pair.kind == self.lead.kind]

    @property
    def by_kind(self) -> dict[str, list[ModelPair]]:
        """Models by every kind of error, its words as key."""
        found = {words: [p for p in self.models if p.kind == kind] for kind, words in KINDS.items()}
        return {words: pairs for words, pairs in found.items() if pairs}

    @property
    def where(self) -> str:
        """The kind of error that matters most, in words."""
        return KINDS[self.lead.kind] if self.lead else ""

    @property
    def same(self) -> bool:
        """Whether nothing that can be compared differs."""
        told = self.counts.every and self.counts.same == self.counts.every
        return self.equal or bool(told and all(p.rms_mm.verdict == "same" for p in self.models))

    def count(self, *verdicts: Verdict) -> int:
        """How many models of `led` are told so."""
        return sum(pair.rms_mm.verdict in verdicts for pair in self.led)

    @property
    def farthest(self) -> ModelPair | None:
        """The model whose error differs most beyond the spread; None where none does."""
        apart = [pair for pair in self.led if pair.rms_mm.apart]
        return max(apart, key=lambda pair: pair.rms_mm.size, default=None)


@dataclass(frozen=True)
class ComparedReport:
    """The fields are the keys of report.json."""

    scenario: str
    runs: list[RunRow]
    inputs: list[InputRow]  #: What differs; none if nothing does.
    beside: list[Beside]  #: Every other run beside the first one.
    worst: list[WorstPlace]  #: Of the leading model; empty where fewer than two runs say it.

    @property
    def names(self) -> list[str]:
        """The runs by their letters and folders, of which no more is said than tells them apart."""
        short = [Path(run.folder).resolve().name for run in self.runs]
        shown = short if len(set(short)) == len(short) else [run.folder for run in self.runs]
        return [f"{run.letter} is {name}" for run, name in zip(self.runs, shown, strict=True)]

    @property
    def same(self) -> bool:
        """Whether neither inputs nor numbers differ."""
        return not self.inputs and all(pair.same for pair in self.beside)

    @property
    def farthest(self) -> tuple[Beside, ModelPair] | None:
        """The model that differs most beyond the spread, with its runs; None where none does."""
        found = [(pair, pair.farthest) for pair in self.beside]
        known = [(pair, model) for pair, model in found if model is not None]
        return max(known, key=lambda own: own[1].rms_mm.size, default=None)


def letters(count: int) -> Sequence[str]:
    """Names of so many runs."""
    return LETTERS[:count]
