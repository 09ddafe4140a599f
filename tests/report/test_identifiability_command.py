"""What people see of identifiability: numbers, words, table and figure say what was found."""

from dataclasses import replace

import numpy as np
import pytest
from reports import check

from testbench.campaign.campaign import Scenario, simulate
from testbench.campaign.identifiability import describe
from testbench.commands.identifiability import DECIDED, report, seen
from testbench.identify.prior import Strength, cad_prior
from testbench.model.structure import mgco68


@pytest.fixture(scope="module")
def found(kr500):
    scenario = Scenario(arm="kr500_l480", truth="linear", workspace_poses=1)
    data = simulate(kr500, scenario, 1).identification
    return describe(kr500.vjm, mgco68(kr500.arm), data, cad_prior(kr500.arm), Strength(0.3))


def test_numbers_and_words_are_what_was_found(found):
    said = report(found, "kr500_l480")
    check(said, ["help"])
    f, text = said.numbers, "\n".join(said.claims)
    assert f["seen"] + f["lost_to_structure"] + f["lost_to_loads"] + f["lost_to_poses"] == f["unknowns"] == 68
    for block in f["blocks"]:
        own = [share for part, share in zip(found.component, found.share, strict=True) if part == block.part]
        assert block.data_share_percent == pytest.approx(100 * np.mean(own), rel=1e-12)
        assert block.prior_decides == sum(share < DECIDED for share in own)
    assert f"68 unknowns; the data ({found.poses} poses, at most 48 independent equations) see" in text
    assert f"Not seen are {f['lost_to_structure']} that no experiment sees" in text
    assert f"{f['lost_to_poses']} lost to too few poses" in text
    assert f"The prior decides {sum(found.share < DECIDED)} of the 68 unknowns: data add under 5 %." in text
    least = min(f["blocks"], key=lambda block: block.data_share_percent)
    told = f"Least is told of {least.part}: data give {least.data_share_percent:.0f} % of what"
    assert said.worst.startswith(told)


def test_the_answer_is_what_would_help_most_and_by_how_much_whichever_it_is(found):
    for best in found.proposals:
        others = [replace(p, place=2) for p in found.proposals if p is not best]
        said = report(replace(found, proposals=(replace(best, place=1), *others))).answer
        off = f"be about {1e3 * found.error:.3f} mm off by these runs, of {1e3 * found.deflection:.3f} mm"
        assert off in said
        assert f"What would help most: {best.words}, {1e3 * best.error:.3f} mm, " in said
    said = report(replace(found, error=np.inf))
    assert said.answer == "These runs bound no prediction of MGCO68: nothing fixes the scale."


def test_the_table_is_what_was_found(found):
    table = report(found).tables["help"]
    cells = [[column.cell(row) for column in table.columns] for row in table.rows]
    assert cells[0] == ["-", "nothing", str(found.rank), f"{1e3 * found.error:.3f}"]
    assert cells[1:] == [
        [str(p.place), p.words, str(p.rank), f"{1e3 * p.error:.3f}"] for p in found.proposals
    ]


def test_the_figure_draws_the_share_of_the_data_and_what_the_prior_decides(found):
    said = report(found)
    [chart] = seen(said).runs
    data, prior = (line.values.tolist() for line in chart.lines)
    blocks = said.numbers["blocks"]
    assert data == [block.data_share_percent for block in blocks]
    assert prior == [100 * block.prior_decides / block.parameters for block in blocks]
    assert chart.labels == [block.part for block in blocks]
