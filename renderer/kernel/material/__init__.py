"""What a surface is made of: its row of numbers, its textures looked up, and which model scatters."""
