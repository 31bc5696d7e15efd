"""Fit the shipped parameter sets again: ``neural/fitted.toml`` and ``neural/fitted_pad.toml``.

``python -m benchmarks.shipped_sets observed_sine_rates.csv -o FOLDER`` fits each class on the
stored response of the ``quick`` finger and under a pin of 1 mm on the stored pad, to rates of
sinusoids, thresholds and timing, and writes both sets into FOLDER; half an hour on one core with
numba. The observed rates may not be distributed.
"""

import argparse
from pathlib import Path

import fembridge as fb
from fembridge.fitting.fit import PARAMETERS_FILE, FitTargets, Search
from fembridge.host.store import read_toml, write_toml
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.stress import pad_response

EVALUATIONS = {"SA": 8000, "RA": 4000, "PC": 4000}
PREINDENT_UM = 75.0
RULES = {"SA": "tolerant", "RA": "balanced", "PC": "tolerant"}
TARGETS = FitTargets(thresholds="thresholds_freeman_johnson_1982", timing=True)
SOURCE = (
    "fembridge fit, class by class: NSGA-II on observed rates of sinusoids, vector strengths at "
    "20 Hz, and thresholds"
)
# Shared by the fits of all classes.
SHARED = ("finished", "seed", "evaluations", "population", "families", "left_out", "versions")


def combined(name, tables):
    """One set from the set of each class, by class."""
    first = next(iter(tables.values()))["fit"]
    fit = {"source": SOURCE, **{key: first[key] for key in SHARED}, "afferents": list(tables)}
    fit |= {key: first[key] for key in ("observed", "response")}
    fit |= {afferent: table["fit"][afferent] for afferent, table in tables.items()}
    sections = {afferent: table[afferent] for afferent, table in tables.items()}
    return {"name": name, "preindent_um": PREINDENT_UM, **sections, "fit": fit}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("observed", type=Path)
    parser.add_argument("-o", dest="folder", type=Path, required=True)
    args = parser.parse_args()
    responses = {"fitted": None, "fitted_pad": pad_response(resolve_pad("reference"))}
    for name, response in responses.items():
        tables = {}
        for afferent, rule in RULES.items():
            output = args.folder / f"{name}_{afferent}"
            fit = fb.fit(
                args.observed,
                afferents=afferent,
                response=response,
                targets=TARGETS,
                search=Search(evaluations=EVALUATIONS[afferent], rule=rule),
                preindent_um=PREINDENT_UM,
                held_out=response is None,
                output=output,
            )
            print(fit)
            tables[afferent] = read_toml(output / PARAMETERS_FILE)
        write_toml(args.folder / f"{name}.toml", combined(name, tables))


if __name__ == "__main__":
    main()
