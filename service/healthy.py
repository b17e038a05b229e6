"""`python3 -IS service/healthy.py`: health check of the service's container; the result is the exit code.

The check runs often, so it imports very few modules: 15 ms instead of the 100 ms that urllib takes.
"""

import socket
import sys

TIMEOUT_S = 2.0


def main(port: int = 8000) -> int:
    """Returns exit code 0 if the service at this port is ready, or a standby for another service; else 1."""
    try:
        with socket.create_connection(("127.0.0.1", port), TIMEOUT_S) as service:
            # HTTP/1.1, since the service takes HTTP/1.0 for a sign of a proxy (service/http/client_address.py).
            service.sendall(b"GET /readyz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
            return int(b" 200 " not in service.recv(64))
    except OSError as error:
        print(error)
        return 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
