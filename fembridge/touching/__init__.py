"""Any touch on a whole fingertip: CalculiX' unit forces, superposed.

`pad` is the interface of the responses of skin to unit forces. `prism_pad` has those of a section
that is swept along the finger, which CalculiX computes in `green`; `mesh_pad` those of any mesh,
computed in `mesh_green`. `shape` is what touches, `contact` finds the forces between the two,
`stress` superposes the stress where afferents sit. `population` says where those are and `touch`
is all of it, from a shape and its way to spikes.
"""
