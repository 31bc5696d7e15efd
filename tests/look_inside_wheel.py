"""Fail when the built wheel lacks a part or holds one too many."""

import sys
import zipfile
from pathlib import Path

WANTED = (
    "fembridge/py.typed",
    "decks/py.typed",
    "neural/py.typed",
    "decks/meshes/quick.npz",
    "decks/meshes/paper.npz",
    "decks/abaqus.inp.j2",
    "decks/calculix.inp.j2",
    "decks/green.inp.j2",
    "decks/keyword_deck.inp.j2",
    "decks/materials.inp.j2",
    "decks/prism.inp.j2",
    "decks/marc/job.dat.j2",
    "decks/plane.inp.j2",
    "fembridge/response/maps/quick.toml",
    "fembridge/response/maps/paper.toml",
    "fembridge/evidence/touchsim/rates.csv",
    "fembridge/report/style.css",
    "fembridge/report/validation.html.j2",
    "fembridge/report/verification.md.j2",
    "fembridge/response/profiles/quick.toml",
    "neural/fitted.toml",
    "neural/fitted_pad.toml",
    "fembridge/touching/pads/reference.npz",
    "fembridge/commands/outputs.md",
    "fembridge/cli.py",
)


def main(folder: str) -> int:
    """Check the newest wheel in `folder`."""
    wheel = max(Path(folder).glob("*.whl"), key=lambda path: path.stat().st_mtime)
    names = set(zipfile.ZipFile(wheel).namelist())
    missing = [name for name in WANTED if name not in names]
    tops = {name.split("/")[0] for name in names}
    strange = sorted(
        top
        for top in tops
        if top not in ("fembridge", "decks", "neural") and not top.endswith(".dist-info")
    )
    if missing or strange:
        print(f"{wheel.name}: missing {missing}, strange {strange}", file=sys.stderr)
        return 1
    size_mb = wheel.stat().st_size / 1e6
    print(f"{wheel.name}: {len(names)} files, {size_mb:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
