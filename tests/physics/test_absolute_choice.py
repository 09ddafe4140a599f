"""An error that pays only until another one is known is declined in the end."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.campaign.absolute_truth import REAL_ARM, AbsoluteCampaign, simulate_series
from testbench.data.series import select_rows
from testbench.identify.absolute import choose
from testbench.identify.absolute.evidence import LOOSE, Learnt, solve
from testbench.identify.absolute.fit import Options, calibrate
from testbench.identify.prior import cad_prior
from testbench.plant import build_plant


def test_joint_errors_that_stand_in_for_soft_links_are_declined_once_links_are_known(kr500):
    """Without joint errors in the truth: of four such arms one where they pay beside rigid links."""
    soft = tuple(replace(link, compliance=6 * link.compliance) for link in kr500.arm.links)
    cell = replace(kr500, truth=build_plant(replace(kr500.arm, links=soft)))
    asked = AbsoluteCampaign(poses=60, disturbances=replace(REAL_ARM, gear=None))
    series, _ = simulate_series(cell, asked, 4)
    prior = cad_prior(kr500.arm)
    rigid = calibrate(kr500.vjm, series, prior, Options(orders=8, without=frozenset({"links"})))
    found = calibrate(kr500.vjm, series, prior, Options(orders=8))
    assert {"joint springs", "joint errors"} <= {step.name for step in rigid.chosen.steps if step.kept}
    steps = {step.name: step.kept for step in found.chosen.steps}
    assert (steps["joint errors"], steps["links"]) == (False, True)
    assert not found.state.n.any()


def near(series, rows):
    """Those rows of a series that are nearest to its first in joint space."""
    far = np.linalg.norm(series.q - series.q[0], axis=1)
    return select_rows(series, np.sort(np.argsort(far)[:rows]))


def test_a_series_is_foretold_only_by_a_fair_share_of_the_readings(kr500, monkeypatch):
    """What 12 readings in one corner tell of an arm must not decide which errors it has."""
    (long, short), _ = simulate_series(kr500, AbsoluteCampaign(series=2, poses=100), 21)
    held, left = [], choose._held_out
    monkeypatch.setattr(
        choose, "_held_out", lambda own, S, parts, *more: held.append(parts) or left(own, S, parts, *more)
    )
    for some, series in (((long, short), {0, 1}), ((long, near(short, 12)), {1})):
        held.clear()
        found = calibrate(kr500.vjm, some, cad_prior(kr500.arm), Options(orders=2))
        assert {parts[0].series for parts in held if len(parts) > 1} == series
        assert max(step.after for step in found.chosen.steps) < 1e-3


def test_a_block_whose_frame_the_others_hardly_tell_is_fitted_to_it(rng):
    """Two columns, the first told by the block alone but for a trace: left is what no frame explains."""
    block, others = rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    others[:, 0] *= 1e-4
    T = block.T @ block
    S = T + others.T @ others
    own = SimpleNamespace(columns=np.arange(2), rigid=2, elastic=None)
    part = SimpleNamespace(gram=T[None], counts=np.array([30]))
    learnt = Learnt(np.array([np.inf, 1.0]), np.ones(1))
    own.unknowns = SimpleNamespace(size=2)
    whole = solve(own, S[None], learnt, LOOSE).variances(np.arange(1))
    [left] = choose._held_out(own, S[None], [part], learnt, whole)
    [_, second] = solve(own, (S - T)[None], learnt, LOOSE).x
    rest = block[:, 2] - block[:, 1] * second
    first = block[:, :1]
    assert left == pytest.approx(np.sum((rest - first @ np.linalg.lstsq(first, rest, rcond=None)[0]) ** 2))
