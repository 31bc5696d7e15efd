"""Tables of ``docs/science/model_study.md``: training and validation side by side for each model.

``python -m benchmarks.model_tables --observed RATES.csv --recorded FOLDER -o STUDY`` runs the
complete model study into STUDY (`fembridge study`, 4000 evaluations, a quarter of an hour on one
core; an existing study is read), predicts the recorded rates of FOLDER with each fit, and prints
the tables in Markdown. ``--write docs/science/model_study.md`` replaces them in the page. Observed
and recorded rates may not be distributed; nothing is fitted to the recorded ones.
"""

import argparse
import math
from pathlib import Path

import numpy as np
import pandas

import fembridge as fb
from benchmarks.touch_evidence import replaced, table
from fembridge.evidence.recorded_folder import joined_rates, read_recorded_folder
from fembridge.fitting.model_study import CASES_FILE, ModelStudy
from fembridge.fitting.problem import fit_problem, observed_entries
from fembridge.fitting.response_source import stored_source
from fembridge.io.observed_rates import FAMILIES, read_observed
from fembridge.io.spike_table import RATE_COLUMNS
from fembridge.reporting.rate_tables import FINGERTIP, TOUCHSIM
from fembridge.reporting.recorded_sets import OUYANG_SOURCE, set_of
from fembridge.trace import AFFERENTS
from neural.agreement import agreement
from neural.models import DEFAULT_MODELS, MODELS, model_named
from neural.parameters import PUBLISHED

SEEDS, EVALUATIONS = (1, 2, 3), 4000
VALIDATION_SETS = ("sine_validation", "diharm_validation", "noise_validation")
HEADS = (
    "model", "cells", "pre-indented (µm)", "free", "training: 37 sinusoids", "held-out frequencies",
    "validation: 30, 150, 250 Hz", "validation: diharmonics", "validation: noises",
)  # fmt: skip
PREINDENT_UM = 75.0


def cell(r_squared, rmse_ips):
    if not math.isfinite(rmse_ips):
        return ""
    share = "–" if not math.isfinite(r_squared) else f"{r_squared:.3f}"
    return f"{share} ({rmse_ips:.1f})"


def predicted(problem, entries, values):
    """R² and RMSE of a fit with each validation set; `entries` are the problem's stimuli."""
    rates_ips = problem.rates_ips(values)[0]
    sets = np.array([set_of(entry) for entry in entries])
    results = []
    for name in VALIDATION_SETS:
        found = agreement(problem.observed_ips[sets == name], rates_ips[sets == name])
        results.append((found.regression.r_squared, found.rmse_ips))
    return results


def case_row(trials, response, recorded):
    """Row of a case: medians over its seeds."""
    case, median = trials.iloc[0], trials.median(numeric_only=True)
    problem = fit_problem(
        recorded, response, model_named(case["drive"], case["afferent"]), families=FAMILIES,
        preindent_um=case["preindent_um"], cells=int(case["cells"]),
    )  # fmt: skip
    names = [parameter.field for parameter in problem.free]
    entries = observed_entries(recorded, case["afferent"], FAMILIES)
    seeds = []
    for text in trials["parameters"]:
        values = dict(part.split("=") for part in text.split())
        seeds.append(predicted(problem, entries, np.array([float(values[name]) for name in names])))
    held_out_ips = trials["held_out_rmse_ips"]
    held_out = cell(median["held_out_r_squared"], median["held_out_rmse_ips"])
    spread = f"{held_out_ips.min():.1f}–{held_out_ips.max():.1f}"
    return [
        case["drive"],
        str(case["cells"]),
        f"{case['preindent_um']:g}",
        str(case["free_parameters"]),
        cell(median["fitted_r_squared"], median["fitted_rmse_ips"]),
        held_out.replace(")", f", {spread})"),
        *(cell(*np.nanmedian(np.array(seeds)[:, column], axis=0)) for column in range(3)),
    ]


def set_cells(sets, source, afferent):
    """Cells of training and validation of a source in `recorded_sets`."""
    rows = sets[(sets["source"] == source) & (sets["afferent"] == afferent)].set_index("set")
    return [
        cell(rows["r_squared"][name], rows["rmse"][name]) if name in rows.index else ""
        for name in ("sine", *VALIDATION_SETS)
    ]


def held_out_text(validation, afferent):
    held_out = validation.tables.get("held_out")
    if held_out is None:
        return ""
    rows = held_out[(held_out["afferent"] == afferent) & held_out["frequency_hz"].isna()]
    return "" if rows.empty else f"({rows['held_out_rmse_ips'].iloc[0]:.1f})"


def class_table(afferent, study, response, recorded, shipped, published):
    fitted, raw = (found.tables["recorded_sets"] for found in (shipped, published))
    own = MODELS[DEFAULT_MODELS[afferent]][afferent]
    rows = []
    for title, sets, source, held_out in (
        ("shipped `fitted`", fitted, "fitted", held_out_text(shipped, afferent)),
        ("shipped `fitted_pad`, pin on the ridged pad", fitted, FINGERTIP, ""),
    ):
        training, *validation = set_cells(sets, source, afferent)
        settings = (str(own.cells), f"{PREINDENT_UM:g}", str(len(own.free())))
        rows.append([title, *settings, training, held_out, *validation])
    for trials in study.ranked(afferent):
        case = trials.iloc[0]
        scanned = case["drive"] == DEFAULT_MODELS[afferent] and case["preindent_um"] not in (
            0.0,
            PREINDENT_UM,
        )
        if not scanned:
            rows.append(case_row(trials, response, recorded))
    for title, cells, sets, source in (
        ("published, Table 2 as printed", str(PUBLISHED[afferent].cells), raw, "published"),
        ("TouchSim", "", fitted, TOUCHSIM),
        (OUYANG_SOURCE, "", fitted, OUYANG_SOURCE),
    ):
        training, *validation = set_cells(sets, source, afferent)
        rows.append([title, cells, "0", "0", training, "", *validation])
    return table(HEADS, rows)


def depth_table(study):
    """Shipped models by pre-indentation: RMSE fitted / held out, medians over seeds."""
    rows = []
    depths = sorted(study.trials["preindent_um"].unique())
    for afferent, name in DEFAULT_MODELS.items():
        cells = MODELS[name][afferent].cells
        trials = study.trials
        chosen = trials[
            (trials["afferent"] == afferent)
            & (trials["drive"] == name)
            & (trials["cells"] == cells)
        ]
        medians = chosen.groupby("preindent_um")[["fitted_rmse_ips", "held_out_rmse_ips"]].median()
        errors = (f"{a:.1f} / {b:.1f}" for a, b in medians.loc[depths].itertuples(index=False))
        rows.append([f"{name} ({afferent})", *errors])
    return table(["RMSE fitted / held out", *(f"{depth:g} µm" for depth in depths)], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--observed", type=Path, required=True)
    parser.add_argument("--recorded", type=Path, required=True)
    parser.add_argument("-o", dest="folder", type=Path, required=True)
    parser.add_argument("--write", type=Path, metavar="PAGE")
    args = parser.parse_args()
    if not (args.folder / CASES_FILE).is_file():
        fb.study(args.observed, seeds=SEEDS, evaluations=EVALUATIONS, output=args.folder)
    study = ModelStudy.read(args.folder)
    recorded = joined_rates(read_recorded_folder(args.recorded)[0])
    everything = joined_rates([read_observed(args.observed), recorded])
    frame = pandas.DataFrame(everything.rates())[list(RATE_COLUMNS)]
    shipped, published = (
        fb.validate(observed=frame, parameters=p) for p in ("fitted", "published")
    )
    response = stored_source("quick").response
    tables = {
        name: class_table(name, study, response, recorded, shipped, published) for name in AFFERENTS
    }
    tables["depths"] = depth_table(study)
    for name, found in tables.items():
        print(f"{name}\n\n{found}\n", flush=True)
        if args.write:
            page = replaced(args.write.read_text(encoding="utf-8"), name, found)
            args.write.write_text(page, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
