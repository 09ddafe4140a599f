"""The command of a study: trials on the engine, then its report and every view of it, all or nothing.

Every study has its headline in the same words: the numbers behind its badge, and warnings.
"""

import json
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import typer
from pydantic import TypeAdapter
from rich.console import Console

from testbench.errors import BenchError, InputError, Interrupted
from testbench.plant.true_arms import true_arms
from testbench.progress import tell
from testbench.report import terminal
from testbench.report.badge import Badge
from testbench.report.figure import Figure, headed, save
from testbench.report.markdown import Markdown, capital, titled
from testbench.report.page import write_page
from testbench.report.recording.run import write_run
from testbench.report.recording.stream import RecordingHeader
from testbench.report.report import FAILURES, Report, failures, fitted, say, with_failures
from testbench.report.scene import PageContent, typical_first
from testbench.report.schema import Table, TableColumn
from testbench.report.table import Row, Trials
from testbench.runs import manifest as files
from testbench.runs.engine import Backend, check_address, check_certificates, on_cluster, on_cores, run_study
from testbench.runs.interrupt import RESULTS_KEPT
from testbench.runs.manifest import digests
from testbench.runs.spread import MIN_PERCENTILE_TRIALS, middle
from testbench.runs.store import TrialPlan, open_store, write_parquet
from testbench.runs.whole import claim_folder, whole_folder
from testbench.studies.study import AnyStudy, Everywhere, P, Run
from testbench.workflows.model_names import in_words
from testbench.workflows.options import Common, takes
from testbench.workflows.own_estimator import EstimatorOptions, digests_of

# --- Trials of a command: where they run, and a bar that shows how many are done ----------------------------


def choose_backend(common: Common) -> Backend:
    """Choose the backend that a command line asks for.

    Raises:
        BenchError: When it asks for both, or the cluster's address or certificates are refused.
    """
    if common.cluster is None:
        return partial(on_cores, workers=common.workers)
    if common.workers is not None:
        raise BenchError("--workers counts processes of this machine and cannot be combined with --cluster")
    check_address(common.cluster, insecure=common.insecure)
    check_certificates(common.cluster)
    return partial(on_cluster, address=common.cluster, insecure=common.insecure)


def show_progress(counts: Iterator[int], total: int, words: str, *, kept: bool = True) -> None:
    """Run a study; whoever follows is told how many trials are done.

    Args:
        counts: Yields the number of finished trials.
        total: Number of all trials.
        words: Kind of trial.
        kept: Whether finished trials are stored.

    Raises:
        Interrupted: After Ctrl-C; says what is stored, where trials are `kept`.
    """
    done = next(counts, 0)
    try:
        tell(words, done, total)
        for done in counts:
            tell(words, done, total)
    except KeyboardInterrupt as err:
        if not done or not kept:
            raise
        stored = f"at least {done} of {total} {words} are stored: --resume continues"
        raise Interrupted(f"{RESULTS_KEPT}; {stored}") from err


# --- The command of a study: trials on the engine, then its report and every view of it, all or nothing -----

NO_ESTIMATORS = EstimatorOptions()  #: No estimator of one's own.
PREPARED = "prepared"  #: Folder in a run's, of what is made once for all trials.


def app(study: AnyStudy) -> typer.Typer:
    """Make a program of the study with its flags."""
    found = typer.Typer(add_completion=False)
    found.command(help=study.about)(as_command(study))
    return found


def as_command(study: AnyStudy) -> Any:
    """Make a command of the study with its flags."""

    @takes(Common, study.options, *([EstimatorOptions] if study.models else []), draws=True)
    def body(common: Common, options: Any, estimators: EstimatorOptions = NO_ESTIMATORS) -> None:
        run(study, common, options, terminal.plain_console(), estimators)

    return body


def run(
    study: AnyStudy,
    common: Common,
    options: Any,
    console: Console,
    estimators: EstimatorOptions = NO_ESTIMATORS,
) -> None:
    """Do the trials, write the folder, print the answer.

    Args:
        study: The study.
        common: Flags that all studies have.
        options: Flags of the command line.
        console: Where to print.
        estimators: Estimators of the user.

    Raises:
        BenchError: When a flag is wrong, a trial cannot be done or the folder cannot be written.
    """
    start, out = time.perf_counter(), common.out or Path("runs") / study.name
    seeds = _seeds(study, common)
    settings = study.settings(options, common.quick, seeds)
    plain, estimator_sources = TypeAdapter(type(settings)).dump_python(settings, mode="json"), estimators.own
    plain |= {"own": {each.name: asdict(each) for each in estimator_sources}} if estimator_sources else {}
    arms = study.arms(settings)
    sha = digests_of((*study.own(settings), *estimator_sources))
    scenario = {"settings": plain, "models": digests(arms), **sha}
    script = f"scenarios/{study.name}.py"
    experiment = TrialPlan(study.name, scenario, seeds)
    backend, remote = choose_backend(common), common.cluster is not None
    with (
        claim_folder(out, script, inputs=arms, force=common.force),
        open_store(out, experiment, row=study.row, resume=common.resume) as store,
        whole_folder(out) as folder,
    ):
        if study.prepare:
            settings = study.prepare(settings, _everywhere(experiment, backend, common, out / PREPARED))
        work = study.work(settings, estimator_sources)
        show_progress(run_study(work, store, backend, size=study.size, remote=remote), len(seeds), "trials")
        report = _reported(study, settings, seeds, Trials.read(write_parquet(store, folder)))
        header = RecordingHeader(study.name, json.dumps(plain, sort_keys=True), seeds[0])
        figures = _write(study, Run(settings, seeds, report, folder), header)
        seconds = time.perf_counter() - start
        files.write_log(folder)
        files.write_manifest(
            folder,
            command=script,
            scenario=plain,
            seeds=seeds,
            models=digests(arms),
            tables=(true_arms,),
            seconds=seconds,
            **sha,
        )
    console.print(terminal.as_plain(report.title))
    terminal.print_words(console, report, _shown(study, report))
    terminal.print_places(console, out, figures=figures, data=study.data)


def _reported(study: AnyStudy, settings: Any, seeds: range, trials: Trials) -> Report:
    """What trials say, without those in which an estimator of one's own failed; and which these are."""
    lost = failures(trials, study.models) if study.models else {}
    report = study.report(settings, seeds, fitted(trials, study.models, lost) if lost else trials)
    return with_failures(report, lost, len(seeds)) if lost else report


def _write(study: AnyStudy, found: Run[Any], header: RecordingHeader) -> list[str]:
    """Numbers, words, figures, and what else the study leaves; names of the figures."""
    report, folder = found.report, found.folder
    files.write_json(report.json(), folder / "report.json")
    (folder / "report.md").write_text(report.whole(), encoding="utf-8")
    figures = headed_figures(study, report)
    for name, figure in figures.items():
        save(figure, folder / name)
    if "data_file" in (first := found.first):
        (folder / study.data).write_text(next(filter(None, first["data_file"])), encoding="utf-8")
    page = typical_first(replace(study.write(found) or PageContent(), tables=_shown(study, report)))
    write_run(folder / "recording.rrd", header, report, page, figures)
    write_page(folder, titled(study.name), report, page)
    return list(figures)


def headed_figures(study: AnyStudy, report: Report) -> dict[str, Figure]:
    """Draw the figures of a report by their names; the badge of its run entitles the first one.

    Args:
        study: The study.
        report: The report.

    Returns:
        The figures.
    """
    badge = terminal.as_plain(report.block("badge"))
    drawn = enumerate(study.figures(report).items())
    return {name: headed(figure, "" if k else badge, report.winner) for k, (name, figure) in drawn}


def _shown(study: AnyStudy, report: Report) -> list[Table]:
    """What terminal and page show."""
    own = [FAILURES] if study.models and FAILURES in report.tables else []
    return [report.tables[name] for name in (*study.printed, *own)]


def _everywhere(experiment: TrialPlan, backend: Backend, common: Common, folder: Path) -> Everywhere[Any]:
    """What comes before the trials, on the same workers, stored in a folder of its own."""

    def everywhere(work: Callable[[int], P], pieces: int, row: type[P]) -> list[P]:
        if folder.is_symlink():
            raise InputError(folder, "", "expected a folder of this run, got a link; move it away")
        plans = replace(experiment, name=f"{experiment.name}: plans", seeds=range(pieces))
        remote = common.cluster is not None
        with open_store(folder, plans, row=row, resume=common.resume) as store:
            counts = run_study(partial(_each, work), store, backend, remote=remote)
            show_progress(counts, pieces, "plans")
            write_parquet(store, folder)
            return store.rows()

    return everywhere


def _each(work: Callable[[int], P], numbers: Sequence[int]) -> list[list[P]]:
    """Rows of some pieces; a module's function, as workers get it by its name."""
    return [[work(k)] for k in numbers]


def _seeds(study: AnyStudy, common: Common) -> range:
    count = common.seeds or study.seeds[0]
    return range(common.seed, common.seed + (min(count, study.seeds[1]) if common.quick else count))


READ = Markdown("docs/study_tables.md says what tables and columns mean.")
NOTHING = Markdown("Nothing is compared.")
FEW = Markdown(f"Fewer than {MIN_PERCENTILE_TRIALS} trials: the tables show ranges in place of percentiles.")


def headline(badge: Badge | None, table: Table) -> Markdown:
    """State what the winner of a badge and its strongest rival reach, in the column that the table is about.

    Args:
        badge: Names both and holds the verdict.
        table: A row for each; numbers over several trials stand by their median.

    Returns:
        One sentence.
    """
    if badge is None:
        return NOTHING
    name, value = table.columns[0], _about(table)
    rows = {name.cell(row): row for row in table.rows}
    told = []
    for own in (badge.winner, badge.rival):
        if own in rows:
            found = value.value(rows[own])
            text = value.text(found if isinstance(found, str) else middle(found))
            unit = f" {value.unit}" if value.unit and text[-1].isdigit() else ""
            told.append(f"{in_words(own)} {text}{unit}")
    return say("{what}: {told}.", what=capital(value.heading), told="; ".join(told))


def _about(table: Table) -> TableColumn:
    """The column of the headline: the last one unless the table names it."""
    return next((c for c in table.columns if c.key == table.headline), table.columns[-1])


def warnings(trials: Trials, name: str = "name") -> list[Markdown]:
    """Warn of models that were not solved in some trials, and of too few trials for percentiles.

    Args:
        trials: Rows of models and trials.
        name: Column of the model.

    Returns:
        The warnings.
    """
    each = zip(trials[name].tolist(), trials["status"].tolist(), strict=True)
    lost = Counter(own for own, word in each if word not in (None, "solved"))
    few = [FEW] if len(trials.values("seed")) < MIN_PERCENTILE_TRIALS else []
    said = "Not solved in {lost} of {fits} fits: {name}."
    names = trials[name].tolist()
    return [*(say(said, Row(name=n, lost=k, fits=names.count(n))) for n, k in lost.items()), *few]
