"""The paper's experiments as plans of runs, carried out where they were interrupted, and told as pages.

plan = plans.plan_of("table1", "small")         what is to be run (plans.py, sizes.py)
outcome = local.carry_out(plan, ...)            or fleet.carry_out: ground truth and runs, from where they stand
page.write(plan, outcome, ...)                  results as JSON, pictures, and a page without a number typed by hand
"""
