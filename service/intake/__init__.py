"""How requests and uploads come in: checked, stored whole, and resolved to what a job needs."""
