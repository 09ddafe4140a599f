"""What people see of the study of wrong inputs equals its report, for trials that are made up."""

import math

import numpy as np
import pytest
from checks import check_report, check_spread, check_table, check_words, summaries
from made_up import fill, of_one_trial, single
from matplotlib.colors import to_hex

from testbench.bench.rows import DatasetRow
from testbench.errors import BenchError
from testbench.studies.wrong_inputs import figure
from testbench.studies.wrong_inputs.faults import FAULTS
from testbench.studies.wrong_inputs.report import rate
from testbench.studies.wrong_inputs.sound import LOADS
from testbench.studies.wrong_inputs.study import STUDY
from testbench.studies.wrong_inputs.trial import SOUND, SetRow, Settings
from testbench.views.colours import GREY, MEASURED, NOMINAL, hexadecimal

SEEDS = range(302, 332)
PLANTED = 25
CASES = ("kilograms", "frame_tilted", "millimetres")
SETTINGS = Settings(CASES, first=SEEDS.start, planted=PLANTED)
FAULT = {
    "fault": "words",
    "right doubt": "names",
    "sets": "right.of",
    "right first, %": "right.share",
    "from, %": "right.low",
    "to, %": "right.high",
    "right anywhere, %": "anywhere",
    "another first, %": "other",
    "not noticed, %": "silent",
    "instead": "instead",
    "noticed by the two checks before, %": "before",
}
KIND = {
    "data sets": "kind",
    "sound": "alarms.of",
    "doubted, %": "alarms.share",
    "at most, %": "alarms.high",
    "faults": "right.of",
    "right first, %": "right.share",
    "at least, %": "right.low",
}
ALARM = {
    "trial": "trial",
    "data set": "kind",
    "doubt": "first",
    "evidence, nats": "evidence",
    "what was said": "said",
}
EXAMPLE = {"planted": "words", "first doubt": "first", "what was said": "said", "right": "right"}


def trials(rng, given=lambda seed, case: {}):
    """Made-up rows; `given` fixes fields of a row by what it is."""
    return [(seed, [row_of(rng, seed, case, given) for case in cases_of(seed)]) for seed in SEEDS]


def cases_of(seed):
    return (SOUND, *SETTINGS.planted_in(seed))


def row_of(rng, seed, case, given):
    """The right doubt, another one or none, by turns; every tenth sound set is doubted."""
    names = FAULTS[case].names if case in FAULTS else ()
    k = int(rng.integers(10))
    first = (
        {0: None, 1: "kinematics"}.get(k, names[0] if names else None) if names else "run" if k == 0 else None
    )
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


summed, made, report = summaries(STUDY, SETTINGS, SEEDS, trials)


def picked(made, **fixed):
    rows = [row for _, own in made for row in own]
    return [row for row in rows if all(getattr(row, key) == value for key, value in fixed.items())]


def share(rows, holds):
    return np.mean([holds(row) for row in rows])


def test_an_interval_is_wilsons():
    """Against the root of (share - p)^2 = z^2 p (1 - p) / n, and the book's 0 of 10."""
    found = rate([True] * 9 + [False] * 3)
    assert (found.of, found.count, found.share) == (12, 9, 0.75)
    for end in (found.low, found.high):
        assert (0.75 - end) ** 2 == pytest.approx(1.96**2 * end * (1 - end) / 12, rel=1e-4)
    assert found.low < 0.75 < found.high
    assert rate([False] * 10).high == pytest.approx(0.2775, abs=1e-4)
    assert rate([False] * 10).low == 0


def test_every_fault_is_counted_over_its_own_sets(made, report):
    assert [fault.right.share for fault in report.faults] == sorted(
        fault.right.share for fault in report.faults
    )
    for fault in report.faults:
        rows = picked(made, case=fault.fault)
        assert len(rows) == fault.right.of == PLANTED
        assert fault.right.share == share(rows, lambda row: row.right)
        assert fault.anywhere == share(rows, lambda row: row.anywhere)
        assert fault.silent == share(rows, lambda row: row.first is None)
        assert fault.right.share + fault.other + fault.silent == pytest.approx(1)
        assert fault.before == share([row for row in rows if not row.tracker], lambda row: row.before)
        others = sum(row.first == "kinematics" for row in rows)
        assert fault.instead == (f"kinematics ({others})" if others else "")
    assert report.right.of == len(CASES) * PLANTED
    assert report.alarms.of == len(SEEDS)
    assert (
        report.alarms.count
        == len(report.false_alarms)
        == share(picked(made, case=SOUND), lambda r: not r.right) * 30
    )
    check_spread(report.seconds, [row.seconds for row in picked(made)])


def test_kinds_part_the_sets_and_the_checks_before_are_judged_in_the_bases_frame(made, report):
    for loads in LOADS:
        name = {
            "hung": "one hung mass",
            "levels": "three hung masses",
            "pressed": "forces in all directions",
        }[loads]
        [own] = [kind for kind in report.kinds if kind.kind == name]
        rows = picked(made, loads=loads)
        assert own.alarms.share == share([r for r in rows if r.case == SOUND], lambda r: r.first is not None)
        assert own.right.share == share([r for r in rows if r.case != SOUND], lambda r: r.right)
    for part in (report.kinds[:3], report.kinds[3:5], report.kinds[5:7], report.kinds[7:]):
        assert sum(kind.alarms.of for kind in part) == len(SEEDS)
        assert sum(kind.right.of for kind in part) == report.right.of
    based = picked(made, tracker=False)
    assert report.before.noticed.share == share([r for r in based if r.case != SOUND], lambda r: r.before)
    assert report.before.alarms.share == share([r for r in based if r.case == SOUND], lambda r: r.before)


def test_losing_faults_are_said(rng):
    """Half of the sets in kilograms are named wrong, every third sound one is doubted."""

    def given(seed, case):
        if case == "kilograms":
            return {"right": seed % 2 == 0, "first": "scale" if seed % 2 == 0 else "force_zero"}
        return (
            {"right": seed % 3 > 0, "first": "run" if seed % 3 == 0 else None}
            if case == SOUND
            else {"right": True}
        )

    found = summed(trials(rng, given))
    words = STUDY.words(found)
    assert [fault.fault for fault in found.lost] == ["kilograms"]
    said = "forces in kg. The right doubt is first in 52.0 % of 25 data sets; first instead: force zero (12)."
    assert f"Named too seldom: {said}" in words.block("more")
    assert "Of 30 sound data sets 33.3 % (19.2 to 51.2) raise a doubt." in words.block("answer")
    assert words.block("worst").startswith("Worst named: forces in kg. The right doubt is first in 52.0 %")
    assert f"first in less than nine of ten data sets for 1 of {len(found.faults)} faults" in words.block(
        "statements"
    )
    good = STUDY.words(summed(trials(rng, lambda _, __: {"right": True, "first": None})))
    assert "No fault is named by the right doubt first in less than nine of ten" in good.block("statements")


def test_without_a_planted_fault_there_is_no_report(made):
    with pytest.raises(BenchError, match="none of these data sets can have the fault"):
        summed([(seed, rows[:1]) for seed, rows in made])


def test_tables_show_the_reports_numbers_with_their_units(report):
    tables = STUDY.tables(report)
    check_table(tables["faults"], report.faults, FAULT)
    check_table(tables["kinds"], report.kinds, KIND)
    check_table(tables["alarms"], report.false_alarms, ALARM)
    check_table(tables["examples"], report.examples, EXAMPLE)
    check_report(STUDY, report)
    check_words(STUDY.words(report))


def test_a_bar_is_the_shares_of_its_fault(report):
    [axes] = figure.bars(report).axes
    drawn = {to_hex(bar.get_facecolor()).upper(): [] for bar in axes.patches}
    for bar in axes.patches:
        drawn[to_hex(bar.get_facecolor()).upper()].append((bar.get_x(), bar.get_width()))
    for k, fault in enumerate(report.faults):
        start = 0.0
        for colour, part in ((NOMINAL, fault.right.share), (MEASURED, fault.other), (GREY, fault.silent)):
            assert drawn[hexadecimal(colour)][k] == pytest.approx((start, 100 * part))
            start += 100 * part
        assert axes.get_yticklabels()[k].get_text() == f"{fault.words}  {100 * fault.right.share:.0f} %"
    [line] = axes.get_lines()
    np.testing.assert_allclose(line.get_xdata(), [100 * fault.before for fault in report.faults])
    assert math.isclose(axes.get_xlim()[1], 100)
