"""What `testbench identify` prints: the numbers of models.json, and the model that it recommends."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from checks import check_report, check_table, tables_of
from made_up import fill, filled, single

from testbench.bench.fit_rows import Fits, Fitted, HeldOut
from testbench.identify.contradiction import Unchecked
from testbench.identify.doubts import Doubt
from testbench.views import fits as views
from testbench.views import markdown

NAMES = ("MLS56", "MGCO56", "MGCO147")
MEANS = {
    "model": "name",
    "unknowns": "parameters",
    "seen": "rank",
    "conservative": "conservative",
    "F_M": "f_m",
    "floor": "f_m_floor",
    "RMS fit, mm": "identification.rms_mm",
    "RMS check, mm": "check.rms_mm",
    "max check, mm": "check.max_mm",
}
INTERVALS = {
    "model": "name",
    "median half width, mm": "intervals.half_width_mm",
    "largest half width, mm": "intervals.half_width_max_mm",
    "components": "intervals.components",
    "without bound": "intervals.unbounded",
}


@pytest.fixture
def fits(rng):
    models = filled(Fitted, rng, [{"name": name} for name in NAMES], status="solved", parameters=56)
    models = tuple(replace(single(m), advice=("seen",), conservative=True) for m in models)
    held_out = tuple(HeldOut(name, *rng.uniform(1, 9, 2)) for name in NAMES)
    return fill(Fits, rng, models=models, recommended="MGCO56", held_out=held_out)


def printed(fits):
    """Everything that the command prints, as it would be in Markdown."""
    tables = views.tables(fits)
    study = SimpleNamespace(tables=views.tables, words=_paged, printed=tuple(tables))
    return check_report(study, fits)


def _paged(fits):
    words = views.words(fits)
    blocks = [words.block(name) for name in ("title", "answer", "statements", "more")]
    return SimpleNamespace(
        block=words.block, has=words.has, worst_lines=words.worst_lines, whole=lambda: "\n".join(blocks)
    )


def test_tables_show_the_numbers_of_models_json(fits):
    tables = views.tables(fits)
    check_table(tables["models"], fits.models, MEANS)
    check_table(tables["intervals"], fits.models, INTERVALS)
    assert "95" in views.tables(_with(fits, confidence=0.95))["intervals"].title
    printed(fits)


def _with(fits, **changes):
    models = tuple(replace(m, intervals=replace(m.intervals, **changes)) for m in fits.models)
    return replace(fits, models=models)


def test_what_was_not_asked_for_is_not_shown(fits):
    plain = replace(fits, models=tuple(replace(m, check=None, intervals=None) for m in fits.models))
    [(head, _)] = tables_of(markdown.grid(views.tables(plain)["models"]))
    assert head == [*(title for title in MEANS if "check" not in title), "max fit, mm"]
    assert list(views.tables(plain)) == ["models"]
    assert "No pose was held back" in printed(plain)
    assert "No pose was held back" not in printed(fits)


@pytest.mark.parametrize("name", NAMES)
def test_the_model_that_is_recommended_is_named_and_marked_whichever_it_is(fits, name):
    fits = replace(fits, recommended=name, doubts=())
    assert views.words(fits).block("answer").startswith(f"Take {name}: ")
    assert f"- Why {name}: {fits.why}." in views.words(fits).block("statements")
    for table in views.tables(fits).values():
        marked = [line for line in markdown.grid(table).splitlines() if "**" in line]
        assert [line.startswith(f"| **{name}** |") for line in marked] == [True]
    for c in fits.held_out:
        assert f"{c.name} {c.f_m:.2f} +- {c.standard_error:.2f}" in printed(fits)


@pytest.mark.parametrize("name", NAMES)
def test_the_answer_says_how_sure_the_model_is_that_is_taken(fits, name):
    fits = replace(fits, recommended=name, doubts=())
    half = next(m.intervals.half_width_mm for m in fits.models if m.name == name)
    answer = views.words(fits).block("answer")
    assert f"a deflection along an axis to +- {half:.3f} mm (95 %, median)" in answer.replace(
        "is predicted ", ""
    )
    assert "held back" in answer
    assert "held back" not in views.words(_without(fits, "check")).block("answer")
    assert "+-" not in views.words(_without(fits, "intervals")).block("answer")


def test_the_answer_is_the_gain_over_least_squares_and_joints_in_the_runs_held_back(fits):
    def judged(m, name, mm):
        kind = {"structure": name, "constraint": "psd" if name == "MGCO56" else "none", "prior": False}
        return replace(m, name=name, check=replace(m.check, rms_mm=mm), **kind)

    errors = {"MGCO56": 0.1, "MLS56": 0.25, "Joints": 0.4}
    models = tuple(judged(fits.models[0], *own) for own in errors.items())
    made = replace(fits, models=models, recommended="MGCO56", doubts=())
    assert (
        views.words(made)
        .block("answer")
        .startswith(
            "Take MGCO56: 0.100 mm RMS in the runs held back, least squares 0.250 mm; 2.5 times less. "
            "Joints alone 0.400 mm, 4.0 times as much; a deflection "
        )
    )
    assert made.beside("MGCO56") is None


def _without(fits, field):
    return replace(fits, models=tuple(replace(m, **{field: None}) for m in fits.models))


def test_what_the_readings_do_not_check_is_said_and_noise_alone_too(fits):
    def said(stiffer, softer, **changes):
        models = tuple(replace(m, **changes) for m in fits.models)
        return printed(replace(fits, models=models, unchecked=Unchecked(stiffer, softer)))

    both = said(("link_1",), ("joint_1", "joint_2"), learnt=True)
    assert "not show ten times stiffer than in the folder: link_1." in both
    assert "not show ten times softer: joint_1 and joint_2." in both
    assert "The intervals count on it." in both
    assert "count on it" not in said(("link_1",), (), learnt=False)
    assert "softer" not in said(("link_1",), ())
    assert "would not show" not in said((), ())
    plain = replace(fits, models=tuple(replace(m, prior=False) for m in fits.models))
    assert "count noise alone" in printed(plain)
    known = replace(fits, models=tuple(replace(m, prior=True) for m in fits.models))
    assert "count noise alone" not in printed(known)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_wrong_with_a_model_is_said_of_that_model(fits, name):
    def only(m, **changes):
        return replace(m, **changes) if m.name == name else m

    stalled = replace(fits, models=tuple(only(m, status="stalled") for m in fits.models))
    assert f"Not certified: {name} (stalled)." in printed(stalled)
    assert "Not certified" not in printed(fits)
    free, held = (_with(fits, on_boundary=state, unbounded=0) for state in (False, True))
    mixed = tuple(h if h.name == name else f for f, h in zip(free.models, held.models, strict=True))
    assert f"The intervals of {name} are not exact" in printed(replace(free, models=mixed))
    assert "not exact" not in printed(free)
    assert "has no bound" not in printed(free)
    assert "has no bound" in printed(_with(free, unbounded=2))


def test_doubts_and_advice_are_said_once_those_about_the_runs_before_the_answer(fits):
    frame, prior = Doubt("frame", "the frame is another one?"), Doubt("prior", "link_2 is softer")
    plain = printed(replace(fits, doubts=(prior,)))
    assert plain.count("Doubt: link_2 is softer") == 1
    assert "\nTake " in plain
    fits = replace(fits, doubts=(frame, prior))
    assert "First look at the runs, see the doubt below; if they are right, take " in printed(fits)
    assert (
        views.words(fits).block("statements").startswith("- Doubt: the frame is another one?\n- Doubt: link")
    )
    assert printed(fits).count("the frame is another one?") == 1
    assert printed(fits).count("- Seen.") == 1
