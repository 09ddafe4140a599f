"""A virtual calibration cell for heavy industrial robot arms.

    import testbench as tb

    cell = tb.build_cell("kr500_l480")  # an arm: its model, and a simulated robot
    campaign = tb.simulate(cell)  # or tb.read_csv("runs.csv", cell.arm)
    structure = tb.MODELS["ALL153"](cell).structure  # the unknown compliances
    method = tb.with_prior(tb.gco, tb.cad_prior(cell.arm))
    estimate = method(cell.vjm, structure, campaign.identification)
    tb.predict(cell.model(estimate), campaign.check.q, [tb.weight(cell.vjm, 460.3)])

Units are SI; six-vectors have the translation first. A wrong argument raises `BenchError`. Every name below
is imported from its module when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from testbench.arm.folder import Arm as Arm
    from testbench.arm.folder import load_arm as load_arm
    from testbench.correct.compensated import Compensated as Compensated
    from testbench.correct.compensated import compensate as compensate
    from testbench.correct.newton import Aim as Aim
    from testbench.correct.predicted import Prediction as Prediction
    from testbench.correct.predicted import Stiffness as Stiffness
    from testbench.correct.predicted import predict as predict
    from testbench.correct.predicted import stiffness as stiffness
    from testbench.data.dataset import Dataset as Dataset
    from testbench.data.dataset import Series as Series
    from testbench.errors import BenchError as BenchError
    from testbench.files.program import Program as Program
    from testbench.files.program import read_program as read_program
    from testbench.files.read_pairs import read_csv as read_csv
    from testbench.files.read_series import SeriesExport as SeriesExport
    from testbench.files.read_series import read_series as read_series
    from testbench.files.write import write_csv as write_csv
    from testbench.files.write import write_program as write_program
    from testbench.identify.absolute.fit import Calibration as Calibration
    from testbench.identify.absolute.fit import calibrate as calibrate
    from testbench.identify.base_frame import register_dataset as register_dataset
    from testbench.identify.conic import certify as certify
    from testbench.identify.estimate import Certificate as Certificate
    from testbench.identify.estimate import DeflectionErrors as DeflectionErrors
    from testbench.identify.estimate import Estimate as Estimate
    from testbench.identify.estimate import deflections as deflections
    from testbench.identify.estimate import make_estimate as make_estimate
    from testbench.identify.estimate import score as score
    from testbench.identify.method import Method as Method
    from testbench.identify.method import completed_least_squares as completed_least_squares
    from testbench.identify.method import gco as gco
    from testbench.identify.method import least_squares as least_squares
    from testbench.identify.method import paper_gco as paper_gco
    from testbench.identify.method import robust as robust
    from testbench.identify.method import with_prior as with_prior
    from testbench.identify.posterior import ArmModel as ArmModel
    from testbench.identify.posterior import Intervals as Intervals
    from testbench.identify.posterior import intervals as intervals
    from testbench.identify.prior import Prior as Prior
    from testbench.identify.prior import PriorUncertainty as PriorUncertainty
    from testbench.identify.prior import cad_prior as cad_prior
    from testbench.identify.regression import Regression as Regression
    from testbench.identify.regression import reduce as reduce
    from testbench.model.laws import JointLaw as JointLaw
    from testbench.model.laws import NominalDeflections as NominalDeflections
    from testbench.model.laws import joint_laws as joint_laws
    from testbench.model.load import Load as Load
    from testbench.model.load import weight as weight
    from testbench.model.structure import Structure as Structure
    from testbench.model.vjm import Vjm as Vjm
    from testbench.plant.disturbance import SpringEffects as SpringEffects
    from testbench.plant.true_arms import TrueArm as TrueArm
    from testbench.plant.true_arms import draw_from_family as draw_from_family
    from testbench.plant.true_arms import true_arms as true_arms
    from testbench.workflows.arm_models import load_model as load_model
    from testbench.workflows.arm_models import save_model as save_model
    from testbench.workflows.campaign import Campaign as Campaign
    from testbench.workflows.campaign import Scenario as Scenario
    from testbench.workflows.campaign import simulate as simulate
    from testbench.workflows.campaign import true_cell as true_cell
    from testbench.workflows.cell import Cell as Cell
    from testbench.workflows.cell import build_cell as build_cell
    from testbench.workflows.load_dataset import PublicCampaign as PublicCampaign
    from testbench.workflows.load_dataset import load_dataset as load_dataset
    from testbench.workflows.models import MODELS as MODELS
    from testbench.workflows.models import Model as Model
    from testbench.workflows.plan import Planned as Planned
    from testbench.workflows.plan import plan as plan
    from testbench.workflows.plan_settings import PlanSettings as PlanSettings

PUBLIC = {
    "arm.folder": "load_arm Arm",
    "correct.compensated": "compensate Compensated",
    "correct.newton": "Aim",
    "correct.predicted": "predict stiffness Prediction Stiffness",
    "data.dataset": "Dataset Series",
    "errors": "BenchError",
    "files.program": "read_program Program",
    "files.read_pairs": "read_csv",
    "files.read_series": "read_series SeriesExport",
    "files.write": "write_csv write_program",
    "identify.absolute.fit": "calibrate Calibration",
    "identify.base_frame": "register_dataset",
    "identify.conic": "certify",
    "identify.estimate": "Estimate make_estimate deflections score Certificate DeflectionErrors",
    "identify.method": "least_squares completed_least_squares gco paper_gco with_prior robust Method",
    "identify.posterior": "intervals ArmModel Intervals",
    "identify.prior": "cad_prior Prior PriorUncertainty",
    "identify.regression": "reduce Regression",
    "model.laws": "joint_laws JointLaw NominalDeflections",
    "model.load": "Load weight",
    "model.structure": "Structure",
    "model.vjm": "Vjm",
    "plant.disturbance": "SpringEffects",
    "plant.true_arms": "true_arms draw_from_family TrueArm",
    "workflows.arm_models": "load_model save_model",
    "workflows.campaign": "Scenario simulate true_cell Campaign",
    "workflows.cell": "build_cell Cell",
    "workflows.load_dataset": "load_dataset PublicCampaign",
    "workflows.models": "MODELS Model",
    "workflows.plan": "plan Planned",
    "workflows.plan_settings": "PlanSettings",
}
"""The public names of every module."""
HOMES = {name: module for module, names in PUBLIC.items() for name in names.split()}
"""The module of every public name."""

__all__ = list(HOMES)


if not TYPE_CHECKING:  # a type checker knows every name from above, and no other

    def __getattr__(name: str) -> object:
        if name not in HOMES:
            raise AttributeError(f"testbench has no attribute {name!r}; names are {', '.join(HOMES)}")
        return getattr(import_module(f"{__name__}.{HOMES[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
