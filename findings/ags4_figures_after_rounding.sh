#!/usr/bin/env bash
# python-ags4 1.2.0 writes numbers of type nSF with a figure too many where rounding carries, and its checker rejects them.
#
# AGS4 files hold laboratory results as text with a type for each column; "3SF" is three significant figures. The
# package's own convert_to_text() formats numbers by that type, and its own check_file() tests them (AGS rule 8):
#
#   number     type   written   checker
#   99.96      3SF    100.0     Value 100.0 in X not of data type 3SF. (Expected: 100)
#   0.9996     3SF    1.000     Value 1.000 in X not of data type 3SF. (Expected: 1.00)
#   1234.6     3SF    1230      accepted
#   98.76      3SF    98.8      accepted
#
# So a table of triaxial tests that the package has written can fail the package's own check, by its values.
#
# Seen with Python 3.11, pandas 2.3.3. Exits 0 if that is still so, not 0 if it has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
unset PYTHONPATH
python3 -m venv env
env/bin/pip install --quiet --quiet --disable-pip-version-check python-ags4==1.2.0 pandas==2.3.3
cat > look.py <<'PYTHON'
import pandas
from python_ags4 import AGS4

numbers = [99.96, 0.9996, 1234.6, 98.76]
table = pandas.DataFrame({"HEADING": ["UNIT", "TYPE", *["DATA"] * 4], "LOCA_ID": ["", "ID", *"ABCD"],
                          "X": ["kPa", "3SF", *numbers]})
text = AGS4.convert_to_text(table)
print("written", *text["X"][2:])
AGS4.dataframe_to_AGS4({"TEST": text}, {"TEST": list(text.columns)}, "test.ags")
for error in AGS4.check_file("test.ags").get("AGS Format Rule 8", []):
    print(error["desc"])
PYTHON
env/bin/python look.py 2> /dev/null | grep -E "^(written|Value)" | tee seen.txt
diff seen.txt - <<'SEEN'
written 100.0 1.000 1230 98.8
Value 100.0 in X not of data type 3SF. (Expected: 100)
Value 1.000 in X not of data type 3SF. (Expected: 1.00)
SEEN
echo "as before"
