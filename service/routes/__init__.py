"""The REST API: one router per resource, which translates requests into calls of the service's functions."""
