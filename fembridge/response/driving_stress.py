"""The stress that a model of an afferent reads: von Mises, or that of equal energy.

Most drives read von Mises stress, as the paper's. A drive whose `quantity` is
``energy`` reads the uniaxial stress of equal strain energy; it takes Poisson's ratio
of the layer in which the afferent lies, which the origin of a response has.
"""

from collections.abc import Mapping
from typing import TypeAlias

from fembridge.errors import ResponseError
from fembridge.response.response_map import ResponseMap
from fembridge.results.stress import energy_stress_pa, von_mises_pa
from fembridge.run_folder import AfferentNode
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import FloatArray
from neural.drive_model import Drive
from neural.drive_table import drive_of
from neural.parameters import AfferentParameters

ENERGY = "energy"

Models: TypeAlias = Mapping[str, Drive] | Mapping[str, AfferentParameters]
"""By class of afferents: rows of the table of drives, or parameters."""


def driving_stress(response: ResponseMap, stimulus: Stimulus, models: Models) -> list[StressTrace]:
    """Give the stress that drives each afferent while the probe follows `stimulus`.

    Parameters
    ----------
    models
        Drives or parameters by class; a class that is not there reads von Mises
        stress.

    Returns
    -------
    list of StressTrace
        One for each afferent of `response`, in its order. Where no model reads
        energy they are those of ``response.traces``.

    Raises
    ------
    ResponseError
        The stimulus goes deeper than the map, or its origin has not the material
        that an energy takes.
    """
    tensor_pa = response.tensors(stimulus.displacement_um, stimulus.id)
    return [
        StressTrace(
            _stress_pa(tensor_pa[:, column], response, place, models),
            stimulus.dt_ms,
            place.node,
            place.afferent,
        )
        for column, place in enumerate(response.places)
    ]


def reading_energy(models: Models) -> str | None:
    """Name the first class whose model reads energy; None: von Mises will do."""
    for afferent, model in models.items():
        drive = drive_of(model) if isinstance(model, AfferentParameters) else model
        if drive.quantity == ENERGY:
            return afferent
    return None


def poisson_at(response: ResponseMap, place: AfferentNode) -> float:
    """Give Poisson's ratio of the layer in which an afferent lies.

    Raises
    ------
    ResponseError
        The origin of `response` does not tell it.
    """
    found: object = response.origin
    for key in ("finger", "materials", place.layer, "poisson"):
        found = found.get(key) if isinstance(found, Mapping) else None
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise ResponseError(
            f"the response does not tell Poisson's ratio of {place.layer}, in which "
            f"{place.afferent} lies: no energy can be taken of its stress"
        )
    return float(found)


def _stress_pa(
    tensor_pa: FloatArray, response: ResponseMap, place: AfferentNode, models: Models
) -> FloatArray:
    model = models.get(place.afferent)
    drive = drive_of(model) if isinstance(model, AfferentParameters) else model
    if drive is not None and drive.quantity == ENERGY:
        return energy_stress_pa(tensor_pa, poisson_at(response, place))
    return von_mises_pa(tensor_pa)
