"""testbench plan ARM --task TASKS --load KG, or --absolute: the poses to measure, and what they promise."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.catalogue import find_arm
from testbench.bench import plan as plans
from testbench.bench.absolute_plan import plan_absolute
from testbench.bench.absolute_plan_settings import AbsolutePlanSettings
from testbench.bench.campaign import Cell, build_cell
from testbench.bench.models import EVERY, plain_name, right_name
from testbench.bench.payload import overloaded, overpulled, payload_of
from testbench.bench.plan_input import box, place, pull, read_tasks
from testbench.bench.plan_settings import PlanSettings, structure
from testbench.cli.absolute_plan import Absolute
from testbench.cli.arguments import ArmName, MapFile, Noise, mass
from testbench.design.planning import check_criterion
from testbench.errors import BenchError
from testbench.output.run import claim_folder
from testbench.plant import Payload
from testbench.shell.options import Force, of_flag, takes
from testbench.views import terminal
from testbench.views.plan import absolute_files, absolute_tables
from testbench.views.plan.files import COMMAND, write
from testbench.views.plan.tables import tables, words

MORE = "under More in plan.md"


@dataclass(frozen=True)
class Options:
    """What an engineer asks for, in the units of a command line."""

    arm: ArmName
    task: Annotated[
        Path | None, typer.Option(help="CSV of tasks: JOINT_deg or JOINT_rad, force_x_N ... if any.")
    ] = None
    load: Annotated[
        list[float] | None,
        typer.Option(
            parser=mass,
            metavar="MASS",
            help="Mass to hang, such as 240 or 530lb, again for a choice; what the arm states if not given. "
            "With --absolute it hangs in every pose after the first reading, or nothing does.",
        ),
    ] = None
    pull: Annotated[
        list[str] | None,
        typer.Option(
            help="Force that may pull at the load point in place of the weight: fx,fy,fz in N, world axes. "
            "Again for more; the plan chooses for every pose."
        ),
    ] = None
    poses: Annotated[
        int | None, typer.Option(help="How many to measure; 12 if not given, 50 with --absolute.")
    ] = None
    mapping: MapFile = None
    tracker: Annotated[str | None, typer.Option(help="Where it stands: x,y,z in m.")] = None
    acceptance_deg: Annotated[
        float | None,
        typer.Option(min=0.1, max=90, help="Half angle of fixed targets; turned by hand if not given."),
    ] = None
    box: Annotated[str | None, typer.Option(help="Where the tool may be: x0,y0,z0,x1,y1,z1 in m.")] = None
    criterion: Annotated[
        str | None, typer.Option(help="test, D, A, E, G or I; test if not given, I with --absolute.")
    ] = None
    model: Annotated[
        str | None, typer.Option(help="Model to be identified: all links and joints, MGCO68 with --no-prior.")
    ] = None
    sigma_um: Noise = 50.0
    uncertainty_percent: Annotated[float | None, typer.Option(help="Of the CAD prior, 30 if not given.")] = (
        None
    )
    no_prior: Annotated[bool, typer.Option("--no-prior", help="Plan for a fit without a prior.")] = False
    candidates: Annotated[
        int | None,
        typer.Option(help="Feasible poses to choose from; 5000 if not given, 1000 with --absolute."),
    ] = None
    sling_m: Annotated[float, typer.Option(min=0, max=100, help="From the load point to the weight.")] = 0.5
    floor_z: Annotated[
        float | None, typer.Option(help="Height in m of a floor that rigid.xml does not have.")
    ] = None
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of all randomness.")] = 1
    out: Annotated[Path, typer.Option(help="Folder of the plan.")] = Path("runs/plan")
    force: Force = False


@takes(Options, Absolute)
def command(asked: Options, absolute: Absolute) -> None:
    """Choose the poses, judge them, write the folder of the plan."""
    if absolute.absolute:
        _plan_absolutely(asked, absolute)
    elif asked.task is None:
        raise BenchError("--task: expected a CSV of tasks, or --absolute")
    else:
        _plan_deflections(asked, asked.task)


def _plan_deflections(asked: Options, task: Path) -> None:
    folder = find_arm(asked.arm)
    given = [folder, task, *([asked.mapping] if asked.mapping else [])]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        cell = replace(build_cell(asked.arm), floor=asked.floor_z)
        settings = _settings(cell, asked)
        with of_flag("--model"):
            structure(cell, settings.model)  # refused here, not after the search
        tasks = read_tasks(task, cell, plans.hung(cell, settings.loads_kg[0]), asked.mapping)
        console = terminal.plain_console()
        doubts = overloaded(cell.arm, settings.loads_kg), overpulled(cell.arm, settings.pulls_n)
        for doubt in filter(None, doubts):
            console.print(f"Doubt: {doubt}", soft_wrap=True)
        with console.status("looking for feasible poses") as status:
            found = plans.search(cell, settings)
            status.update(f"choosing {settings.poses} of {len(found.q)} poses")
            chosen = plans.choose(cell, settings, tasks, found)
            status.update("judging the plan")
            planned = plans.judge(cell, settings, found, chosen)
            status.update("writing")
            write(cell, planned, folder, task, asked.out)
        terminal.print_words(console, words(planned.report), [tables(planned.report)["short"]], MORE)
        out = asked.out
        lines = [
            f"plan       {out / 'plan.csv'}; in words {out / 'plan.md'}",
            f"numbers    {out / 'plan.json'}, {out / 'tasks_expected.csv'}",
            f"figures    {out / 'plan.png'}, {out / 'error_map.png'}",
            *terminal.looked_at(out),
        ]
        console.print("\n".join(lines), soft_wrap=True)


def _plan_absolutely(asked: Options, absolute: Absolute) -> None:
    folder = find_arm(asked.arm)
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=[folder], force=asked.force):
        cell = replace(build_cell(asked.arm), floor=asked.floor_z)
        settings = _absolute_settings(cell, asked, absolute)
        with of_flag("--model"):
            structure(cell, settings.model)
        console = terminal.plain_console()
        if doubt := overloaded(cell.arm, (0.0, *settings.loads_kg)):
            console.print(f"Doubt: {doubt}", soft_wrap=True)
        with console.status(f"choosing {settings.poses} poses"):
            planned = plan_absolute(cell, settings)
            absolute_files.write(cell, planned, folder, asked.out)
        report, out = planned.report, asked.out
        terminal.print_words(
            console, absolute_tables.words(report), [absolute_tables.tables(report)["short"]], MORE
        )
        lines = [
            f"plan       {out / 'plan.csv'}; in words {out / 'plan.md'}; numbers {out / 'plan.json'}",
            f"figures    {out / 'plan.png'}, {out / 'error_map.png'}",
            *terminal.looked_at(out),
        ]
        console.print("\n".join(lines), soft_wrap=True)


def _absolute_settings(cell: Cell, asked: Options, flags: Absolute) -> AbsolutePlanSettings:
    """The flags as settings; BenchError where one excludes --absolute or is out of range."""
    more = ("--pull", asked.pull), ("--map", asked.mapping)
    for flag, given in (("--task", asked.task), ("--no-prior", asked.no_prior), *more):
        if given:
            raise BenchError(f"{flag}: expected no --absolute with it")
    usual = AbsolutePlanSettings
    percent = asked.uncertainty_percent
    with of_flag("--model"):
        model = right_name(cell.arm, asked.model or EVERY)
    return AbsolutePlanSettings(
        model=model,
        criterion=asked.criterion or usual.criterion,
        poses=usual.poses if asked.poses is None else asked.poses,
        loads_kg=tuple(asked.load or ()),
        orientations=flags.orientations,
        sigma_um=asked.sigma_um,
        uncertainty_percent=usual.uncertainty_percent if percent is None else percent,
        geometry_mm=flags.geometry_mm,
        gear_urad=flags.gear_urad,
        orders=flags.orders,
        tracker_m=None if asked.tracker is None else place(asked.tracker),
        acceptance_deg=asked.acceptance_deg,
        box_m=None if asked.box is None else box(asked.box),
        sling_m=asked.sling_m,
        candidates_wanted=usual.candidates_wanted if asked.candidates is None else asked.candidates,
        floor_z_m=asked.floor_z,
        seed=asked.seed,
    )


def _settings(cell: Cell, asked: Options) -> PlanSettings:
    """The flags as settings.

    Raises:
        BenchError: When two flags exclude each other, or one is out of range.
    """
    if asked.uncertainty_percent is not None and asked.no_prior:
        raise BenchError("--uncertainty-percent: expected no --no-prior with it")
    if asked.acceptance_deg is not None and asked.tracker is None:
        raise BenchError("--acceptance-deg: expected --tracker with it")
    percent = 30.0 if asked.uncertainty_percent is None else asked.uncertainty_percent
    criterion = asked.criterion or PlanSettings.criterion
    with of_flag("--criterion"):
        check_criterion(criterion)
    with of_flag("--model"):
        model = right_name(cell.arm, asked.model or (plain_name(cell) if asked.no_prior else EVERY))
    settings = PlanSettings(
        model=model,
        criterion=criterion,
        poses=PlanSettings.poses if asked.poses is None else asked.poses,
        loads_kg=tuple(asked.load or [payload_of(cell.arm, None, "--load")]),
        pulls_n=tuple(map(pull, asked.pull or [])),
        sigma_um=asked.sigma_um,
        uncertainty_percent=None if asked.no_prior else percent,
        tracker_m=None if asked.tracker is None else place(asked.tracker),
        acceptance_deg=asked.acceptance_deg,
        box_m=None if asked.box is None else box(asked.box),
        sling_m=asked.sling_m,
        floor_z_m=asked.floor_z,
        candidates_wanted=PlanSettings.candidates_wanted if asked.candidates is None else asked.candidates,
        seed=asked.seed,
    )
    with of_flag("--sling-m"):
        Payload(max(settings.loads_kg), settings.sling_m)
    return settings
