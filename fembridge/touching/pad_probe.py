"""A probe on a pad: the stress of the afferents below it against its depth, as a response map.

A class has one unit with one ending, below the middle of the probe. Its stress is what
`fembridge.touch` computes there, so that parameters fitted under the probe hold for touches.

On ridged skin the stress depends on the ridges under the probe, and a recorded unit lies under any
of them. The map then has several positions of the probe, parts of a ridge apart, across the ridges;
the unit moves with the probe. Rates and thresholds are means over the positions.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fembridge.errors import UsageError, warn
from fembridge.host.progress import advance
from fembridge.io.run_folder import AfferentNode
from fembridge.ranges import check_range
from fembridge.response.response_map import ResponseMap
from fembridge.results.von_mises import TENSOR
from fembridge.touching.contact import press_to
from fembridge.touching.contact_warnings import (
    depth_warning,
    end_warning,
    narrow_part_mm,
    narrow_warning,
)
from fembridge.touching.fingerprint import Fingerprint
from fembridge.touching.pad import Pad
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population, check_inside
from fembridge.touching.relaxation import relaxation_of
from fembridge.touching.ridged_pad import RidgedPad, with_ridges
from fembridge.touching.shape import Shape, resolve_shape
from fembridge.touching.stress import driving_stress_pa
from fembridge.typing import FloatArray

# Depths at which contact is solved, closer together near 0.
_LEVELS = 31


@dataclass(frozen=True, kw_only=True, eq=False)
class PadProbe:
    """A probe pressed on a pad, under which afferents are recorded or fitted.

    `fembridge.fit`, `threshold`, `study` and `validate` take it as `pad`, `simulate` as `response`.

    Parameters
    ----------
    pad
        ``"reference"``; ``"macaque"``, a narrow finger; a round fingertip, ``"fingertip"`` or
        ``"fingertip_macaque"``; the path of a file, or a `Pad`. Default: ``"reference"``.
    shape
        The probe: a `Shape`, or a specification such as ``"punch:diameter_mm=0.7"`` of the
        shapes of `touch`. Default: ``"punch"``, a flat pin of 1 mm.
    at_mm
        Position of its middle, and of the units below, in mm across and along the finger.
        Default: ``(0, 0)``.
    ridges
        Fingerprint ridges on the skin, as in `touch`: ``"loop"``, ``"whorl"``, ``"across"``,
        ``"along"``, with sizes as in ``"whorl:period_mm=0.5"``, a `Fingerprint`, or ``"none"``.
        Default: None, as in `touch`: ``"loop"`` on the pad of a smooth finger, ``"none"`` on
        others.
    positions
        Positions of the probe across a ridge, 1 to 20; on skin without ridges there is one.
        Default: 3.
    deepest_um
        Largest depth of the probe in um, more than 0, at most 2000. Default: 600.

    Raises
    ------
    UsageError
        A number out of range.

    Examples
    --------
    >>> import fembridge as fb
    >>> probe = fb.PadProbe(shape="punch:diameter_mm=2", ridges="none")
    >>> probe.response.class_names()
    ['SA', 'RA', 'PC']
    """

    pad: str | Path | Pad = "reference"
    shape: str | Shape = "punch"
    at_mm: tuple[float, float] = (0.0, 0.0)
    ridges: str | Fingerprint | None = None
    positions: int = 3
    deepest_um: float = 600.0

    def __post_init__(self) -> None:
        if len(self.at_mm) != 2:
            raise UsageError(argument="at_mm", found=self.at_mm, expected="two numbers")
        for value in self.at_mm:
            check_range("at_mm", value)
        check_range("positions", self.positions)
        check_range("deepest_um", self.deepest_um)

    def skin(self) -> Pad:
        """The pad with its ridges.

        Raises
        ------
        UsageError
            An unknown pad or pattern, or a plane pad.
        ResponseError
            A pad that was altered.
        """
        pad = resolve_pad(self.pad)
        if pad.plane:
            raise UsageError(
                "is plane: its probes are endless along the finger, and the stored response of "
                "the finger (--finger) is the same",
                argument="pad",
                found=getattr(self.pad, "source", self.pad),
            )
        return with_ridges(pad, self.ridges)

    def positions_mm(self, skin: Pad) -> FloatArray:
        """Positions of the probe in mm, ``(position, 2)``.

        Parameters
        ----------
        skin
            The pad with its ridges, as `skin` returns it.
        """
        at_mm = np.array(self.at_mm, dtype=np.float64)
        if not (isinstance(skin, RidgedPad) and skin.fingerprint.height_mm):
            return at_mm[np.newaxis]
        across = np.array(skin.fingerprint.across(*self.at_mm))
        share = (np.arange(self.positions) - (self.positions - 1) / 2) / self.positions
        positions_mm: FloatArray = at_mm + np.outer(share * skin.fingerprint.period_mm, across)
        return positions_mm

    @cached_property
    def response(self) -> ResponseMap:
        """Stress of a unit of each class of the pad against the depth of the probe.

        Returns
        -------
        ResponseMap
            Of each class a unit at each position; `force_n` is the mean over positions. The
            stress that drives a unit is the component xx of an otherwise empty tensor.

        Raises
        ------
        UsageError
            An unknown pad or shape, or a position beside the skin.
        ResponseError
            A pad that was altered.

        Warns
        -----
        FembridgeWarning
            The pad relaxes, the probe is finer than the nodes of the skin, or contact reaches the
            end of the skin.
        """
        skin, shape = self.skin(), resolve_shape(self.shape)
        if relaxation_of(skin) is not None:
            warn("the pad relaxes, but the map of a probe is that of its instantaneous moduli")
        depth_um = self.deepest_um * (np.arange(_LEVELS) / (_LEVELS - 1)) ** 1.5
        classes, positions_mm = tuple(skin.afferents), self.positions_mm(skin)
        stress_pa = np.empty((depth_um.size, len(classes), len(positions_mm)))
        force_n = np.zeros(depth_um.size)
        texts: dict[str, None] = {}
        for k, position_mm in enumerate(positions_mm):
            x_mm, z_mm = np.repeat(position_mm[:, np.newaxis], len(classes), axis=1)
            units = Population.at(classes, x_mm, z_mm, finger=skin).with_endings(0.0)
            check_inside(skin, units)
            probe = shape.moved(*position_mm.tolist())
            nodes, forces_n, _ = press_to(skin, probe, depth_um)
            stress_pa[..., k] = driving_stress_pa(skin, nodes, forces_n, units)
            force_n += forces_n.sum(axis=1) / len(positions_mm)
            width_mm = narrow_part_mm(skin, probe, nodes, forces_n[-1])
            texts[narrow_warning(skin, shape.name, width_mm) or ""] = None
            texts[end_warning(skin, nodes, forces_n) or ""] = None
            advance("probe on the pad", (k + 1) / len(positions_mm))
        for text in (*texts, depth_warning(self.deepest_um)):
            if text:
                warn(text)
        tensor_pa = np.zeros((depth_um.size, stress_pa[0].size, len(TENSOR)))
        tensor_pa[..., 0] = stress_pa.reshape(depth_um.size, -1)
        return ResponseMap(
            depth_um=depth_um,
            tensor_pa=tensor_pa,
            force_n_per_mm=np.empty(0),
            places=_units(skin, classes, positions_mm),
            closure_percent=0.0,
            origin=_origin(skin, shape.moved(*self.at_mm), positions_mm),
            force_n=force_n,
            is_mean=len(positions_mm) > 1,
        )


def pad_probe(pad: "str | Path | Pad | PadProbe") -> PadProbe:
    """The default probe on a pad; a `PadProbe` is returned unchanged.

    Parameters
    ----------
    pad
        A pad, its name or path, or a probe on a pad.
    """
    return pad if isinstance(pad, PadProbe) else PadProbe(pad=pad)


def _units(
    skin: Pad, classes: tuple[str, ...], positions_mm: FloatArray
) -> tuple[AfferentNode, ...]:
    """Units class by class; `unit` numbers the positions of the probe if there are several."""
    is_single = len(positions_mm) == 1
    places = [(name, k) for name in classes for k in range(len(positions_mm))]
    return tuple(
        AfferentNode(
            name,
            node,
            skin.afferents[name].layer,
            float(positions_mm[k, 0]),
            -skin.afferents[name].depth_mm,
            skin.afferents[name].depth_mm,
            float(positions_mm[k, 1]),
            unit="" if is_single else str(k + 1),
        )
        for node, (name, k) in enumerate(places, start=1)
    )


def _origin(skin: Pad, shape: Shape, positions_mm: FloatArray) -> Mapping[str, Any]:
    """Origin of the map: pad, ridges and probe; the model without paths."""
    pad = {"source": Path(skin.source).name, "sha256": skin.sha256, **skin.origin}
    ridges = skin.fingerprint.to_table() if isinstance(skin, RidgedPad) else None
    return {
        "finger": skin.model_table,
        "mechanics": {
            **skin.mechanics,
            "pad": Path(skin.source).name or "own",
            "probe": shape.name,
        },
        "pad": {key: value for key, value in pad.items() if value not in (None, "")},
        **({} if ridges is None else {"ridges": ridges}),
        "probe": shape.to_table(),
        "positions_mm": positions_mm.tolist(),
    }
