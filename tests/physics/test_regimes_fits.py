"""What the study of regimes sets apart: the cone's own work, free directions, what noise may do."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.campaign import Scenario, draw_poses, simulate_at, stream
from testbench.identify import reduce
from testbench.identify.evaluate import deflections
from testbench.identify.least_squares import completed
from testbench.identify.solve import solve
from testbench.model.structure import all153, mgco68, template56
from testbench.studies.factorial.trial import reread
from testbench.studies.regimes import fits
from testbench.studies.regimes.trial import Clean, Grid, expected

SEEDS = (11, 12, 13)


def hung(cell, seed, poses):
    """True deflections under a weight, linear, the structure's tubes: the model can be exact."""
    scenario = Scenario(
        arm=cell.arm.name, noise=False, truth="linear", identification_poses=poses,
        identification_runs=poses, workspace_poses=60,
    )  # fmt: skip
    campaign = simulate_at(cell, scenario, seed, draw_poses(cell, scenario, seed))
    return Clean(campaign.identification, campaign.truth, seed)


def noisy(clean, sigma):
    return reread(clean.runs, sigma, stream(clean.seed, 1))


def rows_of(regression):
    """Rows and readings as least squares weighs them."""
    weights = [np.sqrt(term.equations) for term in regression.terms]
    A = np.vstack([w * term.R for w, term in zip(weights, regression.terms, strict=True)])
    return A, np.concatenate([w * term.z for w, term in zip(weights, regression.terms, strict=True)])


def test_the_fit_of_least_squares_is_kept_and_the_free_directions_are_those_of_gco(kr500):
    structure = all153(kr500.arm)
    clean = hung(kr500, SEEDS[0], 8)
    found = fits.without_prior([reduce(kr500.vjm, structure, noisy(clean, 50e-6))])
    [ls], [gco], [lent] = found.ls, found.gco, found.lent
    A, _ = rows_of(ls.regression)
    assert ls.regression.rank < structure.n
    np.testing.assert_allclose(A @ lent.pi, A @ ls.pi, atol=1e-9 * np.abs(A @ ls.pi).max())
    # here a conservative model fits as well: GCO has the fit of least squares, and the rest from `lent`
    assert not found.binds[0]
    moved = [deflections(kr500.vjm, own, clean.judge) for own in (ls, gco, lent)]
    size = np.abs(moved[1]).max()
    assert np.abs(moved[2] - moved[1]).max() < 1e-3 * size
    assert np.abs(moved[0] - moved[1]).max() > 0.1 * size


def test_where_no_equal_fit_is_sought_there_is_none(kr500):
    ls, taken = [], []
    for structure, poses in ((mgco68(kr500.arm), (8, 12)), (all153(kr500.arm), (4, 12, 20))):
        clean = [hung(kr500, seed, count) for seed in SEEDS for count in poses]
        found = fits.without_prior([reduce(kr500.vjm, structure, noisy(own, 50e-6)) for own in clean])
        ls += found.ls
        taken += map(fits.added, found.ls, found.gco)
    skipped = [own for own, share in zip(ls, taken, strict=True) if share > fits.TAKEN]
    assert 3 < len(skipped) < len(ls) - 3
    assert not any(completed(own.regression).conservative for own in skipped)


def test_the_error_to_expect_is_what_noise_does_to_least_squares(kr500):
    structure, sigma = template56(kr500.arm), 50e-6
    clean = hung(kr500, SEEDS[0], 12)
    exact = reduce(kr500.vjm, structure, replace(clean.runs, sigma=sigma))
    [size] = expected(kr500.vjm, clean, Grid(kr500.arm.name, (12,), (sigma,)), [exact])
    rng, draws = stream(SEEDS[0], 1), 300
    seen = [reduce(kr500.vjm, structure, reread(clean.runs, sigma, rng)) for _ in range(draws)]
    found = [solve(regression, "none") for regression in (exact, *seen)]
    moved = np.array([deflections(kr500.vjm, own, clean.judge) for own in found])
    error = 1e6 * np.sqrt(np.square(moved[1:] - moved[0]).sum(axis=3).mean())
    assert error == pytest.approx(size, rel=0.2)  # of one direction 300 draws tell it to 4 %
