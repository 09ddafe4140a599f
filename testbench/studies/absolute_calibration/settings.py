"""What the study of absolute calibration tries: arms, truths, models and campaigns."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import typer

from testbench.bench.absolute_truth import REAL_ARM, AbsoluteCampaign
from testbench.errors import BenchError
from testbench.identify.absolute.fit import Options as Fit
from testbench.plant import Disturbances, GearErrors

NAME = "absolute_calibration"
ARMS = ("ur10", "kr500_l480")  #: A seed each in turn.
PAYLOAD: Mapping[str, float] = {"ur10": 10.0, "kr500_l480": 460.3}
"""Mass that is hung in loaded poses [kg]."""
NUMBERS = (20, 50, 100, 200, 500)  #: Poses that are tried.
MANY, EVERY = 1000, 4  #: Poses that are tried in every so manieth trial of an arm.
FEATURED = 200  #: Poses of everything else.
CHECKING = 100  #: Poses that predictions are judged in.
QUICK, QUICK_NUMBERS = 2, (20,)  #: With --quick: trials at most, and poses.

ORDERS = 40  #: Periodic errors that are tried: the joints have 30, as a rule.


def _fit(*names: str) -> Fit:
    return Fit(orders=ORDERS, only=frozenset(names))


SPRINGS, GEARS, LINKS = "joint springs", "joint errors", "links"
GEOMETRY = "geometry alone"
INCUMBENT = "joint springs"
WITH_GEARS, WITH_LINKS = "joint springs, joint errors", "joint springs, links"
ALL_LS, ALL = "all, least squares", "all, GCO"
CHOSEN = "chosen by cross-validation"
MODELS: Mapping[str, Fit] = {
    GEOMETRY: _fit(),
    INCUMBENT: _fit(SPRINGS),
    WITH_GEARS: _fit(SPRINGS, GEARS),
    WITH_LINKS: _fit(SPRINGS, LINKS),
    ALL_LS: replace(_fit(SPRINGS, GEARS, LINKS), constraint="none"),
    ALL: _fit(SPRINGS, GEARS, LINKS),
    CHOSEN: Fit(orders=ORDERS),
}
"""Models by name; geometry, frames and mounts are on in all."""
BY_POSES = (GEOMETRY, INCUMBENT, WITH_GEARS, ALL_LS, ALL, CHOSEN)
HIDING = (INCUMBENT, WITH_GEARS, WITH_LINKS, ALL, CHOSEN)
CAMPAIGN = (INCUMBENT, ALL)
FINAL = (INCUMBENT, ALL, CHOSEN)


@dataclass(frozen=True)
class TrueArm:
    """What a true arm is like."""

    words: str
    rigid_links: bool = False  #: Whether its joints alone bend.
    disturbances: Disturbances = REAL_ARM
    sigma: float = 50e-6  #: Of a reading along an axis [m].
    repeatability: float = 0.0  #: Of a joint's angle [rad].
    outliers: float = 0.0  #: Share of readings that are 2 mm off [1].


REAL, NO_GEARS, JOINTS_ONLY, KINDER, NASTIER = "real", "no joint errors", "rigid links", "kinder", "nastier"
TRUE_ARMS: Mapping[str, TrueArm] = {
    REAL: TrueArm("elastic links and joints, joint errors of 30 urad a coefficient up to order 30"),
    NO_GEARS: TrueArm("the same without joint errors", disturbances=replace(REAL_ARM, gear=None)),
    JOINTS_ONLY: TrueArm("joint errors, but links that do not bend", rigid_links=True),
    KINDER: TrueArm(
        "joint errors of 10 urad up to order 10, readings of 20 um",
        disturbances=replace(REAL_ARM, gear=GearErrors(sigma=10e-6, orders=10)),
        sigma=20e-6,
    ),
    NASTIER: TrueArm(
        "joint errors of 60 urad up to order 60, gear ratios 0.01 % off, joints that stiffen and have play "
        "and hysteresis, 10 urad of scatter between approaches, 2 % of the readings 2 mm off",
        disturbances=replace(
            REAL_ARM,
            gear=GearErrors(sigma=60e-6, orders=60, ratio=1e-4),
            stiffening=0.1,
            backlash=5e-5,
            hysteresis=3e-5,
        ),
        repeatability=10e-6,
        outliers=0.02,
    ),
}
"""True arms by name; the first is that of everything else."""
HIDING_ARMS = (NO_GEARS, JOINTS_ONLY)
OTHER_ARMS = (KINDER, NASTIER)

ABSOLUTE, MIXED, PAIRS = "absolute alone", "mixed", "pairs alone"
CAMPAIGNS: Mapping[str, tuple[float, float]] = {ABSOLUTE: (1.0, 0.0), MIXED: (0.75, 0.25), PAIRS: (0.5, 0.5)}
"""Poses of a campaign, and those that are measured loaded as well, over its readings."""


def campaign(arm: str, true: TrueArm, poses: int, *, loaded: int = 0) -> AbsoluteCampaign:
    """Readings of so many poses, the first of them under the payload as well."""
    return AbsoluteCampaign(
        poses=poses,
        masses=(0.0, PAYLOAD[arm]) if loaded else (0.0,),
        loaded_poses=loaded or None,
        sigma=true.sigma,
        repeatability=true.repeatability,
        outliers=true.outliers,
        disturbances=true.disturbances,
    )


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[
        list[str] | None, typer.Option(help="Arm to measure; again for more, a trial each in turn.")
    ] = None


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    arms: tuple[str, ...]
    numbers: tuple[int, ...]  #: Of poses.
    many: int  #: Poses that are tried in some trials; 0 for none.
    featured: int  #: Poses of everything else.

    def arm_of(self, seed: int) -> str:
        """The arm of a trial."""
        return self.arms[seed % len(self.arms)]

    def numbers_of(self, seed: int) -> tuple[int, ...]:
        """Numbers of poses of a trial."""
        often = self.many and seed // len(self.arms) % EVERY == 0
        return (*self.numbers, self.many) if often else self.numbers


def settings(options: Options, quick: bool, _: range) -> Settings:
    """What the flags ask for.

    Raises:
        BenchError: When there is no such arm, or one is there twice.
    """
    arms = tuple(options.arm or ARMS)
    for name in arms:
        if name not in PAYLOAD or arms.count(name) > 1:
            raise BenchError(f"--arm: expected different ones of {', '.join(PAYLOAD)}, got {name!r}")
    return (
        Settings(arms, QUICK_NUMBERS, 0, QUICK_NUMBERS[0])
        if quick
        else Settings(arms, NUMBERS, MANY, FEATURED)
    )
