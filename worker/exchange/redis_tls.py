"""Redis over TLS: rediss:// addresses, and which authority to trust if the machine does not already trust Redis's certificate.

The authority's file has a different place on every machine, so it is not part of the address that a farm tells its workers:
each of them, and the service, has it in RAYFARM_REDIS_CA.
"""

from __future__ import annotations

import os
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

__all__ = ["CA_VARIABLE", "as_told", "trusting", "with_password"]

CA_VARIABLE = "RAYFARM_REDIS_CA"
OWN = ("ssl_ca_certs", "ssl_ca_path", "ssl_certfile", "ssl_keyfile")  # of an address: files of one machine


def trusting(url: str) -> str:
    """An address with the authority that this machine was told of; as it is where it is not over TLS, or names one itself."""
    ca, parts = os.environ.get(CA_VARIABLE, ""), urlsplit(url)
    query = dict(parse_qsl(parts.query))
    if parts.scheme != "rediss":
        return url
    query.setdefault("ssl_cert_reqs", "required")
    if ca:
        query.setdefault("ssl_ca_certs", os.path.expanduser(ca))  # noqa: PTH111 - it stays text
    return parts._replace(query=urlencode(query, safe="/")).geturl()


def as_told(url: str) -> str:
    """The address without what is of this machine alone, for others."""
    parts = urlsplit(url)
    query = [(name, value) for name, value in parse_qsl(parts.query) if name not in OWN]
    return parts._replace(query=urlencode(query, safe="/")).geturl() if parts.scheme == "rediss" else url


def with_password(url: str, password: str) -> str:
    """The address with the password; as it is where it names a password already, or no host."""
    parts = urlsplit(url)
    user, _, host = parts.netloc.rpartition("@")
    if not password or not parts.hostname or ":" in user:
        return url
    return parts._replace(netloc=f"{user}:{quote(password, safe='')}@{host}").geturl()
