"""What `testbench identify` says: each sentence where its condition holds, numbers of the right model."""

import re
from dataclasses import replace

import numpy as np
import pytest
import reports

from testbench.commands.identify import READING, printed, report
from testbench.report.badge import decide
from testbench.report.table import Row
from testbench.views.colours import look
from testbench.views.run_figure import overview
from testbench.views.scene import Seen

MODELS = {
    "Joints": ("Joints", "none", False),
    "MLS56": ("MLS56", "none", False),
    "MGCO56": ("MGCO56", "psd", False),
    "ALL153 + prior": ("ALL153", "psd", True),
}
"""Structure, constraint and prior."""
TAKEN = "ALL153 + prior"


def model(k, name):
    structure, constraint, prior = MODELS[name]
    return Row(
        name=name, structure=structure, constraint=constraint, prior=prior, learnt=prior, method="a method",
        status="solved", parameters=10 + k, rank=5 + k, conservative=constraint == "psd", f_m=1.1 + k,
        f_m_floor=0.9 + k, identification=Row(rms_mm=0.1 + k), check=Row(rms_mm=0.2 + k), advice=("seen",),
        aggregated=[], f_m_held_out=2.5 + k, elsewhere=None,
        intervals=Row(half_width_mm=0.3 + k, on_boundary=False, unbounded=0),
    )  # fmt: skip


@pytest.fixture
def f():
    rng = np.random.default_rng(1)
    runs = [
        Row(run=k, which_run=str(k), pose=k, moved_mm=float(rng.uniform(3, 9)), taken_mm=float(rng.uniform()))
        for k in range(40)
    ]
    blocks = [Row(part="link_1", parameters=21, told_percent=37.0, decided_by_prior=4)]
    return Row(
        arm="kr500", dataset="data.csv", runs=12, poses=7, recommended=TAKEN, why="it is the default",
        models=[model(k, name) for k, name in enumerate(MODELS)], noise_p95_mm=0.226, residuals=runs,
        seen=Row(structure="ALL153", unknowns=153, seen=54, prior_uncertainty_percent=30.0, blocks=blocks),
        map=None, no_map="intervals were not asked for", doubts=[], scale=None,
        laws=[],
        failed=[],
        unchecked=Row(stiffer=(), softer=()), notes=["readings are in the base's frame"],
    )  # fmt: skip


def changed(f, name, **changes):
    return Row(f, models=[Row(m, **changes) if name in (m.name, "all") else m for m in f.models])


def test_numbers_stand_in_their_columns_in_a_terminal_and_on_the_page(f):
    said = report(f)
    page = reports.check(said, [])
    row = "| **ALL153 + prior** | 13 | 8 | yes | 3.200 | 5.50 | 3.100 | 4.100 | 3.900 | 3.300 |"
    assert row in page
    assert "| link_1 | 21 | 37 | 4 |" in page
    worst = max(f.residuals, key=lambda own: own.taken_mm)
    assert f"| {worst.run} | {worst.pose} | {worst.moved_mm:.3f} | {worst.taken_mm:.3f} |" in page
    assert f"Worst in run {worst.run}: {worst.taken_mm:.3f} mm are left of {worst.moved_mm:.3f} mm." in page
    assert "The worst 30 of 40 runs" in page
    keys = [column.key for column in printed(said).columns]
    assert "f_m_held_out" in keys
    assert "elsewhere.apart_mm" not in keys
    for gone, headline in (("check", "f_m_held_out"), ("f_m_held_out", "identification.rms_mm")):
        f = changed(f, "all", **{gone: None})
        assert report(f).tables["models"].headline == headline


def test_what_was_not_compared_over_the_workspace_is_not_called_without_a_bound(f):
    known = Row(half_width_mm=0.157, unbounded=0, apart_mm=0.034)
    said = report(changed(f, "MGCO56", elsewhere=known))
    page = said.whole().splitlines()
    ends = {
        name: next(line for line in page if line.startswith(f"| {name} |")) for name in ("MGCO56", "MLS56")
    }
    assert ends["MGCO56"].endswith("| 0.157 | 0.034 |")
    assert ends["MLS56"].endswith("| no bound, or not compared | not compared |")
    bare = report(changed(f, "MLS56", intervals=Row())).whole().splitlines()
    assert "| no bound, or not asked |" in next(line for line in bare if line.startswith("| MLS56 |"))
    headings = {column.heading.split(",")[0].lower() for column in said.tables["models"].columns}
    explained = re.findall(r"\*([^*]+)\*: ", " ".join(READING.values()))
    assert len(explained) == 3
    assert {name.lower() for name in explained} <= headings
    assert all(words in said.whole() for words in READING.values())
    alone = report(changed(f, "all", f_m_held_out=None)).whole()  # a column that is not there needs no words
    assert "F_M held out" not in alone
    assert "*+- (95 %)*: median" in alone


def test_laws_of_the_joints_are_told_where_the_model_has_them(f):
    sizes = Row(part="joint_2", stiffer_percent=16.5, backlash_urad=54.0, friction_urad=21.0)
    page = reports.check(report(Row(f, laws=[sizes])), [])
    assert "## Joints beyond a spring" in page
    assert "| joint_2 | 16.5 | 54 | 21 |" in page
    assert "beyond a spring" not in report(f).whole()


def test_what_was_not_asked_for_is_not_shown(f):
    plain = changed(Row(f), "all", check=None, intervals=Row(), f_m_held_out=None)
    said = report(plain)
    head = [column.key for column in said.tables["models"].columns]
    assert head[-3:] == ["identification.rms_mm", "f_m", "f_m_floor"]
    page = said.whole()
    assert "No pose was held out" in page
    assert "+-" not in said.answer
    assert "held out" not in said.answer
    assert "No map: intervals were not asked for." in page
    assert "No pose was held out" not in report(f).whole()


@pytest.mark.parametrize("name", MODELS)
def test_the_model_that_is_taken_is_named_marked_and_drawn_first_whichever_it_is(f, name):
    said = report(Row(f, recommended=name))
    own = next(m for m in f.models if m.name == name)
    assert said.answer.startswith(f"Take {name}: {own.check.rms_mm:.3f} mm RMS in the runs held out")
    assert f"+- {own.intervals.half_width_mm:.3f} mm (95 %, median)" in said.answer
    assert f"Why {name}: it is the default." in said.claims
    assert [line for line in said.whole().splitlines() if line.startswith(f"| **{name}** |")]
    axes = overview(said, Seen(tables=[said.tables["models"]])).axes[0]
    first, dot = axes.get_yticklabels()[0].get_text(), axes.get_lines()[1]
    assert first.startswith(name)
    assert dot.get_xdata() == pytest.approx([own.check.rms_mm])
    assert dot.get_color() == look(*MODELS[name]).hex


def test_the_answer_is_the_gain_over_least_squares_and_joints_in_the_runs_held_back(f):
    for name, mm in {TAKEN: 0.1, "MLS56": 0.25, "Joints": 0.4, "MGCO56": 0.05}.items():
        f = changed(f, name, check=Row(rms_mm=mm))
    start = (
        "Take ALL153 + prior: 0.100 mm RMS in the runs held out, least squares 0.250 mm; 2.5 times smaller. "
    )
    assert report(f).answer.startswith(
        f"{start}Joint stiffness only 0.400 mm, 4.0 times larger; a deflection "
    )


def test_without_runs_held_out_the_answer_says_how_sure_it_is_in_the_runs_and_elsewhere(f):
    spread = Row(f.models[-1].intervals, half_width_mm=0.024)
    known = Row(half_width_mm=0.085, unbounded=0, apart_mm=None)
    answer = report(changed(f, TAKEN, check=None, intervals=spread, elsewhere=known)).answer
    assert "gives a deflection in these runs to +- 0.024 mm (95 %, median) along an axis" in answer
    assert answer.endswith(", over the workspace +- 0.085 mm.")
    assert "predict" not in answer


def test_what_the_badge_warns_of_is_not_recommended(f):
    """Joints alone or least squares may be the better ones in runs held out, and the default still stays."""
    for error, words in ((1.0, "Take"), (0.3, "Chosen, though beaten where runs are held out, is")):
        badge = decide((TAKEN, [0.5] * 8), ("MLS56", [error] * 8), "group of fitted runs held out in turn")
        assert report(Row(f, badge=badge)).answer.startswith(f"{words} {TAKEN}")


def test_doubts_about_the_runs_stand_before_the_answer_and_are_said_first(f):
    frame, prior = ({"name": n, "sentence": s} for n, s in (("frame", "another frame?"), ("prior", "softer")))
    assert report(Row(f, doubts=[prior])).answer.startswith("Take ")
    said = report(Row(f, doubts=[prior, frame]))
    assert said.answer.startswith("First look at the runs, see the doubt below; if they are right, take ")
    assert "least squares" not in said.answer
    assert said.claims[:2] == ["Doubt: another frame?", "Doubt: softer."]


def test_each_sentence_is_said_where_it_holds_and_nowhere_else(f):
    spread = Row(f.models[-1].intervals)
    unseen = Row(f, unchecked=Row(stiffer=("link_1",), softer=("joint_1", "joint_2")))
    no_prior = changed(Row(f, recommended="MGCO56"), "MGCO56")
    cases = {
        "not reveal a part ten times stiffer than in the folder: link_1. The intervals assume": unseen,
        "not reveal a part ten times softer than in the folder: joint_1 and joint_2.": unseen,
        "Not certified: MLS56 (stalled).": changed(f, "MLS56", status="stalled"),
        "The intervals of ALL153 + prior are not exact": changed(
            f, TAKEN, intervals=Row(spread, on_boundary=True)
        ),
        "The intervals count noise alone": no_prior,
        "The deflections are 1.25 times those that the arm's folder predicts": Row(f, scale=1.25),
        "Aggregated in ALL153 + prior: the compliance of joint_2 counts": changed(
            f, TAKEN, aggregated=["joint_2"]
        ),
    }
    plain = report(f).whole()
    for words, own in cases.items():
        assert words in report(own).whole()
        assert words not in plain
    learnt = changed(unseen, TAKEN, learnt=False)
    assert "The intervals assume" not in report(learnt).whole()
    assert plain.count("Seen.") == plain.count("Readings are in the base's frame.") == 1


def test_a_report_with_another_models_numbers_would_be_seen(f):
    """The marked row is the taken model's own."""
    said = report(f)
    other = replace(said.tables["models"], bold="MLS56")
    assert reports.check(said, []) != replace(said, tables={**said.tables, "models": other}).whole()
