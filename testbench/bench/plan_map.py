"""The error to expect all over the workspace after a plan was measured: by its model, and by others."""

import numpy as np

from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Cell
from testbench.bench.default import FILLED
from testbench.bench.error_places import ErrorPlaces, Meaning, bounded_mm, error_places, places_at
from testbench.bench.models import named_models, own_name
from testbench.bench.plan_promise import fitted, least_squares
from testbench.design.forecast import Forecast
from testbench.design.planning import Plan
from testbench.design.rows import deflection_rows
from testbench.design.whole_arm import promise_on
from testbench.identify.prior import cad_prior
from testbench.model.vjm import tool_pose

EXPECTED = Meaning(
    "expected error",
    "of the predicted deflection, RMS over the markers and over arms of which every link and joint gives",
    "RMS",
)
OTHERS = ("MLS56", JOINTS)  #: Kinds of models that stand beside: least squares of links, and joints alone.


def plan_map(cell: Cell, plan: Plan, own: Forecast) -> ErrorPlaces:
    """Errors under the first load; GCO without a prior is no linear fit, so nobody foretells it.

    Args:
        cell: The arm.
        plan: What is measured.
        own: Errors over the workspace by the planned model.
    """
    spec, prior = plan.specification, cad_prior(cell.arm)
    q, load = spec.workspace, spec.loads[0]
    planned = spec.experiment.metric.structure
    name = planned.name + (FILLED if spec.uncertainty is not None else "")
    found = {}
    for kind in OTHERS:
        other = own_name(cell, kind)
        if other is None or other == name:
            continue
        [model] = named_models(cell, [other])
        fit = fitted(least_squares(spec, prior, model.structure), prior, plan.q, plan.load)
        found[other] = bounded_mm(promise_on(fit, q, load).error)
    found[name] = bounded_mm(own.error)
    moved = deflection_rows(spec.experiment, q, load) @ spec.experiment.metric.expected
    size = np.sqrt(np.square(moved).sum(axis=1) / (moved.shape[1] / 3))
    at = places_at(cell.arm, q, tool_pose(cell.vjm, q)[0], size)
    return error_places(at, found, list(found), EXPECTED)
