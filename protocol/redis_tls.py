"""Redis over TLS: rediss:// addresses, and the certificate authority to trust.

An authority is needed if the machine does not trust Redis's certificate. Its file has a different path on every machine, so the
path is not part of the address that a farm sends to its workers. The service and each worker read it from RAYFARM_REDIS_CA.
"""

from __future__ import annotations

import os
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

__all__ = ["CA_VARIABLE", "with_certificate_authority", "with_password", "without_local_options"]

CA_VARIABLE = "RAYFARM_REDIS_CA"
LOCAL_FILE_OPTIONS = (
    "ssl_ca_certs",
    "ssl_ca_path",
    "ssl_certfile",
    "ssl_keyfile",
)  # query parameters that name files of one machine


def with_certificate_authority(url: str) -> str:
    """Returns the Redis address with the option for this machine's certificate authority file added.

    Returns it unchanged if it does not use TLS or already names such a file.
    """
    ca, parts = os.environ.get(CA_VARIABLE, ""), urlsplit(url)
    query = dict(parse_qsl(parts.query))
    if parts.scheme != "rediss":
        return url
    query.setdefault("ssl_cert_reqs", "required")
    if ca:
        query.setdefault("ssl_ca_certs", os.path.expanduser(ca))  # noqa: PTH111 - it stays text
    return parts._replace(query=urlencode(query, safe="/")).geturl()


def without_local_options(url: str) -> str:
    """Returns the address without options that refer to local files, for use on other machines."""
    parts = urlsplit(url)
    query = [(name, value) for name, value in parse_qsl(parts.query) if name not in LOCAL_FILE_OPTIONS]
    return parts._replace(query=urlencode(query, safe="/")).geturl() if parts.scheme == "rediss" else url


def with_password(url: str, password: str) -> str:
    """Returns the address with this password; unchanged if it already has one, or has no host."""
    parts = urlsplit(url)
    user, _, host = parts.netloc.rpartition("@")
    if not password or not parts.hostname or ":" in user:
        return url
    return parts._replace(netloc=f"{user}:{quote(password, safe='')}@{host}").geturl()
