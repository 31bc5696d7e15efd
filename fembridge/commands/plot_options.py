"""Options of each picture that ``fembridge plot`` draws."""

import argparse
from pathlib import Path
from typing import TypeAlias

from fembridge.commands.options import add_finger_options

Pictures: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def add_mesh(pictures: Pictures) -> None:
    """Which finger, and which probe on it."""
    parser = _add_picture(
        pictures,
        "mesh",
        "the finger's layers and elements, its afferents, and the probe",
        "fembridge plot mesh --finger paper -o mesh.pdf",
    )
    add_finger_options(parser)


def add_response(pictures: Pictures) -> None:
    """Which response map."""
    parser = _add_picture(
        pictures,
        "response",
        "stress at each afferent and the probe's force against its depth",
        "fembridge plot response --finger quick -o response.pdf",
    )
    parser.add_argument(
        "file",
        nargs="?",
        type=Path,
        metavar="FILE",
        help="a response.toml, as `fembridge simulate` leaves it",
    )
    parser.add_argument(
        "--finger",
        metavar="NAME",
        help="the stored response of this finger (default, without FILE: quick)",
    )


def add_trace(pictures: Pictures) -> None:
    """Which table, and what made it."""
    parser = _add_picture(
        pictures,
        "trace",
        "stress over time, a panel an afferent",
        "fembridge plot trace traces.csv --stimulus sine_20_250",
    )
    parser.add_argument("table", type=Path, metavar="CSV", help="table of traces")
    parser.add_argument("--stimulus", metavar="ID", help="draw the waveform that made them above")


def add_raster(pictures: Pictures) -> None:
    """Which table, rows and panels."""
    parser = _add_picture(
        pictures,
        "raster",
        "spikes: a panel a class, a row a stimulus",
        "fembridge plot raster spikes.csv --stimulus sine_20",
    )
    parser.add_argument("table", type=Path, metavar="CSV", help="table of spikes")
    parser.add_argument(
        "--stimulus",
        action="append",
        metavar="ID",
        help="rows from top to bottom, silent ones too; a single one is drawn above "
        "(default: those of the table)",
    )
    parser.add_argument(
        "--afferent",
        choices=("SA", "RA", "PC"),
        nargs="+",
        help="panels from left to right (default: those of the table)",
    )
    parser.add_argument(
        "--window-ms",
        type=float,
        nargs=2,
        metavar=("START", "END"),
        help="leave white only the time in which spikes were counted",
    )


def add_stimulus(pictures: Pictures) -> None:
    """Which waveforms."""
    parser = _add_picture(
        pictures,
        "stimulus",
        "the probe's depth over time, a panel a stimulus",
        "fembridge plot stimulus noise_25_250 sine_20_250 -o waveforms.svg",
    )
    parser.add_argument(
        "ids",
        nargs="+",
        metavar="ID",
        help="sine_20_250, a set as sine_20, noise or all; commas join several",
    )
    parser.add_argument(
        "--preindent-um",
        type=float,
        default=0.0,
        metavar="DEPTH",
        help="depth of the probe before time 0 (default: 0)",
    )
    parser.add_argument("--seed", type=int, help="draw other noise than the catalogue's (>= 0)")


def add_sensitivity(pictures: Pictures) -> None:
    """Which sweep, and where its tables go."""
    parser = _add_picture(
        pictures,
        "sensitivity",
        "which parameter of a sweep's fingers moves rates and stress how much",
        "fembridge plot sensitivity sweep/results.csv --table effects.md",
    )
    parser.add_argument(
        "table",
        type=Path,
        metavar="CSV",
        help="results.csv of a sweep with a design (docs/sweeps.md), or its --fingers",
    )
    parser.add_argument(
        "--table",
        dest="effects",
        type=Path,
        metavar="FILE",
        help="write the numbers too: .csv has all, .md a table a class",
    )
    parser.add_argument(
        "--fingers",
        type=Path,
        metavar="FILE.csv",
        help="write a row a finger: parameters, and mean answers by set of stimuli",
    )


def _add_picture(
    pictures: Pictures, name: str, shows: str, example: str
) -> argparse.ArgumentParser:
    parser = pictures.add_parser(
        name,
        help=shows,
        description=f"{shows[0].upper()}{shows[1:]}.",
        epilog=f"example: {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(f"{name}.png"),
        metavar="FILE",
        help=f"its suffix chooses the format (default: {name}.png)",
    )
    # The verb has it too; unset here, so as not to undo it there.
    parser.add_argument(
        "--json",
        action="store_true",
        default=argparse.SUPPRESS,
        help="print a summary a program can read",
    )
    return parser
