"""Use of an identified model: predict the loaded tool with intervals, and correct programs for it.

`rest` finds the equilibrium under own weight and loads, `predicted` and `stiffness` evaluate it,
`uncertainty` gives intervals. `newton` and `compensated` find the joints that put the loaded tool on target,
`inverse` the joints along a path of the rigid arm.
"""
