"""Reads a simulated recording with numpy as a table and as arrays: exit 1 with a sentence if they disagree.

    python check_readings.py readings.csv readings.npz truth.csv
"""
import csv
import sys

import numpy as np


def main(table, archive, truth):
    with open(table, newline="") as file:
        rows = list(csv.reader(file))
    numbers = np.array([[float(x) for x in row] for row in rows[1:]])
    arrays = dict(np.load(archive))
    (channel,), (unit,) = arrays["channels"], arrays["units"]
    if rows[0] != ["time"] + [f"{i}.{channel}[{unit}]" for i in arrays["ids"]]:
        return "the columns are not the ids"
    if not np.array_equal(arrays["values"], numbers[:, 1:], equal_nan=True):
        return "the values differ"
    if not np.array_equal(arrays["timestamps"], numbers[:, 0]):
        return "the times differ"
    with open(truth, newline="") as file:
        for row in csv.DictReader(file):
            felt = arrays["values"][int(row["frame"])]
            if np.sum(felt > 0) != int(row["taxels"]):
                return f"frame {row['frame']}: {np.sum(felt > 0)} taxels feel something, not {row['taxels']}"
            # The flat discs of taxels stand up to 0.04 mm above the triangles of this skin of 0.1 m radius, so that
            # the sphere (force k pi R depth^2) is that much deeper in them.
            deeper = np.sqrt(float(row["force"])) + 0.04
            if unit == "N" and np.nansum(felt) > 1.05 * deeper**2:
                return f"frame {row['frame']}: taxels feel {np.nansum(felt)} N of {row['force']} N"
    print(f"numpy: {numbers.shape[0]} frames of {numbers.shape[1] - 1} taxels agree")
    return None


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
