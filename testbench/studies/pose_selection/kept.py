"""Whether promises hold: what `identify` makes of a plan's runs by default, against what was promised of it.

The true arm is one of the family, the planner's prior is wrong in one of the ways of `wrong_prior.PRIORS`:
in as many trials as there are pairs every truth meets every prior once.
"""

from dataclasses import replace

import numpy as np

from testbench.bench.plan_promise import fitted, half_widths, joints_alone
from testbench.bench.plan_summary import overall
from testbench.bench.rows import MM
from testbench.bench.truths import FAMILY, TRUTHS, member
from testbench.bench.wrong_prior import PRIORS, prior_of
from testbench.data.dataset import Dataset
from testbench.design.forecast import Forecast, widened
from testbench.design.whole_arm import promise_on
from testbench.identify import Estimate
from testbench.identify.evaluate import deflections
from testbench.model.vjm import chain
from testbench.studies.pose_selection.measure import Bench
from testbench.studies.pose_selection.rows import Kept, Row
from testbench.studies.pose_selection.settings import INCUMBENT, WHOLE, Settings
from testbench.studies.pose_selection.ways import Chosen, specify


def prior_in_turn(seed: int) -> str:
    """The prior of a seed: another one each time that a truth comes round."""
    return list(PRIORS)[(seed + seed // len(TRUTHS)) % len(PRIORS)]


def of_promise(bench: Bench, asked: Settings, seed: int, measured: tuple[str, Chosen, Dataset]) -> list[Row]:
    """What was promised of all links and joints with a learnt prior, and of joints alone, and what came.

    `measured` are the name of a plan, its poses, and what was read there.
    """
    (plan, chosen, data), name = measured, prior_in_turn(seed)
    prior = prior_of(bench.cell, name, seed)
    whole = specify(bench.cell, asked, prior, WHOLE)
    rows = []
    for fit, spec in ((WHOLE, whole), (INCUMBENT, joints_alone(whole, prior))):
        after = fitted(spec, prior, chosen.q, chosen.load)
        promise = promise_on(after, whole.tasks.q, whole.tasks.load)
        error, inside = _against(bench, promise, fit.identify(bench.cell.vjm, prior, data))
        kept = Kept(member(FAMILY, seed), name, inside)
        row = Row("promise", plan, len(chosen.q), fit.name, error, ground=asked.scope.ground.name, kept=kept)
        rows.append(replace(row, expected=overall(widened(promise))))
    return rows


def _against(bench: Bench, promise: Forecast, estimate: Estimate) -> tuple[float, float]:
    """RMS error at the tasks [mm], and the share of deflections along an axis inside their half widths."""
    vjm, tasks = bench.cell.vjm, bench.tasks
    off = deflections(vjm, estimate, tasks) - tasks.deflection
    own = (off @ chain(vjm, tasks.q).rotation).reshape(len(off), -1)  # along the tool's axes, as promised
    rms = float(np.sqrt(np.square(off).sum(axis=2).mean()))
    return MM * rms, float((np.abs(own) <= half_widths(promise)).mean())
