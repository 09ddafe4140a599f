"""Eq. (7): what a linear model loses under load."""
