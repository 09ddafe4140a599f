"""What --absolute adds to `testbench simulate`: where targets are, not how far a load moved them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Protocol

import typer

from testbench.bench.absolute_settings import AbsoluteCampaign
from testbench.bench.absolute_truth import simulate_series
from testbench.bench.campaign import Cell
from testbench.bench.tracker_runs import places
from testbench.data.series import Series
from testbench.data.series_csv import write_series
from testbench.errors import Array, BenchError
from testbench.output.whole import whole_files
from testbench.plant.disturbance import Disturbances, GeometryErrors
from testbench.plant.gear import GearErrors


@dataclass(frozen=True)
class Absolute:
    """Flags of absolute readings."""

    absolute: Annotated[
        bool,
        typer.Option(
            "--absolute",
            help="Where targets are in the tracker's frame: under own weight, then under every load, if any.",
        ),
    ] = False
    series: Annotated[
        int,
        typer.Option(
            min=1,
            max=50,
            help="Set-ups, each with a frame, poses and a mount some 2 mm off; OUT_1.csv and so on.",
        ),
    ] = 1
    orientations: Annotated[
        bool, typer.Option("--orientations", help="Read one target, and how it is turned, to as many urad.")
    ] = False
    gear_urad: Annotated[
        float,
        typer.Option(min=0, max=10_000, help="Periodic errors of every joint, a coefficient up to order 30."),
    ] = 0.0

    def __post_init__(self) -> None:
        """Refuse the others without the first, by BenchError."""
        for own in fields(self):
            if not self.absolute and getattr(self, own.name) != own.default:
                flag = own.name.replace("_", "-")
                raise BenchError(f"--{flag}: expected --absolute with it")


class Asked(Protocol):
    """What the command says of any readings."""

    @property
    def poses(self) -> int | None:
        """Random poses; None where a file has them."""

    @property
    def tracker(self) -> list[str] | None:
        """Where trackers stand."""

    @property
    def sigma_um(self) -> float:
        """Noise of a reading along an axis."""

    @property
    def geometry_mm(self) -> float:
        """Error of every joint's frame."""


def files(out: Path, series: int) -> list[Path]:
    """A file a series."""
    return [out] if series == 1 else [out.with_stem(f"{out.stem}_{k + 1}") for k in range(series)]


def campaign(cell: Cell, asked: Asked, flags: Absolute, masses: Sequence[float]) -> AbsoluteCampaign:
    """What is measured where these masses hang, one after the other [kg]."""
    geometry = GeometryErrors(*[asked.geometry_mm / 1e3] * 2) if asked.geometry_mm else None
    gear = GearErrors(sigma=flags.gear_urad / 1e6) if flags.gear_urad else None
    return AbsoluteCampaign(
        series=flags.series,
        poses=asked.poses or 1,  # of no effect where a file has them
        masses=tuple(masses),
        targets=1 if flags.orientations else len(cell.arm.markers),
        orientations=flags.orientations,
        sigma=asked.sigma_um / 1e6,
        sigma_rotation=asked.sigma_um / 1e6,
        trackers=tuple(places(asked.tracker)) if asked.tracker else None,
        disturbances=Disturbances(own_weight=True, geometry=geometry, gear=gear),
    )


def write_readings(
    cell: Cell, asked: AbsoluteCampaign, seed: int, q: Array | None, out: Path
) -> list[tuple[Path, Series]]:
    """Measure and write every series; the name of its file is that of its frame and its mount."""
    found, _ = simulate_series(cell, asked, seed, q)
    named = [
        (path, replace(own, name=path.stem, frame=path.stem, target=path.stem))
        for path, own in zip(files(out, asked.series), found, strict=True)
    ]
    with whole_files([path for path, _ in named]) as parts:
        for part, (_, own) in zip(parts, named, strict=True):
            write_series(part, cell.arm, own)
    return named
