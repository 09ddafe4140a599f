"""testbench compare: what differs is said, what is chance is called so, wrong folders are one line."""

import json
import shutil
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pytest
from made_up_run import REPORT
from run_here import check_folder, do, fine, numbers_alone, refused

from testbench.arm.folder import find_arm
from testbench.cli.compare import report
from testbench.model.structure import PAPER_GCO_METHOD
from testbench.report.colours import look
from testbench.report.join import differ, leaves
from testbench.report.schema import Table
from testbench.report.schema import columns as quantities
from testbench.report.table import Trials, merged
from testbench.runs import manifest as files
from testbench.runs.manifest import digests
from testbench.runs.spread import Spread
from testbench.runs.store import arrow_table, write_trials

NAMES = {"Joints": "none", "MLS56": "none", "MGCO56": "psd", "MGCO56 + prior": "psd", "ALL153 + prior": "psd"}
SIZES = dict(zip(NAMES, (0.3, 1.4, 0.6, 0.2, 0.1), strict=True))
"""Error of every model over the workspace, typical [mm]."""


@dataclass(frozen=True)
class Errors:
    rms_mm: float


@dataclass(frozen=True)
class ModelRow:
    name: str
    structure: str
    constraint: str
    prior: bool
    workspace: Errors
    identification: Errors


def row(name, mm, seed):
    """One model of one seed, its error over the workspace given; the other one is the seed's."""
    structure = name.removesuffix(" + prior")
    fit = float(np.random.default_rng([seed, *name.encode()]).uniform(0.1, 0.2))
    return ModelRow(name, structure, NAMES[name], name != structure, Errors(mm), Errors(fit))


def calibration(out, seeds, scale=1.0, sigma=50e-6):
    """The folder of a calibration as a study leaves it, but made up: errors differ widely from seed to seed.

    Args:
        out: The folder.
        seeds: Of its trials; equal ones have equal errors.
        scale: Of the errors over the workspace, or of each model by name.
        sigma: Noise of a reading [m].
    """
    sizes = {n: mm * (scale[n] if isinstance(scale, dict) else scale) for n, mm in SIZES.items()}
    wide = {seed: np.exp(np.random.default_rng(seed).normal()) for seed in seeds}
    trials = [(s, [row(n, float(mm * wide[s]), s) for n, mm in sizes.items()]) for s in seeds]
    out.mkdir()
    write_trials(out / "trials.parquet", arrow_table(ModelRow, trials))
    models = merged(Trials.read(out / "trials.parquet").drop("seed"), "name")
    table = Table(quantities("name workspace.rms_mm identification.rms_mm"), models)
    numbers = {"models": models, "recommended": "ALL153 + prior"}
    files.write_json(replace(REPORT, numbers=numbers, tables={"models": table}).json(), out / "report.json")
    scenario = {"sigma": sigma, "station": {"lower": [1.5, -0.9, 1.1]}}
    plain = {"true_arm": "family" if len(seeds) > 20 else "cast", "first": seeds[0], "scenario": scenario}
    arms, script = digests([find_arm("kr500_l480")]), "scenarios/gravity_calibration.py"
    files.write_manifest(out, command=script, scenario=plain, seeds=seeds, models=arms)
    return out


def changed(run, out, name, change):
    """A copy of a run with something changed in one of its JSON files."""
    shutil.copytree(run, out)
    found = json.loads((out / name).read_text())
    change(found)
    (out / name).write_text(json.dumps(found))
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def one(folder):
    """One seed."""
    return calibration(folder / "one", range(1, 2))


@pytest.fixture(scope="module")
def many(folder):
    """Many seeds."""
    return calibration(folder / "many", range(1, 21))


def said(tmp_path, *runs, views=numbers_alone):
    """What the command says of runs, on one line, and its report."""
    with views():
        done = do("compare", *runs, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    words, places, _ = done.stdout.partition("\nA: ")
    assert places
    assert max(map(len, words.splitlines())) <= 80
    return " ".join(done.stdout.split()), json.loads((tmp_path / "out" / "report.json").read_text())


def test_the_same_run_twice_is_alike_and_nothing_differs(many, tmp_path, legible):
    text, report = said(tmp_path, many, many, views=legible)
    assert text.startswith("Tie")
    assert (report["inputs"], report["equal"]) == ([], True)
    assert {own["verdict"] for own in report["models"]} == {"same"}
    check_folder(tmp_path / "out", "compare.png")


def test_every_model_has_the_look_that_its_run_gives_it(one):
    run = files.read_run(one)
    rows = [dict(own) for own in run.report["models"]]
    papers = {**rows[2], "name": "MGCO56 (paper)", "method": PAPER_GCO_METHOD}
    run = replace(run, report={**run.report, "models": [*rows, papers]})
    looks = report(run, run).tables["models"].looks
    assert looks["MGCO56 (paper)"] == look("MGCO56", "psd", filling="paper")
    assert looks["MGCO56"] == look("MGCO56", "psd")
    assert looks["MGCO56 + prior"] == look("MGCO56", "psd", prior=True)


def test_a_difference_far_below_the_spread_is_seen_in_pairs_of_equal_seeds(many, folder, tmp_path):
    worse = calibration(folder / "worse", range(1, 21), 1.3, 100e-6)
    text, report = said(tmp_path, many, worse)
    assert text.startswith("Do not use B: the error of A is 1.3x lower (20 trials, 95 %")
    badge = report["badge"]
    assert (badge["winner"], badge["rival"], badge["n"], badge["verdict"]) == ("A", "B", 20, "do not use")
    assert badge["interval"] == [pytest.approx(1.3)] * 2
    for runs, code in (((many, worse), 1), ((worse, many), 0), ((many, many), 0)):
        with numbers_alone():
            done = do("compare", *runs, "--out", tmp_path / "out", "--force", "--fail-if-worse")
        assert (done.returncode, done.stderr) == (code, "")
    assert report["inputs"] == [{"what": "settings.scenario.sigma", "a": "5e-05", "b": "0.0001"}]
    [own] = [m for m in report["models"] if (m["name"], m["kind"]) == ("MLS56", "workspace")]
    assert own["by"] == "pairs"
    assert (own["pairs"], own["larger"], own["smaller"], own["verdict"]) == (20, 20, 0, "larger")
    assert own["ratio"]["p05"] == pytest.approx(1.3)


def test_the_same_difference_between_other_seeds_is_within_the_spread(many, folder, tmp_path):
    other = calibration(folder / "other", range(101, 121), 1.25)
    _, report = said(tmp_path, many, other)
    own = [own for own in report["models"] if own["kind"] == "workspace"]
    assert {(one["by"], one["verdict"]) for one in own} == {("spreads", "tie")}
    assert {"what": "seeds", "a": "1 to 20", "b": "101 to 120"} in report["inputs"]
    far = calibration(folder / "far", range(101, 121), 100.0)
    assert {own["verdict"] for own in said(tmp_path, many, far)[1]["models"][:5]} == {"larger"}


def test_a_planted_number_is_found_and_one_seed_has_no_spread(one, tmp_path):
    def plant(report):
        report["models"][2]["workspace"]["rms_mm"] *= 3

    _, report = said(tmp_path, one, changed(one, tmp_path / "planted", "report.json", plant))
    assert report["inputs"] == []
    [own] = [p for p in report["models"] if p["verdict"] != "same"]
    assert (own["name"], own["kind"], own["by"]) == ("MGCO56", "workspace", "one")


def test_files_of_the_arm_versions_and_commit_are_told_apart_and_folders_by_their_order(one, tmp_path):
    def plant(manifest):
        arm = manifest["models"].pop("kr500_l480")
        manifest["models"]["mine"] = {**arm, "elastic.toml": "0" * 64, "picture.png": "0" * 64}
        manifest["versions"]["numpy"] = "1.0"
        manifest["versions"]["another"] = "2.0"
        manifest["git"] = "f" * 40 + "-dirty"
        manifest["scenario"]["scenario"]["station"]["lower"][0] = 2.5

    _, report = said(tmp_path, one, changed(one, tmp_path / "other", "manifest.json", plant))
    assert {own["what"]: own["b"] for own in report["inputs"]} == {
        "settings.scenario.station.lower": "2.5, -0.9, 1.1",
        "arm 1.folder": "mine",
        "arm 1.elastic.toml": "0" * 60,
        "version.numpy": "1.0",
        "version.another": "2.0",
        "commit": "f" * 40 + "-dirty",
    }


def test_of_runs_without_models_the_numbers_of_the_same_keys_are_compared(tmp_path):
    first = tmp_path / "first"
    first.mkdir()
    numbers = {"error": {"rms_mm": 7.99, "p95_mm": 12.5}, "solve_seconds": 1.0, "list": [1.0], "yes": True}
    files.write_json(numbers, first / "report.json")
    files.write_manifest(first, command="testbench predict", scenario={}, seeds=range(0), models={})

    def plant(report):
        report["error"]["rms_mm"] *= 3
        report["solve_seconds"] = 9.0

    text, report = said(tmp_path, first, changed(first, tmp_path / "planted", "report.json", plant))
    assert "1 of 2 numbers differ by more than 2 %." in text
    assert report["numbers"][0]["ratio"] == pytest.approx(3)
    page = (tmp_path / "out" / "report.md").read_text()
    assert "| error.rms mm | 7.99 | 23.97 | 3.00 |" in page


def test_fits_of_ones_own_runs_are_compared_by_models_with_a_study(one, tmp_path):
    def only(report):
        models = [{"name": own["name"], "identification": own["identification"]} for own in report["models"]]
        report.clear()
        report["models"] = models

    fits = changed(one, tmp_path / "fits", "report.json", only)
    settings = {"sigma_um": None, "load": None}
    fits = changed(
        fits,
        tmp_path / "identify",
        "manifest.json",
        lambda m: m.update(command="testbench identify", scenario=settings),
    )
    _, report = said(tmp_path, one, fits)
    assert {pair["kind"] for pair in report["models"]} == {"identification"}
    assert report["inputs"][0] == {
        "what": "command",
        "a": "scenarios/gravity_calibration.py",
        "b": "testbench identify",
    }
    counted = report["inputs"][-1]
    assert counted["what"] == "number of settings that only one run has"
    study = json.loads((one / "manifest.json").read_text())["scenario"]
    assert (int(counted["a"]), counted["b"]) == (len([*leaves(study)]), "2")
    assert not [own for own in report["inputs"] if own["what"].startswith("settings.")]


def broken(text):
    return lambda run: (run / "report.json").write_text(text)


def with_error(text):
    return broken(f'{{"models": [{{"name": "a", "check": {{"rms_mm": {text}}}}}]}}')


HOSTILE = {
    "too deep": (broken("[" * 100_000), "report.json: not JSON: recursion limit"),
    "infinite": (broken('{"a": {"b": Infinity}}'), "report.json: not JSON: expected value at line 1"),
    "beyond": (broken('{"a": {"b": 1e999}}'), "report.json: a.b: expected a finite number, got inf"),
    "integer": (broken(f'{{"a": 1{"0" * 400}}}'), "report.json: a: expected an integer of 64 bits"),
    "size": (with_error("1e300"), "models: a, check: expected an RMS error of 0 to 1e+09 mm, got 1e+300"),
    "sign": (with_error("-1.0"), "models: a, check: expected an RMS error of 0 to 1e+09 mm, got -1.0"),
    "word": (with_error('{"median": "x", "p05": 1, "p95": 2}'), "models: a, check, median: "),
    "values": (with_error('{"median": 1, "p05": 1, "p95": 2, "values": 3}'), "models: a, check, values: "),
    "bytes": (lambda run: (run / "report.json").write_bytes(b"\xff"), "report.json: byte 1: expected UTF-8"),
    "no table": (broken("[]"), "report.json: expected a table of keys, got list"),
    "no report": (lambda run: (run / "report.json").unlink(), "report.json: cannot be read"),
    "no manifest": (lambda run: (run / "manifest.json").unlink(), "manifest.json: cannot be read"),
    "manifest": (
        lambda run: (run / "manifest.json").write_text("{}"),
        "manifest.json: command: this key is missing",
    ),
    "trials": (lambda run: (run / "trials.parquet").write_bytes(b"PAR1"), "trials.parquet: expected trials"),
    "errors that are words": (
        lambda run: write_trials(
            run / "trials.parquet",
            pa.table({"seed": [1], "name": ["MLS56"], "workspace.rms_mm": ["x"]}),
        ),
        "trials.parquet: expected trials",
    ),
}


@pytest.mark.parametrize("fault", HOSTILE)
def test_a_broken_folder_is_one_line_that_names_the_file_and_leaves_nothing(many, fault, tmp_path):
    run = shutil.copytree(many, tmp_path / "run")
    spoil, words = HOSTILE[fault]
    spoil(run)
    line = refused("compare", many, run, "--out", tmp_path / "out", said=words, below=tmp_path)
    assert line.startswith(f"error: {run}")


def test_texts_of_a_report_steer_neither_page_nor_terminal(one, tmp_path):
    def steer(report):
        report["models"][0]["name"] = report["models"][0]["name"] + "\x1b[2J"

    runs = [changed(one, tmp_path / name, "report.json", steer) for name in "ab"]
    printed = fine("compare", *runs, "--out", tmp_path / "out")
    written = [(tmp_path / "out" / name).read_text() for name in ("report.html", "report.md", "report.json")]
    assert all("\ufffd[2J" in text for text in (printed, *written[:2]))
    assert not any("\x1b" in text for text in (printed, *written))


def test_runs_with_nothing_in_common_are_one_line(one, tmp_path):
    def bare(report):
        report.clear()
        report["models"] = [{"name": "a", "check": {"rms_mm": "x"}}]

    said = "expected runs with a model or a number in common"
    other = changed(one, tmp_path / "other", "report.json", bare)
    refused("compare", one, other, "--out", tmp_path / "out", said=said, below=tmp_path)


WIDE, LOW = Spread(1.0, 0.5, 2.0), Spread(0.3, 0.2, 0.4)


@pytest.mark.parametrize(
    ("a", "b", "verdict", "by"),
    [
        (1.0, 1.0 + 1e-9, "same", "one"),
        (1.0, 1.01, "tie", "one"),
        (1.0, 0.9, "smaller", "one"),
        (-1.0, 1.0, "larger", "one"),
        (0.0, 0.0, "same", "one"),
        (WIDE, Spread(1.9, 1.5, 3.0), "tie", "spreads"),
        (WIDE, LOW, "smaller", "spreads"),
        (LOW, WIDE, "larger", "spreads"),
        (WIDE, 1.5, "tie", "one"),
        (WIDE, 3.0, "larger", "one"),
    ],
)
def test_a_difference_counts_beyond_the_spread(a, b, verdict, by):
    found = differ(a, b)
    assert (found.verdict, found.by) == (verdict, by)


def test_pairs_whose_ratios_lie_on_both_sides_are_alike_and_one_pair_is_none():
    ours = dict.fromkeys(range(10), 1.0)
    theirs = {seed: 0.8 if seed % 2 else 1.1 for seed in ours}
    found = differ(1.0, 1.0, ours, theirs)
    assert (found.verdict, found.by, found.smaller, found.larger) == ("tie", "pairs", 5, 5)
    assert differ(1.0, 2.0, {1: 1.0}, {1: 2.0}).by == "one"
    assert differ(WIDE, LOW, {1: 1.0, 2: 1.0}, {1: 2.0, 3: 1.0}).by == "spreads"


def test_one_seed_beside_several_is_refused_unless_asked_for_and_has_no_spread(one, many, tmp_path):
    asked = "expected one seed in both runs or several in both (one seed has no spread), got"
    line = refused("compare", one, many, "--out", tmp_path / "out", said=asked, below=tmp_path)
    assert "with 20 seeds; --anyway compares them" in line
    _, report = said(tmp_path, one, many, "--anyway")
    assert {own["by"] for own in report["models"]} == {"one"}


def test_runs_of_other_true_arms_are_refused_unless_asked_for(tmp_path):
    """One seed is one true arm; of all seeds of the family the arms are the same."""
    many = [calibration(tmp_path / f"many_{k}", range(k, k + 14)) for k in (1, 15)]
    with numbers_alone():
        fine("compare", *many, "--out", tmp_path / "of_many")
    single = [calibration(tmp_path / f"single_{k}", range(k, k + 1)) for k in (1, 2)]
    asked = ("compare", *single, "--out", tmp_path / "of_single")
    said = "expected the same true arms (and the same seed, if each run has one), got"
    refused(*asked, said=said, below=tmp_path)
    with numbers_alone():
        fine(*asked, "--anyway")


def test_a_file_in_place_of_a_folder_is_no_run(one, tmp_path):
    said = "report.json: expected the folder of a run, with manifest.json"
    refused("compare", one, one / "report.json", "--out", tmp_path / "out", said=said, below=tmp_path)
