"""An error that pays only until another one is known is declined in the end."""

from dataclasses import replace

from testbench.bench.absolute_settings import REAL_ARM, AbsoluteCampaign
from testbench.bench.absolute_truth import simulate_series
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
