"""Whose keyword deck it is: CalculiX's, or one that only Abaqus reads.

ccx reads much of what Abaqus does and drops the rest with a warning, so a deck is
taken for ccx unless something in it has no sense there.
"""

from decks.own_model.inp_text import Card, InpText, read_inp_text

# Cards that Abaqus alone has, and that Abaqus/CAE or its users write often.
_CARDS = frozenset(
    (
        "ASSEMBLY",
        "ENDASSEMBLY",
        "ENDINSTANCE",
        "ENDPART",
        "INSTANCE",
        "MONITOR",
        "PARAMETER",
        "PART",
        "PREPRINT",
        "RIGIDSURFACE",
        "SYSTEM",
    )
)
_PLANE_OR_SOLID = ("C3D", "CAX", "CPE", "CPS", "CPEG", "CGAX")


def dialect_of(data: bytes) -> str:
    """Tell whose deck `data` is: ``"abaqus"`` or ``"calculix"``."""
    return "calculix" if sign_of_abaqus(data) is None else "abaqus"


def sign_of_abaqus(data: bytes) -> Card | None:
    """Give the first card that only Abaqus reads; None in a deck for ccx."""
    text = read_inp_text(data)
    return next((card for card in text.cards if _abaqus_alone(text, card)), None)


def _abaqus_alone(text: InpText, card: Card) -> bool:
    if card.keyword in _CARDS:
        return True
    if b"\n" in text.data[card.start : card.head]:  # ccx continues no keyword line
        return True
    if card.keyword == "OUTPUT":  # ccx knows *OUTPUT, FREQUENCY= alone
        return card.option("FIELD") is not None or card.option("HISTORY") is not None
    if card.keyword == "ELEMENT":  # hybrid elements: CPE4H, C3D8RH
        kind = card.option("TYPE")
        word = "" if kind is None else kind.word
        return word.startswith(_PLANE_OR_SOLID) and word.endswith("H")
    return False
