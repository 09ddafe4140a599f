"""A virtual calibration cell for heavy industrial robot arms.

    import testbench as tb

Every name below is imported from its room when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from testbench.arm.folder import load_arm as load_arm
    from testbench.campaign.arm_models import load_model as load_model
    from testbench.campaign.arm_models import save_model as save_model
    from testbench.campaign.campaign import Scenario as Scenario
    from testbench.campaign.campaign import build_cell as build_cell
    from testbench.campaign.campaign import simulate as simulate
    from testbench.campaign.load_dataset import load_dataset as load_dataset
    from testbench.campaign.models import MODELS as MODELS
    from testbench.campaign.plan import plan as plan
    from testbench.campaign.plan_settings import PlanSettings as PlanSettings
    from testbench.correct.compensated import compensate as compensate
    from testbench.correct.newton import Aim as Aim
    from testbench.correct.predicted import predict as predict
    from testbench.correct.stiffness import stiffness as stiffness
    from testbench.data.dataset import Dataset as Dataset
    from testbench.data.program import read_program as read_program
    from testbench.data.read_pairs import read_csv as read_csv
    from testbench.data.read_series import read_series as read_series
    from testbench.data.series import Series as Series
    from testbench.data.write import write_csv as write_csv
    from testbench.data.write import write_program as write_program
    from testbench.errors import BenchError as BenchError
    from testbench.identify import Estimate as Estimate
    from testbench.identify import certify as certify
    from testbench.identify import completed_least_squares as completed_least_squares
    from testbench.identify import gco as gco
    from testbench.identify import intervals as intervals
    from testbench.identify import least_squares as least_squares
    from testbench.identify import make_estimate as make_estimate
    from testbench.identify import paper_gco as paper_gco
    from testbench.identify import reduce as reduce
    from testbench.identify import robust as robust
    from testbench.identify import with_prior as with_prior
    from testbench.identify.absolute.fit import calibrate as calibrate
    from testbench.identify.arm_model import ArmModel as ArmModel
    from testbench.identify.evaluate import deflections as deflections
    from testbench.identify.evaluate import score as score
    from testbench.identify.prior import cad_prior as cad_prior
    from testbench.identify.registered import registered as registered
    from testbench.model.load import Load as Load
    from testbench.model.load import weight as weight
    from testbench.model.structure import Structure as Structure

HOMES = {
    "load_arm": "arm.folder",
    "build_cell": "campaign.campaign",
    "Scenario": "campaign.campaign",
    "simulate": "campaign.campaign",
    "load_dataset": "campaign.load_dataset",
    "MODELS": "campaign.models",
    "Dataset": "data.dataset",
    "read_csv": "data.read_pairs",
    "write_csv": "data.write",
    "Series": "data.series",
    "read_series": "data.read_series",
    "Structure": "model.structure",
    "registered": "identify.registered",
    "least_squares": "identify",
    "completed_least_squares": "identify",
    "gco": "identify",
    "paper_gco": "identify",
    "cad_prior": "identify.prior",
    "with_prior": "identify",
    "robust": "identify",
    "Estimate": "identify",
    "make_estimate": "identify",
    "reduce": "identify",
    "certify": "identify",
    "intervals": "identify",
    "deflections": "identify.evaluate",
    "score": "identify.evaluate",
    "calibrate": "identify.absolute.fit",
    "ArmModel": "identify.arm_model",
    "Load": "model.load",
    "weight": "model.load",
    "predict": "correct.predicted",
    "Aim": "correct.newton",
    "compensate": "correct.compensated",
    "read_program": "data.program",
    "write_program": "data.write",
    "stiffness": "correct.stiffness",
    "load_model": "campaign.arm_models",
    "save_model": "campaign.arm_models",
    "PlanSettings": "campaign.plan_settings",
    "plan": "campaign.plan",
    "BenchError": "errors",
}
"""The module of every public name."""

__all__ = list(HOMES)


if not TYPE_CHECKING:  # a type checker knows every name from above, and no other

    def __getattr__(name: str) -> object:
        if name not in HOMES:
            raise AttributeError(f"testbench has no attribute {name!r}; names are {', '.join(HOMES)}")
        return getattr(import_module(f"{__name__}.{HOMES[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
