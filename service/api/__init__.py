"""The REST and WebSocket surface, one router a resource; routes.py puts them together."""
