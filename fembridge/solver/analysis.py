"""How the finite-element model is computed: element, inertia, section and material law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from decks.dialects import LAWS
from fembridge.errors import UsageError

if TYPE_CHECKING:
    from decks.contact_analysis import Contact, Model
    from decks.finger import Finger
    from decks.probe import Probe

DEFAULT_ELEMENT = "CPE4"


@dataclass(frozen=True, slots=True)
class Analysis:
    """How the finite-element model is computed.

    Parameters
    ----------
    element
        Element of the finger by Abaqus's name: ``"CPE4"``, ``"CPE4R"`` or ``"CPE8R"`` in
        CalculiX, also ``"CPE4H"``, ``"CPE4RH"`` or ``"CPE8"`` in decks for other solvers,
        or Marc's number, as ``"80"``. Default: None, CPE4 in CalculiX, CPE4H (80) in Abaqus
        and Marc.
    inertia
        Whether the mass of the skin counts while the probe follows its waveform.
        Default: False.
    whole_section
        Whether to solve both halves of a symmetric section. Default: False, the right half
        where a spring drives the probe.
    law
        Material law of skin and subcutaneous tissue under large strain: ``"linear"``, as in
        the paper, or ``"neo-hookean"``, with the same stiffness at rest and stiffer under
        strong compression. A layer with a law of its own keeps it. Default: ``"linear"``.

    Raises
    ------
    UsageError
        An unknown law.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.Analysis(law="neo-hookean").inertia
    False
    """

    element: str | None = None
    inertia: bool = False
    whole_section: bool = False
    law: str = "linear"

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise UsageError(argument="law", found=self.law, expected=" or ".join(LAWS))

    def model(
        self,
        finger: Finger,
        probe: Probe | None = None,
        contact: Contact | None = None,
        element: str | None = None,
    ) -> Model:
        """The model of `finger`, which is meshed where no stored mesh fits.

        Parameters
        ----------
        finger
            Sizes, materials and afferents in cross-section.
        probe
            Shape and position of the probe. Default: None, a cylinder of 1 mm.
        contact
            Contact of probe and skin. Default: None, that of the paper.
        element
            Element instead of that of the analysis, by Abaqus's name. Default: None.

        Raises
        ------
        MissingError, FingerError
            The finger needs a new mesh: gmsh is missing, or the mesh fails.
        """
        from decks.contact_analysis import Contact, Model
        from decks.presets import mesh_of
        from decks.probe import Probe

        return Model(
            finger,
            mesh_of(finger),
            probe or Probe(),
            contact or Contact(),
            element or self.element or DEFAULT_ELEMENT,
            self.inertia,
            section="whole" if self.whole_section else "half",
            law=self.law,
        )


DEFAULT_ANALYSIS = Analysis()


def load_finger(finger: str | Finger) -> Finger:
    """A `Finger` as it is, a preset by its name, or the finger of a TOML file."""
    from decks.finger import Finger
    from decks.presets import read_finger

    return finger if isinstance(finger, Finger) else read_finger(str(finger))
