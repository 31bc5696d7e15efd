"""Any touch on a whole fingertip: CalculiX' unit forces, superposed.

`pad` holds the responses of the skin to unit forces and `green` has CalculiX make them;
`shape` is what touches, `contact` finds the forces between the two, `stress` superposes
the stress where afferents sit. `population` says where those are and `touch` is all
of it, from a shape and its way to spikes.
"""
