"""Connection to the Dask cluster given by ``--scheduler ADDRESS``."""

from typing import TYPE_CHECKING

from semantic_slam.errors import InputError, one_line

if TYPE_CHECKING:
    from distributed import Client

CONNECT_TIMEOUT = "10s"
"""Time a scheduler has to answer; one just started on a busy machine needs seconds."""


def connected(address: str) -> "Client":
    """Client of the Dask scheduler at ``address``. Raises InputError where it cannot be reached."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs Dask; install it with: pip install dask distributed") from None
    try:
        return Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as fault:
        reason = one_line(fault)
        raise InputError(
            f"--scheduler {address}: no Dask scheduler ({reason}); start one with: dask scheduler"
        ) from None
