"""The columns of the study of model error, and its tables."""

from dataclasses import replace

from testbench.studies.model_error.report import ModelErrorReport
from testbench.views.schema import Column, Table, pivot

CASE = Column("case", "disturbance")
MODEL = Column("model", "model")
RMS = Column("rms_um", "RMS error", "um", ".0f")
RANKING = (
    CASE,
    Column("moved_um", "moves deflections by", "um", ".0f"),
    Column("added_um", "adds to the error", "um", "+.0f"),
)
CLAIM = (
    CASE,
    MODEL,
    Column("against_readings", "against readings", "%", "+.1f", scale=100),
    Column("within_claim", "within the claim", form="yes"),
    Column("against_truth", "against the truth", "%", "+.1f", scale=100),
)
TOGETHER = (
    MODEL,
    Column("none_um", "without disturbance", "um", ".0f"),
    Column("all_um", "all together", "um", ".0f"),
)


def tables(report: ModelErrorReport) -> dict[str, Table]:
    """Errors by disturbance and model, without noise and with it; what disturbances add; the claim."""
    found = {}
    noise = f"with noise of {report.sigma_um:g} um"
    for name, calm, words in (("calm", True, "without noise"), ("noisy", False, noise)):
        cells = [cell for cell in report.cells if (cell.noise_um == 0) == calm]
        table = Table((), cells, f"RMS error, um, {words}")
        found[name] = pivot(table, CASE, MODEL, RMS)
        found[f"{name}_short"] = pivot(table, CASE, MODEL, replace(RMS, exact=True))
    found["ranking"] = Table(RANKING, report.ranking)
    found["claim"] = Table(CLAIM, report.claim)
    found["together"] = Table(TOGETHER, report.together)
    return found
