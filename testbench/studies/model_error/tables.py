"""The columns of the study of model error, and its tables."""

from dataclasses import replace

from testbench.studies.model_error.cases import NONE
from testbench.studies.model_error.report import ModelErrorReport
from testbench.studies.model_error.summary import distinct
from testbench.studies.noise_sensitivity.tables import HEADLINE, by_arm_table
from testbench.views.schema import Column, Table, pivot

CASE = Column("case", "disturbance", called={NONE: "no disturbance"})
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
    Column("against_truth", "against the truth", "%", "+.1f", scale=100),
    Column("within_true", "true within the claim", form="yes"),
    Column("against_readings", "against readings", "%", "+.1f", scale=100),
    Column("within_claim", "within the claim", form="yes"),
)
BEATS = (
    Column("ours", "model"),
    Column("theirs", "against"),
    Column("better", "better in trials", form="d"),
    Column("alike", "alike in trials", form="d"),
    Column("ratio", "error over its", form=".2f"),
)
TOGETHER = (
    MODEL,
    Column("none_um", "without disturbance", "um", ".0f"),
    Column("all_um", "all together", "um", ".0f"),
)


def tables(report: ModelErrorReport) -> dict[str, Table]:
    """Errors by disturbance and model, without noise and with it; what disturbances add; the claim."""
    found = {}
    names = {cell.model for cell in distinct(report.cells)}
    noise = f"with noise of {report.sigma_um:g} um"
    for name, calm, words in (("calm", True, "without noise"), ("noisy", False, noise)):
        cells = [cell for cell in report.cells if (cell.noise_um == 0) == calm]
        table = Table((), cells, f"RMS error, um, {words}")
        found[name] = pivot(table, CASE, MODEL, RMS)
        told = replace(table, rows=[cell for cell in cells if cell.model in names])
        found[f"{name}_short"] = pivot(told, CASE, MODEL, replace(RMS, exact=True))
    found["ranking"] = Table(RANKING, report.ranking)
    found["beats"] = Table(BEATS, report.beats)
    found["claim"] = Table(CLAIM, report.claim)
    found["together_by_arm"] = by_arm_table(report.together_by_arm, HEADLINE, Column("value", "", form=".0f"))
    found["claim_by_arm"] = by_arm_table(
        report.claim_by_arm,
        replace(HEADLINE, heading="disturbance"),
        Column("value", "change of the error", form="+.1f", scale=100),
    )
    found["together"] = Table(TOGETHER, report.together)
    return found
