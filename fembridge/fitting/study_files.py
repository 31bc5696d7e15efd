"""The files of a model study: a row a seed as CSV, and the summary as Markdown."""

import csv
import io

from fembridge.fitting.study import TABLE_2, Finding, ModelStudy, fitted_rmse_ips, held_out_rmse_ips
from neural.cross_validation import Trial
from neural.drive_table import drive_named

CASES_FILE = "study.csv"
SUMMARY_FILE = "study.md"

_COLUMNS = (
    "afferent",
    "drive",
    "cells",
    "preindent_um",
    "free_parameters",
    "seed",
    "fitted_r_squared",
    "fitted_rmse_ips",
    "held_out_r_squared",
    "held_out_rmse_ips",
    "parameters",
)


def cases_text(study: ModelStudy) -> str:
    """Give a row a case and seed; ``parameters`` as ``name=value`` with blanks."""
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(_COLUMNS)
    for finding in study.findings:
        case = finding.case
        free = drive_named(case.drive, case.afferent).free(case.cells)
        for trial in finding.trials:
            found = " ".join(
                f"{one.field}={getattr(trial.parameters, one.field):.6g}" for one in free
            )
            table.writerow(
                [
                    case.afferent,
                    case.drive,
                    case.cells,
                    f"{case.preindent_um:g}",
                    case.free_parameters,
                    trial.seed,
                    f"{trial.fitted.regression.r_squared:.4f}",
                    f"{trial.fitted.rmse_ips:.3f}",
                    f"{trial.held_out.regression.r_squared:.4f}",
                    f"{trial.held_out.rmse_ips:.3f}",
                    found,
                ]
            )
    return out.getvalue()


def summary_text(study: ModelStudy) -> str:
    """Give a table a class, the smallest held-out error first; medians over seeds."""
    lines = []
    for afferent, unfitted in study.unfitted.items():
        lines += [
            f"### {afferent}",
            "",
            "| drive | cells | held at (µm) | free | R² fitted | RMSE fitted | "
            "R² held out | RMSE held out (range) |",
            "|---|---|---|---|---|---|---|---|",
        ]
        mine = [one for one in study.findings if one.case.afferent == afferent]
        lines += map(_row, sorted(mine, key=_held_out))
        lines += [
            f"| published, {TABLE_2} as printed | 1 | 0 | 0 | "
            f"{unfitted.regression.r_squared:.3f} | {unfitted.rmse_ips:.1f} | | |",
            "",
        ]
    return "\n".join(lines)


def _row(finding: Finding) -> str:
    case = finding.case
    errors = [held_out_rmse_ips(trial) for trial in finding.trials]
    return (
        f"| {case.drive} | {case.cells} | {case.preindent_um:g} | "
        f"{case.free_parameters} | {finding.median(_fitted_r_squared):.3f} | "
        f"{finding.median(fitted_rmse_ips):.1f} | "
        f"{finding.median(_held_out_r_squared):.3f} | "
        f"{finding.median(held_out_rmse_ips):.1f} "
        f"({min(errors):.1f}–{max(errors):.1f}) |"
    )


def _held_out(finding: Finding) -> float:
    return finding.median(held_out_rmse_ips)


def _fitted_r_squared(trial: Trial) -> float:
    return trial.fitted.regression.r_squared


def _held_out_r_squared(trial: Trial) -> float:
    return trial.held_out.regression.r_squared
