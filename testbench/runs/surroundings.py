"""Protection from settings in the environment and the working folder that would steer libraries.

Matplotlib reads `matplotlibrc` of the working folder, which may be a stranger's: it says how large a picture
is, and which programs set its letters.
"""

import importlib
import os
import sys
import warnings
from pathlib import Path

import numpy as np

RECORDINGS = (
    "RERUN_FLUSH",
    "RERUN_CHUNK",
)  #: Begin the names of what cuts recordings otherwise; RERUN=off none.
SETTINGS = "matplotlibrc"
UNUSED = "f2py", "testing"  #: Of numpy: scipy imports all it has, and these take a tenth of a second.


def undisturbed() -> None:
    """Have recordings and figures as they are meant, libraries' warnings unsaid; before any is imported.

    Warnings name lines of code, which are nothing for people at a terminal: `python -W` asks for them.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    for name in [name for name in os.environ if name == "RERUN" or name.startswith(RECORDINGS)]:
        del os.environ[name]
    os.environ["MPLBACKEND"] = "agg"
    os.environ["MUJOCO_GL"] = "disable"  # nothing is drawn by MuJoCo; a driver that lacks is an error
    np.__all__ = [name for name in np.__all__ if name not in UNUSED]
    getattr(np, "__numpy_submodules__", set()).difference_update(UNUSED)
    if os.path.lexists(SETTINGS):
        _import_elsewhere("matplotlib")


def _import_elsewhere(package: str) -> None:
    here = Path.cwd()
    os.chdir("/")
    try:
        importlib.import_module(package)
    finally:
        os.chdir(here)
