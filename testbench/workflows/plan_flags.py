"""Flags of a plan, and the settings that they ask for."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.design.criteria import check_criterion
from testbench.errors import BenchError, in_flags, of_flag
from testbench.identify.absolute.fit import CalibrationOptions as Fit
from testbench.plant.site import Payload
from testbench.workflows.absolute import Calibrated, File, calibrate_with_masses, read_all
from testbench.workflows.campaign_flags import ArmName, MapFile, mass
from testbench.workflows.cell import Cell
from testbench.workflows.masses import payload_of
from testbench.workflows.models import ALL_UNKNOWNS, canonical_name, plain_name
from testbench.workflows.plan_input import parse_work_area, place
from testbench.workflows.plan_settings import USUAL, PlanSettings

SAME = (
    *("poses", "orders", "seed", "sigma_um", "sling_m", "geometry_mm", "gear_urad", "uncertainty_percent"),
    *("gauges", "gauge_um", "tilt_deg"),
)
FLAGS = {
    **{name: f"--{name.replace('_', '-')}" for name in (*SAME, "acceptance_deg")},
    "candidates_wanted": "--candidates",
    "floor_z_m": "--floor-z [m]",
    "box_m": "--box [m]",
    "loads_kg": "--load [kg]",
    "pulls_n": "--pull",
    "pulls_n, its size": "--pull [N], its size",
    "loads_kg and pulls_n, times candidates_wanted": "--load and --pull, times --candidates",
}
"""The flag of every field of `PlanSettings`, as errors name it."""


@dataclass(frozen=True)
class PlanOptions:
    """Hold what an engineer asks for, in the units of a command line."""

    arm: ArmName
    task: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Poses and forces of the robot's task.")
    ] = None
    load: Annotated[
        list[float] | None,
        typer.Option(parser=mass, metavar="MASS", help="Payload, 240 or 530lb; repeat it for a choice."),
    ] = None
    pull: Annotated[
        list[str] | None, typer.Option(metavar="X,Y,Z", help="Force instead of a weight, N; repeatable.")
    ] = None
    poses: Annotated[
        int | None, typer.Option(metavar="N", help="Number of poses (default: 12, or 50 if absolute).")
    ] = None
    mapping: MapFile = None
    tracker: Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Position of the tracker, m.")] = None
    acceptance_deg: Annotated[
        float | None, typer.Option(metavar="DEG", help="Half angle in which fixed targets reflect.")
    ] = None
    box: Annotated[
        str | None, typer.Option(metavar="X0,...,Z1", help="Corners of the box for the tool, m.")
    ] = None
    criterion: Annotated[str | None, typer.Option(metavar="NAME", help="test, D, A, E, G or I.")] = None
    model: Annotated[str | None, typer.Option(metavar="NAME", help="Model that will be identified.")] = None
    sigma_um: Annotated[float, typer.Option(metavar="UM", help="Noise of a reading along an axis.")] = 50.0
    uncertainty_percent: Annotated[
        float | None, typer.Option(metavar="PERCENT", help="Uncertainty of the prior (default: 30).")
    ] = None
    no_prior: Annotated[bool, typer.Option("--no-prior", help="Plan for a fit without a prior.")] = False
    candidates: Annotated[int | None, typer.Option(metavar="N", help="Number of candidate poses.")] = None
    sling_m: Annotated[float, typer.Option(metavar="M", help="Length from load point to weight.")] = 0.5
    floor_z: Annotated[float | None, typer.Option(metavar="M", help="Height of a floor.")] = None
    gauges: Annotated[
        int, typer.Option(metavar="N", help="Gauges per pose, 1 to 3, which the plan places.")
    ] = 0
    gauge_um: Annotated[float, typer.Option(metavar="UM", help="Noise of a gauge.")] = 5.0
    tilt_deg: Annotated[float, typer.Option(metavar="DEG", help="Error of a gauge's direction.")] = 0.5
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of random numbers.")] = 1


@dataclass(frozen=True)
class AbsolutePlanOptions:
    """Hold the flags of a plan of absolute readings."""

    absolute: Annotated[bool, typer.Option("--absolute", help="Plan absolute readings, without tasks.")] = (
        False
    )
    given: Annotated[
        list[Path] | None, typer.Option(metavar="CSV", help="Readings taken before; repeatable.")
    ] = None
    orientations: Annotated[
        bool, typer.Option("--orientations", help="Read one target's orientation too.")
    ] = False
    geometry_mm: Annotated[float, typer.Option(metavar="MM", help="Expected geometric errors.")] = 1.0
    gear_urad: Annotated[float, typer.Option(metavar="URAD", help="Expected periodic joint errors.")] = 30.0
    orders: Annotated[int, typer.Option(metavar="N", help="Highest order of periodic errors.")] = 3


def known_before(cell: Cell, options: PlanOptions, flags: AbsolutePlanOptions) -> Calibrated | None:
    """Calibrate the arm by the readings that were taken before; None without any.

    Args:
        cell: The arm with its model and its truth.
        options: Flags of the command line.
        flags: Flags of absolute readings.

    Returns:
        The calibration; None without readings.
    """
    if not flags.given:
        return None
    files = [File(path, options.mapping, sigma_um=options.sigma_um) for path in flags.given]
    series, notes = read_all(files, cell.arm)
    return calibrate_with_masses(cell.vjm, series, Fit(), notes)


def settings_of(cell: Cell, options: PlanOptions, flags: AbsolutePlanOptions) -> PlanSettings:
    """Turn the flags into settings.

    Args:
        cell: The arm with its model and its truth.
        options: Flags of the command line.
        flags: Flags of absolute readings.

    Returns:
        The settings.

    Raises:
        BenchError: When two flags exclude each other, or one is out of range.
    """
    _check(options, flags)
    usual, loads = USUAL[flags.absolute], options.load or []
    wanted = {"criterion": options.criterion, "poses": options.poses, "candidates_wanted": options.candidates}
    chosen = {key: usual[key] if own is None else own for key, own in wanted.items()}
    if not flags.absolute:
        loads = loads or [payload_of(cell.arm, None, "--load")]
        with of_flag("--criterion"):
            check_criterion(str(chosen["criterion"]))
    with of_flag("--model"):
        model = canonical_name(
            cell.arm, options.model or (plain_name(cell) if options.no_prior else ALL_UNKNOWNS)
        )
    percent = 30.0 if options.uncertainty_percent is None else options.uncertainty_percent
    with in_flags(FLAGS):
        settings = PlanSettings(
            **{**vars(flags), "given": tuple(path.name for path in flags.given or ()), **chosen},
            model=model,
            loads_kg=tuple(loads),
            pulls_n=tuple(place(text, "--pull fx,fy,fz [N]") for text in options.pull or []),
            sigma_um=options.sigma_um,
            uncertainty_percent=None if options.no_prior else percent,
            tracker_m=None if options.tracker is None else place(options.tracker),
            acceptance_deg=options.acceptance_deg,
            box_m=None if options.box is None else parse_work_area(options.box),
            sling_m=options.sling_m,
            floor_z_m=options.floor_z,
            gauges=options.gauges,
            gauge_um=options.gauge_um,
            tilt_deg=options.tilt_deg,
            seed=options.seed,
        )
    if loads:
        with of_flag("--sling-m"):
            Payload(max(loads), settings.sling_m)
    return settings


def _check(options: PlanOptions, flags: AbsolutePlanOptions) -> None:
    """Refuse what excludes --absolute, and what excludes --no-prior."""
    mapping = None if flags.given else options.mapping
    others = {
        "--task": options.task,
        "--no-prior": options.no_prior,
        "--pull": options.pull,
        "--map": mapping,
    }
    if named := [flag for flag, given in others.items() if flags.absolute and given]:
        raise BenchError(f"{named[0]}: expected no --absolute with it")
    if options.uncertainty_percent is not None and options.no_prior:
        raise BenchError("--uncertainty-percent: expected no --no-prior with it")
