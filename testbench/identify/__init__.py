"""Identification of link and joint compliances from deflections: least squares, GCO, priors, intervals.

Every method has one call shape, (vjm, structure, dataset) -> Estimate. It stands between the readings
(`testbench.data`) and predictions or corrections (`testbench.correct`).
"""
