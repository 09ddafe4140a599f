"""Flags of campaigns, measured and simulated, for every study and command that reads or makes one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.document import is_decimal
from testbench.arm.folder import find_arm, load_arm
from testbench.errors import BenchError, shell_word
from testbench.plant.true_arms import FAMILY, true_arms
from testbench.runs.interrupt import SESSION
from testbench.workflows.cell import Scenario, Truth, of_arm
from testbench.workflows.options import read_mass


def mass(text: str) -> float:
    """Read a hung mass, or its weight [kg]; BadParameter for anything else."""
    try:
        return read_mass(text)
    except BenchError as err:
        raise typer.BadParameter(str(err)) from err


def mass_or_none(text: str) -> float:
    """Read a hung mass [kg]; 0 where nothing hangs."""
    return 0.0 if is_decimal(text) and float(text) == 0 else mass(text)


def true_arm_name(text: str) -> str:
    """Check the name of a kind of true arm; BadParameter if there is none."""
    if text == FAMILY or text in true_arms:
        return text
    raise typer.BadParameter(f"expected one of {', '.join([FAMILY, *true_arms])}, got {text!r}")


ArmName = Annotated[str, typer.Argument(help="Folder of an arm, or name of a built-in one.")]
MapFile = Annotated[Path | None, typer.Option("--map", metavar="TOML", help="Names of the table's columns.")]
SigmaUm = Annotated[
    float | None,
    typer.Option(min=0.001, max=10_000, metavar="UM", help="Noise per axis, if the file has none."),
]
Load = Annotated[
    float | None,
    typer.Option(
        parser=mass,
        metavar="MASS",
        help="Payload if the file has none, kg or as 530lb.",
    ),
]
Payload = Annotated[
    float | None,
    typer.Option(
        "--load",
        parser=mass_or_none,
        metavar="MASS",
        help="Load if the file has none, kg or as 530lb (default: rated).",
    ),
]
ArmFlag = Annotated[str, typer.Option(metavar="ARM", help="Folder of an arm, or name of a built-in one.")]
TrueArmFlag = Annotated[
    str,
    typer.Option(parser=true_arm_name, metavar="NAME", help="Kind of true arm; family: one of six per seed."),
]


@dataclass(frozen=True)
class CampaignOptions:
    """Describe what a campaign under gravity is made from; a study adds its own flags."""

    arm: ArmFlag = "kr500_l480"
    payload_kg: Annotated[
        float | None, typer.Option(min=0.001, max=10_000, metavar="KG", help="Payload (default: rated).")
    ] = None
    sigma_um: Annotated[
        float, typer.Option(min=0.001, max=10_000, metavar="UM", help="Noise of a reading, per axis.")
    ] = 50.0
    truth: Annotated[Truth, typer.Option(help="MuJoCo's arm or a linear one.")] = "nonlinear"
    true_arm: TrueArmFlag = FAMILY

    def scenario(self, workspace_poses: int) -> Scenario:
        """Make the campaign that is asked for; InputError names an arm that there is not."""
        scenario = Scenario(
            arm=find_arm(self.arm).resolve().name,
            payload=self.payload_kg,
            sigma=self.sigma_um / 1e6,
            truth=self.truth,
            workspace_poses=workspace_poses,
        )
        return of_arm(load_arm(self.arm), scenario)


@dataclass(frozen=True)
class ReadingOptions:
    """Name measured runs of an arm, and how they are read."""

    arm: ArmName
    dataset: Annotated[Path, typer.Argument(help="Measured runs: CSV, text, or FILE.xlsx#SHEET.")]
    mapping: MapFile = None
    sigma_um: SigmaUm = None
    load: Load = None
    frame: Annotated[
        str, typer.Option(metavar="FRAME", help="Frame of the readings: auto, base, tracker, TOML.")
    ] = "auto"
    new_target: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Target that the arm lacks; repeatable.")
    ] = None

    @property
    def words(self) -> str:
        """Write how runs are read as flags of another command, without what the project file says."""
        load, frame = None if self.load is None else f"{self.load:g}", self.frame
        own = {"map": self.mapping, "sigma_um": self.sigma_um, "load": load}
        own |= {"frame": None if frame == "auto" else frame}
        flags = [(key, value) for key, value in own.items() if value is not None]
        flags += [("new_target", name) for name in self.new_target or ()]
        taken = SESSION.get().taken
        kept = [(key, value) for key, value in flags if {"new_target": "targets"}.get(key, key) not in taken]
        return "".join(f" --{key.replace('_', '-')} {shell_word(Path(str(value)))}" for key, value in kept)
