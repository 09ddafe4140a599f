"""testbench predict MODEL POSES.csv --out DIR: deflections under loads, intervals, stiffness."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench import __version__
from testbench.arm.mjcf import GRAVITY
from testbench.model.vjm import WorkArea
from testbench.report.leave import RunRequest, write_run
from testbench.report.markdown import Markdown, capital, ended
from testbench.report.program_scene import draw_prediction
from testbench.report.report import Report, say
from testbench.report.schema import Table, columns
from testbench.report.table import Row
from testbench.report.terminal import plain_console, print_words, viewing_lines
from testbench.runs.whole import claim_folder
from testbench.workflows.arm_models import load_model
from testbench.workflows.campaign_flags import MapFile, Payload
from testbench.workflows.options import (
    ArmCheck,
    Force,
    ProjectCommand,
    overload_warnings,
    payload_of,
    plain,
    takes,
)
from testbench.workflows.plan_input import parse_work_area
from testbench.workflows.program import (
    DEFAULT_FORCE,
    Predicted,
    predict_file,
    read_pose_file,
)
from testbench.workflows.program_numbers import TABLE, prediction_numbers, write_predictions

if TYPE_CHECKING:  # importing MuJoCo takes a sixth of a second, and --help does without
    from testbench.report.figure import Figure
    from testbench.report.scene import PageContent

# --- The commands of the command line, each imported when it is called --------------------------------------

COMMANDS = {
    "new": "Make an arm's folder from a robot's URDF or MJCF.",
    "check": "Check an arm's folder, and list what to confirm.",
    "plan": "Choose the poses to measure, and predict the error that remains.",
    "simulate": "Simulate readings of an arm in given poses.",
    "data": "Read a file of readings, and show what was understood.",
    "identify": "Identify stiffness models from readings without and with a load.",
    "calibrate": "Calibrate an arm by absolute readings: geometry, joint errors, compliances.",
    "export": "Write the identified geometry into the robot's URDF.",
    "predict": "Predict the deflection under loads, with intervals and stiffness.",
    "compensate": "Correct a robot's program for the deflection under loads.",
    "demo": "Calibrate a heavy arm in simulation.",
    "bench": "Rank your estimators beside others in frozen tasks.",
    "compare": "Compare two runs: which errs less, and which inputs differ.",
    "view": "Open the newest recording of a run in the Rerun viewer.",
}
"""What there is, one module each, and its line of help."""
GROUPS = ("data",)  #: Those that have commands of their own.
TYPED = ("COMP_WORDS", "_TYPER_COMPLETE_ARGS")  #: Where a shell that completes says what was typed.


def program(arguments: Sequence[str]) -> typer.Typer:
    """Make the command with what the arguments ask for; of all others the line of help alone.

    So that `testbench --help` imports neither MuJoCo nor Pinocchio nor Rerun.

    Args:
        arguments: Of the command line; the first one names the command.
    """
    app = typer.Typer(help="Virtual calibration cell for heavy robot arms.", callback=_options)
    named = list(arguments[:1]) or " ".join(os.environ.get(name, "") for name in TYPED).split()[1:2]
    for name, line in COMMANDS.items():
        module = import_module(f"testbench.cli.{name}") if name in named else None
        if module is not None and name in GROUPS:
            app.add_typer(module.group, name=name, help=line)
        else:
            command = module.command if module is not None else _elsewhere
            app.command(name, help=line, cls=ProjectCommand)(command)
    return app


def _elsewhere() -> None:
    """Stands for a command that was not asked for."""


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"testbench {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Flags of the program itself."""


# --- testbench predict MODEL POSES.csv --out DIR: deflections under loads, intervals, stiffness -------------

COMMAND, PICTURE, STIFFNESS = "testbench predict", "predict.png", "stiffness.png"
POSES = (
    "pose deflection_mm half_words deflections_mm.0 deflections_mm.1 deflections_mm.2 turn_mrad "
    "stiffness_n_per_um.0 softest"
)


@dataclass(frozen=True)
class PredictOptions:
    """Hold the flags of the command."""

    model: Annotated[Path, typer.Argument(help="Folder of an identified or calibrated arm.")]
    poses: Annotated[Path, typer.Argument(help="Poses and loads: a program, tasks or a plan.")]
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the results.")] = Path("runs/predict")
    arm: ArmCheck = None
    mapping: MapFile = None
    payload: Payload = None
    push: Annotated[
        float | None,
        typer.Option(min=0.001, max=1e6, metavar="N", help="Force of the map, N (default: the payload's)."),
    ] = None
    box: Annotated[str | None, typer.Option(metavar="X0,...,Z1", help="Corners of the map, m.")] = None
    force: Force = False


@takes(PredictOptions, draws=True)
def command(asked: PredictOptions) -> None:
    """Predict where loads bring the tool, with intervals; map how stiff it is."""
    given = [asked.model, asked.poses, *([asked.mapping] if asked.mapping else [])]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        area = None if asked.box is None else WorkArea(*parse_work_area(asked.box))
        model = load_model(asked.model, asked.arm)
        poses = read_pose_file(
            asked.poses, model, asked.mapping, lambda: payload_of(model.arm, asked.payload, "--load")
        )
        push = asked.push or (GRAVITY * model.arm.payload if model.arm.payload else DEFAULT_FORCE)
        made = predict_file(model, poses, push, area)
        said, flags = report(made), plain(asked, read="poses") | {"model": asked.model.name}
        write = partial(write_predictions, made)
        arms = [model.arm.rigid.parent]
        run = RunRequest(COMMAND, poses.path.name, flags, arms, PICTURE, more=write, draw=_drawn)
        write_run(asked.out, run, said, draw_prediction(made, said.numbers["ellipsoids"]))
        places = ", ".join(str(asked.out / name) for name in ("report.md", "report.json", PICTURE, STIFFNESS))
        lines = [
            *(f"- {words}" for words in overload_warnings(model.arm, poses.hung.tolist())),
            f"poses      {asked.out / TABLE}",
            f"report     {places}",
            *viewing_lines(asked.out, model=asked.model),
        ]
        print_words(plain_console(), said, [printed(said)], lines)


def _drawn(said: Report, page: "PageContent") -> Mapping[str, "Figure"]:
    from testbench.report.run_figure import (
        overview,
        stiffness_figure,  # here: it imports matplotlib
    )

    f = Row(said.numbers)
    return {PICTURE: overview(said, page), STIFFNESS: stiffness_figure(f.ellipsoids, f.map.force_n)}


def report(made: Predicted) -> Report:
    """Report a prediction."""
    f = prediction_numbers(made)
    first = f.worst[0]
    tables = {
        "worst": Table(columns(POSES), f.worst, "Poses that move most", headline="deflection_mm"),
        "numbers": Table(
            columns("what value"),
            [Row(what=name, value=own) for name, own in _others(f) if own is not None],
            "Other numbers",
        ),
    }
    sure = "which the readings do not determine" if first.half_mm is None else "+- {half_mm:.3f} mm (95 %)"
    return Report(
        scenario="predict",
        question=say("Where does the tool of {arm} go under {loads}, and how stiff is it?", f),
        title=say("Deflection under load: {arm}, {poses:counted pose} of {file}", f),
        answer=say(
            f"Under {{loads}} the tool moves by at most {{deflection_mm:.3f}} mm, {sure}, in pose {{pose}}.",
            first,
            loads=f.loads,
        ),
        claims=[say("{text}", text=ended(capital(text))) for text in _warnings(f)],
        numbers=f,
        tables=tables,
        body=[*tables, Markdown("What each table means: docs/correction.md, *Predict*.")],
    )


def _warnings(f: Row) -> Iterator[str]:
    """How the file was read, loads beyond the readings, what no reading has seen, doubts of the model."""
    yield from (*f.notes, *f.extrapolated)
    if any(row.half_mm is not None and 2 * row.half_mm > row.deflection_mm > 0 for row in f.worst[:1]):
        yield "Uncertain: the interval of the largest deflection is wider than half of it"
    if f.map.half_mm is not None and 2 * f.map.half_mm > f.map.worst_mm:
        yield "Uncertain: the interval at the worst place of the map is wider than half of the value there"
    if f.unseen_percent:
        yield f"The readings give no interval for {f.unseen_percent:.0f} % of the deflections"
    if f.map.unseen_percent:
        yield f"No interval for some force direction in {f.map.unseen_percent:.0f} % of the map's poses"
    yield from (f"Doubt of the model: {text}" for text in f.doubts)


def _others(f: Row) -> Iterator[tuple[str, object]]:
    """Numbers that stand in no other table, with their units."""
    field, soft = f.map, f.softest
    yield "model", f.method
    yield "positions", "calibrated" if f.absolute else "of the nominal arm with its deflection"
    yield "95 % half width of a position at the tool, median, mm", f.position_half_mm if f.absolute else None
    yield "largest force about the tool's origin, N", f.force_n
    yield "largest moment, N m", f.moment_nm
    yield "ratio of that force to the largest one identified", f.force_ratio
    yield "ratio of that moment to the largest one identified", f.moment_ratio
    yield "deflection, least, mm", f.least_mm
    yield "deflection, median, mm", f.median_mm
    yield "largest difference from the linear model, Eq. (6), mm", f.other_off_mm
    yield "softest pose of the file", soft.pose
    yield "least stiffness there, N/um", soft.stiffness_n_per_um[0]
    yield "its direction", soft.softest
    yield "force of the map, N", field.force_n
    yield "deflection by that force in the softest pose, mm", soft.push_mm
    yield "its 95 % half width, mm", soft.push_half_mm or "none"
    yield "poses of the map", field.places
    yield "deflection by the force in its worst direction, median of the map, mm", field.median_mm
    yield "this deflection, 95 % of the map, mm", field.p95_mm
    yield "this deflection, worst place of the map, mm", field.worst_mm
    yield "95 % half width there, mm", field.half_mm or "none"
    yield "worst place of the map, x, y, z, m", ", ".join(f"{x:.3f}" for x in field.at_m)
    yield "joints there", field.joints
    yield "softest direction there", field.softest


def printed(said: Report) -> Table:
    """Take the first five poses, for a terminal."""
    table = said.tables["worst"]
    own = tuple(column for column in table.columns if column.key != "turn_mrad")
    return replace(table, columns=own, rows=table.rows[:5])
