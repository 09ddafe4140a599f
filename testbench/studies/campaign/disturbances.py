"""Settings of the study of disturbances: which ones, how large, on which true arms."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import typer

from testbench.errors import BenchError
from testbench.plant.disturbance import STIFF_COMPENSATOR, TYPICAL, Disturbances
from testbench.plant.true_arms import FAMILY, HELD_OUT
from testbench.workflows.campaign_flags import ArmFlag, TrueArmFlag

SIZES = 0.5, 2.0  #: Of all disturbances, over those of the cases [1].
QUICK_WORKSPACE = 20
NONE, ALL = "none", "all together"
PLAIN_COMPENSATOR, STIFF = "gravity compensator", "stiff compensator"
SWITCHES: Mapping[str, str] = {
    "own weight": "own_weight",
    PLAIN_COMPENSATOR: "compensator",
    "nominal geometry": "geometry",
    "joint sensors": "sensor_offset",
    "payload mass": "mass_error",
    "payload centre": "centre_error",
    "stiffening joints": "stiffening",
    "backlash": "backlash",
    "hysteresis": "hysteresis",
    "soft foundation": "foundation",
}
"""The field of Disturbances that each case switches on; their sizes are in docs/studies/model_error.md."""


@dataclass(frozen=True)
class DisturbanceOptions:
    """Flags of the study."""

    scale: Annotated[
        float, typer.Option(min=0, max=10, metavar="X", help="Size of disturbances over the typical size.")
    ] = 1.0
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this disturbance; repeatable.")
    ] = None
    sigma_um: Annotated[
        float, typer.Option(min=0.001, max=10_000, metavar="UM", help="Noise of a reading, per axis.")
    ] = 50.0
    arm: ArmFlag = "kr500_l480"
    true_arm: TrueArmFlag = FAMILY
    arms: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Extra true arm; repeatable (default: all).")
    ] = None
    sizes: Annotated[
        list[float] | None,
        typer.Option(min=0, max=10, metavar="X", help="Extra size over --scale; repeatable."),
    ] = None


@dataclass(frozen=True)
class DisturbanceSettings:
    """What is tried."""

    arm: str  #: Folder or name of the arm.
    first: int  #: The first seed.
    scale: float = 1.0  #: Size of every disturbance over its typical one [1]; switches are on or off.
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    workspace: int = 100  #: Poses in which the models are judged.
    only: tuple[str, ...] = ()  #: Names of cases beside none and all together; none for every one.
    true_arm: str = FAMILY  #: One of TRUTHS, or the family in turn.
    arms: tuple[str, ...] = ()  #: Beside it, of HELD_OUT.
    sizes: tuple[float, ...] = ()  #: In which it is disturbed in every way too, over those of the cases [1].


def settings(options: DisturbanceOptions, quick: bool, seeds: range) -> DisturbanceSettings:
    """What the flags ask for; raises BenchError for a disturbance or a true arm that does not exist."""
    disturbances(options.scale, options.only or ())
    arms, sizes = tuple(options.arms or HELD_OUT), tuple(options.sizes or SIZES)
    for name in arms:
        if name not in HELD_OUT:
            raise BenchError(f"--arms: expected some of {', '.join(HELD_OUT)}, got {name!r}")
    workspace = QUICK_WORKSPACE if quick else DisturbanceSettings.workspace
    only, sigma = tuple(options.only or ()), options.sigma_um / 1e6
    alone = options.true_arm != FAMILY and options.arms is None
    return DisturbanceSettings(
        options.arm,
        seeds[0],
        options.scale,
        sigma,
        workspace,
        only,
        options.true_arm,
        () if alone else tuple(dict.fromkeys(arms)),
        tuple(dict.fromkeys(size for size in sizes if size != 1)),
    )


def disturbances(scale: float, only: Sequence[str] = ()) -> dict[str, Disturbances]:
    """What disturbs the arm by case, `scale` times as much as typical: none, each, stiff compensator, all.

    Those of `only` are kept beside none, and all together are these alone; BenchError for one unknown.
    """
    for name in only:
        if name not in SWITCHES:
            raise BenchError(f"no disturbance {name!r}; disturbances are {', '.join(SWITCHES)}")
    geometry = TYPICAL.geometry
    if geometry is not None:
        geometry = replace(geometry, position=scale * geometry.position, angle=scale * geometry.angle)
    sizes = {field: scale * size for field, size in vars(TYPICAL).items() if type(size) is float}
    fields = {**vars(TYPICAL), **sizes, "geometry": geometry}
    values = {name: {SWITCHES[name]: fields[SWITCHES[name]]} for name in only or SWITCHES}
    alone = {name: Disturbances(**value) for name, value in values.items()}
    stiff = {} if only else {STIFF: Disturbances(compensator=STIFF_COMPENSATOR)}
    together = {field: size for value in values.values() for field, size in value.items()}
    return {NONE: Disturbances(), **alone, **stiff, ALL: Disturbances(**together)}
