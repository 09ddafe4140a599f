"""What --absolute adds to `testbench plan`: poses for a calibration of all that is unknown."""

from dataclasses import dataclass, fields
from typing import Annotated

import typer

from testbench.errors import BenchError


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
    orientations: Annotated[
        bool, typer.Option("--orientations", help="Read one target, and how it is turned, to as many urad.")
    ] = False
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
        for own in fields(self):
            if not self.absolute and getattr(self, own.name) != own.default:
                raise BenchError(f"--{own.name.replace('_', '-')}: expected --absolute with it")
