"""testbench simulate ARM [FILE] --out DATA: measured runs of the true arm."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.console import Console

from testbench.arm.folder import find_arm
from testbench.data.dataset import Series
from testbench.errors import BenchError
from testbench.files.write import write_csv, write_series
from testbench.plant.disturbance import Disturbances, GearErrors, GeometryErrors
from testbench.plant.rigid_cell import check_station_position
from testbench.plant.true_arms import disturb
from testbench.report.terminal import plain_console
from testbench.runs.rows import trial_rng
from testbench.runs.whole import Kind, check_file, whole_files
from testbench.workflows.campaign import Scenario, measure_markers, poses_with_weight, read_instruments
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.instruments import instruments, mounted
from testbench.workflows.options import (
    ArmName,
    Force,
    MapFile,
    Orientations,
    absolute_alone,
    mass,
    overload_warnings,
    takes,
)
from testbench.workflows.plan_input import (
    Place,
    PoseConditions,
    build_checks,
    find_feasible_poses,
    given_poses,
    hung_loads,
    masses_in_turn,
    parse_point,
)

if TYPE_CHECKING:
    from testbench.workflows.absolute_campaign import AbsoluteCampaign

DATASET = Kind("a dataset", rb"run,pose,marker,")
READINGS = Kind("a file of absolute readings", rb"run,")
MAX_POSES = 10_000  #: Random poses that are drawn at most.


@dataclass(frozen=True)
class SimulateOptions:
    """Hold the flags of the command."""

    arm: ArmName
    out: Annotated[Path, typer.Option(metavar="FILE", help="Dataset to write, CSV.")]
    file: Annotated[Path | None, typer.Argument(help="Poses (JOINT_deg or JOINT_rad), or a plan.csv.")] = None
    poses: Annotated[
        int | None,
        typer.Option(min=1, max=MAX_POSES, metavar="N", help="Number of random poses, instead of a file."),
    ] = None
    payload_kg: Annotated[
        float | None,
        typer.Option(parser=mass, metavar="MASS", help="Payload, kg or as 530lb (default: rated)."),
    ] = None
    loads: Annotated[
        str | None, typer.Option(metavar="MASSES", help="Several payloads per pose: 100,240kg.")
    ] = None
    mapping: MapFile = None
    sigma_um: Annotated[
        float | None,
        typer.Option(
            min=0.001, max=10_000, metavar="UM", help="Noise of readings (default: 50 or the tracker's)."
        ),
    ] = None
    tracker: Annotated[
        list[str] | None, typer.Option(metavar="X,Y,Z", help="Position of a laser tracker, m; repeatable.")
    ] = None
    instrument: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND:...", help="gauge:P1:z, wire:P1:X,Y,Z, ...; repeatable."),
    ] = None
    geometry_mm: Annotated[
        float, typer.Option(min=0, max=10, metavar="MM", help="Size of geometric errors, mm and mrad.")
    ] = 0.0
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Seed of poses, noise and true arm.")] = 1
    force: Force = False


@dataclass(frozen=True)
class AbsoluteReadingOptions:
    """Hold the flags of absolute readings: where targets are, not how far a load moved them."""

    absolute: Annotated[bool, typer.Option("--absolute", help="Write positions, not deflections.")] = False
    series: Annotated[
        int, typer.Option(min=1, max=50, metavar="N", help="Number of set-ups: OUT_1.csv ...")
    ] = 1
    orientations: Orientations = False
    gear_urad: Annotated[
        float, typer.Option(min=0, max=10_000, metavar="URAD", help="Periodic errors of the joints.")
    ] = 0.0

    def __post_init__(self) -> None:
        """Refuse the others without the first, by BenchError."""
        absolute_alone(self)


@takes(SimulateOptions, AbsoluteReadingOptions)
def command(asked: SimulateOptions, absolute: AbsoluteReadingOptions) -> None:
    """Settle the true arm, read the markers, write the dataset."""
    inputs = [find_arm(asked.arm), *filter(None, [asked.file, asked.mapping])]
    kind = READINGS if absolute.absolute else DATASET
    for path in _files(asked.out, absolute.series):
        check_file(path, kind, inputs=inputs, force=asked.force)
    cell = build_cell(asked.arm)
    if absolute.absolute:
        _read_absolutely(cell, asked, absolute)
    else:
        _read_deflections(cell, asked)


def _read_absolutely(cell: Cell, asked: SimulateOptions, absolute: AbsoluteReadingOptions) -> None:
    # here: few runs are absolute
    from testbench.workflows.absolute_campaign import simulate_distances, simulate_series

    console = plain_console()
    masses = masses_in_turn(cell.arm, asked.file, asked.payload_kg, asked.loads)
    q = given_poses(cell, asked.file, asked.mapping, asked.poses, len(masses) * absolute.series)
    _say_overload(console, cell, masses)
    campaign, paths = _campaign(cell, asked, absolute, masses), _files(asked.out, absolute.series)
    if asked.instrument:
        if asked.tracker or asked.sigma_um is not None or absolute.orientations or absolute.series > 1:
            others = "--tracker, --sigma-um, --orientations or --series"
            raise BenchError(f"--instrument cannot be combined with {others}")
        found, _ = simulate_distances(cell, campaign, [*map(mounted, asked.instrument)], asked.seed, q)
        files = [found]  # all fixed points and planes in one
    else:
        found, _ = simulate_series(cell, campaign, asked.seed, q)
        files = [(series,) for series in found]
    with whole_files(paths) as parts:
        for path, part, every in zip(paths, parts, files, strict=True):
            write_series(part, cell.arm, [_named(one, path.stem, alone=len(every) == 1) for one in every])
    for path, every in zip(paths, files, strict=True):
        rows, targets = sum(one.n_rows for one in every), ", ".join(every[0].markers)
        poses = len(np.unique(np.concatenate([one.pose_id for one in every])))
        console.print(f"{path}: {rows} rows in {poses} poses, targets {targets}", soft_wrap=True)


def _named(series: Series, stem: str, *, alone: bool) -> Series:
    """Name a series, its frame and its mount after the file; faces of one block share a frame."""
    if alone:
        return replace(series, name=stem, frame=stem, mount=stem)
    return replace(series, name=f"{stem} {series.name}", frame=f"{stem} {series.frame}", mount=stem)


def _files(out: Path, series: int) -> list[Path]:
    """A file a series."""
    return [out] if series == 1 else [out.with_stem(f"{out.stem}_{k + 1}") for k in range(series)]


def _campaign(
    cell: Cell, asked: SimulateOptions, flags: AbsoluteReadingOptions, masses: Sequence[float]
) -> "AbsoluteCampaign":
    """What is measured where these masses hang, one after the other [kg]."""
    from testbench.workflows.absolute_campaign import AbsoluteCampaign  # here: few runs are absolute

    geometry = GeometryErrors(*[asked.geometry_mm / 1e3] * 2) if asked.geometry_mm else None
    gear = GearErrors(sigma=flags.gear_urad / 1e6) if flags.gear_urad else None
    return AbsoluteCampaign(
        series=flags.series,
        poses=asked.poses or 1,  # of no effect where a file has them
        masses=tuple(masses),
        targets=1 if flags.orientations else len(cell.arm.markers),
        orientations=flags.orientations,
        sigma=_sigma(asked),
        sigma_rotation=_sigma(asked),
        trackers=tuple(_trackers(asked)) or None,
        disturbances=Disturbances(own_weight=True, geometry=geometry, gear_errors=gear),
    )


def _read_deflections(cell: Cell, asked: SimulateOptions) -> None:
    masses, pulls = hung_loads(cell.arm, asked.file, asked.payload_kg, asked.loads)
    q = given_poses(cell, asked.file, asked.mapping, asked.poses, masses.shape[1])
    if q is None:
        q = find_feasible_poses(
            build_checks(cell, PoseConditions()), asked.poses or 0, trial_rng(asked.seed, 0)
        ).q
    masses = np.broadcast_to(masses, (len(q), masses.shape[1]))
    scenario = Scenario(arm=cell.arm.name, payload=float(masses.max()) or None, sigma=_sigma(asked))
    if asked.geometry_mm:
        errors = Disturbances(own_weight=True, geometry=GeometryErrors(*[asked.geometry_mm / 1e3] * 2))
        cell = replace(cell, truth=disturb(cell.plant, errors, trial_rng(asked.seed, 3)))
    trackers = _trackers(asked)
    pose = np.repeat(np.arange(len(q)), masses.shape[1])
    loaded = poses_with_weight(cell, q[pose], pose + 1, masses.ravel())
    if pulls is not None:  # they act at the same point
        sideways = np.hstack([pulls, np.zeros_like(pulls)])
        loaded = replace(loaded, wrench=loaded.wrench + sideways[pose])
    if asked.instrument:
        if trackers or asked.sigma_um is not None:
            raise BenchError("--instrument cannot be combined with --tracker or --sigma-um")
        own = instruments(asked.instrument, cell.arm.markers, asked.file, pose)
        data = read_instruments(cell, scenario.truth, loaded, own, trial_rng(asked.seed, 1))
    else:
        data = measure_markers(cell, scenario, loaded, None if trackers else trial_rng(asked.seed, 1))
    if trackers:
        from testbench.workflows.absolute_campaign import by_trackers  # here: few runs have several trackers

        data = by_trackers(data, trackers, asked.seed, None if asked.sigma_um is None else _sigma(asked))
    write_csv(data, cell.arm, asked.out)
    console, size = plain_console(), 1e3 * np.linalg.norm(data.deflection, axis=-1)[data.is_measured]
    _say_overload(console, cell, masses.ravel().tolist(), () if pulls is None else pulls.tolist())
    low, high = masses.min(), masses.max()
    hung = (f"{low:g} kg" if low == high else f"{low:g} to {high:g} kg") + " and forces" * (pulls is not None)
    seen = f", read by a tracker at {' and one at '.join(asked.tracker)} m" if asked.tracker else ""
    deflections = f"deflections of {size.min():.2f} to {size.max():.2f} mm"
    text = f"{asked.out}: {data.n_runs} runs under {hung}, {deflections}"
    text += seen + (f", read by {', '.join(asked.instrument)}" if asked.instrument else "")
    console.print(text, soft_wrap=True)


def _sigma(asked: SimulateOptions) -> float:
    """Noise of a reading along an axis, without a tracker's own [m]."""
    return (50.0 if asked.sigma_um is None else asked.sigma_um) / 1e6


def _trackers(asked: SimulateOptions) -> list[Place]:
    """Where trackers stand, each in the world [m]; BenchError for what is far away."""
    found = list(map(parse_point, asked.tracker or []))
    for own in found:
        check_station_position(own)
    return found


def _say_overload(
    console: Console, cell: Cell, masses: Iterable[float], pulls: Iterable[Sequence[float]] = ()
) -> None:
    for doubt in overload_warnings(cell.arm, masses, pulls):
        console.print(f"Warning: {doubt}", soft_wrap=True)
