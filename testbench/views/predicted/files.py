"""The folder of a prediction, all of it or nothing."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from testbench import files
from testbench.bench.model_folder import digests
from testbench.bench.prediction import Predicted
from testbench.bench.prediction_report import PredictionReport
from testbench.output.run import whole_folder
from testbench.views.page.page import write_page
from testbench.views.predicted.table import write_predictions
from testbench.views.predicted.words import words

COMMAND = "testbench predict"  #: As manifest.json names it.


def write(made: Predicted, report: PredictionReport, asked: Mapping[str, object], out: Path) -> None:
    """All poses, report, figure, recording, page and manifest.json.

    Args:
        made: The prediction.
        report: What there is to say of it.
        asked: What was asked for, as plain data; "model" is the folder of the model.
        out: Folder of the results.

    Raises:
        InputError: When they cannot be written.
    """
    from testbench.views.predicted.page import seen  # thirds of a second
    from testbench.views.recording.run import write_run
    from testbench.views.recording.stream import Header
    from testbench.views.run_figure import overview  # here: importing matplotlib and rerun takes two

    with whole_folder(out) as folder:
        write_predictions(made, folder / "predictions.csv")
        files.write_json(asdict(report), folder / "report.json")
        text = words(report)
        (folder / "report.md").write_text(text.whole(), encoding="utf-8")
        header = Header(COMMAND, json.dumps(asked, sort_keys=True), 0)
        drawn = seen(made, report)
        overview(text, drawn).savefig(folder / "predict.png")
        write_run(folder / "recording.rrd", header, text, drawn, {"Charts": folder / "predict.png"})
        write_page(folder, f"{COMMAND}: {report.file}", text, drawn)
        model = [made.model.arm.rigid.parent]
        files.write_manifest(folder, command=COMMAND, scenario=asked, seeds=range(0), models=digests(model))
