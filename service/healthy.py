"""`python3 -IS service/healthy.py`: whether the service of this container is ready, by its exit code.

A container's health check asks all the time, so nothing is imported that it does not take: 15 ms in place of urllib's 100.
"""

import socket
import sys

PATIENCE_S = 2.0


def main(port: int = 8000) -> int:
    """0 where it says that it is ready, or that it stands by."""
    try:
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as service:
            # Not HTTP/1.0, which the service takes for a trace of a proxy (service/http/client_address.py).
            service.sendall(b"GET /readyz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
            return int(b" 200 " not in service.recv(64))
    except OSError as error:
        print(error)
        return 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
