"""How requests and uploads come in: checked, stored completely, and resolved to what a job needs."""
