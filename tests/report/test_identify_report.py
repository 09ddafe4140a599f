"""The report of `testbench identify`: numbers in their tables, a headline, warnings if they hold."""

import numpy as np
import pytest
import reports

from testbench.cli.identify import MODELS as COLUMNS
from testbench.cli.identify import PAGE, report, table_of
from testbench.report.badge import decide
from testbench.report.colours import look
from testbench.report.figure import row_head
from testbench.report.run_figure import overview
from testbench.report.scene import PageContent
from testbench.report.table import Row
from testbench.workflows.model_names import first_mention

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


def test_numbers_stand_in_their_columns(f):
    said = report(f)
    page = reports.check(said, [])
    row = "| **ALL153 + prior** | 13 | 8 | yes | 3.200 | 5.50 | 3.100 | 4.100 | 3.900 | 3.300 |"
    assert row in page
    assert "| link_1 | 21 | 37 | 4 |" in page
    worst = max(f.residuals, key=lambda own: own.taken_mm)
    assert f"| {worst.run} | {worst.pose} | {worst.moved_mm:.3f} | {worst.taken_mm:.3f} |" in page
    assert len(said.tables["runs"].rows) == 30
    values = {row.quantity: row.value for row in said.tables["fit"].rows}
    assert (
        values["unknowns of ALL153"],
        values["rank: directions of the unknowns that the runs determine"],
    ) == (
        153,
        54,
    )
    keys = [column.key for column in table_of(f, COLUMNS[:-PAGE]).columns]
    assert "f_m_held_out" in keys
    assert "elsewhere.apart_mm" not in keys
    for gone, headline in (("check", "f_m_held_out"), ("f_m_held_out", "identification.rms_mm")):
        f = changed(f, "all", **{gone: None})
        assert report(f).tables["models"].headline == headline


def test_what_was_not_compared_over_the_workspace_is_not_called_without_a_bound(f):
    known = Row(half_width_mm=0.157, unbounded=0, apart_mm=0.034)
    page = report(changed(f, "MGCO56", elsewhere=known)).whole().splitlines()
    ends = {
        name: next(line for line in page if line.startswith(f"| {name} |")) for name in ("MGCO56", "MLS56")
    }
    assert ends["MGCO56"].endswith("| 0.157 | 0.034 |")
    assert ends["MLS56"].endswith("| no interval | not compared |")
    bare = report(changed(f, "MLS56", intervals=Row())).whole().splitlines()
    assert "| no interval |" in next(line for line in bare if line.startswith("| MLS56 |"))


@pytest.mark.parametrize(
    ("parts", "shown"),
    [
        (
            {"laws": [Row(part="joint_2", stiffer_percent=16.5, backlash_urad=54.0, friction_urad=21.0)]},
            ["| joint_2 | 16.5 | 54 | 21 |"],
        ),
        (
            {
                "identifiability": Row(
                    help=[Row(place=1, measure="half the load", rank=7, expected_error_mm=0.25)],
                    unseen=[Row(why="loads", parts="joint_1", directions=1, parameters="joint_1")],
                    expected_error_mm=0.5,
                    expected_deflection_mm=3,
                    equations=42,
                )
            },
            ["| 1 | half the load | 7 | 0.250 |", "| loads | joint_1 | 1 | joint_1 |"],
        ),
    ],
    ids=["laws of joints", "what the runs do not show, and what would help"],
)
def test_tables_of_what_is_known_of_some_runs_are_there_for_these_alone(f, parts, shown):
    page, plain = reports.check(report(Row(f, **parts)), []), report(f).whole()
    assert all(row in page and row not in plain for row in shown)


def test_what_was_not_asked_for_is_not_shown(f):
    said = report(changed(Row(f), "all", check=None, intervals=Row(), f_m_held_out=None))
    head = [column.key for column in said.tables["models"].columns]
    assert head[-3:] == ["identification.rms_mm", "f_m", "f_m_floor"]
    assert [any("--check-pose" in own for own in each.claims) for each in (said, report(f))] == [True, False]
    assert "fitted runs" in said.answer


def test_only_our_methods_need_a_certificate(f):
    for constraint, told in (("psd", ["Not certified: MGCO56 (not certified)."]), ("own", [])):
        claims = report(changed(f, "MGCO56", constraint=constraint, status="not certified")).claims
        assert [own for own in claims if "ertified" in own] == told


def test_what_the_reason_says_is_not_said_again(f):
    reason = "it is the default; link compliances hardly improve the model"
    said = report(Row(changed(f, TAKEN, advice=("link compliances hardly improve the model",)), why=reason))
    assert said.whole().count("ink compliances hardly improve") == 1


@pytest.mark.parametrize("name", MODELS)
def test_the_model_that_is_taken_is_named_marked_and_drawn_first_whichever_it_is(f, name):
    said = report(Row(f, recommended=name))
    own = next(m for m in f.models if m.name == name)
    half = f"The median 95 % interval of a deflection is ± {own.intervals.half_width_mm:.3f} mm"
    error = f"its RMS error in the held-out runs is {own.check.rms_mm:.3f} mm"
    assert said.answer == f"Use {first_mention(name)}: {error}. {half}."
    assert [line for line in said.whole().splitlines() if line.startswith(f"| **{name}** |")]
    axes = overview(said, PageContent(tables=[said.tables["models"]])).axes[0]
    first, dot = axes.get_yticklabels()[0].get_text(), axes.get_lines()[1]
    assert first.startswith(row_head(name))
    assert dot.get_xdata() == pytest.approx([own.check.rms_mm])
    assert dot.get_color() == look(*MODELS[name]).hex


def test_what_the_badge_warns_of_is_not_recommended(f):
    """Joints alone or least squares may be the better ones in runs held out, and the default still stays."""
    for error, words in ((1.0, "Use"), (0.3, "Although another model predicts held-out runs better, use")):
        badge = decide((TAKEN, [0.5] * 8), ("MLS56", [error] * 8), "group of fitted runs held out in turn")
        assert report(Row(f, badge=badge)).answer.startswith(f"{words} {first_mention(TAKEN)}")


def test_doubts_about_the_runs_are_in_the_headline_and_said_first(f):
    frame, prior = ({"name": n, "sentence": s} for n, s in (("frame", "another frame?"), ("prior", "softer")))
    assert report(Row(f, doubts=[prior])).answer.startswith("Use ")
    said = report(Row(f, doubts=[prior, frame]))
    assert said.answer.startswith("If the runs are right (see the warning), use ")
    assert said.claims[:2] == ["Warning: another frame?", "Warning: softer."]


def test_each_warning_names_its_parts_where_it_holds_and_nowhere_else(f):
    spread = Row(f.models[-1].intervals)
    unseen = Row(f, unchecked=Row(stiffer=("link_1",), softer=("joint_1", "joint_2")))
    cases = {
        "stiffer without changing the readings: link_1.": unseen,
        "softer without changing the readings: joint_1 and joint_2.": unseen,
        "MLS56 (stalled).": changed(f, "MLS56", status="stalled"),
        "boundary of the cone: ALL153 + prior.": changed(f, TAKEN, intervals=Row(spread, on_boundary=True)),
        "the noise only": Row(f, recommended="MGCO56"),
        "is part of the link before them: joint_2.": changed(f, TAKEN, aggregated=["joint_2"]),
        "ALL153 + prior: 3.": changed(f, TAKEN, rejected=3),
        "There is no map": Row(f, no_map="no poses"),
    }
    plain = " ".join(report(changed(f, TAKEN, intervals=Row())).claims)
    for words, own in cases.items():
        assert words in " ".join(report(own).claims), words
        assert words not in plain
