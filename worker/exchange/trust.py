"""Selects the TLS certificate that a worker or a command accepts from the farm: one that the machine trusts, or a given one."""

from __future__ import annotations

import os
import ssl
from pathlib import Path

from renderer.sentences import Sentence

__all__ = ["TRUST_VARIABLE", "verify_option", "verify_option_for"]

TRUST_VARIABLE = "RAYFARM_TLS_CERT"
CERTIFICATE_END = "-----END CERTIFICATE-----"


def verify_option(certificate: str | None = None) -> ssl.SSLContext | bool:
    """Returns the value for httpx's `verify`.

    certificate: path of the farm's own certificate (PEM). None: the path in $RAYFARM_TLS_CERT. If the path is empty,
    certificates are verified with the machine's trust store. If there is a path, only the first certificate in the file is
    accepted, for any host name, since a farm may use a self-signed one. Raises OSError if the file cannot be read, and
    ValueError if it contains no certificate.
    """
    path = os.environ.get(TRUST_VARIABLE, "") if certificate is None else certificate
    if not path:
        return True
    text = Path(path).expanduser().read_text()
    if CERTIFICATE_END not in text:
        raise ValueError(
            Sentence(
                "certificate-missing",
                "{path} contains no certificate; {variable} must name the certificate of the farm, as PEM",
                path=path,
                variable=TRUST_VARIABLE,
            )
        )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN  # accept a certificate that is not a CA
    try:
        context.load_verify_locations(cadata=text[: text.index(CERTIFICATE_END) + len(CERTIFICATE_END)] + "\n")
    except ssl.SSLError as error:
        raise ValueError(
            Sentence(
                "certificate-unreadable",
                "the certificate in {path} cannot be read ({reason}); export it again as PEM",
                path=path,
                reason=error.reason,
            )
        ) from None
    return context


def verify_option_for(trusted: ssl.SSLContext | bool, url: str) -> ssl.SSLContext | bool:
    """Returns the value of httpx's `verify` for a client that uses only the address `url`: `trusted`, or False for plain HTTP.

    False saves loading the machine's trust store, which takes a tenth of a second.
    """
    return False if url.startswith("http://") else trusted
