"""The default on true arms with all disturbances, kind by kind: errors, rivals, coverage, share removed."""

from collections.abc import Iterator, Sequence
from math import ceil

import numpy as np

from testbench.campaign.model_selection import DEFAULT, FILLED
from testbench.campaign.models import JOINTS
from testbench.campaign.true_arms import CALLED, HELD_OUT, HELD_OUT_WORDS
from testbench.report.columns import columns
from testbench.report.report import say
from testbench.report.table import TRIAL, Row, Trials, aligned, find, number
from testbench.studies.factorial.compare import ERROR
from testbench.studies.model_error.settings import ALL, NONE, STIFF
from testbench.studies.model_error.trial import BESIDE_IT, IN_FAMILY
from testbench.trials.spread import middle, wins
from testbench.views.markdown import Markdown, counted, listed
from testbench.views.schema import Table

RIVALS = {f"{JOINTS}_um": JOINTS, "same_prior_um": f"MLS56{FILLED}"}
EVERY, CALM = "the family", "undisturbed family"
SHOWN = "kind default_um Joints_um same_prior_um covered_percent worst_tenth_percent"
BEHIND = "beats_joints beats_same_prior removed_percent trials"
NAMED = 2  #: Kinds in a sentence.
HOW = Markdown(
    "Covered: share of the true components of deflection inside their 95 % intervals; worst tenth: the same "
    "in the tenth of arms that are covered worst. Removed: of the deflection, by the default. Kinds held out "
    "of the family:\n\n" + "\n".join(f"- {CALLED[name]}: {what}" for name, what in HELD_OUT_WORDS.items())
)


def kinds(trials: Trials, sigma_um: float) -> list[Row]:
    """A row for the whole family, each kind held out, other sizes, each kind of the family, and other cases.

    Args:
        trials: Of all parts.
        sigma_um: The noise at which models are compared.
    """
    noisy = trials.where(sigma_um=sigma_um)
    family = noisy.where(part=IN_FAMILY, case=ALL)
    beside = noisy.where(part=BESIDE_IT)
    met = set(beside.values("true_arm"))
    parts = {EVERY: family}
    parts |= {CALLED[arm]: beside.where(true_arm=arm) for arm in HELD_OUT if arm in met}
    other = beside.pick(beside["size"] != 1)
    parts |= {f"disturbances times {size:g}": other.where(size=size) for size in other.values("size")}
    own = family.values("true_arm")
    parts |= {CALLED[arm]: family.where(true_arm=arm) for arm in own if len(own) > 1}
    parts[CALM] = noisy.where(part=IN_FAMILY, case=NONE)
    parts[f"{STIFF} alone"] = noisy.where(part=IN_FAMILY, case=STIFF)
    return [_row(kind, part) for kind, part in parts.items() if len(part)]


def _row(kind: str, part: Trials) -> Row:
    """What the default does on arms of one kind, beside its rivals on the same ones."""
    default = part.where(name=DEFAULT)
    errors = dict(
        zip(("default_um", *RIVALS), aligned(part, (DEFAULT, *RIVALS.values()), ERROR).T, strict=True)
    )
    covered, n = default["cover.covered_percent"], len(default.values(TRIAL))
    return Row(
        {key: number(own) for key, own in errors.items()},
        kind=kind,
        trials=n,
        beats_joints=wins(errors["default_um"], errors[f"{JOINTS}_um"]) / n,
        beats_same_prior=wins(errors["default_um"], errors["same_prior_um"]) / n,
        covered_percent=float(covered.mean()),  # every arm has as many components
        worst_tenth_percent=float(np.sort(covered)[: ceil(len(covered) / 10)].mean()),
        removed_percent=number(100 * (1 - default[ERROR] / default["deflection_um"])),
    )


def claims(rows: Sequence[Row]) -> Iterator[Markdown]:
    """How often intervals hold, and where the default loses."""
    own = find(rows, kind=EVERY)
    out = [row for row in rows if row.kind in {CALLED[arm] for arm in HELD_OUT}]
    yield say(
        f"95 % intervals of {DEFAULT} cover "
        "{covered_percent:.1f} % of the disturbed family's deflections, "
        "{worst_tenth_percent:.0f} % in the worst tenth of arms."
        + (" Of kinds held out, least: {least.kind}, {least.covered_percent:.0f} %." if out else ""),
        own,
        least=min(out, key=lambda row: row.covered_percent) if out else None,
    )
    yield say(
        f"{DEFAULT} beats joint stiffness only on "
        "{beats_joints:share {trials}} of {trials} arms of the family, LS with the same prior on "
        "{beats_same_prior:share {trials}}. In the median it loses to joint stiffness "
        "only on {joints}. It loses to LS with the same prior on {same}.",
        own,
        joints=_lost(rows, f"{JOINTS}_um"),
        same=_lost(rows, "same_prior_um"),
    )


def _lost(rows: Sequence[Row], key: str) -> str:
    """Kinds on which the median of a rival is less than the default's, the worst first."""
    over = {row.kind: middle(row.default_um) / middle(row[key]) for row in rows}
    found = sorted((kind for kind in over if over[kind] > 1), key=lambda kind: -over[kind])
    more = [counted(len(found) - NAMED, "other kind")] if len(found) > NAMED else []
    return listed([*found[:NAMED], *more]) if found else "no kind"


def table(rows: Sequence[Row], sigma_um: float) -> Table:
    """What a page shows first."""
    title = f"All disturbances unless told, noise of {sigma_um:g} um: median RMS errors"
    return Table(columns(f"{SHOWN} {BEHIND}"), rows, title, headline="default_um")
