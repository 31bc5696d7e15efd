"""One parameter at a time: how much of a change is the finger, and how much its mesh.

``python -m benchmarks.sensitivity_mesh docs/studies/sensitivity_one_at_a_time.toml``
takes the fingers of a study whose shape is not that of the first, presses the usual
probe 200 um into each, on the study's own mesh and on one with twice as many columns
and rows in the skin under the probe, and prints, in Markdown, how the stress of each
afferent differs from the first finger's on the same mesh. Materials and friction leave
the mesh alone, and need no such table. The solver runs four minutes on one core;
finished runs are kept in the folder.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from decks.finger import Finger, Resolution
from decks.presets import QUICK, model_of
from fembridge.io.formatting import number
from fembridge.reporting.verification_runs import Runs, indent
from fembridge.sensitivity.wording import parameter_words
from fembridge.sweeps import Variant, read_study


def finer(resolution: Resolution) -> Resolution:
    """Give twice as many columns under the probe, and twice as many rows."""
    return replace(
        resolution,
        contact_mm=resolution.contact_mm / 2,
        stratum_corneum_rows=2 * resolution.stratum_corneum_rows,
        epidermis_rows=2 * resolution.epidermis_rows,
        dermis_rows=3 * resolution.dermis_rows // 2,
    )


def shaped(variants: Sequence[Variant]) -> list[Variant]:
    """Give the first finger, and those of another shape."""

    def shape(finger: Finger) -> Finger:
        return replace(finger, materials=QUICK.materials)

    first = variants[0]
    return [first, *(v for v in variants if shape(v.finger) != shape(first.finger))]


def table(study: Path, folder: Path) -> list[str]:
    """Solve what is not solved, and give the lines of the table."""
    runs = Runs(folder, quick=True)
    variants = shaped(read_study(study).variants)
    afferents = list(variants[0].finger.afferents)
    columns: dict[str, list[str]] = {each.called: [] for each in variants}
    heads = []
    for mesh, change in (("own", lambda r: r), ("finer", finer)):
        first = None
        for variant in variants:
            finger = replace(variant.finger, resolution=change(variant.finger.resolution))
            name = f"{mesh}_{variant.called}".replace("=", "_").replace(".", "_")
            pressed = indent(runs, name, model_of(finger))
            print(f"{mesh} {variant.called}: {pressed.elements}", file=sys.stderr)
            if first is None:
                first = pressed
                shown = [f"{each / 1000:.3g} kPa" for each in pressed.last_pa]
                heads = [*heads, f"{mesh} mesh, {pressed.elements} elements"]
            else:
                percent = 100 * (pressed.last_pa / first.last_pa - 1)
                shown = [f"{number(float(each), '+.1f')} %" for each in percent]
            columns[variant.called] += shown
    order = [k + m * len(afferents) for k in range(len(afferents)) for m in range(2)]
    lines = [
        f"{heads[0]}; {heads[1]}",
        "",
        "| finger | " + " | ".join(f"{a}, {m}" for a in afferents for m in ("own", "finer")) + " |",
        "|---" * (1 + len(order)) + "|",
    ]
    for shown, cells in columns.items():
        name, _, value = shown.partition("=")
        words = f"{parameter_words(name)} {value}" if value else "the first"
        lines.append(f"| {words} | {' | '.join(cells[k] for k in order)} |")
    return lines


def main(words: Sequence[str] | None = None) -> None:
    """Print the table of a study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", type=Path)
    parser.add_argument("--folder", type=Path, default=Path("sensitivity_mesh"))
    args = parser.parse_args(words)
    print("\n".join(table(args.study, args.folder)))


if __name__ == "__main__":
    main()
