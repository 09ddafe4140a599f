"""testbench identify ARM DATA: fit stiffness models to measured runs, and say which one to take."""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench.arm.folder import find_arm
from testbench.errors import BenchError
from testbench.identify.method import robust
from testbench.identify.prior import PriorUncertainty, cad_prior
from testbench.model.laws import joint_laws
from testbench.report import terminal
from testbench.report.fitted_runs import badge, ratios_to_chosen, seen, warnings
from testbench.report.markdown import Markdown
from testbench.report.report import MAP, Report, RunRequest, say, write_run
from testbench.report.scene import PageContent
from testbench.report.schema import Table, TableColumn, columns
from testbench.report.table import Row, find
from testbench.report.table import plain as plain_data
from testbench.runs import manifest as files
from testbench.runs.manifest import DOCUMENT
from testbench.runs.whole import claim_folder
from testbench.workflows.arm_check import refuse_warnings
from testbench.workflows.arm_models import FITS
from testbench.workflows.cell import build_cell
from testbench.workflows.fit_numbers import identifiability, numbers, residuals_by_model
from testbench.workflows.fits import fit_models, write_stiffness
from testbench.workflows.model_names import first_mention
from testbench.workflows.models import asked_models
from testbench.workflows.options import Force, of_flag, plain, takes
from testbench.workflows.own_estimator import EstimatorOptions, estimator_models
from testbench.workflows.read_runs import ReadingOptions, files_read, read_runs

if TYPE_CHECKING:
    from testbench.report.figure import Figure

COMMAND, PICTURE, OLD = "testbench identify", "identify.png", frozenset((FITS,))
PICTURES = PICTURE, "model.png", "compliance.png", MAP  #: Figures, in the order in which they are listed.
LISTED_RUNS = 30  #: Runs that are listed, the worst.
MODELS = (
    "name parameters rank conservative check.rms_mm f_m_held_out identification.rms_mm f_m "
    "f_m_floor intervals.half_width_mm elsewhere.half_width_mm elsewhere.apart_mm"
).split()
PAGE = 3  #: Of these columns, the last ones, that a terminal has no room for.
WORST = (
    TableColumn("name", "model"),
    TableColumn("half_mm", "95 % half width, median", "mm", none="no bound"),
    TableColumn("worst_mm", "95 % half width, largest", "mm", none="no bound"),
    TableColumn("unbounded", "poses without bound", form="d"),
    TableColumn("place", "place of the largest half width, m"),
    TableColumn("joints", "joint angles there"),
)
SINGLE = TableColumn("quantity", "quantity"), TableColumn("value", "value", form=",.5g")
HELP = columns("place measure rank expected_error_mm")
UNSEEN = (
    TableColumn("why", "hidden by"),
    TableColumn("parts", "links and joints"),
    TableColumn("directions", "number of directions", form="d"),
    TableColumn("parameters", "parameters in the first direction"),
)
LAWS = columns("part stiffer_percent backlash_urad friction_urad strut_percent")
MEANS = Markdown("What tables, columns and warnings mean: docs/identify.md, *The report*.")


@dataclass(frozen=True)
class IdentifyOptions:
    """Hold the flags of the command."""

    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the results.")] = Path("runs/identify")
    model: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Model to fit; repeatable.")] = None
    check_pose: Annotated[
        list[int] | None, typer.Option(metavar="N", help="Pose to hold out; repeatable.")
    ] = None
    full_pose: Annotated[
        bool, typer.Option("--full-pose", help="Require orientations as well as positions.")
    ] = False
    no_prior: Annotated[
        bool, typer.Option("--no-prior", help="Fit without the prior of the arm's folder.")
    ] = False
    uncertainty_percent: Annotated[
        float | None, typer.Option(metavar="PERCENT", help="Prior's uncertainty (default: estimated).")
    ] = None
    robust: Annotated[bool, typer.Option("--robust", help="Find outliers and fit without them.")] = False
    no_intervals: Annotated[bool, typer.Option("--no-intervals", help="Leave out the 95 % intervals.")] = (
        False
    )
    identifiability: Annotated[
        bool, typer.Option("--identifiability", help="List what the runs do not determine, and what to add.")
    ] = False
    strict: Annotated[bool, typer.Option("--strict", help="Fail if there is any warning.")] = False
    force: Force = False


@takes(ReadingOptions, IdentifyOptions, EstimatorOptions, draws=True)
def command(readings: ReadingOptions, asked: IdentifyOptions, tried: EstimatorOptions) -> None:
    """Fit the models, judge them, recommend one, and write it."""
    arm, out = find_arm(readings.arm), asked.out
    with claim_folder(out, COMMAND, own=OLD, inputs=[arm, *files_read(readings)], force=asked.force):
        if asked.uncertainty_percent is not None and asked.no_prior:
            raise BenchError("--uncertainty-percent cannot be combined with --no-prior")
        filed = build_cell(readings.arm)
        cell, runs = read_runs(filed, readings, asked.check_pose or (), full_pose=asked.full_pose)
        prior, percent = None if asked.no_prior else cad_prior(cell.arm), asked.uncertainty_percent
        if percent is not None and not 1e-4 <= percent <= 1e8:
            raise BenchError(f"--uncertainty-percent: expected 0.0001 to 1e+08, got {percent:g}")
        uncertainty = None if percent is None else PriorUncertainty(percent / 100)
        loss = robust if asked.robust else None
        with of_flag("--model"):
            models = asked_models(cell, asked.model or (), prior, uncertainty, loss=loss)
        models += estimator_models(tried.own)(cell, prior)
        identified = fit_models(cell, models, runs, time.perf_counter, widths=not asked.no_intervals)
        if asked.strict:
            refuse_warnings(readings.arm, identified.fits.doubts)
        left = residuals_by_model(cell, identified)
        f = numbers(filed, cell, identified, left, widths=not asked.no_intervals)
        f["badge"] = badge(identified, left)
        f["over"] = ratios_to_chosen(identified, left)
        f["identifiability"] = identifiability(cell, identified) if asked.identifiability else None
        said, flags = report(f), plain(readings, asked, read="dataset", without=("arm",))
        flags |= {"estimators": {each.name: asdict(each) for each in tried.own}} if tried.own else {}

        def more(folder: Path) -> None:
            files.write_json(plain_data(identified.fits), folder / FITS)
            write_stiffness(cell, identified, flags["dataset"], folder)  # type: ignore[arg-type]

        moment = f" and {f.map.moment_Nm:.0f} N m" if f.map and f.map.moment_Nm >= 0.5 else ""
        title = f"{f.arm} under {f.map.force_N:.0f} N{moment}" if f.map else ""
        left_by_run = RunRequest(
            COMMAND, f.arm, flags, [cell.arm.mjcf_path.parent], PICTURE, more=more, map=title, draw=_drawn
        )
        write_run(out, left_by_run, said, seen(filed, identified, f, left))
        console = terminal.plain_console()
        console.print(terminal.as_plain(said.title))
        lines = [
            f"model      {out / DOCUMENT}: {identified.fits.recommended}; all others: {out / FITS}",
            f"report     {out / 'report.md'}, {out / 'report.json'}",
            f"figures    {', '.join(str(out / own) for own in PICTURES if (out / own).exists())}",
            *terminal.viewing_lines(out),
        ]
        tables = [table_of(f, MODELS[:-PAGE]), *([said.tables["help"]] if asked.identifiability else [])]
        terminal.print_words(console, said, tables, lines)


def _drawn(said: Report, page: PageContent) -> Mapping[str, "Figure"]:
    from testbench.report.figures_fit import identify_figures  # here: it imports matplotlib

    return identify_figures(said, page, Row(said.numbers))


def report(f: Row) -> Report:
    """Report fits from their numbers."""
    taken = find(f.models, name=f.recommended)
    beaten = f.get("badge") is not None and f.badge.winner != taken.name
    first = "Although another model predicts held-out runs better, use" if beaten else "Use"
    if any(doubt["name"] != "prior" for doubt in f.doubts):
        first = "If the runs are right (see the warning), use"
    kind, where = ("check", "held-out") if taken.check else ("identification", "fitted")
    sure = (taken.intervals or Row()).get("half_width_mm") is not None
    half = ". The median 95 % interval of a deflection is ± {intervals.half_width_mm:.3f} mm" if sure else ""
    runs = sorted(f.residuals, key=lambda row: -row.taken_mm)[:LISTED_RUNS]
    own_laws = (
        TableColumn(name, name.replace("_", " "), law.unit_symbol.replace("1", ""), form=".3g")
        for name, law in joint_laws.added.items()
    )
    laws = tuple(c for c in (*LAWS, *own_laws) if any(c.value(row) is not None for row in f.laws))
    told, rest = "part parameters told_percent decided_by_prior", f.get("identifiability")
    uncertain = [Row(row, half_mm=row.typical_mm) for row in f.map.errors.rows()[::-1]] if f.map else []
    tables = {
        "models": table_of(f, MODELS),
        "fit": Table(SINGLE, _fit(f), "The fit"),
        "elsewhere": Table(WORST, uncertain, "Uncertainty at other poses"),
        "laws": Table(laws, f.laws, "Joints that are more than linear springs"),
        "runs": Table(
            columns("which_run pose moved_mm taken_mm"),
            runs,
            f"Runs with the largest residuals, at most {LISTED_RUNS}",
        ),
        "told": Table(columns(told), f.seen.blocks, "What the runs determine"),
        "help": Table(HELP, rest.help if rest else [], "Measurements that could be added"),
        "unseen": Table(UNSEEN, rest.unseen if rest else [], "What the runs do not determine"),
    }
    tables = {name: table for name, table in tables.items() if table.rows}
    return Report(
        scenario="identify",
        question=say("Which stiffness model of {arm} should be used, and how certain is it?", f),
        title=say("{arm}: {runs:counted run} in {poses:counted pose} of {dataset} fitted", f),
        answer=say(
            f"{first} {{words}}: its RMS error in the {where} runs is {{{kind}.rms_mm:.3f}} mm{half}.",
            taken,
            words=first_mention(taken.name),
        ),
        claims=list(warnings(f, taken)),
        numbers=f,
        tables=tables,
        body=[*tables, MEANS],
        badge=f.get("badge"),
    )


def table_of(f: Row, keys: list[str]) -> Table:
    """List every model; a column that no model fills is left out, the first error is the headline.

    Args:
        f: Numbers of the fits.
        keys: Keys of the columns.

    Returns:
        The table.
    """
    every = columns(" ".join(keys), paper=False)
    known = tuple(c for c in every if any(c.value(m) is not None for m in f.models))
    headline = next(c.key for c in known if c.key in (*MODELS[4:7],))
    return Table(known, [*f.models, *f.failed], "Models", f.recommended, headline)


def _fit(f: Row) -> list[Row]:
    """List single numbers of the fit."""
    places, rest = f.map or Row(), f.get("identifiability") or Row()
    pairs = {
        "95 % bound of the residuals that noise alone causes, mm": f.noise_p95_mm,
        f"unknowns of {f.seen.structure}": f.seen.unknowns,
        "rank: directions of the unknowns that the runs determine": f.seen.seen,
        "measured deflections divided by those computed from the arm's folder": f.scale,
        "force in the map of half widths, N": places.get("force_N"),
        "moment in the map, N m": places.get("moment_Nm"),
        "poses in the map": places.get("places"),
        "smallest half width in the map, mm": places.get("least_mm"),
        "half width that 95 % of the map's poses do not exceed, mm": places.get("p95_mm"),
        "expected error at random poses, mm": rest.get("expected_error_mm"),
        "expected deflection at random poses, mm": rest.get("expected_deflection_mm"),
        "largest number of independent equations from these runs": rest.get("equations"),
    }
    return [Row(quantity=name, value=value) for name, value in pairs.items() if value is not None]
