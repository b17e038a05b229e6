"""The REST and WebSocket surface, one router per resource; routes.py puts them together."""
