"""What is said and drawn of planted faults is what their trials hold, of trials that are made up."""

import numpy as np
import pytest
from checks import check_spread, tables_of
from made_up import fill, of_one_trial, single
from matplotlib.colors import to_hex
from reports import check, table_of

from testbench.bench.rows import DatasetRow
from testbench.errors import BenchError
from testbench.studies.wrong_inputs.faults import FAULTS
from testbench.studies.wrong_inputs.report import figures, rate, report
from testbench.studies.wrong_inputs.sound import LOADS
from testbench.studies.wrong_inputs.trial import SOUND, SetRow, Settings
from testbench.views.colours import GREY, MEASURED, NOMINAL, hexadecimal
from testbench.views.markdown import grid

SEEDS = range(302, 332)
PLANTED = 25
CASES = ("kilograms", "frame_tilted", "millimetres")
SETTINGS = Settings(CASES, first=SEEDS.start, planted=PLANTED)


def row_of(rng, seed, case, given):
    """The right doubt, another one or none, by turns; every tenth sound set is doubted."""
    names = FAULTS[case].names if case in FAULTS else ()
    k = int(rng.integers(10))
    first = {0: None, 1: "kinematics"}.get(k, names[0]) if names else "run" if k == 0 else None
    held = first in names if names else first is None
    fixed = {
        "case": case,
        "loads": LOADS[seed % 3],
        "targets": 1 if seed % 4 == 0 else 3,
        "tracker": seed % 3 == 2,
        "first": first,
        "said": first and f"{first} of {case.replace('_', ' ')} in {seed}",
        "evidence": 40.0 + seed if first else None,
        "right": held,
        "anywhere": held or k == 1,
        "measured": single(fill(DatasetRow, rng)) if case == SOUND else None,
    }
    return of_one_trial(SetRow, rng, **fixed | given(seed, case))


def made(given=lambda seed, case: {}, cases=lambda seed: (SOUND, *SETTINGS.planted_in(seed))):
    """Rows, `given` fixes fields of a row by what it is; and the report of them."""
    rng = np.random.default_rng(2021)
    rows = {seed: [row_of(rng, seed, case, given) for case in cases(seed)] for seed in SEEDS}
    return [r for own in rows.values() for r in own], report(SETTINGS, SEEDS, table_of(SEEDS, rows.get))


@pytest.fixture(scope="module")
def of_all():
    return made()


def picked(rows, **fixed):
    return [row for row in rows if all(getattr(row, key) == value for key, value in fixed.items())]


def percent(rows, holds):
    return pytest.approx(100 * np.mean([holds(row) for row in rows]))


def test_an_interval_is_wilsons():
    """Against the root of (share - p)^2 = z^2 p (1 - p) / n, and the book's 0 of 10."""
    found = rate([True] * 9 + [False] * 3)
    assert (found.of, found.count, found.share_percent) == (12, 9, 75.0)
    for end in (found.low_percent / 100, found.high_percent / 100):
        assert (0.75 - end) ** 2 == pytest.approx(1.96**2 * end * (1 - end) / 12, rel=1e-4)
    assert found.low_percent < 75 < found.high_percent
    assert rate([False] * 10).high_percent == pytest.approx(27.75, abs=1e-2)
    assert rate([False] * 10).low_percent == 0


def test_every_fault_is_counted_over_its_own_sets(of_all):
    rows, found = of_all
    f = found.numbers
    shares = [fault.right.share_percent for fault in f["faults"]]
    assert shares == sorted(shares)
    for fault in f["faults"]:
        own = picked(rows, case=fault.fault)
        assert (len(own), fault.right.of) == (PLANTED, PLANTED)
        assert fault.right.share_percent == percent(own, lambda row: row.right)
        assert fault.anywhere_percent == percent(own, lambda row: row.anywhere)
        assert fault.silent_percent == percent(own, lambda row: row.first is None)
        assert fault.right.share_percent + fault.other_percent + fault.silent_percent == pytest.approx(100)
        assert fault.before_percent == percent(picked(own, tracker=False), lambda row: row.before)
        others = sum(row.first == "kinematics" for row in own)
        assert fault.instead == (f"kinematics ({others})" if others else "")
    assert (f["right"].of, f["alarms"].of) == (len(CASES) * PLANTED, len(SEEDS))
    doubted = [row for row in picked(rows, case=SOUND) if row.first]
    assert f["alarms"].count == len(doubted) > 0
    assert [(a.first, a.evidence, a.said) for a in f["false_alarms"]] == [
        ("run", row.evidence, row.said) for row in doubted
    ]
    check_spread(f["seconds"], [row.seconds for row in rows])


def test_kinds_part_the_sets_and_the_checks_before_are_judged_in_the_bases_frame(of_all):
    rows, found = of_all
    f = found.numbers
    names = {"hung": "one hung mass", "levels": "three hung masses", "pressed": "forces in all directions"}
    kinds = {kind.kind: kind for kind in f["kinds"]}
    parts = [*({"loads": loads} for loads in LOADS), {"tracker": True}, {"targets": 1}, {"disturbed": False}]
    words = [
        *(names[loads] for loads in LOADS),
        "in a tracker's frame",
        "one target",
        "true arm as the models",
    ]
    for part, name in zip(parts, words, strict=True):
        own = picked(rows, **part)
        sound, faulty = picked(own, case=SOUND), [row for row in own if row.case != SOUND]
        assert (kinds[name].alarms.of, kinds[name].right.of) == (len(sound), len(faulty))
        assert kinds[name].alarms.share_percent == percent(sound, lambda row: row.first is not None)
        assert kinds[name].right.share_percent == percent(faulty, lambda row: row.right)
    assert sum(kind.alarms.of for kind in f["kinds"]) == 4 * len(SEEDS)
    based = picked(rows, tracker=False)
    noticed, alarms = f["before"].noticed, f["before"].alarms
    assert noticed.share_percent == percent([r for r in based if r.case != SOUND], lambda r: r.before)
    assert alarms.share_percent == percent(picked(based, case=SOUND), lambda r: r.before)


def test_losing_faults_are_said():
    """Half of the sets in kilograms are named wrong, every third sound one is doubted."""

    def given(seed, case):
        if case == "kilograms":
            return {"right": seed % 2 == 0, "first": "scale" if seed % 2 == 0 else "force_zero"}
        if case == SOUND:
            return {"right": seed % 3 > 0, "first": None if seed % 3 else "run"}
        return {"right": True, "first": FAULTS[case].names[0]}

    found = made(given)[1]
    text = check(found, ["kinds"])
    assert [fault.fault for fault in found.numbers["lost"]] == ["kilograms"]
    said = "forces in kg. The right doubt is first in 52.0 % of 25 data sets; first instead: force zero (12)."
    assert f"Named too seldom: {said}" in found.claims
    assert found.answer.endswith("Of 30 sound data sets 33.3 % (19.2 to 51.2) raise a doubt.")
    assert found.answer.startswith("The right doubt is first in 84.0 % (74.1 to 90.6) of 75 data sets")
    assert found.worst.startswith("Worst named: forces in kg. The right doubt is first in 52.0 %")
    assert "first in less than nine of ten data sets for 1 of 3 faults" in text
    noticed = found.numbers["before"].noticed.share_percent
    assert f"The two checks before notice {noticed:.1f} % of data sets with a fault in the base's" in text


def test_where_all_faults_are_named_that_is_said_and_no_alarm_is_listed():
    found = made(lambda _, case: {"right": True, "first": None if case == SOUND else FAULTS[case].names[0]})[
        1
    ]
    text = check(found, ["kinds"])
    assert found.worst == "Every kind of fault is named by the right doubt first wherever it was planted."
    assert "There is no fault of which the right doubt is first in less than nine of ten data sets." in text
    assert "False alarms" not in text


def test_without_a_planted_fault_there_is_no_report():
    with pytest.raises(BenchError, match="none of these data sets can have the fault"):
        made(cases=lambda _: (SOUND,))


def test_the_trial_that_is_shown_is_in_the_bases_frame_with_its_misses_first(of_all):
    rows, found = of_all
    f = found.numbers
    assert f["shown"] == 303  # of 302 the frame is a tracker's
    misses = [example.found_out for example in f["examples"][:-1]]
    assert misses == sorted(misses)
    assert f["examples"][-1].planted == "nothing: the sound data set"
    assert {example.case for example in f["examples"]} == {SOUND, *CASES}
    assert f["dataset"].runs == picked(rows, case=SOUND)[1].measured.runs


def test_tables_hold_the_numbers_under_their_headings(of_all):
    found = of_all[1]
    check(found, ["kinds"])
    [(head, cells)] = tables_of(grid(found.tables["faults"]))
    for fault, line in zip(found.numbers["faults"], cells, strict=True):
        own = dict(zip(head, line, strict=True))
        assert own["planted"] == FAULTS[fault.fault].words
        for title, value in (
            ("right first, %", fault.right.share_percent),
            ("at least, %", fault.right.low_percent),
            ("at most, %", fault.right.high_percent),
            ("right anywhere, %", fault.anywhere_percent),
            ("another first, %", fault.other_percent),
            ("not noticed, %", fault.silent_percent),
            ("noticed by the two checks before, %", fault.before_percent),
        ):
            assert own[title] == f"{value:.1f}", title


def test_a_bar_is_the_shares_of_its_fault(of_all):
    faults = of_all[1].numbers["faults"]
    [axes] = figures(of_all[1])["wrong_inputs.png"].axes
    drawn = {}
    for bar in axes.patches:
        drawn.setdefault(to_hex(bar.get_facecolor()).upper(), []).append((bar.get_x(), bar.get_width()))
    for k, fault in enumerate(faults):
        start, right = 0.0, fault.right.share_percent
        for colour, part in ((NOMINAL, right), (MEASURED, fault.other_percent), (GREY, fault.silent_percent)):
            assert drawn[hexadecimal(colour)][k] == pytest.approx((start, part))
            start += part
        assert axes.get_yticklabels()[k].get_text() == f"{FAULTS[fault.fault].words}  {right:.0f} %"
    [line] = axes.get_lines()
    np.testing.assert_allclose(line.get_xdata(), [fault.before_percent for fault in faults])
    assert axes.get_xlim() == (0, 100)
