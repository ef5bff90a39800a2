#!/usr/bin/env bash
# A random field of GSTools 1.7.0 with a nugget has other values at the same places in every call, whatever its seed.
#
# SRF(model, seed=3) is a function of place as long as the model has no nugget: a part of the places gives a part of the
# values, the same in every call. With nugget=0.5 the seed fixes the smooth part alone, and the nugget is drawn anew in
# each call, in the order of the places. So processes that ask for their own part of a domain disagree at shared places,
# and a call that is repeated disagrees with itself:
#
#   nugget   same call again   the second half asked for alone
#   0        equal             equal
#   0.5      differs           differs
#
# Two new SRF objects of the same seed agree for the same places, and disagree for parts.
#
# Seen with Python 3.11, numpy 2.4.6. Exits 0 if that is still so, not 0 if it has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
unset PYTHONPATH
python3 -m venv env
env/bin/pip install --quiet --quiet --disable-pip-version-check gstools==1.7.0 numpy==2.4.6
cat > look.py <<'PYTHON'
import gstools
import numpy as np

x = np.linspace(0.0, 9.0, 10)


def equal(a, b):
    return "equal" if np.allclose(a, b, rtol=0.0, atol=1e-12) else "differs"


for nugget in (0.0, 0.5):
    model = gstools.Exponential(dim=2, var=1.0, len_scale=1.0, nugget=nugget)
    field = gstools.SRF(model, seed=3)
    whole = field((x, x))
    fresh = gstools.SRF(model, seed=3)
    print(f"nugget {nugget}: again {equal(whole, field((x, x)))}, part {equal(whole[5:], field((x[5:], x[5:])))}, "
          f"new object {equal(whole, fresh((x, x)))}, "
          f"part of a new object {equal(whole[5:], gstools.SRF(model, seed=3)((x[5:], x[5:])))}")
PYTHON
env/bin/python look.py | tee seen.txt
diff seen.txt - <<'SEEN'
nugget 0.0: again equal, part equal, new object equal, part of a new object equal
nugget 0.5: again differs, part differs, new object equal, part of a new object differs
SEEN
echo "as before"
