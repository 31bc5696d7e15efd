"""Appendices A, B and C of Ishizuka et al.: the 82 stimuli as they are printed.

Frequencies in Hz, amplitudes zero-to-peak in um, noise levels in um RMS.

Two of the sinusoids do not fit the geometric series that their neighbours make
and are taken for misprints. The printed numbers are kept, in the ids and in the
waveforms, so that tables made elsewhere still find their stimulus.
"""

SINE_AMPLITUDES_UM: dict[float, tuple[float, ...]] = {
    20: (6.71, 9.32, 12.5, 18, 25, 34.74, 48.27, 67.07, 93.19, 129.49, 179.92, 250),
    50: (7.19, 10.66, 15.81, 23.46, 34.8, 51.62, 76.58, 113.6, 168.52, 250),
    100: (6.52, 10, 15.34, 23.54, 36.11, 55.39, 85.98, 130.37, 200),
    300: (4.59, 7.41, 11.94, 19.24, 31.02, 50),
}
"""Appendix A: amplitudes at each frequency."""

DIHARMONIC_AMPLITUDES_UM: dict[tuple[float, float], tuple[tuple[float, float], ...]] = {
    (10, 50): ((2, 2), (5.62, 5.62), (15.81, 15.81), (44.46, 44.46), (125, 125)),
    (10, 100): ((2, 2), (5.62, 5.32), (15.81, 14.14), (44.46, 37.61), (125, 100)),
    (50, 250): ((2, 1), (5.62, 2.48), (15.81, 6.12), (44.46, 15.15), (125, 37.5)),
    (50, 500): ((2, 0.25), (5.62, 0.74), (15.81, 2.17), (44.46, 6.37), (125, 18.75)),
}
"""Appendix B: amplitudes of both components at each pair of frequencies."""

NOISE_RMS_UM: dict[tuple[float, float], tuple[float, ...]] = {
    (5, 25): (0.5, 1, 5, 10, 50),
    (5, 100): (0.5, 1, 5, 10, 50),
    (25, 250): (0.25, 1, 5, 10, 20),
    (25, 500): (0.25, 1, 5, 10, 20),
    (50, 500): (0.13, 0.5, 1, 5, 10),
}
"""Appendix C: root-mean-square levels in each band, low and high cutoff."""

MISPRINTS_UM = {"sine_20_12.5": 12.95, "sine_100_85.98": 84.98}
"""Ids whose printed amplitude is doubtful, with the one that fits the series."""

MISPRINT_NOTE = "two amplitudes are kept as printed though their series says " + (
    " and ".join(f"{series} ({id_})" for id_, series in MISPRINTS_UM.items())
)
"""The sentence that tells a user about :data:`MISPRINTS_UM`."""
