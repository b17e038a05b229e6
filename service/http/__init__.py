"""The HTTP side of the service: who is let in, problems, headers, uploads and compression."""
