"""The HTTP layer of the service: authorization, problems, headers, uploads and compression."""
