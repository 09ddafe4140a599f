"""The report of all trials."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from testbench.studies.absolute_calibration.report import (
    AbsoluteCalibrationReport,
    CampaignRow,
    DatasetRow,
    Gains,
    HidingRow,
    ModelRow,
    Shares,
)
from testbench.studies.absolute_calibration.rows import Held, Row
from testbench.studies.absolute_calibration.settings import (
    ABSOLUTE,
    BY_POSES,
    CAMPAIGN,
    CHOSEN,
    GEARS,
    GEOMETRY,
    HIDING,
    INCUMBENT,
    LINKS,
    MODELS,
    NAME,
    REAL,
    TRUE_ARMS,
    Settings,
)
from testbench.studies.study import Rows
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import grouped, spread

UM = 1e6
K = TypeVar("K")


def summary(asked: Settings, seeds: range, trials: Rows[Row]) -> AbsoluteCalibrationReport:
    """By arm, true arm, campaign, number of poses and model."""
    every = [row for _, rows in trials for row in rows]
    own = [row for row in every if (row.true_arm, row.campaign) == (REAL, ABSOLUTE)]
    featured = [
        row
        for row in every
        if row.campaign == ABSOLUTE and row.poses == asked.featured and row.model in HIDING
    ]
    campaigns = [row for row in every if row.true_arm == REAL and row.readings == asked.featured]
    by_poses = grouped((row for row in own if row.model in BY_POSES), lambda r: (r.arm, r.poses, r.model))
    by_truth = grouped(featured, lambda r: (r.arm, r.true_arm, r.model))
    by_campaign = grouped(
        (row for row in campaigns if row.model in CAMPAIGN), lambda r: (r.arm, r.campaign, r.model)
    )
    by_arm = grouped((row for row in own if row.poses == asked.featured), lambda r: r.arm)
    return AbsoluteCalibrationReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        trials=len(seeds),
        arms=tuple(arm for arm in asked.arms if any(row.arm == arm for row in every)),
        featured=asked.featured,
        true_arms={name: true.words for name, true in TRUE_ARMS.items()},
        gains=[_gains(arm, by_arm[arm]) for arm in asked.arms if arm in by_arm],
        models=[_model(rows) for rows in _sorted(asked, by_poses)],
        hiding=[_hiding(rows) for rows in _sorted(asked, by_truth)],
        campaigns=[_campaign(rows) for rows in _sorted(asked, by_campaign)],
        dataset=DatasetRow(asked.featured, asked.featured, UM * TRUE_ARMS[REAL].sigma),
    )


def _sorted(asked: Settings, groups: Mapping[tuple[str, K, str], list[Row]]) -> list[list[Row]]:
    """Arms one after the other, then numbers of poses or true arms as they come, then models."""
    models, second = list(MODELS), list(dict.fromkeys(key[1] for key in groups))

    def place(key: tuple[str, K, str]) -> tuple[int, int, int]:
        return asked.arms.index(key[0]), second.index(key[1]), models.index(key[2])

    return [groups[key] for key in sorted(groups, key=place)]


def _gains(arm: str, rows: Sequence[Row]) -> Gains:
    """Of one arm's rows from the featured poses."""
    errors = {name: [row.error_mm for row in own] for name, own in grouped(rows, lambda r: r.model).items()}

    def gain(theirs: str) -> Gain:
        return gained(CHOSEN, theirs, errors[CHOSEN], errors[theirs])

    return Gains(arm, springs=gain(INCUMBENT), geometry=gain(GEOMETRY))


def over_optimum(rows: Sequence[Row]) -> float:
    """Root mean square over trials of the error over the optimum of the same trial [1]."""
    return float(np.sqrt(np.mean([(row.error_mm / row.optimum_mm) ** 2 for row in rows if row.optimum_mm])))


def shares(rows: Sequence[Row]) -> Shares:
    """Over all numbers of all trials."""
    positions = _share([row.positions for row in rows])
    assert positions is not None
    return Shares(
        positions=positions,
        geometry=_share([row.geometry for row in rows]),
        joint_errors=_share([row.joint_errors for row in rows]),
        joints=_share([row.joints for row in rows]),
        entries=_share([row.entries for row in rows]),
    )


def _share(held: Sequence[Held | None]) -> float | None:
    known = [own for own in held if own is not None]
    return sum(own.inside for own in known) / sum(own.of for own in known) if known else None


def _model(rows: Sequence[Row]) -> ModelRow:
    first = rows[0]
    return ModelRow(
        name=first.model,
        arm=first.arm,
        poses=first.poses,
        trials=len(rows),
        error_mm=spread([row.error_mm for row in rows]),
        loaded_mm=spread([row.loaded_mm for row in rows]),
        optimum_mm=spread([row.optimum_mm for row in rows if row.optimum_mm is not None]),
        over_optimum=over_optimum(rows),
        inside=shares(rows),
    )


def _off(rows: Sequence[Row], joint: int) -> tuple[float, float]:
    """Median and root mean square of a joint's compliance over the true one, less one."""
    off = np.array([row.compliance_off[joint] for row in rows])
    return float(np.median(off)), float(np.sqrt(np.mean(off**2)))


def _hiding(rows: Sequence[Row]) -> HidingRow:
    first, chosen = rows[0], rows[0].model == CHOSEN
    (bias_2, off_2), (bias_3, off_3) = _off(rows, 1), _off(rows, 2)
    kept = [np.mean([name in row.kept for row in rows]) for name in (GEARS, LINKS)]
    return HidingRow(
        arm=first.arm,
        true_arm=first.true_arm,
        model=first.model,
        error_mm=spread([row.error_mm for row in rows]),
        bias_2=bias_2,
        off_2=off_2,
        bias_3=bias_3,
        off_3=off_3,
        geometry_off=spread([row.geometry_off for row in rows]),
        inside=shares(rows),
        gears_kept=float(kept[0]) if chosen else None,
        links_kept=float(kept[1]) if chosen else None,
    )


def _campaign(rows: Sequence[Row]) -> CampaignRow:
    first = rows[0]
    return CampaignRow(
        arm=first.arm,
        campaign=first.campaign,
        poses=first.poses,
        readings=first.readings,
        model=first.model,
        error_mm=spread([row.error_mm for row in rows]),
        loaded_mm=spread([row.loaded_mm for row in rows]),
        off_2=_off(rows, 1)[1],
        off_3=_off(rows, 2)[1],
    )
