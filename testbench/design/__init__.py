"""Optimal design of experiments: which poses to measure, and how far any plan is from the best.

A plan is judged by its information matrix M = prior + sum of rows^T rows over its poses, in units of what the
prior expects. Criteria are information functions of M (Pukelsheim, Optimal Design of Experiments, 1993):
concave, positively homogeneous, large when the plan is good.
"""
