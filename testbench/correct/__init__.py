"""Use of an identified model: predict the loaded tool with intervals, and correct programs for it.

`predicted` evaluates a model in any pose with intervals, and the stiffness of the loaded tool. `newton` finds
the equilibrium under own weight and loads, and joints that put the loaded tool on its target. `compensated`
corrects programs, and finds the joints along a path of the rigid arm.
"""
