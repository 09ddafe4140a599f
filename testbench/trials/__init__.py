"""The engine of trials: independent trials of a study on all cores or a cluster, stored as they come."""

from testbench.trials.chunk import Backend, Work
from testbench.trials.cluster import on_cluster
from testbench.trials.engine import run_study
from testbench.trials.experiment import Experiment
from testbench.trials.local import on_cores
from testbench.trials.store import TrialStore, open_store, write_parquet

__all__ = [
    "Backend",
    "Experiment",
    "TrialStore",
    "Work",
    "on_cluster",
    "on_cores",
    "open_store",
    "run_study",
    "write_parquet",
]
