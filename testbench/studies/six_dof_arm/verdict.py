"""What our numbers say of the statements of section 5.2."""

from collections.abc import Mapping, Sequence

from testbench.studies.paper import SECTION_5_2, Claim, comparison, judged, number
from testbench.studies.six_dof_arm.report import ModelReport, Paired, TieBreak
from testbench.studies.six_dof_arm.tables import CELLS
from testbench.studies.six_dof_arm.trial import CLOSE, MODELS
from testbench.trials.spread import middle
from testbench.views.schema import Column, show, show_truth

Models = Mapping[str, ModelReport]


def claims(models: Models, nonlinear: Sequence[ModelReport], paired: Paired, tie: TieBreak) -> list[Claim]:
    """The paper's statements of section 5.2, and what our numbers say of each."""
    bent = next(m for m in nonlinear if m.name == "MGCO56")
    ours = {name: models[name] for name in MODELS}
    least = sorted(ours.values(), key=lambda m: middle(m.check_true.p95_mm))
    return [
        _conservative(ours, tie),
        *(
            _cell(name, column, models[name])
            for name in ("MGCO56", "MLS32", "MLS56", "MGCO69", "MGCO147")
            for column in CELLS
            if column.known(models[name])
        ),
        comparison(
            "MGCO56 is the best model",
            "its 95 % error without noise is the least of the five",
            paired.mgco56_best,
            paired.seeds,
            "medians " + ", ".join(f"{m.name} {middle(m.check_true.p95_mm):.3f} mm" for m in least),
        ),
        comparison(
            "MGCO56 and MLS32 are nearly the same",
            f"their 95 % errors without noise differ by at most {100 * CLOSE:g} %",
            paired.mgco56_near_mls32,
            paired.seeds,
            f"MGCO56's is {show(paired.mgco56_over_mls32_p95_check_true)} times that of MLS32, and the "
            f"smaller one in {paired.mgco56_better_than_mls32}",
        ),
        _redundant(ours, paired),
        _linear(bent, models["MGCO56"], paired),
    ]


def _conservative(models: Models, tie: TieBreak) -> Claim:
    holds = all(m.conservative is (m.constraint == "psd") for m in models.values())
    shares = ", ".join(f"{name}: {show_truth(m.conservative)}" for name, m in models.items())
    why = (
        f"{shares}. For MLS56 that is a tie-break: it takes the minimum norm in {tie.free} free directions; "
        f"another solution of the same fit is conservative in {tie.conservative} of {tie.seeds} seeds"
    )
    return judged("only the GCO models are conservative (Table I)", holds, why)


def _cell(name: str, column: Column, model: ModelReport) -> Claim:
    known = (model.paper or {})[column.paper]
    words = "mm, 95 %" if column.unit == "mm" else "% at most"
    differs = "another arm and a single draw"
    if name == "MGCO69":
        differs += "; links 1, 4, 5 and 6, which MGCO69 takes for rigid, weigh differently on ours"
    return number(f"{name}: {known:g} {words}", column.value(model), known, differs)


def _redundant(models: Models, paired: Paired) -> Claim:
    columns = models["MLS56"].parameters - middle(models["MLS56"].rank)
    paper = {name: f"{SECTION_5_2[name]['check_p95_mm']:.3f}" for name in ("MLS56", "MLS32")}
    why = (
        f"the {columns:g} redundant columns of MLS56 change no prediction; against readings ours are "
        f"{show(models['MLS56'].check.p95_mm)} and {show(models['MLS32'].check.p95_mm)} mm, the paper's "
        f"{paper['MLS56']} and {paper['MLS32']}"
    )
    test = "the 95 % error without noise of MLS32 is the smaller one"
    return comparison("MLS56 does worse than MLS32", test, paired.mls32_better_than_mls56, paired.seeds, why)


def _linear(bent: ModelReport, straight: ModelReport, paired: Paired) -> Claim:
    return comparison(
        "a linear model is enough (the paper's truth is linear)",
        f"MGCO56's 95 % error without noise grows by at most {100 * CLOSE:g} % with the non-linear truth",
        paired.linear_is_enough,
        paired.seeds,
        f"{show(bent.check_true.p95_mm)} mm then, {show(straight.check_true.p95_mm)} mm with a linear one",
    )
