"""What is said and drawn of solvers is what their trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_spread, tables_of
from reports import campaign_row, check, check_forest, place_of, table_of

from testbench.studies.solver_comparison.study import LOOKS, figures, report
from testbench.studies.solver_comparison.trial import Options, SolverRow, settings
from testbench.views.colours import GCO
from testbench.views.gains import ratio
from testbench.views.markdown import grid
from testbench.views.schema import show

KEYS = ("a", "a'", "b", "b'", "c", "d")
SEEDS = range(3, 6)


def made(**f_m):
    """Three seeds; F_M of a solver is 6 if not given, and (a) comes within 1 % in two of them."""

    def rows(seed):
        rng = np.random.default_rng(seed)
        for key in KEYS:
            own = {"key": key, "f_m": f_m.get(key, 6.0), "f_m_excess_bound": 0.5, "local_solves": 4}
            row = campaign_row(SolverRow, rng, "MGCO69", parameters=69, **own)
            missed = {"seconds_to_1_percent": None, "ratio_to_conic": None} if (key, seed) == ("a", 4) else {}
            yield replace(row, **missed)

    trials = table_of(SEEDS, lambda seed: list(rows(seed)))
    return report(settings(Options(), False, SEEDS), SEEDS, trials), trials


def test_numbers_of_every_solver_are_those_of_its_seeds():
    found, trials = made()
    check(found, ["short"])
    f = found.numbers
    [(head, cells)] = tables_of(grid(found.tables["solvers"]))
    for row in f["solvers"]:
        own = trials.where(key=row.key)
        check_spread(row.solve_seconds, own["solve_seconds"])
        check_spread(row.check_true.rms_mm, own["check_true.rms_mm"])
        there = own["ratio_to_conic"][~np.isnan(own["ratio_to_conic"])]
        check_spread(row.ratio_to_conic, there)
        assert row.within_1_percent == len(there) == (2 if row.key == "a" else 3)
        assert (row.local_solves, row.f_m) == (12, 6.0)
        shown = dict(zip(head, next(own for own in cells if own[0] == row.solver), strict=True))
        for title, value, form in (
            ("time, s", row.solve_seconds, ".3g"),
            ("time to 1 %, s", row.seconds_to_1_percent, ".3g"),
            ("to 1 %, times (d)", row.ratio_to_conic, ".3g"),
            ("whole time, times (d)", row.whole_ratio_to_conic, ".3g"),
            ("over the bound", row.relative_excess_bound, ".1e"),
            ("of them elsewhere", row.local_solves_elsewhere, "d"),
            ("RMS check, true, mm", row.check_true.rms_mm, ".3f"),
        ):
            assert shown[title] == show(value, form), title
    counted = trials.where(key=("a", "a'", "b", "c"))["local_solves_elsewhere"]
    assert (f["local_solves"], f["elsewhere"]) == (48, counted.sum())
    worst = max(f["solvers"], key=lambda row: row.relative_excess.median)
    assert found.worst.startswith(f"Highest ends {worst.solver}: ")


@pytest.mark.parametrize("least", ["a", "b", "d"])
def test_who_is_above_whom_is_judged_by_f_m(least):
    found, trials = made(**{least: 5.0})
    f, rows = found.numbers, {row.key: row for row in found.numbers["solvers"]}
    assert f["conic_never_above_paper"] == (least != "a")
    assert f["largest_relative_excess_of_d_over_any"] == pytest.approx(0.0 if least == "d" else 0.2)
    assert ("never ends above" in found.answer) == (least != "a")
    assert ("In 3 seeds (d) ends up to " in found.claims[0]) == (least != "d")
    times = np.nanmedian(trials.where(key="a")["ratio_to_conic"])
    assert f"(a) takes {times:.0f} times as long" in found.answer
    short, local = (ratio(rows[key].ratio_to_conic.median) for key in ("a'", "b"))
    said = (
        f"To 1 % one local solve (b) takes {local} times as long as (d), a short differential evolution (a')"
    )
    assert f"{said} {short} times." in found.claims[1]
    assert f"takes {show(1000 * rows['d'].solve_seconds.median, '.3g')} ms" in found.answer


def test_the_figure_draws_time_and_bound_of_every_solver_in_its_colour():
    found, _ = made()
    rows = found.numbers["solvers"]
    looks = [LOOKS[row.key] for row in rows]
    times, bounds = figures(found)["solver_comparison.png"].axes
    first = place_of(found, [row.key for row in rows])
    check_forest(times, [row.seconds_to_1_percent for row in rows], looks, "s", first)
    check_forest(bounds, [row.relative_excess_bound for row in rows], looks, None, first)
    assert [key for key, look in LOOKS.items() if look.colour == GCO] == ["d"]
