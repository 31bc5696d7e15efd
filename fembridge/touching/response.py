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
from fembridge.touching.contact import Contact, gaps_mm, skin_nodes
from fembridge.touching.pad import COMPONENTS, Pad, pad_named
from fembridge.touching.shape import Shape
from fembridge.touching.stress import influence_pa

PIN_MM = 1.0
DEEPEST_UM = 600.0
# Few enough that nodes which come into contact one by one leave no kinks.
_LEVELS = 21


def pad_response(pad: Pad, diameter_mm: float = PIN_MM) -> ResponseMap:
    """Stress tensors at each site of the pad's finger under a flat pin over the apex."""
    nodes = skin_nodes(pad)
    gap_mm = gaps_mm(nodes, Shape.punch(diameter_mm))
    gap_mm -= gap_mm.min()
    near = gap_mm < DEEPEST_UM * 1e-3
    nodes, gap_mm = nodes.subset(near), gap_mm[near]
    depth_um = DEEPEST_UM * (np.arange(_LEVELS) / (_LEVELS - 1)) ** 1.5
    contact = Contact.of(nodes)
    forces = np.stack([contact.press(depth * 1e-3 - gap_mm) for depth in depth_um])
    sites = pad.finger.afferents
    names = list(sites)
    influence = influence_pa(
        pad,
        nodes,
        [sites[name].layer for name in names],
        np.array([sites[name].x_mm for name in names]),
        np.zeros(len(names)),
        np.array([sites[name].depth_mm for name in names]),
    )
    stress = np.einsum("cun,kn->kuc", influence, forces, dtype=np.float64)
    order = [COMPONENTS.index(name) for name in ("xx", "yy", "zz", "xy", "yz", "zx")]
    tensor = stress[..., order]
    tensor[..., 4:] = 0.0  # by symmetry about z = 0, but for rounding
    return ResponseMap(
        depth_um=depth_um,
        tensor_pa=tensor,
        force_n_per_mm=forces.sum(axis=1),
        places=tuple(
            AfferentNode(
                name,
                1 + n,
                sites[name].layer,
                sites[name].x_mm,
                -sites[name].depth_mm,
                sites[name].depth_mm,
            )
            for n, name in enumerate(names)
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
