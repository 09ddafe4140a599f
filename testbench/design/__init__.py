"""Optimal design of experiments: which poses to measure, and how far any plan is from the best.

A plan is judged by its information matrix M = prior + sum of F^T F over its poses. F holds a pose's whitened
rows, in the units of the prior, so M has no unit. Criteria are information functions of M (Pukelsheim,
Optimal Design of Experiments, 1993): concave, positively homogeneous, and large for a good plan. The flow is:
`rows` (the information of a pose), `criteria`, `exchange` (an upper bound on all plans, the plan, its
refinement), `planning` (all of it, and the sequence of the poses), `forecast` (the error to expect).
"""
