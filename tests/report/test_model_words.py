"""Models in words: who does not know their names reads what they are; every model has its own words."""

import pytest

from testbench.workflows.model_names import first_mention, in_words, row_words
from testbench.workflows.models import DEFAULT, MODELS

WORDS = {
    "Joints": "the joints-only model",
    "Joints + prior": "the joints-only model with prior",
    "MLS56": "least squares of beam links",
    "MLS56 + prior": "least squares of beam links with prior",
    "MGCO56": "GCO of beam links",
    "MGCO56 (paper)": "GCO of beam links as in the paper",
    "MGCO64": "GCO of beam links",  # of seven joints
    "MGCO147": "GCO of full links",
    "MGCO168": "GCO of full links",
    "ALL153": "GCO of all links and joints",
    "ALL175 + prior": "GCO of all links and joints with prior",
    "LS153 + prior": "least squares with the same prior",
    "default": "the default model",
    "mine.py:best": "mine.py:best",
    "MGCO56, LS + prior": "MGCO56, LS + prior",  # another method than its first word says
    "corrected program": "corrected program",
    "+ links, GCO + prior": "the model with links by GCO with prior",
    "joint springs": "the model with joint springs",
}


@pytest.mark.parametrize("name", WORDS)
def test_a_name_is_told_in_words_and_what_is_no_model_of_ours_keeps_its_name(name):
    assert in_words(name) == WORDS[name]


def test_every_model_has_words_of_its_own():
    told = {name: in_words(name) for name in MODELS}
    assert len(set(told.values())) == len(MODELS)
    assert all(name not in words for name, words in told.items())


def test_a_first_mention_has_the_name_of_the_tables_behind_its_words():
    assert first_mention(DEFAULT) == "GCO of all links and joints with prior (ALL153)"
    assert (first_mention("Joints"), row_words("Joints")) == ("the joints-only model", "joints-only model")
    assert first_mention("MLS56, PSD of equal fit").endswith("made conservative (MLS56)")
    assert row_words("random poses") == "random poses"
