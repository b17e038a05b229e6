"""What is rendered next, by whom, and what comes back: the engine's thread and its parts."""
