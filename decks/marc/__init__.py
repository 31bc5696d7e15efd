"""Marc: the dialect of Marc Mentat 2021.4. Written from real decks, never run in Marc.

``lines`` are its fixed columns, ``element_types`` its numbers of elements, ``layout``
who has which number; ``mesh``, ``properties``, ``contact``, ``motion`` and ``post``
are the options of a deck, ``deck`` puts them in their order.
"""
