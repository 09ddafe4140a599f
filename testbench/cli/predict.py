"""testbench predict MODEL POSES.csv --out DIR: deflections under loads, intervals, stiffness."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.mjcf import GRAVITY
from testbench.model.vjm import WorkArea
from testbench.report.markdown import Markdown, capital, ended
from testbench.report.program_scene import STIFFNESS, draw_prediction, program_figures
from testbench.report.report import Report, RunRequest, say, write_run
from testbench.report.schema import Table, columns
from testbench.report.table import Row
from testbench.report.terminal import plain_console, print_words, viewing_lines
from testbench.runs.whole import claim_folder
from testbench.workflows.arm_models import load_model
from testbench.workflows.options import (
    ArmCheck,
    Force,
    MapFile,
    Payload,
    Recording,
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

COMMAND, PICTURE = "testbench predict", "predict.png"
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
        typer.Option(min=0.001, max=1e6, metavar="N", help="Force for the map, N (default: the payload)."),
    ] = None
    box: Annotated[str | None, typer.Option(metavar="X0,...,Z1", help="Corners of the map, m.")] = None
    recording: Recording = False
    force: Force = False


@takes(PredictOptions, draws=True)
def command(asked: PredictOptions) -> None:
    """Predict where loads bring the tool, with intervals; map how stiff it is."""
    given = [asked.model, asked.poses, *([asked.mapping] if asked.mapping else [])]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        area = None if asked.box is None else WorkArea(*parse_work_area(asked.box))
        model = load_model(asked.model, asked.arm)
        poses = read_pose_file(asked.poses, model, asked.mapping, asked.payload)
        push = asked.push or (GRAVITY * model.arm.payload if model.arm.payload else DEFAULT_FORCE)
        made = predict_file(model, poses, push, area)
        said, flags = report(made), plain(asked, read="poses") | {"model": asked.model.name}
        write = partial(write_predictions, made)
        arms = [model.arm.mjcf_path.parent]
        run = RunRequest(
            COMMAND,
            poses.path.name,
            flags,
            arms,
            PICTURE,
            more=write,
            draw=partial(program_figures, PICTURE, push),
            recording=asked.recording,
        )
        write_run(asked.out, run, said, draw_prediction(made, said.numbers["ellipsoids"]))
        places = ", ".join(str(asked.out / name) for name in ("report.md", "report.json", PICTURE, STIFFNESS))
        lines = [
            f"poses      {asked.out / TABLE}",
            f"report     {places}",
            *viewing_lines(asked.out, recording=asked.recording, model=asked.model),
        ]
        print_words(plain_console(), said, [printed(said)], lines)


def report(made: Predicted) -> Report:
    """Report a prediction."""
    f = prediction_numbers(made)
    first = f.worst[0]
    tables = {
        "worst": Table(
            columns(POSES), f.worst, "Poses with the largest deflection", headline="deflection_mm"
        ),
        "numbers": Table(
            columns("what value"),
            [Row(what=name, value=own) for name, own in _others(f) if own is not None],
            "Other numbers",
        ),
    }
    sure = "not determined by the readings" if first.half_mm is None else "± {half_mm:.3f} mm (95 %)"
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
        yield "Uncertain: the 95 % half width of the largest deflection exceeds half of this deflection"
    if f.map.half_mm is not None and 2 * f.map.half_mm > f.map.worst_mm:
        yield "Uncertain: the 95 % half width of the largest deflection in the map exceeds half of it"
    if f.unseen_percent:
        yield f"The readings give no interval for {f.unseen_percent:.0f} % of the deflections"
    if f.map.unseen_percent:
        yield f"{f.map.unseen_percent:.0f} % of the map's poses have no interval for some force direction"
    yield from (f"Warning of the model: {text}" for text in f.doubts)


def _others(f: Row) -> Iterator[tuple[str, object]]:
    """Numbers that stand in no other table, with their units."""
    field, soft = f.map, f.softest
    yield "model", f.method
    yield "predicted positions", "of the calibrated arm" if f.absolute else "of the nominal arm, deflected"
    yield "95 % half width of a position at the tool, median, mm", f.position_half_mm if f.absolute else None
    yield "largest force about the tool's origin, N", f.force_n
    yield "largest moment, N m", f.moment_nm
    yield "ratio of this force to the largest one of the identification", f.force_ratio
    yield "ratio of this moment to the largest one of the identification", f.moment_ratio
    yield "deflection, least, mm", f.least_mm
    yield "deflection, median, mm", f.median_mm
    yield "largest difference from the linear model, Eq. (6), mm", f.other_off_mm
    yield "softest pose of the file", soft.pose
    yield "least stiffness in this pose, N/um", soft.stiffness_n_per_um[0]
    yield "direction of the least stiffness", soft.softest
    yield "force in the stiffness map, N", field.force_n
    yield "deflection by that force in the softest pose, mm", soft.push_mm
    yield "95 % half width of this deflection, mm", soft.push_half_mm or "none"
    yield "poses in the map", field.places
    yield "deflection by the force in the worst direction, median over the map, mm", field.median_mm
    yield "this deflection, 95th percentile over the map, mm", field.p95_mm
    yield "this deflection, largest over the map, mm", field.worst_mm
    yield "95 % half width of the largest deflection, mm", field.half_mm or "none"
    yield "place of the largest deflection (x, y, z), m", ", ".join(f"{x:.3f}" for x in field.at_m)
    yield "joint angles there", field.joints
    yield "softest direction there", field.softest


def printed(said: Report) -> Table:
    """Take the first five poses, for a terminal."""
    table = said.tables["worst"]
    own = tuple(column for column in table.columns if column.key != "turn_mrad")
    return replace(table, columns=own, rows=table.rows[:5])
