"""From a probe on a fingertip to the spikes of its afferents.

>>> import fembridge as fb
>>> result = fb.simulate("sine_100_250", stored=True)
>>> result.rates["afferent"].tolist()
['SA', 'RA', 'PC']

Arguments have the words of the options of the command line. Times are in ms, depths in um,
stress in Pa, rates in impulses per second. Errors are `FembridgeError`, doubts about a result
`FembridgeWarning`; progress and choices are logged by `logging`. Results have ``plot(kind,
ax)``, ``write(folder)``, ``read(folder)`` and ``provenance``.

``__all__`` has the functions and the objects that they take. Further names are the types of
their results (``Simulation``, ``Touch``, ...), ``make_stimulus`` and ``resolve`` of the
catalogue, ``read_history``, ``read_fields`` and ``write_vtu_series`` for whole result files,
``Recording`` for spikes in the formats of other programs, ``ResponseMap``, ``read_observed``
and ``touchsim_rates``. ``import fembridge`` loads NumPy and nothing heavier; the rest is
imported on first use.
"""

from fembridge.host import interrupt as _interrupt  # noqa: F401 - first: the rest takes long

# isort: split
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.version import __version__ as __version__

if TYPE_CHECKING:
    from decks.contact_analysis import Contact
    from decks.finger import Finger
    from decks.probe import Probe
    from decks.stimuli import resolve as resolve
    from decks.synthesis import make_stimulus as make_stimulus
    from fembridge.errors import FembridgeError, FembridgeWarning
    from fembridge.evidence import touchsim_rates as touchsim_rates
    from fembridge.fitting.fit import Fit as Fit
    from fembridge.fitting.fit import FitTargets as FitTargets
    from fembridge.fitting.fit import Search as Search
    from fembridge.fitting.fit import fit
    from fembridge.fitting.model_study import ModelStudy as ModelStudy
    from fembridge.fitting.model_study import study
    from fembridge.fitting.thresholds import Thresholds as Thresholds
    from fembridge.fitting.thresholds import threshold
    from fembridge.io.observed_rates import read_observed as read_observed
    from fembridge.io.recording import Recording as Recording
    from fembridge.io.waveform import Waveform
    from fembridge.reporting.deflect import Deflections as Deflections
    from fembridge.reporting.deflect import deflect
    from fembridge.reporting.explorer import Explorer as Explorer
    from fembridge.reporting.explorer import explore
    from fembridge.reporting.folder_page import Report as Report
    from fembridge.reporting.folder_report import report
    from fembridge.reporting.validation import Validation as Validation
    from fembridge.reporting.validation import validate
    from fembridge.reporting.verify import Verification as Verification
    from fembridge.reporting.verify import verify
    from fembridge.response.response_map import ResponseMap as ResponseMap
    from fembridge.results import read
    from fembridge.results import read_fields as read_fields
    from fembridge.results import read_history as read_history
    from fembridge.results.vtu import write_vtu_series as write_vtu_series
    from fembridge.simulation.calibrate import Calibration as Calibration
    from fembridge.simulation.calibrate import calibrate
    from fembridge.simulation.deck_response import DeckResponse as DeckResponse
    from fembridge.simulation.deck_response import map_deck, map_response
    from fembridge.simulation.encode import encode
    from fembridge.simulation.encoding import Encoding as Encoding
    from fembridge.simulation.sample import sample
    from fembridge.simulation.simulate import simulate
    from fembridge.simulation.simulation import Simulation as Simulation
    from fembridge.solver.analysis import Analysis
    from fembridge.solver.ccx import run
    from fembridge.solver.check import DeckCheck as DeckCheck
    from fembridge.solver.check import check
    from fembridge.solver.deck import build_deck, rebase_deck
    from fembridge.solver.fingertip import FingertipDeck as FingertipDeck
    from fembridge.solver.fingertip import write_fingertip
    from fembridge.solver.settings import Solver
    from fembridge.stimulus import Stimulus
    from fembridge.sweeps.dataset import Touches as Touches
    from fembridge.sweeps.sweep import Sweep as Sweep
    from fembridge.sweeps.sweep import sweep
    from fembridge.sweeps.touches import touch_many
    from fembridge.touching.fingerprint import Fingerprint
    from fembridge.touching.make_pad import make_pad, pad_decks
    from fembridge.touching.pad import Pad
    from fembridge.touching.pad_probe import PadProbe
    from fembridge.touching.pad_request import SkinMap
    from fembridge.touching.population import Population
    from fembridge.touching.receptive_field import ReceptiveField as ReceptiveField
    from fembridge.touching.receptive_field import receptive_field
    from fembridge.touching.shape import Shape
    from fembridge.touching.touch import touch
    from fembridge.touching.touch_result import Touch as Touch
    from fembridge.touching.trajectory import Trajectory
    from fembridge.trace import StressTrace
    from neural.c_header import export_c

__all__ = [  # noqa: RUF022 - the main job first, then from deck to spikes, then what is built on it
    "simulate",
    "build_deck",
    "check",
    "rebase_deck",
    "write_fingertip",
    "map_response",
    "map_deck",
    "run",
    "read",
    "encode",
    "calibrate",
    "export_c",
    "touch",
    "touch_many",
    "receptive_field",
    "make_pad",
    "pad_decks",
    "sweep",
    "fit",
    "threshold",
    "study",
    "validate",
    "verify",
    "deflect",
    "report",
    "explore",
    "sample",
    "Stimulus",
    "Waveform",
    "StressTrace",
    "Finger",
    "Probe",
    "Contact",
    "Analysis",
    "Solver",
    "Shape",
    "Trajectory",
    "Population",
    "Fingerprint",
    "PadProbe",
    "Pad",
    "SkinMap",
    "FembridgeError",
    "FembridgeWarning",
]

_HOMES = {
    name: home
    for home, names in (
        ("fembridge.simulation.simulate", "simulate"),
        ("fembridge.simulation.simulation", "Simulation"),
        ("fembridge.simulation.sample", "sample"),
        ("fembridge.simulation.deck_response", "map_deck map_response DeckResponse"),
        ("fembridge.simulation.encode", "encode"),
        ("fembridge.simulation.encoding", "Encoding"),
        ("fembridge.simulation.calibrate", "calibrate Calibration"),
        ("neural.c_header", "export_c"),
        ("fembridge.solver.deck", "build_deck rebase_deck"),
        ("fembridge.solver.check", "check DeckCheck"),
        ("fembridge.solver.fingertip", "write_fingertip FingertipDeck"),
        ("fembridge.solver.ccx", "run"),
        ("fembridge.solver.analysis", "Analysis"),
        ("fembridge.results", "read read_fields read_history"),
        ("fembridge.results.vtu", "write_vtu_series"),
        ("fembridge.touching.touch", "touch"),
        ("fembridge.touching.touch_result", "Touch"),
        ("fembridge.touching.trajectory", "Trajectory"),
        ("fembridge.touching.receptive_field", "receptive_field ReceptiveField"),
        ("fembridge.touching.fingerprint", "Fingerprint"),
        ("fembridge.touching.make_pad", "make_pad pad_decks"),
        ("fembridge.touching.pad_request", "SkinMap"),
        ("fembridge.touching.pad", "Pad"),
        ("fembridge.touching.pad_probe", "PadProbe"),
        ("fembridge.touching.shape", "Shape"),
        ("fembridge.touching.population", "Population"),
        ("fembridge.sweeps.sweep", "sweep Sweep"),
        ("fembridge.sweeps.touches", "touch_many"),
        ("fembridge.sweeps.dataset", "Touches"),
        ("fembridge.reporting.validation", "validate Validation"),
        ("fembridge.reporting.verify", "verify Verification"),
        ("fembridge.reporting.deflect", "deflect Deflections"),
        ("fembridge.reporting.folder_report", "report"),
        ("fembridge.reporting.folder_page", "Report"),
        ("fembridge.reporting.explorer", "explore Explorer"),
        ("fembridge.solver.settings", "Solver"),
        ("fembridge.stimulus", "Stimulus"),
        ("fembridge.trace", "StressTrace"),
        ("fembridge.io.waveform", "Waveform"),
        ("fembridge.io.recording", "Recording"),
        ("fembridge.response.response_map", "ResponseMap"),
        ("fembridge.io.observed_rates", "read_observed"),
        ("fembridge.fitting.fit", "fit Fit FitTargets Search"),
        ("fembridge.fitting.thresholds", "threshold Thresholds"),
        ("fembridge.fitting.model_study", "study ModelStudy"),
        ("fembridge.evidence", "touchsim_rates"),
        ("fembridge.errors", "FembridgeError FembridgeWarning"),
        ("decks.contact_analysis", "Contact"),
        ("decks.finger", "Finger"),
        ("decks.probe", "Probe"),
        ("decks.stimuli", "resolve"),
        ("decks.synthesis", "make_stimulus"),
    )
    for name in names.split()
}
"""Where each public name is."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    if name not in _HOMES:
        raise AttributeError(f"module 'fembridge' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(
        [*_HOMES, "__all__", "__doc__", "__file__", "__name__", "__path__", "__version__"]
    )


def _refuse_other_packages() -> None:
    """Refuse to work if ``decks`` or ``neural`` is a module of another project.

    A file ``neural.py`` in the current folder, or another installed package of that name, hides
    the package that fembridge needs. Both are searched, not imported.
    """
    home = Path(__file__).resolve().parent.parent
    for name in ("decks", "neural"):
        try:
            spec = find_spec(name)
        except ValueError:  # a module without a spec has been put there by hand
            spec = None
        locations = [] if spec is None else list(spec.submodule_search_locations or [])
        if str(home / name) in {str(Path(folder).resolve()) for folder in locations}:
            continue
        if spec is None:
            raise ImportError(f"fembridge: no package {name!r} in {home}; install fembridge again")
        foreign_origin = spec.origin or ", ".join(locations)
        raise ImportError(
            f"fembridge: {foreign_origin} hides the package {name!r} of "
            f"fembridge, expected in {home / name}; rename it or take it off the path"
        )


_refuse_other_packages()
