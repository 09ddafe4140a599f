"""A study: trials return rows, a report is made of their table, views show the report.

Rivals of the default in every study: the default without its cone, and restrained least squares.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

import numpy as np
import typer

from testbench.arm.folder import find_arm, load_arm
from testbench.data.dataset import Dataset, select_rows, split_by_pose
from testbench.errors import Array
from testbench.files.read_pairs import from_text
from testbench.files.write import write_csv
from testbench.identify.method import gco, least_squares, paper_gco
from testbench.model.structure import all153, template56
from testbench.plant.shapes import body_origins, elastic_frames, rigid_frames
from testbench.plant.true_arms import FAMILY_NAME, true_arms
from testbench.report.colours import MEASURED, Look, look_of
from testbench.report.figure import Figure
from testbench.report.report import Report
from testbench.report.scene import (
    Layer,
    ModelLine,
    PageContent,
    PlaceMap,
    PoseGroup,
    RunChart,
    Scene,
    arrow_scale,
    at_one_target,
    largest_and_even,
    loads,
    of_all,
    on_tool,
)
from testbench.report.table import Row, Trials
from testbench.runs.engine import Work
from testbench.studies.intervals import clipped, ridge
from testbench.workflows.campaign import Scenario, Setup, Truth, of_arm, settle_both
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.model_names import CLIPPED, FILLED, IN_PAPER, RIDGE, WITHOUT_CONE, in_words
from testbench.workflows.models import Model, equal_fit, named_models
from testbench.workflows.own_estimator import EstimatorSource, Models, estimator_models
from testbench.workflows.rows import MM

# --- Flags of simulated campaigns ---------------------------------------------------------------------------


def true_arm_name(text: str) -> str:
    """Check the name of a kind of true arm; BadParameter if there is none."""
    if text == FAMILY_NAME or text in true_arms:
        return text
    raise typer.BadParameter(f"expected one of {', '.join([FAMILY_NAME, *true_arms])}, got {text!r}")


ArmFlag = Annotated[str, typer.Option(metavar="ARM", help="Folder of an arm, or name of a built-in one.")]
TrueArmFlag = Annotated[
    str,
    typer.Option(parser=true_arm_name, metavar="NAME", help="Kind of true arm; family: one of six per seed."),
]


@dataclass(frozen=True)
class CampaignOptions:
    """Describe what a campaign under gravity is made from; a study adds its own flags."""

    arm: ArmFlag = "kr500_l480"
    payload_kg: Annotated[
        float | None, typer.Option(min=0.001, max=10_000, metavar="KG", help="Payload (default: rated).")
    ] = None
    sigma_um: Annotated[
        float, typer.Option(min=0.001, max=10_000, metavar="UM", help="Noise of a reading, per axis.")
    ] = 50.0
    truth: Annotated[Truth, typer.Option(help="MuJoCo's arm or a linear one.")] = "nonlinear"
    true_arm: TrueArmFlag = FAMILY_NAME

    def scenario(self, workspace_poses: int) -> Scenario:
        """Make the campaign that is asked for; InputError names an arm that there is not."""
        scenario = Scenario(
            arm=find_arm(self.arm).resolve().name,
            payload=self.payload_kg,
            sigma=self.sigma_um / 1e6,
            truth=self.truth,
            workspace_poses=workspace_poses,
        )
        return of_arm(load_arm(self.arm), scenario)


# --- A study: trials return rows, a report is made of their table, views show the report --------------------

O = TypeVar("O")  # noqa: E741 - options
S = TypeVar("S")
W = TypeVar("W")
P = TypeVar("P")


Everywhere = Callable[[Callable[[int], P], int, type[P]], list[P]]
"""Does pieces of work on all cores, as trials are done, and stores their rows for --resume.

It takes what makes the row of a piece by its number from 0, how many pieces there are, and the type of a row.
"""


def own_arm(settings: Any) -> list[Path]:
    """Find the folder of the arm that the settings name."""
    return [find_arm(settings.arm)]


def own_cell(settings: Any) -> Cell:
    """Build the cell of the arm that the settings name."""
    return build_cell(find_arm(settings.arm))


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
    #: Rows of one trial, from what trials share, the settings, the seed, and what makes models of a user's
    #: estimators; a function of a module (see `runs.engine.Work`).
    trial: Callable[[Any, S, int, Models], Iterable[W]]
    #: What all trials say, from the settings, the seeds and the rows of all trials.
    report: Callable[[S, range, Trials], Report]
    printed: tuple[str, ...]  #: Names of the tables that the terminal shows.
    figures: Callable[[Report], Mapping[str, Figure]]  #: PNGs made of the report alone, by name.
    #: Writes what is not made of the report alone, and says what the page draws beside
    #: words and tables.
    write: Callable[["Run[S]"], PageContent | None] = lambda _: None
    #: Name of the data file. `write` makes it, or a row of the first seed holds its text as `data_file`: then
    #: nothing is simulated again for it.
    data: str = "dataset.csv"
    size: int = 1  #: Seeds of a chunk: 0.1 to 1 s of work.
    shared: Callable[[S], Any] = own_cell  #: What trials share, made once a chunk; a function of a module.
    #: Adds to the settings what all trials share and what is too dear for each of them.
    prepare: Callable[[S, Everywhere[Any]], S] | None = None
    arms: Callable[[S], Sequence[Path]] = own_arm  #: Folders of the arms that it needs.
    own: Callable[[S], Sequence[EstimatorSource]] = lambda _: ()  #: Estimators that its settings name.
    #: Column that names the models where `trial` takes estimators of one's own; beside it is `status`.
    models: str = ""

    def work(self, settings: S, own: Sequence[EstimatorSource] = ()) -> Work:
        """Make what does the trials of some seeds.

        Args:
            settings: What is tried.
            own: Estimators of the user.

        Returns:
            A function of the seeds, which returns the rows of each.
        """
        return partial(_rows, self.trial, self.shared, settings, own)


def _rows(
    trial: Callable[[Any, S, int, Models], Iterable[W]],
    shared: Callable[[S], Any],
    settings: S,
    own: Sequence[EstimatorSource],
    seeds: Sequence[int],
) -> list[list[W]]:
    """Rows of some seeds; a module's function, as workers get it by its name."""
    common, models = shared(settings), estimator_models(own)
    return [list(trial(common, settings, seed, models)) for seed in seeds]


AnyStudy = Study[Any, Any, Any]


@dataclass(frozen=True)
class Run(Generic[S]):
    """Hold a finished study, for what is still to be written."""

    settings: S  #: What was tried.
    seeds: range  #: Of the trials.
    report: Report  #: What was found.
    folder: Path  #: Where to write.

    @property
    def first(self) -> Trials:
        """Read the rows of the first seed."""
        return Trials.read(self.folder / "trials.parquet").where(seed=self.seeds[0])


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
    held = [equal_fit(cell), Model(RIDGE, beams, ridge), Model(CLIPPED, beams, clipped)]
    return [*models[:behind], *held, *models[behind:]]


def as_in_paper(models: Sequence[Model]) -> list[Model]:
    """Copy models that GCO identifies without a prior, by the paper's GCO, without a trace weight."""
    own = [m for m in models if m.estimator == gco]
    return [Model(f"{m.name}{IN_PAPER}", m.structure, paper_gco) for m in own]


def without_cone(cell: Cell) -> Model:
    """Make the model of the default's unknowns by least squares, to be given its prior."""
    return Model(WITHOUT_CONE, replace(all153(cell.arm), name=WITHOUT_CONE), least_squares)


# --- Arms in poses with the errors of models, from the rows of the first seed, without a new simulation -----

ARROWS = 0.25  #: Length of an arrow longer than 95 % of those of a model over the reach of the arm [1].
LONGEST = 0.3  #: The same of errors alone.
OVER = "Error in each pose, RMS over the markers (mm)"
LEFT = "Residual of each run, RMS over the markers (mm)"


def with_errors(
    poses: PoseGroup, at: Array, errors: Mapping[str, Array], looks: Mapping[str, Look], scale: float
) -> tuple[PoseGroup, list[ModelLine]]:
    """Add the errors of models to poses as arrows at one point and in words; and make lines of them.

    Args:
        poses: All else that is drawn.
        at: Where arrows may begin, (poses, m, 3) [m].
        errors: Of models, where the last one errs most is shown first, (poses, m, 3) [m].
        looks: Of the models.
        scale: Magnification of the arrows.

    Returns:
        The poses, and the lines, RMS over the points.
    """
    lines = [
        ModelLine(name, looks[name], MM * np.sqrt((off**2).sum(axis=-1).mean(axis=-1)))
        for name, off in errors.items()
    ]
    errs = [
        ", ".join(f"{in_words(model_line.name)} {model_line.values[k]:.3f} mm" for model_line in lines)
        for k in range(len(at))
    ]
    start, one = at_one_target(at, errors, [*errors][-1])
    arrows = [
        Layer(
            f"error of {in_words(name)}", looks[name].colour, looks[name].stroke, start, start + scale * off
        )
        for name, off in one.items()
    ]
    drawn = replace(
        poses,
        words=[f"{words}Error: {err}." for words, err in zip(poses.words, errs, strict=True)],
        layers=[*poses.layers, *arrows],
        first=int(lines[-1].values.argmax()),
    )
    return drawn, lines


def amid_errors(
    cell: Cell, q: Array, names: Sequence[str], errors: Mapping[str, Array], looks: Mapping[str, Look]
) -> PageContent:
    """Draw the arm with arrows from where models have its targets to where they truly are, or were read.

    Args:
        cell: The arm.
        q: Poses, (poses, n) [rad, m]; those of the largest errors of the last model and others evenly.
        names: Of the poses, a few letters each.
        errors: Of models, on the first of the arm's markers, base axes, (poses, 3) [m].
        looks: Of the models.

    Returns:
        The content.
    """
    some = largest_and_even(np.linalg.norm([*errors.values()][-1], axis=-1), np.arange(len(q)))
    errors, names = {name: off[some, None] for name, off in errors.items()}, [names[k] for k in some]
    scale = arrow_scale(next(iter(errors.values())), LONGEST * cell.vjm.reach)
    rigid = rigid_frames(cell.room, q[some])
    title, called = "Positions that were not fitted", [f"Position {name}" for name in names]
    poses = PoseGroup(title, called, [""] * len(some), rigid, bent=None)
    drawn, lines = with_errors(
        poses, body_origins(cell.room, cell.arm.markers[:1], rigid), errors, looks, scale
    )
    note = of_all(len(some), len(q), "positions")
    chart = RunChart("Error at each position (mm)", 0, "position", names, lines, note=note)
    return PageContent(scene=Scene(cell, f"Errors x {scale:g}.", [drawn]), runs=[chart])


def _runs_of(cell: Cell, first: Trials) -> tuple[Dataset, Dataset]:
    """Read all measured runs of the first seed, and the true ones that models are judged by."""
    trials = first.inside("drawn")
    return from_text(trials["measured"][0], cell.arm), from_text(trials["over"][0], cell.arm)


def write_runs(run: Run[Any], cell: Cell, poses: int | None = None) -> None:
    """Write dataset.csv of the first seed.

    Args:
        run: The finished study.
        cell: The arm with its model and its truth.
        poses: Number of poses; None for all.
    """
    measured, _ = _runs_of(cell, run.first)
    data = measured if poses is None else split_by_pose(measured, np.arange(poses) + 1)[0]
    write_csv(data, cell.arm, run.folder / "dataset.csv")


def calibration_scene(run: Run[Any], cell: Cell, setup: Setup, fitted: int) -> PageContent:
    """Draw the arm in the poses that judge and in all runs, with the errors of compared models.

    Args:
        run: Its report has models and a map, whose order of places is that of the page.
        cell: The true arm.
        setup: What was measured.
        fitted: How many poses, from 1, were fitted.

    Returns:
        The content.
    """
    f = Row(run.report.numbers)
    first = run.first
    size = run.settings.magnification
    names = first["name"].tolist()
    looks = {m.name: look_of(m) for m in f.models}
    shown = f.map.compared
    wrong, left = (
        {name: -np.reshape(first[key][names.index(name)], (-1, len(cell.arm.markers), 3)) for name in shown}
        for key in ("drawn.wrong_m", "drawn.residuals_m")
    )
    measured, over = _runs_of(cell, first)
    order = np.array([over.run_id.tolist().index(run) for run in f.map.run])
    over, wrong = select_rows(over, order), {name: own[order] for name, own in wrong.items()}
    places = [f"Place {k} of {over.n_runs}" for k in range(1, over.n_runs + 1)]
    kinds = ["fitted" if pose <= fitted else "check" for pose in measured.pose_id.tolist()]
    said = [
        f"Run {run}, {kind} pose {pose}"
        for run, kind, pose in zip(measured.run_id.tolist(), kinds, measured.pose_id.tolist(), strict=True)
    ]
    reach = float(np.linalg.norm(over.before[:, 0], axis=-1).max())
    each = sorted(arrow_scale(off, ARROWS * reach) for off in wrong.values())
    scale = each[(len(each) - 1) // 2]  # that of a model in the middle: the worst one has longer arrows
    (poses, by_place), (runs, by_run) = (
        with_errors(*_poses(cell, setup, data, of, size), errors, looks, scale)
        for data, of, errors in (
            (over, ("Poses, against the truth", places), wrong),
            (measured, ("Runs, against their readings", said), left),
        )
    )
    title = (
        f"Deflections x {size:g}; arrows: errors at the marker where {in_words(shown[-1])} errs most, "
        f"x {scale:g}."
    )
    return PageContent(
        scene=Scene(cell, title, [poses, runs]),
        map=PlaceMap(OVER, 0, np.array(f.map.position_m), by_place),
        runs=[RunChart(LEFT, 1, "run", [str(run) for run in measured.run_id], by_run)],
    )


def _poses(
    cell: Cell, setup: Setup, data: Dataset, of: tuple[str, Sequence[str]], M: float
) -> tuple[PoseGroup, Array]:
    """The arm in every pose of a dataset under its load, deflections magnified; where its markers then are.

    Args:
        cell: The arm.
        setup: Its kind of truth.
        data: The runs.
        of: Name of the group and names of the poses.
        M: Magnification.
    """
    before, after = settle_both(cell.plant, setup.truth, data.q, data.wrench, data.point)
    at = before.marker_positions + M * data.deflection
    bent = elastic_frames(cell.plant, data.q, M * (after.theta - before.theta))
    moved = MM * np.linalg.norm(data.deflection, axis=-1).max(axis=1)
    poses = PoseGroup(
        *of,
        words=[
            f"Markers move up to {mm:.2f} mm. Joints at {cell.arm.pose_text(q)}. "
            for mm, q in zip(moved.tolist(), data.q, strict=True)
        ],
        rigid=rigid_frames(cell.room, data.q),
        bent=bent,
        layers=[
            Layer("markers under load", MEASURED, "dots", at),
            *loads(on_tool(cell, bent, data.point), data.wrench[:, :3], cell.vjm.reach),
        ],
    )
    return poses, at
