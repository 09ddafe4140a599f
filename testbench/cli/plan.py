"""testbench plan ARM --task TASKS --load KG, or --absolute: the poses to measure, and what they promise."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.folder import find_arm
from testbench.campaign.absolute import Calibrated, File, calibrated, read_all
from testbench.campaign.campaign import Cell, build_cell
from testbench.campaign.campaign_flags import ArmName, MapFile, mass
from testbench.campaign.models import EVERY, plain_name, right_name
from testbench.campaign.plan import plan_absolute, plan_for
from testbench.campaign.plan_input import box, overloads, payload_of, place, read_tasks
from testbench.campaign.plan_settings import PlanSettings, structure
from testbench.cli.arguments import Noise, Orientations, absolute_alone
from testbench.commands.plan import COMMAND, printed, report, write
from testbench.commands.plan_numbers import numbers
from testbench.design.criteria import check_criterion
from testbench.errors import BenchError
from testbench.identify.absolute.fit import Options as Fit
from testbench.model.load import weight
from testbench.output.place import claim_folder
from testbench.plant.site import Payload
from testbench.shell.options import Force, of_flag, takes
from testbench.views.markdown import as_plain
from testbench.views.terminal import looked_at, plain_console, print_words

MORE = "under More in plan.md"
USUAL = {True: ("I", 50, 1000), False: ("test", 12, 5000)}
"""Criterion, poses and candidates of a plan of absolute readings, and of one for tasks."""


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
            help="Load, such as 240 or 530lb; again for a choice. Default: the arm's stated payload. "
            "With --absolute every pose after the first reading has it, or none has.",
        ),
    ] = None
    pull: Annotated[
        list[str] | None,
        typer.Option(
            help="Force applied at the load point instead of the weight: fx,fy,fz in N, world axes. "
            "Again for more; the plan chooses for every pose."
        ),
    ] = None
    poses: Annotated[
        int | None, typer.Option(help="How many to measure; default: 12, 50 with --absolute.")
    ] = None
    mapping: MapFile = None
    tracker: Annotated[str | None, typer.Option(help="Position of the tracker: x,y,z in m.")] = None
    acceptance_deg: Annotated[
        float | None,
        typer.Option(min=0.1, max=90, help="Half angle of fixed targets; default: turned by hand."),
    ] = None
    box: Annotated[str | None, typer.Option(help="Where the tool may be: x0,y0,z0,x1,y1,z1 in m.")] = None
    criterion: Annotated[
        str | None, typer.Option(help="test, D, A, E, G or I; default: test, I with --absolute.")
    ] = None
    model: Annotated[
        str | None, typer.Option(help="Model to be identified: all links and joints, MGCO68 with --no-prior.")
    ] = None
    sigma_um: Noise = 50.0
    uncertainty_percent: Annotated[float | None, typer.Option(help="Of the CAD prior; default: 30.")] = None
    no_prior: Annotated[bool, typer.Option("--no-prior", help="Plan for a fit without a prior.")] = False
    candidates: Annotated[
        int | None,
        typer.Option(help="Feasible poses to choose from; default: 5000, 1000 with --absolute."),
    ] = None
    sling_m: Annotated[float, typer.Option(min=0, max=100, help="From the load point to the weight.")] = 0.5
    floor_z: Annotated[
        float | None, typer.Option(help="Height in m of a floor that rigid.xml does not have.")
    ] = None
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of all random numbers.")] = 1
    out: Annotated[Path, typer.Option(help="Folder of the plan.")] = Path("runs/plan")
    force: Force = False


@dataclass(frozen=True)
class Absolute:
    """Flags of a plan of absolute readings."""

    absolute: Annotated[
        bool,
        typer.Option(
            "--absolute",
            help="For absolute readings: frame, targets, geometry, joint errors and compliances unknown.",
        ),
    ] = False
    given: Annotated[
        list[Path] | None,
        typer.Option(help="Absolute readings taken before; the plan fills what they leave open. Repeatable."),
    ] = None
    orientations: Orientations = False
    geometry_mm: Annotated[
        float, typer.Option(help="Expected error of geometry along an axis, and in mrad, with --absolute.")
    ] = 1.0
    gear_urad: Annotated[
        float, typer.Option(help="Expected coefficient of a joint's periodic errors, with --absolute.")
    ] = 30.0
    orders: Annotated[
        int, typer.Option(help="Orders of them that are unknowns; others are noise of a pose.")
    ] = 3

    def __post_init__(self) -> None:
        """Refuse the others without the first, by BenchError."""
        absolute_alone(self)


@takes(Options, Absolute)
def command(asked: Options, absolute: Absolute) -> None:
    """Choose the poses, judge them, write the folder of the plan."""
    if not absolute.absolute and asked.task is None:
        raise BenchError("--task: expected a CSV of tasks, or --absolute")
    folder = find_arm(asked.arm)
    given = [folder, *(absolute.given or []), *filter(None, [asked.task, asked.mapping])]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        cell = replace(build_cell(asked.arm), floor=asked.floor_z)
        settings = _settings(cell, asked, absolute)
        with of_flag("--model"):
            structure(cell, settings.model)  # refused here, not after the search
        console = plain_console()
        tasks = asked.task and read_tasks(
            asked.task, cell, weight(cell.vjm, settings.loads_kg[0]), asked.mapping
        )
        for doubt in overloads(cell.arm, (0.0, *settings.loads_kg), settings.pulls_n):
            console.print(f"Doubt: {doubt}", soft_wrap=True)
        if tasks:
            made = plan_for(cell, settings, tasks)
        else:
            made = plan_absolute(cell, settings, _known(cell, asked, absolute))
        said, out = report(numbers(made), cell.arm), asked.out
        write(made, said, folder, asked.task, out)
        console.print(as_plain(said.title))
        tables = f", {out / 'tasks_expected.csv'}" if tasks else ""
        lines = [
            f"plan       {out / 'plan.csv'}, all {settings.poses} poses; in words {out / 'plan.md'}",
            f"numbers    {out / 'plan.json'}{tables}",
            f"figures    {out / 'plan.png'}, {out / 'error_map.png'}",
            *looked_at(out, absolute.given or (), arm=asked.arm),
        ]
        print_words(console, said, [printed(said)], lines, MORE)


def _known(cell: Cell, asked: Options, flags: Absolute) -> Calibrated | None:
    """The arm by the readings that were taken before."""
    if not flags.given:
        return None
    files = [File(path, asked.mapping, sigma_um=asked.sigma_um) for path in flags.given]
    series, notes = read_all(files, cell.arm)
    return calibrated(cell.vjm, series, Fit(), notes)


def _settings(cell: Cell, asked: Options, flags: Absolute) -> PlanSettings:
    """The flags as settings; BenchError where two exclude each other, or one is out of range."""
    _check(asked, flags)
    criterion, poses, candidates = USUAL[flags.absolute]
    criterion = asked.criterion or criterion
    if not flags.absolute:
        with of_flag("--criterion"):
            check_criterion(criterion)
    with of_flag("--model"):
        model = right_name(cell.arm, asked.model or (plain_name(cell) if asked.no_prior else EVERY))
    loads = asked.load or ([] if flags.absolute else [payload_of(cell.arm, None, "--load")])
    percent = 30.0 if asked.uncertainty_percent is None else asked.uncertainty_percent
    settings = PlanSettings(
        **{**vars(flags), "given": tuple(path.name for path in flags.given or ())},
        model=model,
        criterion=criterion,
        poses=poses if asked.poses is None else asked.poses,
        loads_kg=tuple(loads),
        pulls_n=tuple(place(text, "--pull fx,fy,fz [N]") for text in asked.pull or []),
        sigma_um=asked.sigma_um,
        uncertainty_percent=None if asked.no_prior else percent,
        tracker_m=None if asked.tracker is None else place(asked.tracker),
        acceptance_deg=asked.acceptance_deg,
        box_m=None if asked.box is None else box(asked.box),
        sling_m=asked.sling_m,
        floor_z_m=asked.floor_z,
        candidates_wanted=candidates if asked.candidates is None else asked.candidates,
        seed=asked.seed,
    )
    if loads:
        with of_flag("--sling-m"):
            Payload(max(loads), settings.sling_m)
    return settings


def _check(asked: Options, flags: Absolute) -> None:
    """Refuse what excludes --absolute, and what excludes --no-prior."""
    others = {
        "--task": asked.task,
        "--no-prior": asked.no_prior,
        "--pull": asked.pull,
        "--map": None if flags.given else asked.mapping,
    }
    if named := [flag for flag, given in others.items() if flags.absolute and given]:
        raise BenchError(f"{named[0]}: expected no --absolute with it")
    if asked.uncertainty_percent is not None and asked.no_prior:
        raise BenchError("--uncertainty-percent: expected no --no-prior with it")
