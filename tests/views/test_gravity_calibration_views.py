"""What people see of a calibration equals its report, for reports that are made up."""

import pytest
from checks import check_report, check_table
from made_up import fill, filled, single

from testbench.studies.gravity_calibration import STUDY
from testbench.studies.gravity_calibration.summary import (
    GravityReport,
    ModelReport,
    winners,
)

MODELS = [
    {"name": "MLS32", "structure": "MLS32", "constraint": "none", "prior": False, "conservative": False},
    {"name": "MGCO56", "structure": "MGCO56", "constraint": "psd", "prior": False, "conservative": True},
    {"name": "MLS56 + prior", "structure": "MLS56", "constraint": "none", "prior": True, "conservative": 0.4},
    {
        "name": "MGCO56 + prior",
        "structure": "MGCO56",
        "constraint": "psd",
        "prior": True,
        "conservative": True,
    },
]
PAPER = ("identification_rms_mm", "check_rms_mm", "check_max_mm", "check_max_relative_percent")
ERRORS = {
    "RMS fit, mm": "identification.rms_mm",
    "RMS check, mm": "check.rms_mm",
    "95 % check, mm": "check.p95_mm",
    "max check, mm": "check.max_mm",
    "max rel., %": "check.max_relative_percent",
    "RMS workspace, mm": "workspace.rms_mm",
}
SHORT = {"95 % check, mm", "max rel., %"}
MEANS = {
    "model": "name",
    "unknowns": "parameters",
    "seen": "rank",
    "conservative": "conservative",
    "F_M": "f_m",
    "floor": "f_m_floor",
    **ERRORS,
}
KNOWN = {
    "RMS fit, mm": "paper.identification_rms_mm",
    "RMS check, mm": "paper.check_rms_mm",
    "max check, mm": "paper.check_max_mm",
    "max rel., %": "paper.check_max_relative_percent",
}
FITS = {"model": "name", "method": "method", "status": "status", "duality gap": "duality_gap"} | {
    "smallest eigenvalue": "min_eigenvalue",
    "time, s": "solve_seconds",
    **{
        title: f"residuals.{group}.{key}"
        for group in ("identification", "check")
        for title, key in (
            (f"residual mean, {group}, um", "mean_um"),
            (f"residual standard deviation, {group}, um", "std_um"),
            (f"Lilliefors p, {group}", "lilliefors_p"),
        )
    },
}


@pytest.fixture
def report(rng):
    models = filled(ModelReport, rng, MODELS, paper={key: float(rng.uniform(1, 9)) for key in PAPER})
    return fill(
        GravityReport,
        rng,
        seed=[1, 2],
        models=models,
        recommended="MGCO56",
        twins=[],
        winners=winners(models),
    )


@pytest.mark.parametrize("several", [True, False])
def test_tables_show_the_reports_numbers_with_their_units(report, several):
    report = report if several else single(report)
    tables = STUDY.tables(report)
    short = {t: path for t, path in MEANS.items() if t not in SHORT and t != "floor"}
    check_table(tables["models"], report.models, MEANS, KNOWN)
    check_table(tables["short"], report.models, short, {t: p for t, p in KNOWN.items() if t in short})
    check_table(tables["fits"], report.models, FITS)
    check_report(STUDY, report)
