"""`tailroad batch`: many questions in one file, run here or by a service, and told in one table.

plan.py       the file, and the cells that it comes to
local.py      runs cells in run directories of this machine
remote.py     has a service run them
verdict.py    what the results say about a limit
"""
