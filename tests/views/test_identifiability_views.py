"""What people see of identifiability: numbers, words, table and figure say what was found."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_words
from rich.console import Console

from testbench.bench.campaign import Scenario, simulate
from testbench.identify.identifiability import describe
from testbench.identify.prior import Strength, cad_prior
from testbench.model.structure import mgco68
from testbench.views import terminal
from testbench.views.identifiability.figure import PRIOR_ALPHA, shares
from testbench.views.identifiability.report import seen_report, table
from testbench.views.identifiability.words import DECIDED, words


@pytest.fixture(scope="module")
def found(kr500):
    scenario = Scenario(arm="kr500_l480", truth="linear", workspace_poses=1)
    data = simulate(kr500, scenario, 1).identification
    return describe(kr500.vjm, mgco68(kr500.arm), data, cad_prior(kr500.arm), Strength(0.3))


def test_directions_seen_and_lost_add_up_and_each_lost_one_has_its_words(found):
    seen = seen_report(found)
    assert seen.seen + seen.lost_to_structure + seen.lost_to_loads + seen.lost_to_poses == seen.unknowns == 68
    assert len(seen.unseen.structure) == seen.lost_to_structure
    assert len(seen.unseen.loads) == seen.lost_to_loads
    assert all(
        lost.text.startswith(tuple(lost.parameters)) or lost.others_a_little for lost in seen.unseen.loads
    )


def test_the_prior_decides_where_the_data_add_little(found):
    seen = seen_report(found)
    for p, share in zip(seen.parameters, found.share, strict=True):
        assert p.data_share == share
        assert (p.decided_by == "prior") == (share < DECIDED)
    assert {p.decided_by for p in seen.parameters} == {"prior", "data and prior"}
    for block in seen.blocks:
        own = [p for p in seen.parameters if p.component == block.component]
        assert block.data_share == pytest.approx(np.mean([p.data_share for p in own]), rel=1e-12)
        assert block.decided_by_prior == sum(p.decided_by == "prior" for p in own)


def test_sentences_carry_the_numbers_of_the_report(found):
    seen = seen_report(found)
    text = "\n".join(seen.sentences)
    assert f"{seen.unknowns} unknowns; the data ({seen.poses} poses, at most 48" in text
    assert f"see {seen.seen} directions of them.\n" in text
    assert f"Not seen are {seen.lost_to_structure} that no experiment sees" in text
    assert f"{seen.lost_to_poses} lost to too few poses" in text
    assert f"about {seen.expected_error_mm:.3f} mm off" in text
    assert f"Markers move {seen.expected_deflection_mm:.3f} mm" in text
    assert f"under {100 * DECIDED:g} %" in text
    assert all(len(s.split()) <= 60 and s == s.strip() for s in seen.sentences)


def test_the_best_proposal_is_named_whichever_it_is(found):
    for best in found.proposals:
        others = [replace(p, place=2) for p in found.proposals if p is not best]
        made_up = replace(found, proposals=(replace(best, place=1), *others))
        [line] = [s for s in seen_report(made_up).sentences if s.startswith("What would help most")]
        assert line.startswith(f"What would help most: {best.words}; ")
        assert f"error {1e3 * best.error:.3f} mm" in line


def test_the_answer_is_what_would_help_most_and_by_how_much(found):
    said = words(found, "kr500_l480")
    check_words(said)
    best = found.proposals[0]
    answer = said.block("answer")
    assert (
        f"be about {1e3 * found.error:.3f} mm off by these runs, of {1e3 * found.deflection:.3f} mm" in answer
    )
    assert (
        f"most: {best.words}, {1e3 * best.error:.3f} mm, {found.error / best.error:.1f} times less." in answer
    )
    blocks = seen_report(found).blocks
    least = min(blocks, key=lambda block: block.data_share)
    told = f"Least is told of {least.component}: data give {100 * least.data_share:.0f} % of what"
    assert said.block("worst").startswith(told)
    assert f" {sum(block.decided_by_prior for block in blocks)} of the 68 unknowns" in said.block(
        "statements"
    )


def test_runs_that_fix_no_scale_bound_nothing(found):
    said = words(replace(found, error=np.inf))
    assert said.block("answer") == "These runs bound no prediction of MGCO68: nothing fixes the scale."


def test_the_table_is_the_report_and_fits_80_columns(found):
    seen = seen_report(found)
    console = Console(width=80, record=True, quiet=True)
    assert console.measure(terminal.grid(table(seen))).maximum <= 80
    cells = [[column.cell(row) for column in table(seen).columns] for row in table(seen).rows]
    assert cells[0] == ["-", "nothing", str(found.rank), f"{1e3 * found.error:.3f}"]
    assert cells[1:] == [
        [str(p.place), p.words, str(p.rank), f"{1e3 * p.error:.3f}"] for p in found.proposals
    ]


def test_the_figure_fills_each_cell_by_the_share_of_the_data(found):
    seen = seen_report(found)
    [axes] = shares(seen).axes
    back = [p for p in axes.patches if p.get_alpha() == PRIOR_ALPHA]
    front = [p for p in axes.patches if p.get_alpha() is None]
    assert len(back) == len(front) == 68
    area = [
        a.get_width() * a.get_height() / (b.get_width() * b.get_height())
        for a, b in zip(front, back, strict=True)
    ]
    order = [p.data_share for block in seen.blocks for p in seen.parameters if p.component == block.component]
    np.testing.assert_allclose(area, order, atol=1e-12)


def _area(patch):
    return patch.get_width() * patch.get_height()
