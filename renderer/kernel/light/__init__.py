"""Where light comes from: emitting surfaces, points and suns, the environment, and the choice among many of them."""
