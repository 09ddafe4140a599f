"""The columns of the study of noise, and its tables."""

from dataclasses import replace

from testbench.studies.noise_sensitivity.report import NoiseReport
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
    Column("um_per_um", "error a um of noise", "um", ".2f"),
)
PAIRED = (
    SIGMA,
    Column("ratio", "GCO over least squares", form=".2f"),
    Column("better_in", "GCO better", form="yes"),
)
WEIGHTED = (
    Column("truth", "truth"),
    Column("distance_m", "distance", "m", "g"),
    Column("ratio", "full over flat", form=".2f"),
)
INSTRUMENTS = (
    Column("truth", "truth"),
    Column("model", "instrument"),
    DISTANCE,
    replace(RMS, heading="RMS over the workspace"),
)


def tables(report: NoiseReport) -> dict[str, Table]:
    """Errors by model and noise, for people who read and for 80 columns; what they say; instruments."""
    found = {}
    for part, words in PARTS.items():
        levels = Table((), report.sweeps[part], f"{words}: RMS error, um, by noise of a reading")
        found[f"{part}_rms"] = pivot(levels, MODEL, SIGMA, RMS)
        found[f"{part}_p95"] = pivot(levels, MODEL, SIGMA, P95)
        found[f"{part}_short"] = pivot(levels, MODEL, SIGMA, replace(RMS, form=".0f", exact=True))
        found[f"{part}_slopes"] = Table(SLOPES, list(report.slopes[part].values()))
        found[f"{part}_paired"] = Table(PAIRED, [row for row in report.gco_over_ls if row.part == part])
    found["weighted"] = Table(WEIGHTED, [row for own in report.weighted_over_flat.values() for row in own])
    found["instruments"] = Table(INSTRUMENTS, report.instruments)
    return found
