"""testbench calibrate ARM READINGS.csv ... --out MODEL: geometry, gears, elasticity by absolute readings."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.data.dataset import mean_numbers_per_reading
from testbench.errors import PoseError
from testbench.identify.absolute import fit
from testbench.identify.registration import MIN_REGISTRATION_POSES
from testbench.report import scene as draw
from testbench.report.badge import decide
from testbench.report.markdown import Markdown
from testbench.report.readings import CALIBRATED_ARM, NOMINAL_ARM, calibration_tables, draw_calibration
from testbench.report.report import Report, RunRequest, bullets, say, write_run
from testbench.report.terminal import plain_console, print_words, viewing_lines
from testbench.runs.whole import claim_folder
from testbench.workflows import calibration_numbers as counted
from testbench.workflows.absolute import (
    Calibrated,
    File,
    calibrate_with_masses,
    files_of,
    read_all,
    score,
)
from testbench.workflows.arm_models import read_model
from testbench.workflows.calibration_numbers import write_model
from testbench.workflows.cell import build_cell
from testbench.workflows.options import ArmName, Force, SigmaUm, mass, of_flag, plain, refuse_flags, takes
from testbench.workflows.plan import gain_of_further_poses
from testbench.workflows.rows import MM

if TYPE_CHECKING:
    from testbench.report.figure import Figure

KEPT = "Green: kinds of error that improve held-out readings; they are kept. Grey: dropped."
OUT = "runs/calibrate"
SCORING = "frame_poses", "at_most"
CALIBRATING = "out", "without", "orders", "least_squares", "force"
"""Flags that only `--score` uses, and flags that it does not use."""
COMMAND, PICTURE, JOINTS = "testbench calibrate", "calibration.png", "joint_errors.png"


@dataclass(frozen=True)
class CalibrateOptions:
    """Hold the flags of the command."""

    arm: ArmName
    readings: Annotated[list[Path], typer.Argument(help="Absolute readings: table or FILE.xlsx#SHEET.")]
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help=f"Folder of the calibrated arm (default: {OUT})."),
    ] = None
    mapping: Annotated[
        list[Path] | None,
        typer.Option("--map", metavar="TOML", help="Map of the columns: one, or one per file."),
    ] = None
    sigma_um: SigmaUm = None
    load: Annotated[
        list[float] | None,
        typer.Option(
            parser=mass, metavar="MASS", help="Payload of loaded rows, kg or as 530lb: one, or one per file."
        ),
    ] = None
    without: Annotated[
        list[str] | None, typer.Option(metavar="ERROR", help="Error to leave out, such as links or backlash.")
    ] = None
    orders: Annotated[
        int, typer.Option(min=1, max=400, metavar="N", help="Highest order of periodic errors.")
    ] = fit.MAX_HARMONIC_ORDER
    least_squares: Annotated[
        bool, typer.Option("--least-squares", help="Use least squares instead of GCO.")
    ] = False
    score: Annotated[
        bool,
        typer.Option("--score", help="Print how a calibrated ARM fits new readings."),
    ] = False
    frame_poses: Annotated[
        int | None,
        typer.Option(
            min=MIN_REGISTRATION_POSES, metavar="N", help="With --score: poses used only for the frame."
        ),
    ] = None
    at_most: Annotated[
        float | None,
        typer.Option(min=0, metavar="MM", help="With --score: exit with 1 above this mean error."),
    ] = None
    force: Force = False


@takes(CalibrateOptions, draws=True)
def command(asked: CalibrateOptions) -> None:
    """Calibrate an arm by where a tracker saw its tool, and write the model; or score one."""
    files = files_of(asked.readings, asked.mapping, asked.load, asked.sigma_um)
    if asked.score:
        refuse_flags(asked, CALIBRATING, "cannot be combined with --score, which writes nothing")
        _score(asked, files)
        return
    refuse_flags(asked, SCORING, "works only with --score")
    out = Path(OUT) if asked.out is None else asked.out
    given = [find_arm(asked.arm), *asked.readings, *filter(None, asked.mapping or [])]
    with claim_folder(out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        cell = build_cell(asked.arm)
        series, notes = read_all(files, cell.arm)
        with of_flag("--without"):
            without = frozenset(asked.without or ())
            tried = fit.CalibrationOptions("none" if asked.least_squares else "psd", asked.orders, without)
        calibrated = calibrate_with_masses(cell.vjm, series, tried, notes)
        left = counted.remaining_errors(calibrated)
        more = None
        console = plain_console()
        with suppress(PoseError):  # an arm that can be nowhere has no workspace
            more = gain_of_further_poses(cell, calibrated.calibration.model(), series[0].sigma)
        said = report(calibrated, left, more)
        lines = [f"- {note}" for note in said.numbers["notes"]]
        if said.numbers["rejected"]:
            nothing = "rejected   the calibrated arm predicts worse than the nominal arm; nothing was written"
            print_words(console, said, [], [*lines, nothing])
            raise typer.Exit(1)
        flags = plain(asked, read="readings", without=("arm", "score", "frame_poses", "at_most"))
        assert isinstance(flags["readings"], dict)
        write = partial(write_model, calibrated.calibration, flags["readings"], said.numbers["doubts"])
        run = RunRequest(
            COMMAND, cell.arm.name, flags, [cell.arm.mjcf_path.parent], PICTURE, more=write, draw=_drawn
        )
        write_run(out, run, said, draw_calibration(cell, calibrated, left))
        names = ("report.md", "report.json", PICTURE, *([JOINTS] if said.numbers["spectrum"] else []))
        places = ", ".join(str(out / name) for name in names)
        lines += [f"model      {out / 'model.json'}", f"report     {places}", *viewing_lines(out)]
        print_words(console, said, [said.tables["steps"]], lines)


def _drawn(said: Report, page: draw.PageContent) -> Mapping[str, "Figure"]:
    from testbench.report.figure import add_words  # here: it imports matplotlib
    from testbench.report.figures_fit import joint_error_figure
    from testbench.report.run_figure import overview

    joints = said.numbers["spectrum"]
    more = {JOINTS: joint_error_figure(joints)} if joints else {}
    return {PICTURE: add_words(overview(said, page), KEPT), **more}


def _score(asked: CalibrateOptions, files: Sequence[File]) -> None:
    """Print how far readings are from a calibrated arm; of a new series fit frame and target only."""
    model = read_model(Path(asked.arm))
    position_errors, notes = score(model, files, asked.frame_poses)
    limit = math.inf if asked.at_most is None else asked.at_most
    failed = not position_errors.mean_mm <= limit
    verdict = (
        f"{'Do not use' if failed else 'Holds'}: the mean error is {position_errors.mean_mm:.3f} mm, "
        f"the limit is {limit:g} mm"
    )
    sizes = (
        f"{position_errors.mean_mm:.3f} mm mean, {position_errors.rms_mm:.3f} mm RMS, "
        f"{position_errors.p95_mm:.3f} mm 95th percentile"
    )
    lines = [
        *([] if asked.at_most is None else [verdict]),
        *notes,
        f"errors of {position_errors.n} positions: {sizes}, {position_errors.max_mm:.3f} mm largest",
        f"{100 * position_errors.coverage_95:.1f} % of these positions lie in their 95 % interval",
    ]
    plain_console().print("\n".join(lines), soft_wrap=True)
    if failed:
        raise typer.Exit(1)


def report(
    found: Calibrated, left: counted.RemainingErrors, more: tuple[float, float] | None = None
) -> Report:
    """Report a calibration; see `numbers` for the arguments.

    Args:
        found: The calibration.
        left: Errors that remain.
        more: Errors now and after further poses [m]; None if not asked for.

    Returns:
        The report.
    """
    f, chosen = counted.numbers(found, left, more), found.calibration.selection
    length = np.sqrt(mean_numbers_per_reading(found.calibration.series))
    plain_mm, own_mm = (MM * length * x for x in chosen.held_out_rms)
    rival = f"arm with only {chosen.simpler_model}" if chosen.simpler_model else NOMINAL_ARM
    answer = say(
        "RMS error at fitted readings (none held out): {total_after.rms_mm:.3f} mm of the "
        "calibrated arm, {total_before.rms_mm:.3f} mm of the nominal arm.",
        f,
    )
    if f.held_out_mm:
        answer = say(
            "RMS error at held-out readings: {own:.3f} mm of the {arm}, {plain:.3f} mm of the {rival}.",
            own=np.sqrt(np.mean(own_mm**2)),
            plain=np.sqrt(np.mean(plain_mm**2)),
            arm=CALIBRATED_ARM,
            rival=rival,
        )
    heads = (("What is not determined", f.left_open), ("How the files were read", f.notes))
    lists = [Markdown(f"## {head}\n\n{bullets(texts) or 'Nothing.'}") for head, texts in heads]
    badge = decide(
        (CALIBRATED_ARM, own_mm), (rival, plain_mm), "block held out", counted.reason_against_use(f)
    )
    tables = calibration_tables(f)
    return Report(
        scenario="calibrate",
        question=say("How large are the position errors of {arm}, nominal and calibrated?", f),
        title=say("{arm}: {total_after.n:counted position} in {k} series fitted", f, k=len(f.series)),
        answer=answer,
        claims=[
            say("**{name}**: {text}", name=name, text=text) for name, text in counted.calibration_doubts(f)
        ],
        numbers=f,
        tables=tables,
        body=[*tables, *lists, Markdown("What each table means: docs/calibration.md, *The report*.")],
        badge=replace(badge, article="the "),
    )
