"""Fit the shipped parameter sets again: ``neural/fitted.toml`` and ``neural/fitted_pad.toml``.

``python -m benchmarks.shipped_sets observed_sine_rates.csv -o FOLDER`` runs ``fembridge fit`` on
the stored response of the ``quick`` finger and under a pin of 1 mm on the reference pad, to rates
of sinusoids, thresholds and timing, and copies both sets into FOLDER. ``--set`` fits one of them,
``--ridges none`` on smooth skin. Processor time on one core with numba: `fitted` 7 minutes,
`fitted_pad` 5 on ridged skin, 1.5 on smooth skin. The observed rates may not be distributed.
"""

import argparse
import resource
import shutil
from pathlib import Path

from fembridge.cli import main as run_command
from fembridge.fitting.fit import PARAMETERS_FILE

SETTINGS = [
    *("--thresholds", "thresholds_freeman_johnson_1982", "--timing", "--preindent-um", "75"),
    *("--evaluations", "8000", "--rule", "SA=tolerant,RA=smallest_error,PC=tolerant"),
]
SETS = {"fitted": ["--held-out"], "fitted_pad": ["--pad", "reference"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("observed", type=Path)
    parser.add_argument("-o", dest="folder", type=Path, required=True)
    parser.add_argument("--set", dest="sets", choices=SETS, action="append")
    parser.add_argument("--ridges", help="skin of fitted_pad (default: as in touch)")
    args = parser.parse_args()
    for name in args.sets or SETS:
        output = args.folder / name
        words = ["fit", "--observed", str(args.observed), *SETTINGS, *SETS[name], "--name", name]
        if args.ridges and "--pad" in SETS[name]:
            words += ["--ridges", args.ridges]
        if code := run_command([*words, "-o", str(output)]):
            raise SystemExit(code)
        shutil.copyfile(output / PARAMETERS_FILE, args.folder / f"{name}.toml")
        used = resource.getrusage(resource.RUSAGE_SELF)
        print(f"{name}: {used.ru_utime + used.ru_stime:.0f} s of processor time so far")


if __name__ == "__main__":
    main()
