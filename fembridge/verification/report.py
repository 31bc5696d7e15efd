"""A verification as a folder: the page, its pictures, its tables, and a summary."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from fembridge.store import write_text
from fembridge.typing import Table
from fembridge.validation.long_table import LongTable
from fembridge.verification.chart_picture import draw_chart
from fembridge.verification.finding import Finding
from fembridge.verification.page import (
    IMAGES_FOLDER,
    TABLES_FOLDER,
    command_of,
    image_name,
    page_text,
    table_name,
)

PAGE_FILE = "verification.md"
SUMMARY_FILE = "verification.json"


def write_report(
    folder: Path, findings: Sequence[Finding], versions: Mapping[str, str], *, quick: bool
) -> None:
    """Write all of it; the page comes last.

    Raises
    ------
    OutputError
        `folder` cannot be written.
    """
    for finding in findings:
        for chart in finding.charts:
            draw_chart(chart, folder / IMAGES_FOLDER / image_name(chart.name))
        for table in finding.tables:
            rows = tuple(table.rows)
            LongTable(table_name(table.name), table.columns, rows).write(folder / TABLES_FOLDER)
    summary = summary_of(findings, versions, quick=quick)
    text = json.dumps(summary, indent=2, ensure_ascii=False)
    write_text(folder / SUMMARY_FILE, text + "\n")
    write_text(folder / PAGE_FILE, page_text(findings, versions, quick=quick))


def summary_of(findings: Sequence[Finding], versions: Mapping[str, str], *, quick: bool) -> Table:
    """Give what a program asks for: each check, found, bound, passed."""
    return {
        "quick": quick,
        "versions": dict(versions),
        "passed": all(finding.passed for finding in findings),
        "studies": [
            {
                "name": finding.name,
                "title": finding.title,
                "passed": finding.passed,
                "skipped": finding.skipped or None,
                "command": command_of(finding.name, quick=quick),
                "increments": finding.cost.increments,
                "iterations": finding.cost.iterations,
                "cpu_s": round(finding.cost.cpu_s, 3),
                "checks": [
                    {
                        "what": check.what,
                        "found": check.found if check.found == check.found else None,
                        "side": check.side,
                        "bound": check.bound,
                        "unit": check.unit,
                        "passed": check.passed,
                    }
                    for check in finding.checks
                ],
            }
            for finding in findings
        ],
    }
