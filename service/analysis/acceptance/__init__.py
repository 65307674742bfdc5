"""Is the fleet safe enough? Rates of a whole case from the estimates of its scenarios, with a joint interval and a
verdict.

quantity.py    a number that is not known exactly, as its confidence distributions
combine.py     sums and ratios of such numbers
case.py        the case as its file says it
measured.py    what a scenario's run says of a measure
accept.py      from a case to its verdicts, and what it would take to decide
objects.py     what is told of it, as JSON objects
"""
