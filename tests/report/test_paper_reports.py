"""Reports of the paper's sections hold and draw what their trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import at, check_spread, tables_of, unit_in
from made_up import of_one_trial
from reports import AT, campaign_row, check, check_forest, place_of, read_back, table_of

from testbench.report.colours import GCO, LEAST_SQUARES, NOMINAL, look
from testbench.report.markdown import grid
from testbench.report.table import find
from testbench.runs.spread import middle
from testbench.studies.paper import loaded_stiffness, single_link, six_dof_arm, solver_comparison
from testbench.workflows.model_names import EQUAL_FIT
from testbench.workflows.models import JOINTS_ONLY
from testbench.workflows.rows import DatasetRow, ErrorRow

SEEDS = range(1, 21)


def verdicts(report):
    return {row.claim: row.verdict for row in report.numbers["claims"]}


#: Position error [um], rotation error [urad], share of the draws that are conservative.
LINK = {"MLS36": (40.0, 400.0, 0.0), "MLS21": (20.4, 100.0, 0.5), "MGCO21": (20.0, 300.0, 1.0)}
DIAGONAL = np.array([4.5e-8, 8.01e-5, 3.64e-5, 3.76e-3, 1.09e-3, 2.65e-3])
NEARER = "GCO predicts positions better than least squares"


def link(seeds=SEEDS, least=5, changes=lambda name, seed: {}):
    """The single link; from the order `least` on the optimum is reached, in the first seed always."""

    def row(name, seed, m=0, **own):
        rng, (position, rotation, share) = np.random.default_rng([seed, len(name), m]), LINK[name]
        found = {
            **{"name": name, "structure": name, "prior": False, "advice": (), "m": m, "data_file": None},
            "constraint": "psd" if name == "MGCO21" else "none",
            "conservative": seed <= share * len(SEEDS),
            "measured": of_one_trial(DatasetRow, np.random.default_rng(1), runs=6),
            single_link.POSITION: position,
            single_link.ROTATION: rotation,
            "error": tuple(np.diag(0.1 * DIAGONAL).ravel()),
            "printed": None if seed > 1 or name == "MLS21" else of_one_trial(single_link.Matrix, rng),
            "status": "solved",
        }
        return of_one_trial(single_link.LinkRow, rng, **(found | own))

    def rows(seed):
        orders = [
            row("MGCO21", seed, m, reaches_optimum=m >= least or seed == 1) for m in range(1, 7) if seed <= 2
        ]
        return [row(name, seed, **changes(name, seed)) for name in LINK] + orders

    trials = table_of(seeds, rows)
    return single_link.STUDY.report(single_link.SingleLinkSettings(), seeds, trials), trials


def test_methods_of_the_single_link_are_compared_draw_by_draw():
    found, _ = link()
    check(found, ["errors", "shape"])
    assert (found.badge.rival, found.badge.verdict) == ("MLS21", "tie")  # 2 %, in every draw
    assert [m.conservative for m in found.numbers["models"]] == [0.0, 0.5, 1.0]
    assert [*verdicts(found).values()] == [
        *("confirmed", "confirmed", "not confirmed", "confirmed", "confirmed", "not confirmed")
    ]
    np.testing.assert_allclose(np.diag(found.numbers["models"][2].entry_bias), 0.1 * DIAGONAL)

    def better(name, seed):
        return {single_link.POSITION: 10.0} if name == "MLS21" and seed <= 6 else {}  # 14 of 20: p = 0.12

    own = verdicts(link(changes=better)[0])
    assert own[NEARER] == "confirmed"
    assert own[f"{NEARER} with a symmetric matrix (not in the paper)"] == "no clear difference"
    assert list(verdicts(link(SEEDS[:2], least=4)[0]).values())[5] == "confirmed"


def test_the_picture_of_the_single_link_has_the_errors_and_the_printed_matrices():
    found, _ = link()
    models = found.numbers["models"]
    for axes, key, unit in zip(
        single_link.STUDY.figures(read_back(found))["single_link.png"].axes,
        (single_link.POSITION, single_link.ROTATION),
        ("um", "urad"),
        strict=False,
    ):
        looks = [look(m.structure, m.constraint) for m in models]
        check_forest(axes, [m[key] for m in models], looks, unit, place_of(found, LINK))
        diamonds = [line.get_xdata()[0] for line in axes.get_lines() if line.get_marker() == "D"]
        assert sorted(diamonds) == pytest.approx(sorted(m.paper[key] for m in models if m.paper), rel=0.01)


#: Constraint, and errors of the check runs without noise, linear and non-linear truth [mm].
MODELS = {
    "MLS56": ("none", 2.2, 3.0),
    "MLS32": ("none", 2.09, 4.0),
    "MGCO147": ("psd", 5.0, 5.0),
    "MGCO69": ("psd", 6.0, 6.0),
    "MGCO56": ("psd", 2.0, 2.05),
    JOINTS_ONLY: ("none", 20.0, 21.0),
    EQUAL_FIT: ("free", 1.0, 1.0),
}


def six_dof(count=20, changes=lambda name, seed: {}):
    """The 6R arm; every error is 0.9 to 1.1 times what is asked for, the same factor for all of a seed."""

    def fit(name, truth, seed, mm, **own):
        rng = np.random.default_rng([seed, len(name)])
        constraint = MODELS[name][0]
        mm = mm * (0.89 + 0.01 * seed)
        found = {"conservative": constraint != "none", "parameters": 56, "rank": 32, "f_m": 2.0, "m": 0}
        found |= {"constraint": constraint, "truth": truth, "status": "solved"}
        found |= {
            key: of_one_trial(ErrorRow, rng, p95_mm=k * mm) for key, k in (("check_true", 1), ("check", 0.04))
        }
        return campaign_row(six_dof_arm.SixDofRow, rng, name, **found | own)

    def rows(seed):
        for k, truth in enumerate(("linear", "nonlinear"), 1):
            for name, own in MODELS.items():
                placed = {"places": AT, "place_mm": (0.7 * own[k], 1.2 * own[k])} if seed * k == 1 else {}
                changed = changes(name, seed)
                yield fit(name, truth, seed, changed.pop("mm", own[k]), **placed, **changed)
        if seed == 1:
            for name, m in [(name, m) for name in ("MGCO69", "MGCO56") for m in range(1, 7)]:
                yield fit(name, "linear", 1, 1.0, m=m)

    seeds = SEEDS[:count]
    asked = six_dof_arm.STUDY.settings(six_dof_arm.SixDofOptions(), True, seeds)
    return six_dof_arm.STUDY.report(asked, seeds, table_of(seeds, lambda seed: list(rows(seed))))


def test_models_of_the_6r_arm_are_judged_by_their_true_errors():
    found = six_dof()
    check(found, ["short"])
    f = found.numbers
    # MGCO56 is asked about: nothing beats it by 5 %; MLS32 is its strongest rival
    assert (found.badge.winner, found.badge.rival, found.badge.verdict) == ("MGCO56", "MLS32", "holds")
    assert found.badge.factor == pytest.approx(2.09 / 2)
    assert f["dataset"].noise_p95_mm == pytest.approx(0.06989, abs=1e-5)  # 2.7955 times 25 um
    assert find(f["models"], name="MGCO69").paper == {"check_p95_mm": 0.084}
    assert middle(f["models"][4].nonlinear.check_true.p95_mm) == pytest.approx(2.05 * 0.995)
    own = verdicts(found)
    assert own["only the GCO models are conservative (Table I)"] == "confirmed"
    # our readings of MLS32 are 0.076 to 0.091 mm, those of MGCO69 three times that
    assert own["MLS32: 95 % error, mm"] == "consistent"
    assert own["MGCO69: 95 % error, mm"] == "not confirmed"


@pytest.mark.parametrize(
    ("claim", "name", "mm", "most"),
    [
        ("MGCO56 is the best model", "MLS32", 1.0, 5),  # 15 of 20: p = 0.041; 14: p = 0.12
        ("MGCO56 and MLS32 are nearly the same: within 5 %", "MLS32", 2.2, 1),
    ],
)
def test_a_statement_of_section_5_2_is_confirmed_up_to_so_many_seeds_against_it(claim, name, mm, most):
    for failing, verdict in ((most, True), (most + 1, False)):
        own = six_dof(changes=lambda n, seed, k=failing: {"mm": mm} if n == name and seed <= k else {})
        row = find(own.numbers["claims"], claim=claim)
        assert (row.verdict == "confirmed", row.holds) == (verdict, (20 - failing) / 20)


def test_a_tie_break_counts_equal_fits_and_conservative_ones_apart():
    fits = {1: 2.0, 2: 2.0 * (1 + 9e-8), 3: 2.0 * (1 + 2e-7), 4: 2.1}

    def changes(name, seed):
        own = {"MGCO56": {"f_m": fits[seed]}, EQUAL_FIT: {"conservative": seed < 4}}
        return dict(own.get(name, {}))

    for truth, tie in zip(("linear", "nonlinear"), six_dof(4, changes).numbers["ties"], strict=True):
        assert list(tie.values()) == [truth, 4, 24, 3, 2]


def test_the_picture_of_the_6r_arm_has_both_truths_and_the_papers_numbers():
    found = six_dof()
    panes, models = six_dof_arm.STUDY.figures(found)["six_dof_arm.png"].axes, found.numbers["models"]
    looks = [look(m.structure, m.constraint) for m in models]
    first = place_of(found, [m.name for m in models])
    for axes, path in zip(panes, six_dof_arm.PANES, strict=True):
        check_forest(axes, [at(m, path) for m in models], looks, first=first)
    diamonds = [x for x in panes[1].get_lines() if (x.get_marker(), x.get_markersize()) == ("D", 3.6)]
    assert sorted(x.get_xdata()[0] for x in diamonds) == [0.072, 0.078, 0.084, 0.085]


KEYS = ("a", "a'", "b", "b'", "c", "d")


def solvers(**f_m):
    """Three seeds; F_M of a solver is 6 if not given, and (a) comes within 1 % in two of them."""

    def rows(seed):
        rng = np.random.default_rng(seed)
        for key in KEYS:
            own = {"key": key, "f_m": f_m.get(key, 6.0), "f_m_excess_bound": 0.5, "local_solves": 4}
            row = campaign_row(solver_comparison.SolverRow, rng, "MGCO69", parameters=69, **own)
            missed = {"seconds_to_1_percent": None, "ratio_to_conic": None} if (key, seed) == ("a", 4) else {}
            yield replace(row, **missed)

    seeds = range(3, 6)
    trials = table_of(seeds, lambda seed: list(rows(seed)))
    asked = solver_comparison.STUDY.settings(solver_comparison.SolverOptions(), False, seeds)
    return solver_comparison.STUDY.report(asked, seeds, trials), trials


def test_numbers_of_every_solver_are_those_of_its_seeds():
    found, trials = solvers()
    check(found, ["short"])
    f = found.numbers
    for row in f["solvers"]:
        own = trials.where(key=row.key)
        check_spread(row.solve_seconds, own["solve_seconds"])
        check_spread(row.check_true.rms_mm, own["check_true.rms_mm"])
        there = own["ratio_to_conic"][~np.isnan(own["ratio_to_conic"])]
        check_spread(row.ratio_to_conic, there)
        assert row.within_1_percent == len(there) == (2 if row.key == "a" else 3)
        assert (row.local_solves, row.f_m) == (12, 6.0)
    counted = trials.where(key=("a", "a'", "b", "c"))["local_solves_elsewhere"]
    assert (f["local_solves"], f["elsewhere"]) == (48, counted.sum())


def test_the_picture_of_solvers_has_time_and_bound_of_each_in_its_colour():
    found, _ = solvers()
    rows = found.numbers["solvers"]
    looks = [solver_comparison.LOOKS[row.key] for row in rows]
    times, bounds = solver_comparison.STUDY.figures(found)["solver_comparison.png"].axes
    first = place_of(found, [row.solver for row in rows])
    check_forest(times, [row.seconds_to_1_percent for row in rows], looks, "s", first)
    check_forest(bounds, [row.relative_excess_bound for row in rows], looks, None, first)
    assert [key for key, own in solver_comparison.LOOKS.items() if own.colour == GCO] == ["d"]


LOADS, POSES, TRUTHS = (1100.0, 9700.0), 4, ("weightless", "own weight")
NAMES = loaded_stiffness.NAMES


def loaded(**scales):
    """Three seeds of poses; errors of methods are scaled under the heaviest weight, weightless."""

    def rows(seed):
        for load, truth, method in [(a, b, c) for a in LOADS for b in TRUTHS for c in NAMES]:
            last = (load, truth) == (LOADS[-1], TRUTHS[0])
            for pose in range(POSES):
                rng = np.random.default_rng([seed, int(load), len(truth), len(method), pose])
                error = scales.get(method, 1.0) ** last * rng.uniform(1e-6, 9e-6, 3)
                error = np.array([1e-4, 0, 0]) if method == "joints" else error
                fixed = {"load_N": load, "truth": truth, "method": method, "error_m": tuple(error)}
                fixed |= {"deflection_m": tuple(rng.uniform(1e-3, 9e-3, 3)), "pose": pose}
                yield of_one_trial(loaded_stiffness.PoseRow, rng, **fixed)

    seeds = range(3, 6)
    trials = table_of(seeds, lambda seed: list(rows(seed)))
    asked = loaded_stiffness.LoadedStiffnessSettings(arm="kr500_l480", poses=POSES)
    return loaded_stiffness.STUDY.report(asked, seeds, trials), trials


def test_errors_of_every_load_truth_and_method_are_those_of_its_poses():
    found, trials = loaded(secant=1e-5, integrated=1e-6)
    check(found, ["by_load"])
    [(_, cells)] = tables_of(grid(found.tables["by_load"]))
    shown = {name: dict(zip(LOADS, own, strict=True)) for name, *own in cells}
    for row in found.numbers["rows"]:
        own = trials.where(load_N=row.load_N, truth=row.truth, method=row.method)
        far, size = (np.linalg.norm(np.stack([*own[name]]), axis=1) for name in ("error_m", "deflection_m"))
        assert row.rms_um == pytest.approx(1e6 * np.sqrt(np.mean(far**2)))
        assert row.deflection_rms_mm == pytest.approx(1e3 * np.sqrt(np.mean(size**2)))
        assert row.rms_percent == pytest.approx(0.1 * row.rms_um / row.deflection_rms_mm)
        assert row.max_um == pytest.approx(1e6 * far.max())
        word = "exact" if row.rms_um < 1e-3 else f"{row.rms_um:.2f}"
        assert shown[row.prediction][row.load_N] == word


@pytest.mark.parametrize("winner", ["linear", "secant", "integrated"])
def test_the_headline_names_the_method_of_least_error_whichever_it_is(winner):
    found, _ = loaded(**{winner: 0.01})
    best = f"{NAMES[winner]}, {TRUTHS[0]}"
    assert (found.badge.winner, found.badge.verdict) == (best, "holds")
    assert verdicts(found)["Eq. (7) from no load to the whole is nearer the truth than Eq. (6)"] == {
        "linear": "contradicted",
        "integrated": "confirmed",
    }.get(winner, "no clear difference")


def test_the_picture_of_loads_has_the_numbers_of_every_prediction():
    found, _ = loaded()
    [axes] = loaded_stiffness.STUDY.figures(found)["loaded_stiffness.png"].axes
    assert (unit_in(axes.get_xlabel()), unit_in(axes.get_ylabel())) == ("N", "um")
    drawn = {line.get_label(): line for line in axes.get_lines()}
    looks = loaded_stiffness.LOOKS
    light = [looks[f"{name}, {TRUTHS[0]}"].colour for name in NAMES.values()]
    assert light == [LEAST_SQUARES, NOMINAL, GCO, look("Joints", "none").colour]
    for name, own in looks.items():
        rows = [r for r in found.numbers["rows"] if r.prediction == name]
        np.testing.assert_allclose(drawn[name].get_xydata(), [(r.load_N, r.rms_um) for r in rows])
        style = drawn[name].get_color(), drawn[name].get_linestyle()
        assert style == (own.hex, "--" if name.endswith(TRUTHS[1]) else "-")
