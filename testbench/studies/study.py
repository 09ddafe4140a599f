"""A study: trials return rows, a report is made of their table, views show the report.

Rivals of the default in every study: the default without its cone, and restrained least squares.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from testbench.arm.folder import find_arm
from testbench.identify import gco, least_squares, paper_gco
from testbench.model.structure import all153, template56
from testbench.report.figure import Figure
from testbench.report.recording.stream import RecordingHeader
from testbench.report.report import Report
from testbench.report.scene import PageContent
from testbench.report.table import Trials
from testbench.studies.shrinkage import clipped, ridge
from testbench.workflows.cell import Cell
from testbench.workflows.models import FILLED, WITHOUT_CONE, Model, equal_fit, named_models
from testbench.workflows.own_estimator import EstimatorSource

O = TypeVar("O")  # noqa: E741 - options
S = TypeVar("S")
W = TypeVar("W")
P = TypeVar("P")


class Everywhere(Protocol):
    """Do pieces of work on all cores, as trials are done, and stores them for --resume."""

    def __call__(
        self, work: Callable[[Sequence[int]], Sequence[Sequence[P]]], pieces: int, row: type[P], words: str
    ) -> list[P]:
        """Rows of all pieces, in their order.

        Args:
            work: Rows of some pieces, by their numbers from 0.
            pieces: How many.
            row: Type of the rows.
            words: What a piece is, such as "plans".
        """
        ...


def own_arm(settings: Any) -> list[Path]:
    """Find the folder of the arm that the settings name."""
    return [find_arm(settings.arm)]


@dataclass(frozen=True)
class Study(Generic[O, S, W]):
    """Describe a study: what is asked, tried, found and shown."""

    name: str  #: Of the scenario.
    about: str  #: What it asks, one line for --help.
    options: type[O]  #: Dataclass of its own flags; see `workflows.options.takes`.
    #: What is tried, from its flags, `--quick` and the seeds; raises BenchError for a wrong flag.
    settings: Callable[[O, bool, range], S]
    seeds: tuple[int, int]  #: How many trials by default, and with `--quick` at most.
    row: type[W]  #: Type of a trial's rows.
    #: Rows of some seeds, one sequence a seed; a function of a module (see `runs.engine.Work`).
    trials: Callable[..., Sequence[Sequence[W]]]
    report: Callable[[S, range, Trials], Report]  #: What all trials say.
    printed: tuple[str, ...]  #: Names of the tables that the terminal shows.
    figures: Callable[[Report], Mapping[str, Figure]]  #: PNGs made of the report alone, by name.
    #: Writes what is not made of the report alone, such as other figures; and says what the page draws beside
    #: words and tables.
    write: Callable[["Run[S]"], PageContent | None] = lambda _: None
    extra: tuple[str, ...] = ()  #: Names of other figures that `write` makes.
    #: Name of the data file. `write` makes it, or a row of the first seed holds its text as `data_file`: then
    #: nothing is simulated again for it.
    data: str = "dataset.csv"
    size: int = 1  #: Seeds of a chunk: 0.1 to 1 s of work.
    #: Adds to the settings what all trials share and what is too dear for each of them.
    prepare: Callable[[S, Everywhere], S] | None = None
    arms: Callable[[S], Sequence[Path]] = own_arm  #: Folders of the arms that it needs.
    own: Callable[[S], Sequence[EstimatorSource]] = lambda _: ()  #: Estimators that its settings name.
    #: Column that names the models where `trials` takes estimators of one's own; beside it is `status`.
    models: str = ""


AnyStudy = Study[Any, Any, Any]


@dataclass(frozen=True)
class Run(Generic[S]):
    """Hold a finished study, for what is still to be written."""

    name: str  #: Of the study.
    settings: S  #: What was tried.
    seeds: range  #: Of the trials.
    report: Report  #: What was found.
    folder: Path  #: Where to write.
    parameters: str  #: The settings as JSON.

    @property
    def first(self) -> Trials:
        """Read the rows of the first seed."""
        return Trials.read(self.folder / "trials.parquet").where(seed=self.seeds[0])

    @property
    def header(self) -> RecordingHeader:
        """Make the header of its recording."""
        return RecordingHeader(self.name, self.parameters, self.seeds[0])


AnyRun = Run[Any]


IN_PAPER = " (paper)"  #: Behind the name of a model that GCO identifies without a trace weight.
LEAST_SQUARES = "MLS56"
#: Unknowns, prior and evidence of the default; what it lacks is the cone.
DEFAULT_WITHOUT_CONE = f"{WITHOUT_CONE}{FILLED}"


def plain_models(cell: Cell, names: Sequence[str]) -> list[Model]:
    """List models without a prior; behind MLS56 what restrains it: equal fits, shrinking, clipping.

    Args:
        cell: The arm with its model and its truth.
        names: Names of the models.

    Returns:
        The models.
    """
    models, behind = named_models(cell, names), names.index(LEAST_SQUARES) + 1
    beams = template56(cell.arm, name=LEAST_SQUARES)
    held = [equal_fit(cell), Model("Ridge", beams, ridge), Model("Clipped LS", beams, clipped)]
    return [*models[:behind], *held, *models[behind:]]


def as_in_paper(models: Sequence[Model]) -> list[Model]:
    """Copy models that GCO identifies without a prior, by the paper's GCO, without a trace weight."""
    own = [m for m in models if m.estimator == gco]
    return [Model(f"{m.name}{IN_PAPER}", m.structure, paper_gco) for m in own]


def without_cone(cell: Cell) -> Model:
    """Make the model of the default's unknowns by least squares, to be given its prior."""
    return Model(WITHOUT_CONE, replace(all153(cell.arm), name=WITHOUT_CONE), least_squares)
