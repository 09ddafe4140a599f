"""The ladder on every split of the readings: gathered once a split, explained by every model."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from testbench.bench.rows import UM
from testbench.errors import Array
from testbench.identify.absolute.fit import Calibration, Options, explain, gather
from testbench.identify.prior import cad_prior
from testbench.studies.real_ur10.ladder import CHOSEN, ERRORS, GEOMETRY, LADDER, LINKS, SPRINGS, TWO, Model
from testbench.studies.real_ur10.readings import Judged, read, split
from testbench.studies.real_ur10.trial import LadderRow, Settings, judge, left, placed
from testbench.studies.study import Everywhere

SHOWN = "blocks"  #: Split whose errors are drawn, by both models of `TWO`.
AGAIN = ("blocks, realigned",)
"""Splits that train as those whose names theirs begin with, and judge in another way."""


def prepare(asked: Settings, everywhere: Everywhere) -> Settings:
    """The settings with the ladder, which no draw changes."""
    found = everywhere(partial(pieces, asked), len(asked.splits), LadderRow, "splits")
    return replace(asked, ladder=tuple(found))


def pieces(asked: Settings, places: Sequence[int]) -> list[list[LadderRow]]:
    """Rows of some splits."""
    return [list(_rows(asked, asked.splits[place])) for place in places]


def models_of(asked: Settings, name: str) -> list[Model]:
    """Models that are tried on a split: of the one that judges nothing, those that are looked into.

    Choosing is dear: from one series to the other it is left out.
    """
    every = [one for one in LADDER if one.name in asked.models]
    if name == "both":
        return [one for one in every if one in (*TWO, CHOSEN)]
    return [one for one in every if name == SHOWN or one is not CHOSEN]


def _rows(asked: Settings, name: str) -> Iterator[LadderRow]:
    readings = read(asked.thin)
    tried, own, vjm = models_of(asked, name), split(name, readings.series), readings.cell.vjm
    others = [split(other, readings.series) for other in AGAIN if other.startswith(name)]
    options = Options() if CHOSEN in tried else Options(only=frozenset({SPRINGS, ERRORS, LINKS}))
    found = gather(vjm, own.train, cad_prior(vjm.arm), replace(options, orders=asked.orders))
    poses = sum(one.rows for one in own.train)
    for model in tried:
        calibration = explain(found, model.options)
        about = _about(calibration, model, name, poses)
        yield about
        for one in [own, *(others if model in (GEOMETRY, *TWO) else ())]:
            for judged in one.judged:
                yield _judged(calibration, replace(about, split=one.name), judged)


def _judged(found: Calibration, about: LadderRow, judged: Judged) -> LadderRow:
    at = placed(found, judged)
    off = left(at, judged)
    drawn = about.split == SHOWN and about.name in [model.name for model in TWO]
    return replace(
        about,
        judged=judged.series.name,
        error=judge(found, at, judged, off),
        left_um=_left(off) if drawn else (),
    )


def _left(error: Array) -> tuple[float, ...]:
    return tuple(np.round(UM * error, 2).ravel().tolist())


def _about(found: Calibration, model: Model, name: str, poses: int) -> LadderRow:
    estimate, own, steps = found.estimate, found.own, found.chosen.steps
    K, n = 2 * len(found.state.errors.orders), found.state.vjm.arm.n_joints
    certificate = None if estimate is None else estimate.certificate
    return LadderRow(
        split=name,
        name=model.name,
        judged=None,
        error=None,
        left_um=(),
        poses=poses,
        method=None if estimate is None else estimate.method,
        parameters=int((own.columns >= own.unknowns.starts["geometry"]).sum()),
        conservative=estimate is None or bool(estimate.conservative),
        min_eigenvalue=0.0 if estimate is None else float(estimate.min_eigenvalue),
        duality_gap=None if certificate is None else float(certificate.duality_gap),
        joints=tuple(np.diag(found.state.C_theta)[-n:].tolist()),
        waves=tuple(found.state.n[:, :K].ravel().tolist()) if "harmonics" in found.chosen.kinds else (),
        kept=tuple(step.name for step in steps if step.kept),
        declined=tuple(step.name for step in steps if not step.kept),
    )
