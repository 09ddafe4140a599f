"""What the models of a campaign are, in a few words, and which of them tell the story."""

from collections.abc import Sequence

from testbench.report.campaigns import distinct, user_estimators
from testbench.report.table import Row
from testbench.studies.study import DEFAULT_WITHOUT_CONE, IN_PAPER
from testbench.workflows.model_selection import DEFAULT
from testbench.workflows.models import JOINTS

MEANINGS = {
    DEFAULT: "GCO of all, learnt prior: default",
    DEFAULT_WITHOUT_CONE: "the default without its cone",
    JOINTS: "rigid links: the usual model",
    "MGCO56": "GCO of beams, learnt weight",
    f"MGCO56{IN_PAPER}": "GCO of beams, as in the paper",
    "MLS56": "least squares of beams",
}
"""The models that are printed, in this order, and what they are."""
METHODS = {
    "psd": "GCO",
    "none": "least squares",
    "free": "least squares with GCO's prior",
    "own": "an estimator of your own",
}
"""What a model is whose name is none of these, by its constraint."""


def told(rows: Sequence[Row]) -> Sequence[Row]:
    """Select the models that tell the story, and those of the user; all of an arm that names others.

    Args:
        rows: All models.

    Returns:
        Rows with the column `meaning`.
    """
    models = {m.name: m for m in distinct(rows)}
    listed = [name for name in (*MEANINGS, *user_estimators([*models.values()])) if name in models]
    names = listed if len(listed) > 2 else models
    return [Row(models[name], meaning=_meaning(models[name])) for name in names]


def _meaning(model: Row) -> str:
    """Say what a model is: its method and, where its name says nothing, its unknowns."""
    if model.name in MEANINGS:
        return MEANINGS[model.name]
    method = METHODS[model.constraint]
    return method if model.constraint == "own" else f"{method} of {model.parameters} unknowns"
