"""Which certificate a worker or a command accepts as the farm's over HTTPS: one that the machine trusts, or the one it was
given."""

from __future__ import annotations

import os
import ssl
from pathlib import Path

__all__ = ["TRUST_VARIABLE", "as_needed", "trust"]

TRUST_VARIABLE = "RAYFARM_TLS_CERT"
END = "-----END CERTIFICATE-----"


def trust(certificate: str | None = None) -> ssl.SSLContext | bool:
    """For httpx's `verify`. certificate: the farm's own, as PEM; $RAYFARM_TLS_CERT unless told; empty: what the machine trusts.

    The first certificate of the file is then the only one that is believed, by whatever name the farm is reached: a farm may sign
    its own. Raises OSError where the file cannot be read, and ValueError where it is none.
    """
    path = os.environ.get(TRUST_VARIABLE, "") if certificate is None else certificate
    if not path:
        return True
    text = Path(path).expanduser().read_text()
    if END not in text:
        raise ValueError(f"{path} has no certificate; {TRUST_VARIABLE} names the farm's, as PEM")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN  # it need not be an authority's
    try:
        context.load_verify_locations(cadata=text[: text.index(END) + len(END)] + "\n")
    except ssl.SSLError as error:
        raise ValueError(f"{path} has no certificate that can be read ({error.reason})") from None
    return context


def as_needed(trusted: ssl.SSLContext | bool, url: str) -> ssl.SSLContext | bool:
    """The same, for a client of this address alone: over plain HTTP nothing is verified, and to read what the machine trusts
    takes a tenth of a second."""
    return False if url.startswith("http://") else trusted
