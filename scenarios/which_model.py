"""Which method to use by default: a family of true arms, wrong priors, 8, 12 and 20 poses.

python scenarios/which_model.py --out runs/which_model
"""

from testbench.studies import main

if __name__ == "__main__":
    main("which_model")
