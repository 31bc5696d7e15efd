"""What each verb writes: its files, and of each table every column with unit and meaning.

This is the one table of it: `fembridge VERB --help` shows it, and docs/outputs.md is
``python -m fembridge.commands.written``. A name in angle brackets stands for columns that
differ from case to case.
"""

import textwrap
from typing import NamedTuple


class Column(NamedTuple):
    """A column of a table: its name, the unit of its numbers ("" for none), its meaning."""

    name: str
    unit: str
    meaning: str


class Output(NamedTuple):
    """A file that a verb writes, what it is, and its columns if it is a table."""

    file: str
    what: str
    columns: tuple[Column, ...] = ()


def _columns(*rows: tuple[str, str, str]) -> tuple[Column, ...]:
    return tuple(Column(*row) for row in rows)


_STIMULUS = ("stimulus", "", "id of the stimulus, as `fembridge stimuli` lists it")
_AFFERENT = ("afferent", "", "class of the afferent: SA, RA or PC")
_REPEAT = ("repeat", "", "number of the cell in its population, from 1; 0 of a single one")
_UNIT = ("unit", "", "number of the unit in the population")
_SPIKE_TIME = ("spike_time_ms", "ms", "time of a spike; 0 is the start of the stimulus")
_RATE = ("rate_ips", "impulses/s", "firing rate in the window that is counted, mean of all cells")
_SPIKES_IN_WINDOW = ("spikes", "", "spikes in the window that is counted, of all cells")
_PEAK = ("peak_stress_pa", "Pa", "largest von Mises stress at the afferent")
_TIME = ("time_ms", "ms", "time; 0 is the start of the stimulus, or of the solver's clock")
_SOURCE = ("source", "", "whose numbers: a model, TouchSim or observed")
_FAMILY = ("family", "", "family of stimuli: sine, diharm, noise or ramp")
_SET = ("set", "", "frequencies or band of the stimuli")
_MESH = ("mesh", "", "name of the mesh, or of its finger")
_ELEMENTS = ("elements", "", "elements of the mesh")
_DISTANCE = ("distance_mm", "mm", "distance from the middle of the probe along the skin")
_DEFLECTION = ("deflection_mm", "mm", "how far the skin has gone down there")
_FREQUENCY = ("frequency_hz", "Hz", "frequency of the sinusoid")
_STEP = ("step", "", "step of the deck, from 1")
_INCREMENT = ("increment", "", "increment of the step, from 1")
_ATTEMPT = ("attempt", "", "attempt at the increment, from 1")

_UNIT_OF = (_STIMULUS, _AFFERENT, ("unit", "", "name of the unit"))
_PLACE = (
    ("x_mm", "mm", "place across the finger, to the right; 0 in the middle of the pad"),
    ("z_mm", "mm", "place along the finger, towards the tip; 0 in the middle of the pad"),
)
_UNITS = _columns(
    ("unit", "", "name of the unit"),
    _AFFERENT,
    *_PLACE,
    ("depth_mm", "mm", "depth below the skin"),
    ("deviate", "", "q: the unit needs exp(spread q) times the stress of the median"),
)

_EFFECT = (
    ("parameter", "", "what was varied, such as skin.dermis_mm"),
    ("low", "in the parameter", "its low end"),
    ("base", "in the parameter", "its value in the base"),
    ("high", "in the parameter", "its high end"),
    _AFFERENT,
    ("quantity", "", "rate_ips or peak_stress_pa"),
    ("stimuli", "", "the set whose mean it is, or all"),
)


def _of_increment_and_job(*counts: tuple[str, str]) -> list[tuple[str, str, str]]:
    return [
        *((name, "", f"{words} of the increment") for name, words in counts),
        *((f"total_{name}", "", f"{words} since the job began") for name, words in counts),
    ]


_AMPLITUDE = ("amplitude_um", "um", "amplitude of the sinusoid, zero to peak")

_SPIKES = _columns(_STIMULUS, _AFFERENT, _REPEAT, _SPIKE_TIME)
_RATES = _columns(_STIMULUS, _AFFERENT, _RATE)
_WAVEFORM = _columns(
    _TIME,
    ("displacement_um", "um", "depth of the probe, positive into the skin; 0 at first touch"),
)
_TRACES = _columns(
    _TIME,
    ("afferent", "", "class of the afferent; empty where the node is of none"),
    ("node", "", "node of the solver; of an integration point element x 100 + point"),
    ("von_mises_pa", "Pa", "von Mises stress there"),
)

_RECORDING = Output(
    "spikes.npz", "the spikes for other programs (--export); also .mat, .nwb, .pkl, .h5"
)

OUTPUTS: dict[str, tuple[Output, ...]] = {
    "stimuli": (
        Output("ID.csv", "waveform of a stimulus (--export csv)", _WAVEFORM),
        Output("ID.npy", "its displacement alone in um, a sample every 0.5 ms"),
        Output("ID.wav", "the same as 16-bit sound; its comment says what 32767 is in um, the "
               "same for all files of an export"),
        Output("ID.marc.dat", "the same as a table of a Marc deck, in s and mm"),
    ),
    "build-deck": (
        Output("ID/job.inp", "the deck; job.dat and job.proc for Marc"),
        Output("ID/stimulus.csv", "the waveform; aside_um too where the probe slides", _WAVEFORM),
        Output("ID/run.toml", "which node is which afferent, times, what the deck was made from"),
    ),
    "run": (
        Output("job.frd, job.dat, job.sta, job.cvg", "what CalculiX wrote, accepted"),
        Output("solver.toml", "what they answer and cost, with checksums"),
        Output("solver.log", "what the solver printed"),
        Output("failed/", "files of a run that was not accepted, and cause.txt"),
    ),
    "ingest": (
        Output("NAME_traces.csv", "stress at nodes or points", _TRACES),
        Output("NAME_traces.csv.toml", "of which run they are, which encode reads"),
        Output(
            "NAME_displacement.csv",
            "another quantity at nodes (--quantity), output by output",
            _columns(
                _TIME,
                ("afferent", "", "class that sits at the node; empty for a plain node"),
                ("node", "", "node of the solver"),
                ("step, increment", "", "of the output; absent where resampled"),
                ("<component>", "in the name", "component, such as sxx_pa or d1_mm"),
            ),
        ),
        Output(
            "NAME_modes_displacement.csv",
            "modes of a frequency or buckling step; also of a file that has no times",
            _columns(
                ("step, mode", "", "numbers of the step and of its mode"),
                ("frequency_hz", "Hz", "its frequency; or buckling_factor, or number"),
                ("node", "", "node of the solver"),
                ("<component>", "in the name", "component, such as von_mises_pa or d1_mm"),
            ),
        ),
        Output(
            "NAME_sides.csv",
            "stress at a node in each material there (--one-sided)",
            _columns(
                _TIME,
                ("node", "", "node of the solver"),
                ("material", "", "name of the material, or of its elements"),
                ("von_mises_pa", "Pa", "von Mises stress on this side"),
                ("<xx, yy, zz, xy, yz, zx>_pa", "Pa", "component of its stress tensor"),
            ),
        ),
        Output(
            "NAME_stress_1_39.csv",
            "a quantity at all nodes at an increment (--field); as .npz with nodes, values, units",
            _columns(
                ("node", "", "node of the solver"),
                ("<component>", "in the name", "component, such as sxx_pa or d1_mm"),
            ),
        ),
        Output(
            "NAME_dat.csv",
            "what CalculiX printed, a number a row",
            _columns(
                _TIME,
                ("mode", "", "number of the mode, where there is no time"),
                ("quantity", "", "what was printed, such as total force"),
                ("set", "", "set of nodes or elements"),
                ("node", "", "node of the solver"),
                ("element", "", "element of the solver"),
                ("point", "", "integration point of the element"),
                ("face", "", "face of the element"),
                ("component", "", "component of the quantity"),
                ("value", "in unit", "the number"),
                ("unit", "", "unit of the value"),
            ),
        ),
        Output(
            "NAME_sta.csv",
            "increments of CalculiX",
            _columns(
                _STEP,
                _INCREMENT,
                _ATTEMPT,
                ("failed", "", "1 where the attempt was given up"),
                ("iterations", "", "iterations of the attempt"),
                ("total_time_ms", "ms", "time since the first step began"),
                ("step_time_ms", "ms", "time since the step began"),
                ("increment_time_ms", "ms", "length of the increment"),
            ),
        ),
        Output(
            "NAME_cvg.csv",
            "iterations of CalculiX",
            _columns(
                _STEP,
                _INCREMENT,
                _ATTEMPT,
                ("iteration", "", "iteration of the attempt, from 1"),
                ("contact_springs", "", "contact springs or elements"),
                ("force_residual_percent", "%", "largest residual force, of the mean force"),
                ("displacement_correction_percent", "%", "largest correction, of the change"),
                ("flux_residual_percent", "%", "the same of a flux"),
                ("temperature_correction_percent", "%", "the same of a temperature"),
            ),
        ),
        Output(
            "NAME_sts.csv",
            "increments of Marc",
            _columns(
                ("load_case", "", "load case of the job"),
                _INCREMENT,
                *_of_increment_and_job(
                    ("cycles", "iterations"),
                    ("separations", "separations of contact"),
                    ("cut_backs", "cut-backs"),
                ),
                ("remeshings", "", "remeshings"),
                ("increment_time_ms", "ms", "length of the increment"),
                ("total_time_ms", "ms", "time since the job began"),
                ("displacement_min_mm", "mm", "least length of a displacement"),
                ("displacement_max_mm", "mm", "greatest length of one"),
            ),
        ),
        Output("NAME_plot.csv", "a plot saved from Mentat, number by number, units as there"),
        Output("FOLDER/*.vtu, *.pvd", "every increment for ParaView (--vtu); units in array names"),
    ),
    "export-script": (Output("FILE", "the script; its table is that of ingest's traces"),),
    "encode": (
        Output("spikes.csv", "a row a spike; where a class has several, unit behind it", _SPIKES),
        Output("rates.csv", "a row a trace; unit as in spikes.csv", _RATES),
        Output("raster.png", "the spikes, a panel a class"),
        _RECORDING,
    ),
    "simulate": (
        Output("rates.csv", "a row a stimulus and afferent", _RATES),
        Output("spikes.csv", "a row a spike", _SPIKES),
        Output(
            "traces.npz",
            "arrays for numpy.load",
            _columns(
                ("stimulus", "", "(S,) ids"),
                ("afferent", "", "(A,) classes"),
                ("dt_ms", "ms", "() time between samples; the first is at 0"),
                ("displacement_um", "um", "(S, T) depth of the probe; NaN behind a shorter one"),
                ("von_mises_pa", "Pa", "(S, T, A) von Mises stress at the afferents, as long"),
            ),
        ),
        Output("simulation.toml", "how it was computed: method, response, parameters, stimuli"),
        Output("finger.toml", "the whole finger of the response, which --finger takes"),
        Output("raster.png", "the spikes: a panel a class, a row a stimulus"),
        _RECORDING,
        Output("response/", "what the solver made, where one ran"),
    ),
    "touch": (
        Output("population.csv", "a row a unit", _UNITS),
        Output("spikes.csv", "a row a spike", _columns(*_UNIT_OF, _REPEAT, _SPIKE_TIME)),
        Output("rates.csv", "a row a unit", _columns(*_UNIT_OF, _RATE)),
        Output(
            "touch.csv",
            "how it was pressed",
            _columns(
                _TIME,
                ("depth_um", "um", "depth of what touches, from first touch"),
                ("force_n", "N", "force on the skin"),
            ),
        ),
        Output("pad.png", "who fires how much, where the shape is, depth and force over time"),
        Output("raster.png", "spikes of every unit that fires, a panel a class"),
        _RECORDING,
        Output("touch.gif", "pressure, stress and spikes over time (--animate); .mp4 with ffmpeg"),
    ),
    "receptive-field": (
        Output(
            "areas.csv",
            "a row a depth",
            _columns(
                _AFFERENT,
                ("depth_um", "um", "how deep the probe goes"),
                ("area_mm2", "mm2", "area where the criterion is reached"),
                ("whole", "", "False where the field goes on beyond the skin that may be touched"),
            ),
        ),
        Output(
            "fields.csv",
            "a row a place of the probe",
            _columns(
                _AFFERENT,
                ("depth_um", "um", "how deep the probe goes"),
                *_PLACE,
                ("impulses", "", "impulses of the unit in the middle of the pad"),
            ),
        ),
        Output("field_CLASS.png", "the field at each depth"),
    ),
    "pad": (Output("FILE.npz", "Green's functions of a finger, which touch --pad takes"),),
    "sweep": (
        Output(
            "results.csv",
            "a row a point and afferent",
            _columns(
                ("finger", "", "name of the finger"),
                ("<parameter>", "in the name", "what differs between points: skin.dermis_mm"),
                _STIMULUS,
                _AFFERENT,
                _RATE,
                _SPIKES_IN_WINDOW,
                _PEAK,
                ("status", "", "done or failed"),
                ("cause", "", "why it failed"),
                ("run", "", "folder of the item"),
            ),
        ),
        Output(
            "runs/KEY/answers.csv",
            "the answers of an item",
            _columns(_STIMULUS, _AFFERENT, _RATE, _SPIKES_IN_WINDOW, _PEAK),
        ),
        Output("runs/KEY/spikes.csv", "its spikes", _SPIKES),
        Output("runs/KEY/item.toml", "its inputs, and checksums of the two"),
        Output("solves/KEY/", "mesh, deck and results of a solve, and response.toml"),
    ),
    "fit": (
        Output("fitted.toml", "parameters, which --parameters takes, and how they came about"),
        Output(
            "pareto_SA.csv",
            "the Pareto front of a class, a row a candidate",
            _columns(
                _AFFERENT,
                ("candidate", "", "number of the candidate, from 1"),
                ("chosen", "", "yes of the one that was taken"),
                ("<parameter>", "in the name", "free parameter of the model (--drive list)"),
                ("rmse_<frequency>_ips", "impulses/s", "root of the mean squared error of rates"),
            ),
        ),
        Output("fitted_rates.csv", "rates that the parameters give", _RATES),
        Output("tradeoffs.png", "the front, and predicted against observed rates"),
    ),
    "study": (
        Output(
            "study.csv",
            "a row a case and seed",
            _columns(
                _AFFERENT,
                ("drive", "", "model of the afferent (fit --drive list)"),
                ("cells", "", "cells of the population"),
                ("preindent_um", "um", "depth of the probe before time 0"),
                ("free_parameters", "", "parameters that are searched"),
                ("seed", "", "seed of the search"),
                ("fitted_r_squared", "", "R2 on the sinusoids that were fitted"),
                ("fitted_rmse_ips", "impulses/s", "error there"),
                ("held_out_r_squared", "", "R2 on each frequency when it was left out"),
                ("held_out_rmse_ips", "impulses/s", "error there"),
                ("parameters", "", "name=value with blanks"),
            ),
        ),
        Output("study.md", "medians over seeds, the best case first"),
        Output("study.png", "errors of all cases"),
    ),
    "threshold": (
        Output(
            "thresholds.csv",
            "a row a class, criterion and frequency",
            _columns(
                _AFFERENT,
                ("criterion", "", "absolute: first impulse; one_impulse_a_cycle"),
                ("frequency_hz", "Hz", "of the vibration"),
                ("amplitude_um", "um", "threshold of the median cell, zero-to-peak"),
                ("least_um", "um", "of the keenest cell"),
                ("most_um", "um", "of the dullest cell"),
            ),
        ),
        Output("thresholds.png", "tuning curves, with observed thresholds"),
    ),
    "validate": (
        Output("index.html", "the page; its figures lie beside it as SVG"),
        Output("validation.toml", "what it was made from"),
        Output(
            "rates.csv",
            "every rate",
            _columns(
                _SOURCE, _STIMULUS, _AFFERENT, _RATE, _FAMILY, _SET,
                ("level_um", "um", "amplitude, or RMS of a noise"),
            ),
        ),
        Output(
            "agreement.csv",
            "a row a pair of sources and set of stimuli",
            _columns(
                ("reference", "", "what is held against: observed or touchsim"),
                _SOURCE, _FAMILY, _SET, _AFFERENT,
                ("count", "", "rates that were compared"),
                ("slope", "", "of the regression of source on reference"),
                ("intercept_ips", "impulses/s", "of the same"),
                ("r_squared", "", "of the same"),
                ("p_value", "", "of the same"),
                ("rmse_ips", "impulses/s", "root of the mean squared difference"),
                ("bias_ips", "impulses/s", "mean difference, source less reference"),
            ),
        ),
        Output("rasters.csv", "spikes that are drawn", _columns(_SOURCE, *_SPIKES)),
        Output(
            "locking.csv",
            "phase locking to sinusoids",
            _columns(
                _SOURCE, _AFFERENT, _STIMULUS, _FREQUENCY,
                ("amplitude_um", "um", "amplitude of the sinusoid, zero to peak"),
                ("impulses_per_cycle", "", "spikes in a cycle"),
                ("vector_strength", "", "0: at any phase, 1: all at one"),
            ),
        ),
        Output(
            "entrainment.csv",
            "where an afferent fires once a cycle",
            _columns(
                _SOURCE, _AFFERENT, _FREQUENCY,
                ("entrainment_threshold_um", "um", "smallest amplitude with a spike a cycle"),
                ("plateau_low_um", "um", "where one a cycle begins"),
                ("plateau_high_um", "um", "where it ends"),
                ("plateau_decades", "", "decimal logarithm of their ratio"),
            ),
        ),
        Output(
            "thresholds.csv",
            "amplitude at which an afferent answers",
            _columns(
                _SOURCE, _AFFERENT, _FREQUENCY,
                ("criterion_ips", "impulses/s", "rate that counts as an answer"),
                ("lowest_tried_um", "um", "smallest amplitude that was tried"),
                ("highest_tried_um", "um", "largest one"),
                ("threshold_um", "um", "smallest amplitude with an answer; empty: none"),
            ),
        ),
        Output(
            "timing.csv",
            "timing beside recorded afferents",
            _columns(
                _AFFERENT, _FREQUENCY, _AMPLITUDE,
                ("impulses_per_cycle", "", "recorded impulses in a cycle"),
                ("strength_f", "", "recorded vector strength at the frequency"),
                ("strength_2f", "", "recorded vector strength at twice the frequency"),
                ("model_impulses_per_cycle", "", "of the class, mean of its cells"),
                ("model_strength_f", "", "of the model, at the frequency"),
                ("model_strength_2f", "", "of the model, at twice the frequency"),
                ("model_keenest_impulses", "", "impulses in a cycle of the most sensitive cell"),
                ("strengths_near", "", "whether both strengths are within 0.25"),
                ("impulses_near", "", "whether the keenest cell's impulses are within 30 %"),
            ),
        ),
        Output(
            "phases.csv",
            "when in a cycle spikes come",
            _columns(
                _AFFERENT, _FREQUENCY, _AMPLITUDE,
                ("phase_ms", "ms", "start of the bin, from the start of a cycle"),
                ("recorded", "", "share of the recorded spikes"),
                ("model", "", "share of the model's spikes"),
            ),
        ),
        Output(
            "tuning.csv",
            "thresholds beside recorded ones",
            _columns(
                _AFFERENT,
                ("criterion", "", "first impulse, or one a cycle"),
                _FREQUENCY,
                ("amplitude_um", "um", "recorded threshold, zero to peak"),
                ("model_um", "um", "threshold of the model"),
                ("ratio", "", "model over recorded"),
            ),
        ),
        Output(
            "tuning_curves.csv",
            "thresholds against frequency",
            _columns(
                _AFFERENT,
                ("criterion", "", "first impulse, or one a cycle"),
                _FREQUENCY,
                ("amplitude_um", "um", "threshold, median of the cells"),
                ("least_um", "um", "of the most sensitive cell"),
                ("most_um", "um", "of the least sensitive cell"),
            ),
        ),
        Output(
            "impulses_in_man.csv",
            "impulses a cycle beside afferents in man",
            _columns(
                _AFFERENT, _FREQUENCY, _AMPLITUDE,
                ("impulses_per_cycle", "", "recorded impulses in a cycle"),
                ("model", "", "those of the model"),
            ),
        ),
        Output(
            "distance.csv",
            "amplitude of RA for one impulse a cycle away from a probe on the whole fingertip",
            _columns(
                ("distance_mm", "mm", "from the centre of the probe"),
                ("amplitude_um", "µm", "recorded"),
                ("model_um", "µm", "of the parameters fitted_pad; empty: not reached"),
            ),
        ),
        Output(
            "held_out.csv",
            "errors under sinusoids of a frequency that the fit did not see; where the parameters "
            "hold what `fit --held-out` found",
            _columns(
                _AFFERENT,
                ("frequency_hz", "Hz", "empty: all together"),
                ("count", "", "stimuli"),
                ("fitted_rmse_ips", "ips", "error of the model, fitted to all"),
                ("held_out_rmse_ips", "ips", "error of fits that did not see the frequency"),
                ("held_out_bias_ips", "ips", "mean of predicted minus observed of those"),
                ("touchsim_rmse_ips", "ips", "error of TouchSim"),
            ),
        ),
        Output("ramp_and_hold.csv", "spikes under a ramp and a hold", _SPIKES),
        Output("deflection.csv", "the skin around a thin probe",
               _columns(_MESH, _ELEMENTS, _DISTANCE, _DEFLECTION)),
        Output(
            "deflection_convergence.csv",
            "the same from mesh to mesh",
            _columns(
                ("quantity", "", "what is compared: a place in mm, or the force"),
                _MESH, _ELEMENTS,
                ("value", "mm or N/mm", "what this mesh gives"),
                ("last_change_percent", "%", "change from the mesh before"),
                ("limit", "mm or N/mm", "what ever finer meshes would give"),
                ("order", "", "order of convergence"),
            ),
        ),
    ),
    "verify": (
        Output("verification.md", "the page, with figures"),
        Output("verification.json", "every check: found, bound, passed"),
        Output("tables/verification_*.csv", "a table a study; units are in the columns' names"),
    ),
    "deflect": (
        Output("deflection.csv", "a row a mesh and place",
               _columns(_MESH, _DISTANCE, _DEFLECTION)),
        Output("deflection.png", "the same, drawn"),
        Output("run/", "what the solver made (--solver run)"),
    ),
    "plot": (
        Output("PICTURE.png", "the picture; the suffix of -o chooses the format"),
        Output(
            "--table FILE",
            "sensitivity: of one parameter at a time the effects, a row a parameter and answer",
            _columns(
                *_EFFECT,
                ("at_low", "unit of quantity", "answer at the low end"),
                ("at_base", "unit of quantity", "answer of the base"),
                ("at_high", "unit of quantity", "answer at the high end"),
                ("change", "unit of quantity", "at_high less at_low"),
                ("change_percent", "%", "of the answer of the base"),
                ("monotone", "", "yes where the answer goes one way"),
            ),
        ),
        Output(
            "--table FILE of drawn fingers",
            "sensitivity: the regression, a row a parameter and answer",
            _columns(
                *(row for row in _EFFECT if row[0] != "base"),
                ("coefficient", "", "standardised: standard deviations of the answer for one"),
                ("low_95", "", "lower end of its interval of 95 %"),
                ("high_95", "", "upper end"),
                ("r_squared", "", "of the regression of this answer on all parameters"),
                ("adjusted_r_squared", "", "the same, for the number of parameters"),
            ),
        ),
        Output(
            "--fingers FILE.csv",
            "sensitivity: a row a finger",
            _columns(
                ("<parameter>", "in the name", "what differs between fingers"),
                ("<class>:<quantity>:<set>", "in the name", "mean answer: SA:rate_ips:sine_20"),
            ),
        ),
    ),
}  # fmt: skip
"""By verb; one that is not here writes no file."""


def help_text(verb: str) -> str:
    """The outputs of `verb` for its ``--help``; "" where it writes nothing."""
    lines = ["outputs:"] if verb in OUTPUTS else []
    for output in OUTPUTS.get(verb, ()):
        lines.append(f"  {output.file}: {output.what}")
        for name, unit, meaning in output.columns:
            words = f"{name}{f' ({unit})' if unit else ''}: {meaning}".replace("`", "")
            lines += textwrap.wrap(words, 88, initial_indent=" " * 4, subsequent_indent=" " * 6)
    return "\n".join(lines)


def page_text() -> str:
    """docs/outputs.md."""
    lines = [
        "# Outputs",
        "",
        "What each verb writes, into the folder or file that `-o` names. Tables are CSV in UTF-8,",
        "numbers with as many digits as bring them back exactly. `--json` prints a summary with",
        '`exit_code`; of an error `{"error": {"kind", "message"}, "exit_code"}`. A name in angle',
        "brackets stands for columns that differ from case to case. `fembridge VERB --help` shows",
        "the same; this page is `python -m fembridge.commands.written`.",
    ]
    for verb, outputs in OUTPUTS.items():
        lines += ["", f"## {verb}"]
        for output in outputs:
            lines += ["", f"**`{output.file}`**: {output.what}"]
            if output.columns:
                lines += ["", "| column | unit | meaning |", "|---|---|---|"]
                lines += [f"| `{name}` | {unit} | {what} |" for name, unit, what in output.columns]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(page_text(), end="")
