"""Random post files for `post_writer`, whose module every strategy takes."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

SET_TYPES = (0, 1, 7, 12, 13, 18, 19)
REALS = st.floats(-1e30, 1e30).filter(lambda x: x == 0 or abs(x) > 1e-30)
NAMES = st.text("abcdefgh XYZ_0189", min_size=1, max_size=24).map(str.strip).filter(bool)


def storages(writer):
    """Draw a way to store numbers."""
    return st.one_of(
        st.builds(
            writer.Storage,
            big_endian=st.booleans(),
            real_bytes=st.sampled_from((4, 8)),
            word_bytes=st.sampled_from((4, 4, 8)),
            piece_bytes=st.sampled_from((0, 0, 0, 7, 50)),
        ),
        st.builds(writer.Storage, binary=st.just(False), line_end=st.sampled_from(("\n", "\r\n"))),
    )


@st.composite
def models(draw, writer, revision=None, codes=None):
    """Draw a small model: mixed elements, pressure nodes, sets of all types."""
    ids = draw(st.lists(st.integers(1, 99_999), min_size=1, max_size=9, unique=True))
    dimensions = draw(st.sampled_from((2, 3)))
    place = st.tuples(*[REALS] * dimensions)
    node = st.sampled_from(ids)
    extras = st.lists(st.integers(0, 40), min_size=5, max_size=5).map(tuple)
    element = st.tuples(
        st.integers(1, 99_999),
        st.sampled_from((11, 80, 27, 6)),
        st.lists(node, min_size=1, max_size=9).map(tuple),
        extras,
    )
    members = st.lists(st.integers(1, 99_999), max_size=15)
    sets = [
        (name, kind, tuple(some), tuple(range(len(some))))
        for name, kind, some in draw(
            st.lists(st.tuples(NAMES, st.sampled_from(SET_TYPES), members), max_size=3)
        )
    ]
    label = st.text("abcdefgh ", max_size=24).map(str.strip)
    code = st.tuples(st.integers(1, 900), st.just(0), label)
    return writer.Model(
        node_ids=tuple(ids),
        coordinates=tuple(draw(place) for _ in ids),
        elements=tuple(draw(st.lists(element, max_size=5))),
        points=draw(st.sampled_from((1, 3, 4, 9))),
        codes=tuple(draw(st.lists(code, max_size=8))) if codes is None else codes,
        sets=tuple(sets),
        dimensions=dimensions,
        revision=draw(st.sampled_from((12, 13, 14))) if revision is None else revision,
        strange_block=draw(st.booleans()),
    )


@st.composite
def runs(draw, writer):
    """Draw a model and increments, among them such that change the mesh."""
    model = draw(models(writer))
    at, increments = model, []
    seed = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    for place in range(draw(st.integers(0, 6))):
        new = None
        if draw(st.integers(0, 9)) == 0:
            new = draw(models(writer, revision=model.revision))
        at = new or at
        increments.append(
            replace(draw(increments_of(writer, at, seed)), number=place, new_model=new)
        )
    return model, tuple(increments)


@st.composite
def increments_of(draw, writer, model, seed):
    """Draw one increment on `model`, with numbers from `seed`."""
    shape = len(model.elements), model.points, len(model.codes)
    element = None
    if draw(st.booleans()) and model.codes and model.elements:
        element = seed.normal(size=shape) * 10.0 ** seed.integers(-20, 20, size=shape)
    nodal = []
    for name, code in (("Displacement", 1), ("External Force", 3), ("Contact", 34)):
        components = draw(st.integers(1, 3))
        values = None
        if draw(st.booleans()):
            values = seed.normal(size=(len(model.node_ids), components))
        nodal.append(writer.Quantity(name, code, components, values, draw(st.booleans())))
    variables = [("Completion", [*seed.normal(size=2)]), ("fix", [0.5])]
    return writer.Increment(
        sub=draw(st.integers(0, 2)),
        time_s=draw(st.floats(0, 100)),
        title=draw(st.sampled_from(("lcase1", "lcase2"))),
        element=element,
        nodal=tuple(nodal[: draw(st.integers(0, 3))]),
        variables=tuple(variables[: draw(st.integers(0, 2))]),
        recycles=draw(st.integers(0, 9)),
        cut_backs=draw(st.integers(0, 9)),
        loads=tuple(seed.normal(size=draw(st.integers(0, 3)))),
        energies=tuple(seed.normal(size=22)),
    )
