"""The pad's answer to one pin, as a response map: what parameters are fitted on.

The pin is the flat one of 1 mm that observed rates were recorded with; under it are a
median unit of each class, where the finger's sites are.

``python -m fembridge.touching.response reference response.toml`` writes it, and
``fembridge fit --response response.toml`` made ``fitted_pad`` of it, see ``docs/model_study.md``.
"""

import sys
from pathlib import Path

import numpy as np

from decks.presets import finger_table
from fembridge.response.response_map import ResponseMap, write_map
from fembridge.run_folder import AfferentNode
from fembridge.touching.contact import press_to
from fembridge.touching.pad import Pad, pad_named
from fembridge.touching.shape import Shape
from fembridge.touching.stress import influence_pa

PIN_MM = 1.0
DEEPEST_UM = 600.0
# Few enough that nodes which come into contact one by one leave no kinks.
_LEVELS = 21


def pad_response(pad: Pad, diameter_mm: float = PIN_MM) -> ResponseMap:
    """Stress tensors at each site of the pad's finger under a flat pin over the apex."""
    depth_um = DEEPEST_UM * (np.arange(_LEVELS) / (_LEVELS - 1)) ** 1.5
    nodes, forces, _ = press_to(pad, Shape.punch(diameter_mm), depth_um)
    sites = pad.finger.afferents
    layer, x_mm, depth_mm = zip(
        *((s.layer, s.x_mm, s.depth_mm) for s in sites.values()), strict=True
    )
    places = np.array(layer), np.array(x_mm), np.zeros(len(sites)), np.array(depth_mm)
    influence = influence_pa(pad, nodes, *places)
    tensor = np.einsum("cun,kn->kuc", influence, forces, dtype=np.float64)
    tensor[..., 4:] = 0.0  # yz and zx, by symmetry about z = 0, but for rounding
    return ResponseMap(
        depth_um=depth_um,
        tensor_pa=tensor,
        force_n_per_mm=forces.sum(axis=1),
        places=tuple(
            AfferentNode(name, n, site.layer, site.x_mm, -site.depth_mm, site.depth_mm)
            for n, (name, site) in enumerate(sites.items(), start=1)
        ),
        closure_percent=0.0,
        origin={"finger": finger_table(pad.finger), "pad": dict(pad.origin), "pin_mm": diameter_mm},
    )


def main() -> None:
    """Write the response of a pad: its name or file, and where to."""
    pad, target = sys.argv[1:]
    write_map(Path(target), pad_response(pad_named(pad)))


if __name__ == "__main__":
    main()
