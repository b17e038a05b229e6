"""The HTTP layer of the service: authorization, error responses, headers, uploads and compression."""
