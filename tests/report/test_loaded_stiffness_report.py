"""What is said and drawn of a loaded arm is what its trials hold, of trials that are made up."""

import numpy as np
import pytest
from checks import tables_of, unit_in
from made_up import of_one_trial
from reports import check, table_of

from testbench.studies.loaded_stiffness.study import LOOKS, NAMES, figures, report
from testbench.studies.loaded_stiffness.trial import PoseRow, Settings
from testbench.views.colours import GCO, LEAST_SQUARES, NOMINAL, look
from testbench.views.gains import ratio
from testbench.views.markdown import grid

LOADS, POSES, SEEDS = (1100.0, 9700.0), 2, range(3, 6)
TRUTHS = ("weightless", "own weight")


def made(**scales):
    """Three seeds of two poses; errors of methods are scaled under the heaviest weight, weightless."""

    def rows(seed):
        for load in LOADS:
            for truth in TRUTHS:
                for method in NAMES:
                    last = (load, truth) == (LOADS[-1], TRUTHS[0])
                    for pose in range(POSES):
                        rng = np.random.default_rng([seed, int(load), len(truth), len(method), pose])
                        error = scales.get(method, 1.0) ** last * rng.uniform(1e-6, 9e-6, 3)
                        error = np.array([1e-4, 0, 0]) if method == "joints" else error
                        fixed = {"load_N": load, "truth": truth, "method": method, "error_m": tuple(error)}
                        fixed |= {"deflection_m": tuple(rng.uniform(1e-3, 9e-3, 3))}
                        yield of_one_trial(PoseRow, rng, **fixed)

    trials = table_of(SEEDS, lambda seed: list(rows(seed)))
    return report(Settings(arm="kr500_l480", poses=POSES), SEEDS, trials), trials


def test_errors_of_every_load_truth_and_method_are_those_of_its_poses():
    found, trials = made()
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
        assert shown[row.prediction][row.load_N] == f"{row.rms_um:.2f}"


@pytest.mark.parametrize("winner", ["linear", "secant", "integrated"])
def test_words_name_the_method_of_least_error_whichever_it_is(winner):
    found, _ = made(**{winner: 0.01})
    own = {r.method: r for r in found.numbers["rows"] if (r.load_N, r.truth) == (9700, TRUTHS[0])}
    said = {m: f"{r.rms_um:.2f} um RMS, {r.rms_percent:.2f} % of the deflection" for m, r in own.items()}
    assert found.answer.startswith(f"Least error under 9700 N: {NAMES[winner]}, {said[winner]}. ")
    over = ratio(100 / own["linear"].rms_um)
    assert f"Eq. (6): {said['linear']}; joint stiffness only 100 um, {over} times that." in found.answer
    assert f"leaves {own['joints'].rms_percent:.1f} % of the deflection, with own" in found.claims[1]
    more = "more" if own["linear"].rms_um < 100 else "less"
    assert f"Rigid links cost {more} than neglecting the load" in found.claims[1]


def test_what_is_rounding_is_exact_in_words_and_tables():
    found, _ = made(secant=1e-5, integrated=1e-6)
    assert found.numbers["best"][TRUTHS[0]] == ("secant", "integrated")
    assert "Eq. (7) once and Eq. (7) integrated (equal to 2 %), exact to rounding." in found.answer
    assert grid(found.tables["by_load"]).count("| exact |") == 2


def test_the_figure_draws_the_numbers_of_every_prediction():
    found, _ = made()
    figure = figures(found)["loaded_stiffness.png"]
    assert "kr500_l480 without own weight under 9700 N: " in " ".join(figure.get_suptitle().split())
    [axes] = figure.axes
    assert (unit_in(axes.get_xlabel()), unit_in(axes.get_ylabel())) == ("N", "um")
    drawn = {line.get_label(): line for line in axes.get_lines()}
    light = [LOOKS[f"{name}, {TRUTHS[0]}"].colour for name in NAMES.values()]
    assert light == [LEAST_SQUARES, NOMINAL, GCO, look("Joints", "none").colour]
    for name, own in LOOKS.items():
        rows = [r for r in found.numbers["rows"] if r.prediction == name]
        np.testing.assert_allclose(drawn[name].get_xydata(), [(r.load_N, r.rms_um) for r in rows])
        style = drawn[name].get_color(), drawn[name].get_linestyle()
        assert style == (own.hex, "--" if name.endswith(TRUTHS[1]) else "-")
