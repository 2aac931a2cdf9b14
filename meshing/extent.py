"""Bodies whose extent hints at another unit than the metre."""

from __future__ import annotations

from meshing.warnings import UnitWarning, warn

# m; parts that are analysed here are seldom larger or smaller, but those whose mm are taken for m are
LARGEST, SMALLEST = 20.0, 1e-3
IN_METRES = "lengths are in m, so divide those in millimetres by 1000"


def check_extent(
    origin: str, width: float, height: float, *, if_large: str | None = IN_METRES, if_small: str = IN_METRES
) -> None:
    """Warn of a body above 20 m or below 1 mm.

    Parameters
    ----------
    origin : str
        What or which file it is, for the message.
    width, height : float
        m.
    if_large, if_small : str
        How it is mended; None where a large body is known to be meant.

    Warns
    -----
    UnitWarning
    """
    mend = if_large if max(width, height) > LARGEST else if_small if max(width, height) < SMALLEST else None
    if mend is not None:
        warn(origin, f"it is {width:g} m wide and {height:g} m high; {mend}.", UnitWarning)
