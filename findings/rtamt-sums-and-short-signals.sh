#!/usr/bin/env bash
# rtamt 0.4.10, discrete time, offline: sums are read from the right, and short signals give infinities or fail.
#
# Expected: `a - b + c` is (a - b) + c; an interval that reaches beyond the end of the signal is cut there, and evaluating
#           a formula changes none of the lists that it is given.
# Seen:     a - (b + c); the signal's own list is lengthened by infinities, so a second operator over the same signal
#           gives -inf, inf, or an IndexError.
# Ends with 0 while that is so, with 1 once it has changed.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check rtamt==0.4.10
cat > "$folder/seen.py" <<'PYTHON'
import sys

import rtamt


def robustness(formula: str, **signals: list[float]) -> list[float]:
    specification = rtamt.StlDiscreteTimeOfflineSpecification()
    for name in signals:
        specification.declare_var(name, "float")
    specification.set_sampling_period(100, "ms", 0.1)
    specification.spec = formula
    specification.parse()
    states = len(next(iter(signals.values())))
    return [value for _, value in specification.evaluate({"time": list(range(states)), **signals})]


sums = robustness("a - b + c", a=[10.0, 10.0], b=[3.0, 3.0], c=[2.0, 2.0])[0]
print(f"a - b + c of 10, 3, 2: {sums}; expected 9")
short = robustness("eventually[0:2 s](a) and always(a)", a=[3.0, 1.0, 2.0])[0]
print(f"eventually[0:2 s](a) and always(a) over 3, 1, 2: {short}; expected 1")
try:
    late = robustness("always[0:2 s](a) and eventually[0:0.5 s](a >= 0)", a=[3.0, 1.0, 2.0])[0]
except IndexError as error:
    late = f"IndexError: {error}"
print(f"always[0:2 s](a) and eventually[0:0.5 s](a >= 0) over 3, 1, 2: {late}; expected 1")
sys.exit(0 if sums == 5.0 and short != 1.0 and late != 1.0 else 1)
PYTHON
"$folder/venv/bin/python" "$folder/seen.py"
