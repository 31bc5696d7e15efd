"""What a user asks of the pad of a mesh: the map of the skin, and where stress is computed."""

from collections.abc import Mapping
from dataclasses import dataclass

from fembridge.errors import UsageError
from fembridge.ranges import check_range


@dataclass(frozen=True, slots=True)
class SkinMap:
    """How the map of the skin lies on a model, in coordinates of the model; for `make_pad`.

    Parameters
    ----------
    apex
        Node at the middle of the map. Default: None, that of the node set APEX if the deck has
        one, else the skin nearest to its mean position.
    outward
        Direction out of the skin at the middle. Default: None, the normal of the skin at the
        apex, without one its mean normal.
    along
        Direction along the finger, towards its tip. Default: None, the longest direction of the
        skin.
    reach_mm
        Distance from the middle in mm up to which skin may be touched. Default: None, no limit.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.SkinMap(apex=4711, along=(0, 0, 1))
    SkinMap(apex=4711, outward=None, along=(0, 0, 1), reach_mm=None)
    """

    apex: int | None = None
    outward: tuple[float, float, float] | None = None
    along: tuple[float, float, float] | None = None
    reach_mm: float | None = None


@dataclass(frozen=True, slots=True)
class SiteRequest:
    """Where stress is computed for a class: the nodes of a set, or a depth in a layer.

    Parameters
    ----------
    set_name
        Node set, or with `depth_mm` the element set of a layer; "" for the elements at that depth.
    depth_mm
        Depth below the skin in mm. Default: None, at the nodes of the set.
    """

    set_name: str
    depth_mm: float | None = None


def site_requests(afferents: str | Mapping[str, str] | None) -> dict[str, SiteRequest]:
    """Requests by class, of a text for all classes, or of texts by class.

    Parameters
    ----------
    afferents
        ``"SET:0.6"``, ``"0.6"`` or ``"NODES"``, for all classes or by class; None: the depths of
        the reference finger.

    Raises
    ------
    UsageError
        An unknown class, or a text of another form.
    """
    from decks.finger import SITES

    if afferents is None:
        return {name: SiteRequest("", site.depth_mm) for name, site in SITES.items()}
    if isinstance(afferents, str):
        afferents = dict.fromkeys(SITES, afferents)
    requests = {}
    for name, text in afferents.items():
        if name not in SITES:
            raise UsageError(
                argument="afferents", found=name, expected=f"one of {', '.join(SITES)}"
            )
        set_name, colon, depth = text.rpartition(":")
        try:
            depth_mm = float(depth)
        except ValueError:
            if colon:
                expected = "SET:DEPTH_MM, a depth in mm, or a node set"
                raise UsageError(argument="afferents", found=text, expected=expected) from None
            requests[name] = SiteRequest(text)
            continue
        check_range("depth_mm", depth_mm)
        requests[name] = SiteRequest(set_name, depth_mm)
    return requests
