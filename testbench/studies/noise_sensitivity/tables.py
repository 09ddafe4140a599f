"""The columns of the study of noise, and its tables."""

from collections.abc import Sequence
from dataclasses import replace

from testbench.bench.truths import CALLED
from testbench.studies.noise_sensitivity.by_arm import ByArm
from testbench.studies.noise_sensitivity.report import Level, NoiseReport
from testbench.studies.noise_sensitivity.summary import PARTS
from testbench.views.schema import Column, Table, pivot

MODEL = Column("model", "model")
SIGMA = Column("sigma_um", "noise of a reading", "um", "g")
RMS = Column("rms_um", "RMS error", "um", ".1f")
P95 = Column("p95_um", "95 % error", "um", ".1f")
DISTANCE = Column("x", "distance", "m", "g")
SLOPES = (
    MODEL,
    Column("noise_free_um", "error without noise", "um", ".1f", rounding=1e-3),
    Column("um_per_um", "cost of a um of noise", "um", ".2f"),
)
PAIRED = (
    Column("ours", "model"),
    Column("theirs", "against"),
    SIGMA,
    Column("ratio", "error over its", form=".2f"),
    Column("better_in", "better", form="yes"),
    Column("alike_in", "alike", form="yes"),
)
WEIGHTED = (
    Column("truth", "truth"),
    MODEL,
    Column("distance_m", "distance", "m", "g"),
    Column("ratio", "full over flat", form=".2f"),
    Column("better_in", "full better", form="yes"),
)
TRUE_ARM, HEADLINE = Column("true_arm", "true arm", called=CALLED), Column("headline", "model")
INSTRUMENTS = (
    Column("truth", "truth"),
    Column("model", "instrument"),
    DISTANCE,
    replace(RMS, heading="RMS over the workspace"),
)


def distinct(levels: Sequence[Level]) -> list[Level]:
    """Without a completion that exists in no trial with noise: that is least squares once more."""
    there = {level.model for level in levels if level.x > 0 and level.conservative}
    return [level for level in levels if level.constraint != "free" or level.model in there]


def by_arm_table(rows: Sequence[ByArm], headline: Column, value: Column) -> Table:
    """Headlines that differ by true arm: a row each, a column a true arm."""
    return pivot(Table((), rows), headline, TRUE_ARM, value)


def tables(report: NoiseReport) -> dict[str, Table]:
    """Errors by model and noise, for people who read and for 80 columns; what they say; instruments."""
    found = {}
    for part, words in PARTS.items():
        levels = Table((), report.sweeps[part], f"{words}: RMS error, um, by noise of a reading")
        found[f"{part}_rms"] = pivot(levels, MODEL, SIGMA, RMS)
        found[f"{part}_p95"] = pivot(
            replace(levels, title=f"{words}: 95 % error, um, by noise of a reading"), MODEL, SIGMA, P95
        )
        told = replace(levels, rows=distinct(report.sweeps[part]))
        found[f"{part}_short"] = pivot(told, MODEL, SIGMA, replace(RMS, form=".0f", exact=True))
        found[f"{part}_slopes"] = Table(SLOPES, list(report.slopes[part].values()), f"{words}: slopes")
        found[f"{part}_by_arm"] = by_arm_table(
            report.by_arm[part], HEADLINE, Column("value", "RMS error", form=".0f")
        )
        pairs = [row for row in report.paired if row.part == part]
        found[f"{part}_paired"] = Table(PAIRED, pairs, f"{words}: pairs of models")
    found["weighted"] = Table(WEIGHTED, [row for own in report.weighted_over_flat.values() for row in own])
    found["weighted_by_arm"] = by_arm_table(
        report.weighted_by_arm,
        replace(HEADLINE, heading="truth, model"),
        Column("value", "full over flat", form=".2f"),
    )
    found["instruments"] = Table(INSTRUMENTS, report.instruments)
    return found
