"""Colours and line widths of every figure, so that a class looks the same in all.

The class colours are those of Okabe and Ito (2008), which people with any common
colour blindness tell apart; green, blue and orange for SA, RA and PC is the custom
of the field.
"""

AFFERENT_COLOURS = {"SA": "#009E73", "RA": "#0072B2", "PC": "#D55E00"}

INK = "#1A1A1A"
FAINT = "#B8B8B8"
SHADE = "#F1F1F1"

# In points, for a figure that is printed at its own size.
TEXT_PT = 8.0
SMALL_TEXT_PT = 7.0
TINY_TEXT_PT = 5.5
HAIR_PT = 0.5
LINE_PT = 0.9

# Two columns of a journal, in inches.
PAGE_WIDTH_IN = 7.2
DPI = 200
