"""Light sampling: emitting surfaces, punctual lights, the environment, and the choice among many lights."""
