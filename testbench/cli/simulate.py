"""testbench simulate ARM POSES --out DATA: measured runs of the true arm."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Scenario, build_cell, hanging, measure, stream
from testbench.bench.plan_input import read_payload
from testbench.bench.tracker_runs import by_trackers, places
from testbench.cli.arguments import ArmName
from testbench.data.csvfile import write_csv
from testbench.data.posefile import read_poses
from testbench.errors import InputError
from testbench.output.place import Kind, check_file
from testbench.plant import check_poses
from testbench.plant.disturbance import Disturbances, GeometryErrors
from testbench.plant.disturbed import disturb
from testbench.shell.options import Force, takes

HUNG = 460.3  #: Mass that hangs where nothing else is said [kg].
DATASET = Kind("a dataset", rb"run,pose,marker,")


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    arm: ArmName
    poses: Annotated[Path, typer.Argument(help="CSV of joint angles, columns JOINT_rad; or a plan.csv.")]
    out: Annotated[Path, typer.Option(help="Dataset to write, CSV.")]
    payload_kg: Annotated[
        float | None, typer.Option(help=f"Hung mass, {HUNG} if not given; a plan.csv has its own.")
    ] = None
    sigma_um: Annotated[float, typer.Option(help="Noise of a reading along an axis.")] = 50.0
    tracker: Annotated[
        list[str] | None,
        typer.Option(
            help="Where a laser tracker stands, x,y,z [m]; it reads in its own frame. Again for more."
        ),
    ] = None
    geometry_mm: Annotated[
        float, typer.Option(min=0, max=10, help="Error of every joint's frame along an axis, and in mrad.")
    ] = 0.0
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of the noise.")] = 1
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Settle the true arm, read the markers, write the dataset."""
    check_file(asked.out, DATASET, inputs=[find_arm(asked.arm), asked.poses], force=asked.force)
    cell = build_cell(asked.arm)
    mass = HUNG if asked.payload_kg is None else asked.payload_kg
    scenario = Scenario(arm=cell.arm.name, payload=mass, sigma=asked.sigma_um / 1e6)
    q = read_poses(asked.poses, cell.arm)
    payload = read_payload(asked.poses)
    if payload is not None and asked.payload_kg is not None:
        raise InputError(
            asked.poses, "column load_kg", "says what hangs in every run; leave out --payload-kg"
        )
    check_poses(cell.room, q)
    if asked.geometry_mm:
        errors = Disturbances(own_weight=True, geometry=GeometryErrors(*[asked.geometry_mm / 1e3] * 2))
        cell = replace(cell, truth=disturb(cell.plant, errors, stream(asked.seed, 3)).plant)
    loaded = hanging(cell, q, np.arange(len(q)) + 1, mass if payload is None else payload)
    trackers = places(asked.tracker or [])
    data = measure(cell, scenario, loaded, None if trackers else stream(asked.seed, 1))
    if trackers:
        data = by_trackers(data, trackers, asked.seed)
    write_csv(data, cell.arm, asked.out)
    size = 1e3 * np.linalg.norm(data.deflection, axis=-1)
    text = f"{asked.out}: {data.runs} runs, deflections {size.min():.2f} to {size.max():.2f} mm"
    Console(highlight=False).print(text, soft_wrap=True)
