"""What the round tip changes: a ball on the round fingertip beside the prism of the reference pad.

``python -m benchmarks.fingertip_roundness OUT`` makes a pad of the human fingertip with elements
of 1 mm wherever the ball touches (168 597 unknowns, some minutes, 2.5 GB) and presses a ball of
5 mm along the normal of the skin at several distances from the tip, and into the middle of the
prism. It prints force, von Mises stress at the units below the ball, and rates.

With ``PAD.npz --plate`` it presses a flat plate into this pad, such as that of all skin of the
fingertip; ``PAD.npz --line`` presses a thin rod across the stored pad of the fingertip, and across
one of a single modulus, which it makes at that path.
"""

import sys
import warnings
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.interpolate import LinearNDInterpolator

import fembridge as fb
from decks.fingertip import HUMAN, Fingertip
from decks.fingertip_deck import fingertip_deck
from decks.fingertip_mesh import FACE_NODES, mesh_fingertip
from decks.keyword_deck import LINES
from fembridge.host.store import make_folder
from fembridge.touching.contact import press_to
from fembridge.touching.mesh_pad import MeshPad
from fembridge.touching.pad import Pad
from fembridge.touching.pad_file import resolve_pad

BALL_MM, DEPTH_UM, STIMULUS = 5.0, 300.0, "sine_50_100"
FROM_TIP_MM = (10.0, 8.0, 4.0, 1.0)
WIDTH_MM = 1.0
# Skin that the ball may touch: a strip along the finger.
STRIP_MM, BEHIND_MM = 3.0, -3.0
OFFSET_MM = 0.3
ROD_MM, ROD_UM = 0.5, 200.0


def main() -> None:
    """Print the tables that the command line names."""
    warnings.simplefilter("ignore", fb.errors.FembridgeWarning)
    words = sys.argv[1:]
    if "--plate" in words:
        plate(resolve_pad(words[0]))
    elif "--line" in words:
        line_load(Path(words[0]))
    else:
        roundness(make_folder(Path(words[0])) / "strip.npz")


def roundness(path: Path) -> None:
    """A ball on the fingertip, whose pad is at `path`, and on the prism."""
    tip = strip_pad(path)
    print("pad, mm from the tip, tilt (deg), force (N), SA, RA, PC (kPa), rates (1/s)")
    print("prism", "", 0, *numbers(resolve_pad("reference"), 0.0, 0.0), sep=", ")
    for from_tip_mm in FROM_TIP_MM:
        z_mm = HUMAN.outline.tip_mm - from_tip_mm
        tilt_deg = tip.tilt_deg_at((0.0, z_mm))[1]
        row = "fingertip", from_tip_mm, round(tilt_deg, 1), *numbers(tip, z_mm, tilt_deg)
        print(*row, sep=", ", flush=True)


def numbers(pad: Pad, z_mm: float, tilt_deg: float) -> list[float | str]:
    """Force in N, von Mises stress in kPa and rates under the ball that is pressed in or vibrates.

    Means over nine positions of the ball and of the units below it, 0.3 mm apart: the position
    between nodes changes stress by some per cent.
    """
    forces_n, stress_kpa, rates_ips = [], [], []
    for aside_mm, ahead_mm in product((-OFFSET_MM, 0.0, OFFSET_MM), repeat=2):
        x, z = aside_mm, z_mm + ahead_mm
        units = fb.Population.at(["SA", "RA", "PC"], [x] * 3, [z] * 3, finger=pad)
        words = {
            "pad": pad,
            "at_mm": (x, z),
            "tilt_deg": (0.0, tilt_deg),
            "population": units.with_endings(0.0, sa_von_mises=True),
        }
        ball = f"sphere:diameter_mm={BALL_MM:g}"
        pressed = fb.touch(ball, press_um=DEPTH_UM, **words)
        forces_n.append(pressed.force_n.max())
        stress_kpa.append(1e-3 * pressed.stress_pa.max(axis=0))
        rates_ips.append(fb.touch(ball, stimulus=STIMULUS, **words).rate_ips)
    return [
        round(float(np.mean(forces_n)), 4),
        *(round(value, 2) for value in np.mean(stress_kpa, axis=0).tolist()),
        "/".join(f"{rate:.0f}" for rate in np.mean(rates_ips, axis=0)),
    ]


def strip_tip() -> Fingertip:
    """The human fingertip with elements of one width wherever skin may be touched."""
    resolution = replace(HUMAN.resolution, pad_mm=WIDTH_MM, pad_radius_mm=12.0)
    return replace(HUMAN, name="strip", resolution=resolution)


def strip_pad(path: Path) -> MeshPad:
    """The pad of a strip of the skin along the finger, with points below all of it."""
    if not path.is_file():
        tip = strip_tip()
        mesh = mesh_fingertip(tip)
        at_mm = mesh.node_mm
        skin = np.unique(mesh.tet[mesh.skin][:, list(FACE_NODES)])
        in_strip = (np.abs(at_mm[:, 0]) < STRIP_MM) & (at_mm[:, 2] > BEHIND_MM)
        in_strip &= at_mm[:, 1] > -1.2 * tip.outline.half_height_mm
        deck = fingertip_deck(tip, mesh)
        for name, rows in (("STRIP", skin), *mesh.afferents.items()):
            deck += f"*NSET, NSET=STRIP_{name}\n{LINES['list_lines'](rows[in_strip[rows]] + 1)}\n"
        model = path.with_suffix(".inp")
        model.write_text(deck)
        pad = fb.make_pad(
            base_deck=model,
            skin="STRIP_STRIP",
            afferents={name: f"STRIP_{name}" for name in mesh.afferents},
            skin_map=fb.SkinMap(mesh.apex + 1, (0, 1, 0), (0, 0, 1)),
            solver=fb.Solver(runs_folder=path.parent / "runs", threads=1),
        )
        pad.write(path)
    pad = resolve_pad(path)
    assert isinstance(pad, MeshPad)
    print(pad, pad.origin["unknowns"], "unknowns")
    return pad


def plate(pad: Pad) -> None:
    """Force of a flat plate against depth, by superposition."""
    depth_um = np.array([250.0, 500.0, 1000.0, 1500.0, 2000.0])
    _, forces, _ = press_to(pad, fb.Shape.plate(), depth_um)
    for depth, force in zip(depth_um, forces.sum(axis=1), strict=True):
        print(f"{depth:g} um: {force:.4f} N")


def line_load(path: Path) -> None:
    """Depth of the skin along the finger under a thin rod across it: of layers, and of one modulus.

    Far from the rod only its force counts, so that depths are compared by that 1 mm away.
    """
    tissue = HUMAN.materials["subcutaneous_tissue"]
    soft = dict.fromkeys(("stratum_corneum", "epidermis", "dermis"), tissue)
    if not path.is_file():
        one_modulus = replace(HUMAN, name="one_modulus", materials={**HUMAN.materials, **soft})
        fb.make_pad(one_modulus, reach_mm=6.5).write(path)
    for name, pad in (("layers", resolve_pad("fingertip")), ("one modulus", resolve_pad(path))):
        assert isinstance(pad, MeshPad)
        rod = fb.Shape.cylinder(diameter_mm=ROD_MM).rotated(90.0)
        nodes, forces, _ = press_to(pad, rod, np.array([ROD_UM]))
        rows = nodes.to_arrays()["node_row"]
        down_um = 1e3 * pad.down_mm[1][:, rows] @ forces[0]
        # Skin between the nodes, on the axis.
        depth_um = LinearNDInterpolator(pad.position_mm[:, [0, 2]], down_um)
        away_mm = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0])
        ahead, behind = (depth_um(np.zeros_like(away_mm), sign * away_mm) for sign in (1, -1))
        print(f"{name}: {forces.sum():.4f} N")
        for away, first, second in zip(away_mm, ahead / ahead[2], behind / behind[2], strict=True):
            print(f"{name}: {away:g} mm from the rod, of that at 1 mm: {first:.3f}, {second:.3f}")


if __name__ == "__main__":
    main()
