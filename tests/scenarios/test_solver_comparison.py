"""The solver comparison as a stranger runs it: files, keys, who ends where."""

from run_here import app_of_study, check_files, quick_study

APP = app_of_study("solver_comparison")
SMALL = ["--generations", "3", "--trial-points", "30", "--starts", "2", "--model", "MGCO56", "--seed", 3]
quick, report, rows = quick_study(APP, *SMALL)


def test_a_run_leaves_its_files_and_says_where(quick):
    check_files(quick, "solver_comparison.png")


def test_every_solver_has_its_row(report):
    assert (report["seed"], report["dataset"]["runs"], report["dataset"]["check_runs"]) == ([3, 4], 108, 120)
    assert [row["key"] for row in report["solvers"]] == ["a", "a'", "b", "b'", "c", "d"]
    assert all(row["conservative"] for row in report["solvers"])


def test_conic_program_is_never_above_any_other_solver(report):
    for row in report["solvers"]:
        assert row["relative_excess_bound"]["p05"] >= 0
        if row["key"] != "d":
            assert row["relative_excess"]["least"] >= -1e-6  # the trace beside F_M costs (d) up to 1e-7 of it
            # certified: nobody is farther from the least F_M than its bound says
            assert row["relative_excess"]["p95"] <= row["relative_excess_bound"]["p95"]
