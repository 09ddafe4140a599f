"""Runs beside one another: tables, words, recording."""
