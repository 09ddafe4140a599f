"""What the model does not know: each disturbance of the true arm alone and all together, beside the noise.

The KR 500 under its payload, the poses of section 6; the links weigh only where a case says so. The arm is
identified while it is disturbed; it is judged all over the workspace by deflections of the same disturbed arm
under exactly the recorded loads: a payload that was weighed wrongly spoils the model, not the arm.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from testbench.bench.campaign import Campaign, Cell, Scenario, build_cell, simulate, stream
from testbench.data.dataset import Dataset
from testbench.errors import BenchError
from testbench.identify.evaluate import predict, score
from testbench.plant import STIFF_COMPENSATOR, TYPICAL, Disturbances, disturb, settle_pair
from testbench.studies.noise_sensitivity.trial import Way, reread, ways
from testbench.views.report import UM

NAME = "model_error"
PLAIN, WITH_PRIOR = ("MLS56", "MGCO56"), ("MGCO56", "MGCO68")
NONE, ALL = "none", "all together"
STIFF = "compensator, other reading"
SWITCHES: dict[str, tuple[str, ...]] = {
    "own weight": ("own_weight",),
    "gravity compensator": ("compensator",),
    "nominal geometry": ("geometry",),
    "joint sensors": ("sensor_offset",),
    "payload mass": ("mass_error",),
    "payload centre": ("centre_error",),
    "stiffening joints": ("stiffening",),
    "backlash": ("backlash",),
    "hysteresis": ("hysteresis",),
    "soft foundation": ("foundation",),
}
"""Fields of Disturbances that each case switches on, at their typical size."""


@dataclass(frozen=True)
class Study:
    """What is tried.

    Attributes:
        scale: Size of every disturbance over its typical one [1]; switches are on or off.
        sigma: Standard deviation of one reading along one axis [m].
        workspace: Poses in which the models are judged.
        only: Names of cases beside none and all together; none for every one.
    """

    scale: float = 1.0
    sigma: float = 50e-6
    workspace: int = 100
    only: tuple[str, ...] = ()


def cases(scale: float, only: Sequence[str] = ()) -> dict[str, Disturbances]:
    """Disturbances by name: none, each alone, the compensator's other reading, all together.

    Args:
        scale: Size of those that have one, over the typical one.
        only: Cases to keep beside none; then all together are these alone.

    Raises:
        BenchError: When there is no such case.
    """
    sized = resized(TYPICAL, scale)
    if only:
        return _only(sized, only)
    alone = {
        name: replace(Disturbances(), **{field: getattr(sized, field) for field in fields})
        for name, fields in SWITCHES.items()
    }
    return {
        NONE: Disturbances(),
        **alone,
        STIFF: Disturbances(compensator=STIFF_COMPENSATOR),
        ALL: sized,
    }


def _only(sized: Disturbances, only: Sequence[str]) -> dict[str, Disturbances]:
    """None, the cases asked for, and they together."""
    for name in only:
        if name not in SWITCHES:
            raise BenchError(f"no disturbance {name!r}; disturbances are {', '.join(SWITCHES)}")
    fields = {name: {key: getattr(sized, key) for key in SWITCHES[name]} for name in only}
    together = {key: value for own in fields.values() for key, value in own.items()}
    alone = {name: replace(Disturbances(), **own) for name, own in fields.items()}
    return {NONE: Disturbances(), **alone, ALL: replace(Disturbances(), **together)}


def sizes(scale: float, only: Sequence[str] = ()) -> dict[str, dict[str, Any]]:
    """What every case switches on, as plain data."""
    return {
        name: {key: value for key, value in asdict(case).items() if value}
        for name, case in cases(scale, only).items()
    }


def resized(typical: Disturbances, scale: float) -> Disturbances:
    """Every disturbance that has a size, so many times as large."""
    fields = "sensor_offset mass_error centre_error stiffening backlash hysteresis foundation".split()
    geometry = typical.geometry
    if geometry is not None:
        geometry = replace(geometry, position=scale * geometry.position, angle=scale * geometry.angle)
    return replace(typical, geometry=geometry, **{name: scale * getattr(typical, name) for name in fields})


@dataclass(frozen=True)
class Row:
    """One fit judged by true deflections."""

    case: str
    noise_um: float
    model: str
    rms_um: float
    p95_um: float
    moved_um: float
    conservative: int
    solved: int


def trials(folder: Path, study: Study, seeds: Sequence[int]) -> list[list[Row]]:
    """Rows of some trials, a list a seed.

    Args:
        folder: Of the arm.
        study: What is tried.
        seeds: Roots of randomness.
    """
    cell = build_cell(folder)
    fits = ways(cell, PLAIN, WITH_PRIOR)
    return [list(_trial(cell, fits, study, seed)) for seed in seeds]


def _trial(cell: Cell, fits: dict[str, Way], study: Study, seed: int) -> Iterator[Row]:
    scenario = Scenario(
        arm=cell.arm.name, truth="linear", noise=False, sigma=study.sigma, workspace_poses=study.workspace
    )
    campaign = simulate(cell, scenario, seed)  # for its poses and loads
    quiet: Dataset | None = None
    for name, disturbances in cases(study.scale, study.only).items():
        clean, truth = disturbed(cell, campaign, disturbances, seed)
        quiet = quiet or truth
        moved = UM * float(np.sqrt(np.square(truth.deflection - quiet.deflection).sum(axis=2).mean()))
        for noise in (0.0, study.sigma):
            data = reread(clean, noise, stream(seed, 1))
            for model, fit in fits.items():
                estimate = fit(cell, data, seed)
                found = score(predict(cell.vjm, estimate, truth), truth.deflection)
                yield Row(
                    case=name,
                    noise_um=UM * noise,
                    model=model,
                    rms_um=UM * found.rms,
                    p95_um=UM * found.p95,
                    moved_um=moved,
                    conservative=int(estimate.conservative),
                    solved=int(estimate.status == "solved"),
                )


def disturbed(
    cell: Cell, campaign: Campaign, disturbances: Disturbances, seed: int
) -> tuple[Dataset, Dataset]:
    """Noise-free runs to identify from, and those to be judged by, of a disturbed arm.

    Args:
        cell: The nominal arm.
        campaign: Its poses and recorded loads.
        disturbances: What the true arm does.
        seed: Root of the disturbances' sizes; the same for every case.
    """
    true = disturb(cell.plant, disturbances, stream(seed, 20))
    exact = replace(disturbances, mass_error=0.0, centre_error=0.0)
    judge = disturb(cell.plant, exact, stream(seed, 20))
    found = []
    for arm, runs in ((true, campaign.identification), (judge, campaign.workspace)):
        before, after = settle_pair(arm, runs.q, runs.wrench, runs.point)
        found.append(replace(runs, before=before.markers, after=after.markers))
    return found[0], found[1]
