"""Names of models, and what they say in words: for headlines, and where a picture names a model first.

Tables and report.json keep the names. This file imports no method, as commands that identify nothing show
names too.
"""

import re
from collections.abc import Mapping

from testbench.model.structure import FULL_ENTRIES, JOINTS_ONLY

WITHOUT_CONE = "LS153"  #: All links and joints by least squares: what the default is without its cone.
EQUAL_FIT, RIDGE, CLIPPED = "MLS56, PSD of equal fit", "Ridge", "Clipped LS"
"""MLS56 held down without a cone: by its free directions, by shrinking, by clipping its eigenvalues."""
FILLED = " + prior"  #: Behind the name of a model with a prior.
IN_PAPER = " (paper)"  #: Behind the name of a model that GCO identifies without a trace weight.

WORDS: Mapping[str, str] = {
    JOINTS_ONLY: "the joints-only model",
    "MLS32": "least squares of beam links, redundancy removed",
    "MLS36": "least squares of links without symmetry",
    "MGCO47": "GCO of two links and joints",
    "MGCO68": "GCO of three links and joints",
    "MGCO69": "GCO of three links and all joints",
    EQUAL_FIT: "least squares of beam links, made conservative",
    RIDGE: "ridge regression of beam links",
    CLIPPED: "clipped least squares of beam links",
    f"{WITHOUT_CONE}{FILLED}": "least squares with the same prior",
    "default": "the default model",
    "+ joint springs": "the model with joint springs",
    "+ links, LS": "the model with links by least squares",
    "+ links, GCO": "the model with links by GCO",
    "+ links, GCO + prior": "the model with links by GCO with prior",
    "+ joint errors": "the model with joint errors",
    "+ joint errors + links": "the model with joint errors and links",
    "+ common pattern": "the model with a common pattern of joint errors",
    "chosen": "the model chosen by cross-validation",
    "geometry alone": "the model with geometry alone",
    "joint springs": "the model with joint springs",
    "joint springs, joint errors": "the model with joint errors",
    "joint springs, links": "the model with links",
    "all, least squares": "the model with all errors by least squares",
    "all, GCO": "the model with all errors by GCO",
    "chosen by cross-validation": "the model chosen by cross-validation",
}
"""Models whose name in words does not follow from their kind; absolute calibration names errors."""
METHODS = {"MLS": "least squares", "LS": "least squares", "MGCO": "GCO", "ALL": "GCO"}
"""Methods by the letters of a name."""
KIND = re.compile(r"(MLS|LS|MGCO|ALL)([1-9]\d*)")
FULL_LINK = len(FULL_ENTRIES)
"""Unknowns of a link in full: counts of models of full links are multiples of it."""


def in_words(name: str) -> str:
    """Describe a model by its name, for a reader who does not know the names.

    Args:
        name: Name of a model of any arm, such as "ALL153 + prior".

    Returns:
        Method, unknowns and prior, such as "GCO of all links and joints with prior"; what is no model of
        ours, such as an estimator of a user, keeps its name.
    """
    if name in WORDS:
        return WORDS[name]
    code = model_code(name)
    ends = {FILLED: " with prior", IN_PAPER: " as in the paper"}
    end = "".join(words for own, words in ends.items() if own in name.removeprefix(code))
    if code in WORDS:
        return WORDS[code] + end
    if kind := KIND.fullmatch(code):
        letters, count = kind.groups()
        links = "beam links" if int(count) % FULL_LINK else "full links"
        unknowns = "all links and joints" if letters in ("ALL", "LS") else links
        return f"{METHODS[letters]} of {unknowns}{end}"
    return name


def model_code(name: str) -> str:
    """Return the name of a model without its prior and without the paper's mark: ALL153."""
    return name.removesuffix(FILLED).removesuffix(IN_PAPER)


def first_mention(name: str) -> str:
    """Describe a model where a sentence names it first: in words, with the name that tables have.

    Args:
        name: Name of a model.

    Returns:
        Such as "GCO of beam links with prior (MGCO56)"; a name that has no words stays alone.
    """
    words, code = in_words(name), model_code(name).partition(",")[0]
    return f"{words} ({code})" if words != name and KIND.fullmatch(code) else words


def row_words(name: str) -> str:
    """Describe a model beside its row or line of a picture: `first_mention` without its first words.

    These are "the", or "the model with".

    Args:
        name: Name of a model.

    Returns:
        The words.
    """
    return first_mention(name).removeprefix("the model with ").removeprefix("the ")
