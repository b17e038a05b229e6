"""The REST API: one router per resource. Routes translate requests into calls of the service's functions."""
