#!/usr/bin/env bash
# A second h5py.File on a file that another process has extended shows what the first one saw; and an environment
# variable overrules `locking=False`.
#
# One process appends a number and flushes, another reads: it opens the file by h5py.File(name, "r", locking=False),
# keeps it open, and opens it once more after the next number has been appended. The second handle shows
#
#   opened by name:                                    1 number, for HDF5 knows the file by device and inode, and shares
#                                                      what it has read of it in this process
#   opened through Python, h5py.File(open(name, "rb")): 2 numbers
#
# With HDF5_USE_FILE_LOCKING=TRUE in the environment of reader and writer, the file that is being written cannot be
# opened by name at all, though locking=False was asked for ("unable to lock file"); through Python it can.
#
# Seen with Python 3.11, h5py 3.16.0 (HDF5 2.0.0), numpy 2.4.6, on Linux. Exits 0 if that is still so, not 0 if it has
# changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
unset PYTHONPATH HDF5_USE_FILE_LOCKING
python3 -m venv env
env/bin/pip install --quiet --quiet --disable-pip-version-check h5py==3.16.0 numpy==2.4.6
cat > read.py <<'PYTHON'
import subprocess
import sys

import h5py

WRITER = """
import h5py
file = h5py.File("numbers.h5", "w", libver="earliest", locking=False)
numbers = file.create_dataset("numbers", (0,), "f8", maxshape=(None,), chunks=(8,))
while True:
    numbers.resize(len(numbers) + 1, axis=0)
    file.flush()
    print(len(numbers), flush=True)
    if not input():
        break
"""


def opened(source):
    try:
        return len(h5py.File(source, "r", **({"locking": False} if isinstance(source, str) else {}))["numbers"])
    except OSError as error:
        return "cannot lock" if "unable to lock file" in str(error) else str(error)


pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
with subprocess.Popen([sys.executable, "-c", WRITER], **pipes) as writer:
    writer.stdout.readline()
    first = None
    try:
        first = h5py.File("numbers.h5", "r", locking=False)
        seen = len(first["numbers"])
    except OSError as error:
        seen = "cannot lock" if "unable to lock file" in str(error) else str(error)
    print("more", file=writer.stdin, flush=True)
    writer.stdout.readline()
    print("first", seen, "second", opened("numbers.h5"), "through Python", opened(open("numbers.h5", "rb")))
    print("", file=writer.stdin, flush=True)
PYTHON
for locking in unset TRUE; do
    if [ $locking = unset ]; then env/bin/python read.py; else HDF5_USE_FILE_LOCKING=$locking env/bin/python read.py; fi
done | tee seen.txt
diff seen.txt - <<< "first 1 second 1 through Python 2
first cannot lock second cannot lock through Python 2"
echo "as before"
