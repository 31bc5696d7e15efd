"""The pad of a round fingertip: its deck, its skin and its afferents, all known by their names."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.inp import normalized_name
from fembridge.solver.fingertip import write_fingertip
from fembridge.solver.settings import Solver
from fembridge.touching.mesh_green import solve_mesh_pad
from fembridge.touching.mesh_pad import MeshPad, MeshSite
from fembridge.touching.pad_request import SiteRequest, SkinMap

if TYPE_CHECKING:
    from decks.fingertip import AfferentDepth, Fingertip

_OUTWARD, _ALONG = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def solve_fingertip_pad(
    folder: Path, tip: "Fingertip", reach_mm: float | None, settings: Solver
) -> MeshPad:
    """The pad of `tip`, whose map begins at its apex, with y out of the pad and z to the tip.

    Points with stress are the nodes of the mesh at the depth of each class.

    Parameters
    ----------
    folder
        Folder of the deck and of the runs.
    tip
        The fingertip.
    reach_mm
        Distance from the apex in mm up to which skin may be touched; None: all of it.
    settings
        Threads, limits, progress.

    Raises
    ------
    FingerError, MissingError
        The fingertip cannot be meshed, or gmsh or CalculiX is not installed.
    SolverError, ResponseError
        As `solve_mesh_pad`.
    """
    deck = write_fingertip(folder / "fingertip.inp", tip)
    class_of: dict[AfferentDepth, str] = {}  # classes at one depth have one set of nodes
    for name, site in tip.afferents.items():
        class_of.setdefault(site, name)
    requests = {
        name: SiteRequest(f"AFFERENTS_{class_of[site]}") for name, site in tip.afferents.items()
    }
    skin_map = SkinMap(deck.apex_node, _OUTWARD, _ALONG, reach_mm)
    pad = solve_mesh_pad(folder, deck.path, "SKIN", requests, skin_map, settings)
    return _in_layers(pad, tip, requests)


def _in_layers(pad: MeshPad, tip: "Fingertip", requests: Mapping[str, SiteRequest]) -> MeshPad:
    """`pad` with points in the layers of the fingertip instead of sets, at their exact depths."""
    site_of = {
        normalized_name(request.set_name): tip.afferents[name] for name, request in requests.items()
    }
    sites_of_sets = [site_of[name] for name in pad.layers]
    layers = tuple(dict.fromkeys(site.layer.upper() for site in sites_of_sets))
    number = np.array([layers.index(site.layer.upper()) for site in sites_of_sets])
    depth_mm = np.array([site.depth_mm for site in sites_of_sets])
    return replace(
        pad,
        name=tip.name,
        point_layer=number[pad.point_layer],
        point_depth_mm=depth_mm[pad.point_layer],
        layers=layers,
        sites={
            name: MeshSite(site.layer.upper(), site.depth_mm)
            for name, site in tip.afferents.items()
        },
    )
