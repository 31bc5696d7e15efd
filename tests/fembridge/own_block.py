"""A small deck of a user: two plane elements of skin on a plate, pushed from above."""

BLOCK = """\
*HEADING
two elements of skin on a plate
*NODE, NSET=ALL
1, 0., 0.
2, 1., 0.
3, 0., 1.
4, 1., 1.
5, 0., 2.
6, 1., 2.
*ELEMENT, TYPE=CPE4, ELSET=LOWER
1, 1, 2, 4, 3
*ELEMENT, TYPE=CPE4, ELSET=UPPER
2, 3, 4, 6, 5
*ELSET, ELSET=SKIN
LOWER, UPPER
*NSET, NSET=TOP
5, 6
*NSET, NSET=SIDE
4
*MATERIAL, NAME=SOFT
*ELASTIC
0.05, 0.3
*DENSITY
1.E-9
*EXPANSION
1.E-3
*MATERIAL, NAME=HARD
*ELASTIC
0.5, 0.3
*SOLID SECTION, ELSET=SKIN, MATERIAL=SOFT
1.
{model}
*BOUNDARY
1, 1, 2
2, 1, 2
{before}
*STEP, NLGEOM
*STATIC
0.05, 1.
*BOUNDARY
TOP, 2, 2, -0.01
{loads}
*END STEP
"""
GRAVITY = "*DLOAD\nSKIN, GRAV, 9.81E6, 0., -1., 0."
