"""What the round tip changes: a ball on the round fingertip beside the prism of the reference pad.

``python -m benchmarks.fingertip_roundness OUT`` makes a pad of the human fingertip with elements
of 1 mm wherever the ball touches (some minutes, 2 GB) and presses a ball of 5 mm along the normal
of the skin at several distances from the tip; and the same ball into the prism from above. It
prints force, stress at the unit below the ball, and rates. With ``--plate`` it presses a flat plate
into the stored pad of the fingertip; ``PAD.npz --line`` presses a thin rod across that pad, and
across one of a single modulus, which it makes.
"""

import sys
import warnings
from dataclasses import replace
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
ROD_MM, ROD_UM = 0.5, 200.0


def main() -> None:
    """Print the tables that the command line names."""
    warnings.simplefilter("ignore", fb.errors.FembridgeWarning)
    words = sys.argv[1:]
    if "--plate" in words:
        plate(resolve_pad("fingertip"))
    elif "--line" in words:
        line_load(Path(words[0]))
    else:
        roundness(make_folder(Path(words[0])) / "strip.npz")


def roundness(path: Path) -> None:
    """A ball on the fingertip, whose pad is at `path`, and on the prism."""
    tip = strip_pad(path)
    prism = resolve_pad("reference")
    print("mm from the tip, tilt (deg), pad, force (N), SA, RA, PC (kPa), rates (1/s)")
    for from_tip_mm in FROM_TIP_MM:
        at_mm = (0.0, HUMAN.outline.tip_mm - from_tip_mm)
        for name, pad in (("fingertip", tip), ("prism", prism)):
            tilt_deg = tip.tilt_deg_at(at_mm) if pad is tip else (0.0, 0.0)
            row = [from_tip_mm, round(tilt_deg[1], 1), name, *numbers(pad, at_mm, tilt_deg)]
            print(*row, sep=", ", flush=True)


def numbers(
    pad: Pad, at_mm: tuple[float, float], tilt_deg: tuple[float, float]
) -> list[float | str]:
    """Force in N, stress in kPa and rates under the ball that is pressed in or vibrates."""
    units = fb.Population.at(["SA", "RA", "PC"], [at_mm[0]] * 3, [at_mm[1]] * 3, finger=pad)
    words = {"pad": pad, "at_mm": at_mm, "tilt_deg": tilt_deg, "population": units}
    ball = f"sphere:diameter_mm={BALL_MM:g}"
    pressed = fb.touch(ball, press_um=DEPTH_UM, **words)
    rates = fb.touch(ball, stimulus=STIMULUS, **words).rate_ips
    stress_kpa = 1e-3 * pressed.stress_pa.max(axis=0)
    return [
        round(float(pressed.force_n.max()), 4),
        *(round(float(value), 2) for value in stress_kpa),
        "/".join(f"{rate:.0f}" for rate in rates),
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
